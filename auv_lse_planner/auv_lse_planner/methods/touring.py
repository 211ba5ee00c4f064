"""The method `tour`: one tour over all that is left of the mission, optimized again and again, under an account.

A decision values everything by the same reward (`reward/anytime.py`), with the team mates' places in time order:

- The incumbent is the last plan, continued. It stays unless another is worth more.
- Every `planner.tour_interval` legs, and where the incumbent is void, the last path is bent to where it brings more
  (`search/tour.py`), by explicit actions: a tour's equal segments do not hold its narrow turns. It is bent for what
  comes early as far as the account allows and a few tries find. Beside that a tree search proposes heads: next legs,
  which rejoin the tour's waypoints. The rest of a path that is too long to be told by its actions stays a tour, and is
  optimized.
- At the mission's start waypoints are optimized from several boustrophedons for the mission's end alone, which is what
  the account is about, and the best path of all is bent. The naive paths are candidates.

The own path is valued at two places of each leg at least. By one, at the leg's end, the risk that a turning path leaves
is overestimated twice as much as that of straight lanes (docs/design/planner.md), and these are chosen wrongly.

The account keeps the bound. E is the drop of the map's risk that is expected for the mission's end (`Value.end`): at
the start A = E(chosen) - E(best naive path) >= 0, and each later choice needs E(new) >= E(incumbent) - A and changes A
by E(new) - E(incumbent). E telescopes, so that the mission's expected end is never below that of mowing from the start.
An incumbent that the map or a current makes void is given up without a charge; the record says so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.vocabulary.naive_ids import COVERING, FITTED, LAWNMOWERS, STRIPS
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.rollout import PlannedPath, Rollout
from auv_lse_planner.paths.steering import Steering
from auv_lse_planner.reward.anytime import AnytimeReward, Value
from auv_lse_planner.search.tour import Found, TourSearch, arc_m
from auv_lse_planner.search.uct import Actions

Array = NDArray[np.float64]

#: Iterations that bend the last path, and the best path at the mission's start.
ITERATIONS = 14
FIRST_BEND_ITERATIONS = 20
#: Boustrophedons that are optimized at the start for the mission's end, iterations of each, and of the best of them
#: after that.
STARTS = 2
START_ITERATIONS = 20
FIRST_ITERATIONS = 100
#: Shares of the anytime weight that paths are bent by, one after the other until the expected end allows it: at the
#: start all of them; then two, from the one before that which was allowed last, for what may be spent changes little
#: from one time to the next, or behind those that were not.
EARLINESS = (1.0, 0.5, 0.25, 0.0)
TRIES = 2
#: A tour is rejoined at a waypoint at least so far (m) away.
REJOIN_M = 20.0
#: Legs that lead around ground that the map shows to be too shallow, as explicit actions.
DETOUR_LEGS = 8
#: Places of a leg that the own path is valued by, at least: with fewer, corners are worth more than they are.
OWN_PLACES = 2
#: Explicit actions of a plan at most: told two to a byte they leave a packet room for ten samples.
MOST_EXPLICIT = 200
#: Places of a leg by which a path is a fine polyline.
LINE_PLACES = 4
#: A path's risk is guessed by one in so many of its places.
SPARSE = 4


@dataclass(frozen=True, slots=True)
class Candidate:
    """A plan with its path from the present step on, and what it is worth.

    Attributes:
        plan: The plan.
        path: Its path.
        value: Its value.
        kind: Where it comes from: "incumbent", "tour", "bent", "head" or "naive".
        waypoints_m: What its tour was made from.
    """

    plan: Plan
    path: PlannedPath
    value: Value
    kind: str
    waypoints_m: Array | None = None


@dataclass(frozen=True, slots=True)
class TourChoice:
    """The plan that is followed, and the account.

    Attributes:
        chosen: The plan.
        incumbent: The last plan, continued; None where there was none or it is void.
        new: The other candidates.
        iterations: Gradients computed.
        evaluations: Plans valued.
        deadline_hit: Whether the deadline ended the search.
    """

    chosen: Candidate
    incumbent: Candidate | None
    new: list[Candidate]
    iterations: int
    evaluations: int
    deadline_hit: bool


class Touring:
    """Chooses the tour of one vehicle, decision by decision.

    Attributes:
        balance: The account A: how much of the expected end may still be spent; 0 for a plan of another method.
    """

    def __init__(self, vehicle: int, vehicles: int, space: FreeSpace, rollout: Rollout) -> None:
        """Starts before the first decision.

        Args:
            vehicle: Number of the vehicle, from 1.
            vehicles: Vehicles of the mission.
            space: Where to go.
            rollout: Follows plans to the mission's end.
        """
        self.balance = 0.0
        self._vehicle, self._vehicles = vehicle, vehicles
        self._space, self._rollout = space, rollout
        self._steering = Steering(space)
        self._search = TourSearch(space, rollout.samples_per_leg)
        self._finer = TourSearch(space, max(OWN_PLACES, rollout.samples_per_leg))
        self._optimized_at = -1
        self._earliness = 0  # which of `EARLINESS` is tried first
        self._waypoints: Array | None = None  # of the tour that is followed, if it was optimized ...
        self._waypoints_step = 0  # ... at this step

    def snapshot(self) -> dict[str, Any]:
        """The account and the tour's waypoints, for a journal."""
        waypoints = None if self._waypoints is None else np.asarray(self._waypoints).tolist()
        return {
            "balance": self.balance,
            "optimized_at": self._optimized_at,
            "earliness": self._earliness,
            "waypoints": waypoints,
            "waypoints_step": self._waypoints_step,
        }

    def restore(self, values: Mapping[str, Any]) -> None:
        """Goes on from what `snapshot` gave."""
        self.balance, self._optimized_at = values["balance"], values["optimized_at"]
        self._earliness = values.get("earliness", 0)  # journals of before have none
        self._waypoints = None if values["waypoints"] is None else np.array(values["waypoints"])
        self._waypoints_step = values["waypoints_step"]

    def due(self, planner: PlannerConfig, step: int, void: bool) -> bool:
        """Whether a decision after the first looks for another tour: where the last one is void, and now and then."""
        return void or bool(planner.tour_interval and step - self._optimized_at >= planner.tour_interval)

    def delay(self, legs: int) -> None:
        """The plan goes on so many steps later."""
        self._optimized_at += legs
        self._waypoints_step += legs

    def decide(
        self,
        planner: PlannerConfig,
        step: int,
        state: Array,
        reward: AnytimeReward,
        last: tuple[Plan, PlannedPath] | None,
        void: bool,
        heads: Sequence[Actions],
        own: Callable[[Sequence[PlannedPath]], Sequence[float]],
        deadline: Callable[[], bool] | None,
    ) -> TourChoice:
        """Chooses a plan for what is left of the mission.

        Args:
            planner: Parameters, complete.
            step: Mission step planned from.
            state: State planned from, shape (3,).
            reward: What paths are worth.
            last: The last plan and its path from this step on.
            void: Whether that plan can not be followed from here: it is only a start for the next.
            heads: Actions that a tree search proposes for the next legs: each is tried before the rest of the tour.
            own: What the next legs of paths bring at their own places (`planner.own_share` of it counts).
            deadline: Says when to stop searching; None: never.
        """
        incumbent = None
        if last is not None and not void:
            incumbent = self._worth(*last, reward, "incumbent")
        candidates: list[Candidate] = []
        gradients, hit = 0, False
        floor = -math.inf if incumbent is None else incumbent.value.end - self.balance
        if last is None:
            candidates, floor, gradients, hit = self._first(step, state, reward, deadline)
            self._optimized_at = step
        elif self.due(planner, step, void):
            candidates, gradients, hit = self._again(planner, step, state, reward, last[1], floor, heads, deadline)
            self._optimized_at = step
        every = candidates if incumbent is None else [incumbent, *candidates]
        sound = [c for c in every if c.value.end >= floor]
        chosen = self._best(sound or every, planner.own_share, own)
        if incumbent is not None:
            self.balance = max(0.0, self.balance + (chosen.value.end - incumbent.value.end))
        elif last is None:
            self.balance = chosen.value.end - floor
        if chosen is not incumbent:
            self._waypoints, self._waypoints_step = chosen.waypoints_m, step
        return TourChoice(chosen, incumbent, candidates, gradients, len(every), hit)

    def _first(
        self, step: int, state: Array, reward: AnytimeReward, deadline: Callable[[], bool] | None
    ) -> tuple[list[Candidate], float, int, bool]:
        """Candidates for the mission's start, the naive paths first, and the best expected end of those.

        The own fitted lanes come first, then naive paths in the order of the risk that they pass: with a short deadline
        some of them are all that there is.
        """
        ids = (STRIPS[(self._vehicle - 1) % len(STRIPS)], *COVERING, *LAWNMOWERS)
        plans = [Plan.at(step, state, (), i) for i in ids]
        paths = [(plan, self._rollout.follow(plan)) for plan in plans]
        paths.sort(key=lambda item: -reward.risk_near(item[1].places_m[::SPARSE]))
        own = Plan.at(step, state, (), FITTED[(self._vehicle - 1) % len(FITTED)])
        naive = [self._valued(own, reward, "naive")]
        for plan, path in paths:
            naive.append(self._worth(plan, path, reward, "naive"))
            if deadline is not None and deadline():
                break
        floor = max(c.value.end for c in naive)
        if deadline is not None and deadline():
            return naive, floor, 0, True
        starts = self._finer.starts(state[1:], reward.legs, self._vehicle, self._vehicles)
        starts.insert(0, self._finer.resampled(self._rest(state, naive[0].path), reward.legs))
        found = self._from_starts(starts, reward.weighing(0.0), deadline)
        candidates = [*naive, *(self._candidate(step, state, f.waypoints_m, reward) for f in found)]
        gradients, hit = sum(f.evaluations for f in found), found[-1].deadline_hit
        if reward.legs <= MOST_EXPLICIT and not hit:
            path = max(candidates, key=lambda c: c.value.end).path
            bent, more, hit = self._earlier(
                step, state, path, reward, floor, FIRST_BEND_ITERATIONS, len(EARLINESS), deadline
            )
            candidates += bent
            gradients += more
        return candidates, floor, gradients, hit

    def _earlier(
        self,
        step: int,
        state: Array,
        path: PlannedPath,
        reward: AnytimeReward,
        floor: float,
        iterations: int,
        tries: int,
        deadline: Callable[[], bool] | None,
    ) -> tuple[list[Candidate], int, bool]:
        """A path bent for what comes early: by the first of a few shares that leaves the expected end above its floor.

        The next time begins with the share before that one, or behind the last one tried if none did.

        Args:
            step: Mission step planned from.
            state: State planned from, shape (3,).
            path: The path that is bent.
            reward: What paths are worth.
            floor: Least expected end that is allowed; -inf: any, by the whole share.
            iterations: Of each bend, at most.
            tries: Shares tried, at most.
            deadline: Says when to stop.

        Returns:
            The candidates, gradients computed, and whether the deadline ended the search.
        """
        candidates: list[Candidate] = []
        gradients, hit = 0, False
        limited = floor > -math.inf
        first = self._earliness if limited else 0
        for i in range(first, min(first + tries, len(EARLINESS))):
            bent, more, hit = self._bent(step, state, path, reward, EARLINESS[i], iterations, deadline)
            candidates.append(bent)
            gradients += more
            allowed = bent.value.end >= floor
            if hit or not limited:  # a bend cut short says nothing about its share
                break
            self._earliness = max(i - 1, 0) if allowed else min(i + 1, len(EARLINESS) - 1)
            if allowed:
                break
        return candidates, gradients, hit

    def _from_starts(
        self, starts: Sequence[Array], aim: AnytimeReward, deadline: Callable[[], bool] | None
    ) -> list[Found]:
        """Tours optimized from the best of several starts, and behind them what the best becomes with more.

        Which of them is best shows with fewer places on each leg as well.
        """
        worth = []
        for waypoints in starts:
            worth.append(aim.coarse_value(self._search.places(waypoints, aim.legs)))
            if deadline is not None and deadline():
                break
        found: list[Found] = []
        for i in sorted(range(len(worth)), key=lambda i: -worth[i])[:STARTS]:
            found.append(self._search.improve(starts[i], aim.legs, aim, START_ITERATIONS, deadline))
            if found[-1].deadline_hit:
                return [max(found, key=lambda f: f.value)]
        best = max(found, key=lambda f: f.value)
        return [*found, self._finer.improve(best.waypoints_m, aim.legs, aim, FIRST_ITERATIONS, deadline)]

    def _again(
        self,
        planner: PlannerConfig,
        step: int,
        state: Array,
        reward: AnytimeReward,
        path: PlannedPath,
        floor: float,
        heads: Sequence[Actions],
        deadline: Callable[[], bool] | None,
    ) -> tuple[list[Candidate], int, bool]:
        """Candidates after the start: the last path bent, and behind each of the heads the rest of the last tour.

        A path that is too long to be told by its actions is told as a tour, and its waypoints are moved instead.
        """
        waypoints = self._warm(step, state, path)
        if planner.tour_interval and reward.legs <= MOST_EXPLICIT:
            candidates, gradients, hit = self._earlier(step, state, path, reward, floor, ITERATIONS, TRIES, deadline)
        else:
            gradients, hit = 0, False
            if planner.tour_interval:
                found = self._search.improve(waypoints, reward.legs, reward, ITERATIONS, deadline)
                waypoints, gradients, hit = found.waypoints_m, found.evaluations, found.deadline_hit
            candidates = [self._candidate(step, state, waypoints, reward)]
        for actions in heads:
            if hit or (deadline is not None and deadline()):
                return candidates, gradients, True
            candidates.append(self._headed(step, state, actions, waypoints, reward))
        return candidates, gradients, hit

    def _warm(self, step: int, state: Array, path: PlannedPath) -> Array:
        """Waypoints to optimize from: those of the last optimization that are still ahead, else the last path's."""
        gone, aside = divmod(step - self._waypoints_step, self._search.segment_legs(len(path)))
        if self._waypoints is not None and not aside and len(self._waypoints) > gone + 1:
            return np.concatenate([np.asarray(state, dtype=float)[None, 1:], self._waypoints[gone + 1 :]])
        return self._search.resampled(self._rest(state, path), len(path))

    def _rest(self, state: Array, path: PlannedPath) -> Array:
        """A path as a polyline from a state: the ends of its legs."""
        return np.concatenate([np.asarray(state, dtype=float)[None, 1:], path.states[1:, 1:]])

    def _candidate(self, step: int, state: Array, waypoints_m: Array, reward: AnytimeReward) -> Candidate:
        """The tour through waypoints; around shallow ground by explicit actions, which no receiver could know."""
        legs = reward.legs
        candidate = self._valued(Plan.at(step, state, (), NONE, self._search.tour(waypoints_m, legs)), reward, "tour")
        if self._space.path_feasible(state, candidate.path.actions, DETOUR_LEGS):
            return replace(candidate, waypoints_m=waypoints_m)
        start, every = candidate.plan.state, self._search.segment_legs(legs)
        corners = self._search.resampled(waypoints_m, legs)
        around = self._steering.actions(start, corners, every, min(DETOUR_LEGS, legs), around_shallows=True)
        actions, tour = tuple(int(a) for a in around), None
        if len(actions) < legs:
            end = self._space.motion.roll(start, around)[-1]
            rest = np.concatenate([end[None, 1:], corners[1 + len(around) // every :]])
            tour = self._search.tour(rest, legs - len(actions)) if len(rest) > 1 else None
        return self._valued(Plan.at(step, state, actions, NONE, tour), reward, "tour")

    def _bent(
        self,
        step: int,
        state: Array,
        path: PlannedPath,
        reward: AnytimeReward,
        share: float,
        iterations: int,
        deadline: Callable[[], bool] | None,
    ) -> tuple[Candidate, int, bool]:
        """The last path, displaced to where it brings more: by explicit actions, which keep its narrow turns.

        Returns:
            The candidate, gradients computed, and whether the deadline ended the search.
        """
        legs = reward.legs
        fine = self._rollout.leg_places(path.states[:-1], path.actions, LINE_PLACES)[:legs]
        line = np.concatenate([np.asarray(state, dtype=float)[None, 1:], fine.reshape(-1, 2)])
        spacing = arc_m(line) / legs
        found = self._search.bend(line, legs, reward.weighing(share), iterations, deadline)
        start = Plan.at(step, state, (), NONE).state
        actions = self._steering.along(start, found.waypoints_m, spacing, legs)
        if not self._space.path_feasible(state, actions, DETOUR_LEGS):
            actions = self._steering.along(start, found.waypoints_m, spacing, legs, around_shallows=True)
        bent = self._valued(Plan.at(step, state, tuple(int(a) for a in actions), NONE), reward, "bent")
        return bent, found.evaluations, found.deadline_hit

    def _headed(self, step: int, state: Array, actions: Actions, base_m: Array, reward: AnytimeReward) -> Candidate:
        """Actions, and the rest of a tour's waypoints after them, from the one that is nearest to where they end."""
        head = actions[: reward.legs]
        states = self._space.motion.roll(state, head)
        if len(head) == reward.legs:
            return self._valued(Plan.at(step, state, head, NONE), reward, "head")
        end, every = states[-1, 1:], self._search.segment_legs(reward.legs)
        near = base_m[1 : 2 + 2 * (len(head) // every)]
        skip = 1 + int(np.argmin(np.hypot(*(near - end).T)))
        rest = base_m[skip:] if np.hypot(*(base_m[skip] - end)) > REJOIN_M else base_m[skip + 1 :]
        left = reward.legs - len(head)
        if not len(rest):
            ahead = np.array([math.cos(states[-1, 0]), math.sin(states[-1, 0])])
            rest = (end + left * self._space.motion.leg_length_m * ahead)[None]
        corners = np.concatenate([end[None], rest])
        candidate = self._valued(Plan.at(step, state, head, NONE, self._search.tour(corners, left)), reward, "head")
        polyline = np.concatenate([states[:-every:every, 1:], corners])
        return replace(candidate, waypoints_m=polyline)

    def _best(
        self, candidates: list[Candidate], share: float, own: Callable[[Sequence[PlannedPath]], Sequence[float]]
    ) -> Candidate:
        """The candidate with the largest anytime value plus share of what its next legs bring; the first of equals."""
        score = np.array([c.value.weighted for c in candidates])
        if share and len(candidates) > 1:
            score = score + share * np.array(own([c.path for c in candidates]))
        return candidates[int(np.argmax(score))]

    def _valued(self, plan: Plan, reward: AnytimeReward, kind: str) -> Candidate:
        return self._worth(plan, self._rollout.follow(plan), reward, kind)

    def _worth(self, plan: Plan, path: PlannedPath, reward: AnytimeReward, kind: str) -> Candidate:
        """A plan valued at `OWN_PLACES` of each leg, while team mates' plans and the search have fewer."""
        each = max(OWN_PLACES, self._rollout.samples_per_leg)
        places = self._rollout.leg_places(path.states[:-1], path.actions, each)
        return Candidate(plan, path, reward.value(places), kind)
