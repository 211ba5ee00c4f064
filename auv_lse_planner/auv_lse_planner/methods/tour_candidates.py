"""New plans of the method `tour`.

At the mission's start, waypoints are optimized for the expected end, to which the budget refers, from several
boustrophedons. The naive paths are candidates too. A single vehicle also optimizes and bends many routes over the whole
ground (`single_routes.py`). The best path is then bent: displaced to increase its value. A vehicle of a large team on a
short mission bends its lanes instead. Otherwise each would choose the best tour beside mates assumed to mow, several
would choose the same one, and they would learn of it too late.

Later, the last path is bent again (`search/tour.py`). The result consists of explicit actions, because a tour's equal
segments cannot represent narrow turns. The bend favors early reward as far as the budget allows. In addition, a tree
search proposes heads: next legs that rejoin the tour's waypoints. A path too long to be sent as actions stays a tour,
and its waypoints are optimized instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.goals import is_large_team
from auv_lse_common.mission_file.methods import MAP_LOCATIONS_PER_LEG
from auv_lse_common.vocabulary.naive_ids import COVERING, FITTED, LAWNMOWERS, STRIPS
from auv_lse_common.vocabulary.plan import NONE, Plan, Tour, length_m
from auv_lse_planner.methods.coverage import follows_isobath
from auv_lse_planner.methods.method import Candidate, Followed, PlanningContext, Situation
from auv_lse_planner.methods.single_routes import single_routes_m
from auv_lse_planner.methods.stages import Stages
from auv_lse_planner.paths.rollout import PlannedPath
from auv_lse_planner.paths.steering import DETOUR_LEGS, Steering
from auv_lse_planner.reward.anytime import AnytimeReward
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.tour import Found, TourSearch
from auv_lse_planner.search.uct import Actions

Array = NDArray[np.float64]

#: Floor of the expected end if none is required.
NO_FLOOR = -math.inf
#: Iterations of bending the last path, and of bending the best path at the mission's start.
ITERATIONS = 14
FIRST_BEND_ITERATIONS = 20
#: Number of boustrophedons optimized at the start, iterations of each, and further iterations of the best one.
STARTS = 2
START_ITERATIONS = 20
FIRST_ITERATIONS = 100
#: Share by which a team's tour may be behind the best naive path and still get more iterations.
FAR_BEHIND = 0.003
#: Iterations of optimizing each route of a single vehicle.
ROUTE_ITERATIONS = 10
#: Rounds in which starts are bent for the mission's end; each keeps one start of this many; iterations of each bend.
#: Then the best is bent this often, with as many locations per leg as its value uses.
START_BENDS, KEPT_ONE_OF, START_BEND_ITERATIONS = 3, 3, 40
FINER_BENDS = 2
#: Shares of the anytime weight, tried in this order until a bent path's expected end stays above its floor. The
#: mission's start tries all. Later decisions try `SHARES_TRIED` of them, beginning near the last allowed one, because
#: the budget changes little between decisions.
WEIGHT_SHARES = (1.0, 0.5, 0.25, 0.0)
SHARES_TRIED = 2
#: A head rejoins the tour at a waypoint at least this far (m) away.
REJOIN_M = 20.0
#: Largest number of explicit actions of a plan; two fit in a byte, so that a packet also holds ten samples.
MAX_EXPLICIT_ACTIONS = 200
#: Corners per leg of the polyline that represents a path for bending.
LINE_LOCATIONS = 4
#: The risk along a path is estimated from every n-th of its locations.
SPARSE_LOCATIONS = 4


@dataclass(frozen=True, slots=True)
class TourProblem:
    """The problem for which candidates are made.

    Attributes:
        floor: Lowest allowed expected end.
        path_reward: Gives the paper's reward of paths, conditional on the mates' plans.
        stages: The stages of a long mission; None: all remaining legs are planned in detail.
    """

    situation: Situation
    reward: AnytimeReward
    floor: float
    path_reward: Callable[[], PathReward]
    stages: Stages | None = None

    @property
    def start(self) -> Array:
        """The state as rounded in a packet, shape (3,)."""
        return Plan.at(self.situation.step, self.situation.state, (), NONE).state

    @property
    def position_m(self) -> Array:
        """North and east of the state, shape (1, 2)."""
        return np.asarray(self.situation.state, dtype=float)[None, 1:]

    def plan(self, actions: Actions | NDArray[np.int64], tour: Tour | None = None) -> Plan:
        """A plan from the state."""
        return Plan.at(self.situation.step, self.situation.state, tuple(int(a) for a in actions), NONE, tour)


@dataclass(slots=True)
class Candidates:
    """New plans, and how they were found.

    Attributes:
        floor: Lowest allowed expected end.
        gradients: Number of gradients computed.
    """

    plans: list[Candidate] = field(default_factory=list)
    floor: float = NO_FLOOR
    gradients: int = 0
    deadline_hit: bool = False

    def add(self, plan: Candidate, found: Found) -> None:
        """Adds a plan found by an optimization."""
        self.plans.append(plan)
        self.gradients += found.evaluations
        self.deadline_hit = found.deadline_hit


def best_of(candidates: Sequence[Candidate]) -> Candidate:
    """The first candidate with the largest expected end."""
    return max(candidates, key=lambda c: c.value.expected_end)


class TourCandidates:
    """Makes tours for one vehicle and stores the waypoints of the current one."""

    def __init__(self, context: PlanningContext) -> None:
        self._context = context
        self._space, self._rollout = context.space, context.rollout
        self._steering = Steering(context.space)
        self._search = TourSearch(context.space, context.rollout.samples_per_leg)
        self._finer = TourSearch(context.space, max(MAP_LOCATIONS_PER_LEG, context.rollout.samples_per_leg))
        self._strips_floor = follows_isobath(context.settings)
        self._earliness = 0  # index into `WEIGHT_SHARES` to try first
        self._waypoints: Array | None = None  # of the current tour, if it was optimized ...
        self._waypoints_step = 0  # ... at this step

    def follow(self, chosen: Candidate, step: int) -> None:
        """Stores the candidate chosen at mission step `step` as the current tour."""
        self._waypoints, self._waypoints_step = chosen.waypoints_m, step

    def shift(self, legs: int) -> None:
        """Delays the current tour by this many legs."""
        self._waypoints_step += legs

    def snapshot(self) -> dict[str, Any]:
        """The state, for a journal."""
        waypoints = None if self._waypoints is None else np.asarray(self._waypoints).tolist()
        return {"earliness": self._earliness, "waypoints": waypoints, "waypoints_step": self._waypoints_step}

    def restore(self, values: Mapping[str, Any]) -> None:
        """Continues from a `snapshot`."""
        self._earliness, self._waypoints_step = values["earliness"], values["waypoints_step"]
        self._waypoints = None if values["waypoints"] is None else np.array(values["waypoints"])

    # ------------------------------------------------------------------ at the mission's start

    def at_start(self, problem: TourProblem, last: PlannedPath | None = None) -> Candidates:
        """Candidates for the mission's start, or for a new horizon, and their floor.

        Args:
            last: The last path; None at the start.
        """
        s, reward = problem.situation, problem.reward
        if last is None and is_large_team(self._context.settings.mission):
            return self._along_lanes(problem)
        naive = self._naive(problem)
        result = Candidates(naive, self._floor(problem, naive), 0, s.out_of_time)
        if result.deadline_hit:
            return result
        starts = self._finer.starts(s.state[1:], reward.legs, self._context.vehicle, self._vehicles)
        starts.insert(0, self._finer.resampled(self._polyline(problem, naive[0].path), reward.legs))
        starts += self._continued(problem, last)
        self._optimize(problem, starts, result)
        if reward.legs <= MAX_EXPLICIT_ACTIONS and not result.deadline_hit:
            self._bend_alone(problem, result)
        self._bend_first(problem, result)
        return result

    def _along_lanes(self, problem: TourProblem) -> Candidates:
        """This vehicle's fitted lanes, which its mates assume, and these lanes bent."""
        lanes = self._fitted(problem)
        result = Candidates([lanes], self._floor(problem, [lanes]), 0, problem.situation.out_of_time)
        self._bend_first(problem, result)
        return result

    def _bend_first(self, problem: TourProblem, result: Candidates) -> None:
        """Adds the best path, bent towards early reward."""
        if problem.reward.legs <= MAX_EXPLICIT_ACTIONS and not result.deadline_hit:
            limited, path = replace(problem, floor=result.floor), best_of(result.plans).path
            self._bend_early(limited, path, FIRST_BEND_ITERATIONS, len(WEIGHT_SHARES), result)

    def _continued(self, problem: TourProblem, last: PlannedPath | None) -> list[Array]:
        """The last path, cut at the horizon or followed by lanes."""
        if last is None or not len(last):
            return []
        legs, line_m = problem.reward.legs, self._polyline(problem, last)
        more = legs - len(last)
        if more <= 0:
            return [self._finer.resampled(line_m[: legs + 1], legs)]
        lanes = self._finer.starts(line_m[-1], more, self._context.vehicle, self._vehicles)
        return [self._finer.resampled(np.concatenate([line_m, lane_m[1:]]), legs) for lane_m in lanes]

    def _bend_alone(self, problem: TourProblem, result: Candidates) -> None:
        """Bends the routes of a single vehicle and the optimized tours for the mission's end, several times.

        Each round bends the best third of the previous round's paths; the first, that of the optimized starts.
        """
        s, legs, aim = problem.situation, problem.reward.legs, problem.reward.weighing(0.0)
        lines_m = single_routes_m(self._context, s.state[1:], legs, s.deadline)
        starts = [c.waypoints_m for c in result.plans if c.waypoints_m is not None] if lines_m else []
        bends: list[list[Candidate]] = []  # of each start
        for line_m in [*starts, *lines_m]:
            found = self._search.improve(self._search.resampled(line_m, legs), legs, aim, ROUTE_ITERATIONS, s.deadline)
            bends.append([self._through(problem, found.waypoints_m)])
            if found.deadline_hit:
                result.add(bends[-1][0], found)
                return
        kept = bends
        for _ in range(START_BENDS if bends else 0):
            kept = sorted(kept, key=lambda b: -best_of(b).value.expected_end)[: -(-len(kept) // KEPT_ONE_OF)]
            for bent in kept:
                bent.append(self._bent_for_end(problem, bent[-1].path, self._search, result))
                if result.deadline_hit:
                    result.plans += [best_of(b) for b in bends]
                    return
        if not bends:
            return
        result.plans += [best_of(b) for b in bends]
        path = best_of([best_of(b) for b in kept]).path
        for _ in range(FINER_BENDS):
            result.plans.append(self._bent_for_end(problem, path, self._finer, result))
            path = result.plans[-1].path
            if result.deadline_hit:
                return

    def _bent_for_end(
        self, problem: TourProblem, path: PlannedPath, search: TourSearch, result: Candidates
    ) -> Candidate:
        """A path bent for the mission's end; counts the gradients."""
        candidate, found = self._bent_by(search, problem, path, 0.0, START_BEND_ITERATIONS)
        result.gradients += found.evaluations
        result.deadline_hit = found.deadline_hit
        return candidate

    def _floor(self, problem: TourProblem, naive: Sequence[Candidate]) -> float:
        """Expected end of the best naive path, or of this vehicle's covering strip if it follows the isobath."""
        if not self._strips_floor:
            return max(c.value.expected_end for c in naive)
        strip = self._naive_plan(problem, STRIPS[(self._context.vehicle - 1) % len(STRIPS)])
        known = [c for c in naive if c.plan == strip]
        return (known or [self._candidate(strip, problem.reward)])[0].value.expected_end

    @property
    def _vehicles(self) -> int:
        return self._context.settings.mission.vehicles

    def _naive(self, problem: TourProblem) -> list[Candidate]:
        """The naive paths.

        This vehicle's fitted lanes come first, then naive paths by decreasing risk along them. A short deadline may
        leave only the first ones.
        """
        number, reward = self._context.vehicle - 1, problem.reward
        plans = [self._naive_plan(problem, i) for i in (STRIPS[number % len(STRIPS)], *COVERING, *LAWNMOWERS)]
        paths = [(plan, self._rollout.follow(plan)) for plan in plans]
        paths.sort(key=lambda item: -reward.risk_near(item[1].locations_m[::SPARSE_LOCATIONS]))
        naive = [self._fitted(problem)]
        for plan, path in paths:
            naive.append(self.evaluated(plan, path, reward))
            if problem.situation.out_of_time:
                break
        return naive

    def _fitted(self, problem: TourProblem) -> Candidate:
        """This vehicle's fitted lanes."""
        plan = self._naive_plan(problem, FITTED[(self._context.vehicle - 1) % len(FITTED)])
        return self._candidate(plan, problem.reward)

    def _naive_plan(self, problem: TourProblem, naive_path: int) -> Plan:
        s = problem.situation
        return self._context.naive_plan(s.step, s.state, naive_path)

    def _optimize(self, problem: TourProblem, starts: Sequence[Array], result: Candidates) -> None:
        """Adds tours optimized from the best of several starts, and the best one after more iterations.

        Starts are compared with fewer locations on each leg, which is enough to rank them. In a team, a tour that is
        behind the best naive path by more than `FAR_BEHIND` gets no more iterations: they gain less than that.
        """
        s, aim = problem.situation, problem.reward.weighing(0.0)
        values = []
        for waypoints in starts:
            values.append(aim.coarse_value(self._search.locations(waypoints, aim.legs)))
            if s.out_of_time:
                break
        naive, tours = best_of(result.plans), []
        best_first = sorted(range(len(values)), key=lambda i: -values[i])
        for i in best_first[:STARTS]:
            found = self._search.improve(starts[i], aim.legs, aim, START_ITERATIONS, s.deadline)
            tours.append((found, self._through(problem, found.waypoints_m)))
            result.add(tours[-1][1], found)
            if found.deadline_hit:
                return
        best, candidate = max(tours, key=lambda tour: tour[0].value)
        if self._vehicles > 1 and candidate.value.expected_end < (1.0 - FAR_BEHIND) * naive.value.expected_end:
            return
        longer = self._finer.improve(best.waypoints_m, aim.legs, aim, FIRST_ITERATIONS, s.deadline)
        result.add(self._through(problem, longer.waypoints_m), longer)

    # ------------------------------------------------------------------ later

    def under_way(self, problem: TourProblem, path: PlannedPath, heads: Sequence[Actions]) -> Candidates:
        """Candidates after the start: the last path, bent, and each head followed by the rest of the last tour.

        A path with too many actions for a packet is sent as a tour; its waypoints are moved instead.
        """
        s, legs, result = problem.situation, problem.reward.legs, Candidates()
        if problem.stages is not None and not problem.stages.is_last:
            self._bend_early(problem, path, ITERATIONS if s.planner.tour_interval else 0, SHARES_TRIED, result)
            return result
        waypoints = self._waypoints_ahead(problem, path)
        if s.planner.tour_interval and legs <= MAX_EXPLICIT_ACTIONS:
            self._bend_early(problem, path, ITERATIONS, SHARES_TRIED, result)
        else:
            found = Found(waypoints, 0.0, 0, False)
            if s.planner.tour_interval:
                found = self._search.improve(waypoints, legs, problem.reward, ITERATIONS, s.deadline, s.margin)
                waypoints = found.waypoints_m
            result.add(self._through(problem, waypoints), found)
        self._add_headed(problem, heads, waypoints, result)
        return result

    def headed(self, problem: TourProblem, path: PlannedPath, heads: Sequence[Actions], result: Candidates) -> None:
        """Adds each head followed by the rest of the last tour."""
        if heads:
            self._add_headed(problem, heads, self._waypoints_ahead(problem, path), result)

    def _add_headed(
        self, problem: TourProblem, heads: Sequence[Actions], waypoints_m: Array, result: Candidates
    ) -> None:
        for actions in heads:
            if result.deadline_hit or problem.situation.out_of_time:
                result.deadline_hit = True
                break
            result.plans.append(self._headed(problem, actions, waypoints_m))

    def _waypoints_ahead(self, problem: TourProblem, path: PlannedPath) -> Array:
        """Waypoints to optimize from: those of the last optimization that lie ahead, else those of the last path."""
        passed, partial = divmod(problem.situation.step - self._waypoints_step, self._search.segment_legs(len(path)))
        if self._waypoints is not None and not partial and len(self._waypoints) > passed + 1:
            return np.concatenate([problem.position_m, self._waypoints[passed + 1 :]])
        return self._search.resampled(self._polyline(problem, path), len(path))

    def _polyline(self, problem: TourProblem, path: PlannedPath) -> Array:
        """A path as a polyline from the state through the ends of its legs."""
        return np.concatenate([problem.position_m, path.states[1:, 1:]])

    def _bend_early(
        self, problem: TourProblem, path: PlannedPath, iterations: int, tries: int, result: Candidates
    ) -> None:
        """Bends a path towards early reward, with the first share that keeps the expected end above its floor.

        The next call starts one share before the allowed one, or after the last rejected one. Without a floor, the full
        share is used.

        Args:
            iterations: Largest number of iterations of each bend.
            tries: Largest number of shares to try.
            result: Receives the candidates.
        """
        limited = problem.floor > NO_FLOOR
        first = self._earliness if limited else 0
        for i in range(first, min(first + tries, len(WEIGHT_SHARES))):
            bent, found = self._bent(problem, path, WEIGHT_SHARES[i], iterations)
            result.add(bent, found)
            if found.deadline_hit or not limited:  # an interrupted bend does not show whether its share is allowed
                break
            allowed = bent.value.expected_end >= problem.floor
            self._earliness = max(i - 1, 0) if allowed else min(i + 1, len(WEIGHT_SHARES) - 1)
            if allowed:
                break

    # ------------------------------------------------------------------ along given lines

    def along(self, problem: TourProblem, line_m: Array) -> Followed:
        """The plan along a polyline (n + 1, 2) from the state; after its end it continues straight."""
        plan = self._plan_along(problem, line_m, problem.reward.legs)
        return Followed(plan, self._rollout.follow(plan))

    def joined(self, problem: TourProblem, head: PlannedPath, legs: int, path: PlannedPath) -> Candidate:
        """The first `legs` legs of a path, followed by the rest of the last one."""
        actions = tuple(int(a) for a in head.actions[:legs])
        return self._headed(problem, actions, self._waypoints_ahead(problem, path))

    def bend(self, problem: TourProblem, path: PlannedPath, result: Candidates) -> None:
        """Bends a path and adds the result."""
        if problem.reward.legs <= MAX_EXPLICIT_ACTIONS:
            self._bend_early(problem, path, ITERATIONS, 1, result)

    def _plan_along(self, problem: TourProblem, line_m: Array, legs: int) -> Plan:
        s, spacing = problem.situation, self._space.motion.leg_length_m
        actions = self._steering.along(problem.start, line_m, spacing, legs)
        if not self._space.path_feasible(s.state, actions, DETOUR_LEGS):
            actions = self._steering.along(problem.start, line_m, spacing, legs, around_shallows=True)
        return problem.plan(actions)

    # ------------------------------------------------------------------ single candidates

    def _bent(self, problem: TourProblem, path: PlannedPath, share: float, iterations: int) -> tuple[Candidate, Found]:
        """A path displaced to increase its value, as explicit actions that preserve its narrow turns."""
        return self._bent_by(self._search, problem, path, share, iterations)

    def _bent_by(
        self, search: TourSearch, problem: TourProblem, path: PlannedPath, share: float, iterations: int
    ) -> tuple[Candidate, Found]:
        reward, legs = problem.reward, problem.reward.legs
        fine = self._rollout.leg_locations(path.states[:-1], path.actions, LINE_LOCATIONS)[:legs]
        line = np.concatenate([problem.position_m, fine.reshape(-1, 2)])
        spacing = length_m(line) / legs
        staged = problem.stages is not None and not problem.stages.is_last
        s, aim = problem.situation, reward.weighing(share)
        found = search.bend(line, legs, aim, iterations, s.deadline, fixed_end=staged, margin=s.margin)
        actions = self._steering.along(problem.start, found.waypoints_m, spacing, legs)
        if not self._space.path_feasible(s.state, actions, DETOUR_LEGS):
            actions = self._steering.along(problem.start, found.waypoints_m, spacing, legs, around_shallows=True)
        candidate = self._candidate(problem.plan(actions), reward)
        if problem.stages is not None and staged:
            tour = problem.stages.tour(candidate.path.states[-1, 1:])
            candidate = replace(candidate, plan=problem.plan(actions, tour=tour))
        return candidate, found

    def _through(self, problem: TourProblem, waypoints_m: Array) -> Candidate:
        """The tour through waypoints; detours around shallow ground are explicit actions."""
        reward, legs = problem.reward, problem.reward.legs
        candidate = self._candidate(problem.plan((), tour=self._search.tour(waypoints_m, legs)), reward)
        if self._space.path_feasible(problem.situation.state, candidate.path.actions, DETOUR_LEGS):
            return replace(candidate, waypoints_m=waypoints_m)
        every = self._search.segment_legs(legs)
        corners = self._search.resampled(waypoints_m, legs)
        around = self._steering.actions(problem.start, corners, every, min(DETOUR_LEGS, legs), around_shallows=True)
        tour = None
        if len(around) < legs:
            end = self._space.motion.roll(problem.start, around)[-1]
            rest = np.concatenate([end[None, 1:], corners[1 + len(around) // every :]])
            tour = self._search.tour(rest, legs - len(around)) if len(rest) > 1 else None
        return self._candidate(problem.plan(around, tour=tour), reward)

    def _headed(self, problem: TourProblem, actions: Actions, base_m: Array) -> Candidate:
        """Actions, followed by the rest of a tour's waypoints, from the one nearest to the actions' end."""
        reward, legs = problem.reward, problem.reward.legs
        head = actions[:legs]
        if len(head) == legs:
            return self._candidate(problem.plan(head), reward)
        states = self._space.motion.roll(problem.situation.state, head)
        end, every, left = states[-1, 1:], self._search.segment_legs(legs), legs - len(head)
        near = base_m[1 : 2 + 2 * (len(head) // every)]
        skip = 1 + int(np.argmin(np.hypot(*(near - end).T)))
        rest = base_m[skip:] if np.hypot(*(base_m[skip] - end)) > REJOIN_M else base_m[skip + 1 :]
        if not len(rest):
            ahead = np.array([math.cos(states[-1, 0]), math.sin(states[-1, 0])])
            rest = (end + left * self._space.motion.leg_length_m * ahead)[None]
        corners = np.concatenate([end[None], rest])
        candidate = self._candidate(problem.plan(head, tour=self._search.tour(corners, left)), reward)
        return replace(candidate, waypoints_m=np.concatenate([states[:-every:every, 1:], corners]))

    def _candidate(self, plan: Plan, reward: AnytimeReward) -> Candidate:
        return self.evaluated(plan, self._rollout.follow(plan), reward)

    def evaluated(self, plan: Plan, path: PlannedPath, reward: AnytimeReward) -> Candidate:
        """A plan and its path with their value."""
        return Candidate(plan, path, reward.value(self._context.map_locations(path)[: reward.legs]))
