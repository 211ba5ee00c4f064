"""The method `line`: as much of the isobath located as the mission's legs allow.

It searches and keeps account as `tour` does, with the isobath's expected unlocated length (`reward/line.py`) in place
of the map's risk: required of every choice is E(chosen) >= E(incumbent) - budget, where E is the length expected to be
located by the mission's end, and the first incumbent is the best naive path. So the mission is never expected to locate
less than the fitted lanes.

E assumes that the rest of a plan is travelled as it is, although a vehicle that finds the line will follow it. So the
plans that the budget allows are compared by what their next `NEXT_LEGS` legs locate if the vehicle goes on learning:

    J = mean over draws k of ( N_k if the plan begins like the route along the draw's own contours, else N )

N is the length that these legs are expected to locate as they are. N_k is what the draw's route follows in as many
legs, if that is more. A plan begins like a route if both are at the same place after `COMMON_LEGS` legs, from where the
vehicle can still follow whichever draw turns out to be true. Where the line is known, all draws begin alike, and
following counts nearly a metre per metre. Where nothing is known no two draws agree, and a plan counts by what it is
expected to locate as it is. So nothing but J tells a vehicle to follow or to explore.

New plans, beside those of `tour`: routes along the expected contours and along those of draws (`line_routes.py`), as
whole plans and as the next legs of the last plan, the best of them bent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from auv_lse_planner.methods.line_routes import LineRoutes
from auv_lse_planner.methods.method import Candidate, Followed, PlanningContext, Situation
from auv_lse_planner.methods.tour import Tour
from auv_lse_planner.methods.tour_candidates import Candidates, TourProblem
from auv_lse_planner.reward.anytime import AnytimeReward
from auv_lse_planner.reward.line import LineLoss
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.uct import Actions

Array = NDArray[np.float64]

#: Additional weight of what the next legs locate, and the legs over which it decays by e.
NEAR_WEIGHT, NEAR_LEGS = 10.0, 5.0
#: Legs over which plans are compared, and those after which a plan and a draw's route must be at the same place, to so
#: many metres.
NEXT_LEGS, COMMON_LEGS, COMMON_M = 8, 2, 20.0
#: Weight of the length located by the mission's end beside J.
END_SHARE = 0.1
#: Number of routes that are bent.
BENT = 2


class Line(Tour):
    """Chooses the path of one vehicle for the goal `line`."""

    def __init__(self, context: PlanningContext) -> None:
        super().__init__(context)
        self._loss = LineLoss(context.settings.level_set.level_m, context.map_grid.resolution_m)
        self._routes = LineRoutes(context)
        self._stages = None  # their account is in units of risk; `check_planner` limits the legs
        self._reward: AnytimeReward | None = None  # of the last search
        self._drawn: list[tuple[Array, float]] = []  # each draw's route: where it is after `COMMON_LEGS`, and N_k

    def map_reward(self, situation: Situation) -> AnytimeReward:
        """See `Method`."""
        return self.context.map_reward(situation, None, self._loss, (NEAR_WEIGHT, NEAR_LEGS))

    def _heads(self, s: Situation, path_reward: Callable[[], PathReward]) -> list[Actions]:
        return self._searched_heads(s, path_reward)

    def _search(self, problem: TourProblem, last: Followed | None, heads: list[Actions], renewed: bool) -> Candidates:
        found = super()._search(problem, last, heads, renewed)
        self._drawn = []
        if found.deadline_hit:
            return found
        s, reward, context = problem.situation, problem.reward, self.context
        mates = [np.empty((0, 2)), *(locations for _, locations in context.mates_ahead(s))]
        routes = self._routes.routes(context.window.fine, s.state, reward.legs, np.concatenate(mates))
        next_m = min(NEXT_LEGS, reward.legs) * context.space.motion.leg_length_m
        plans: list[Candidate] = []
        for number, route in enumerate(routes):
            if s.out_of_time:
                found.deadline_hit = True
                break
            if len(route.line_m) < 2:
                if number:
                    self._drawn.append((np.full(2, np.inf), 0.0))
                continue
            plans.append(self._candidates.along(problem, route.line_m))
            if number:
                self._drawn.append((_common_m(plans[-1]), route.followed_m(next_m)))
            if last is not None:
                plans.append(self._candidates.joined(problem, plans[-1], NEXT_LEGS, last.path))
        floor = found.floor if last is None or renewed else problem.floor
        scores = self._scores(reward, plans)
        for number in np.argsort(-scores, kind="stable")[:BENT]:
            if not found.deadline_hit and not s.out_of_time:
                self._candidates.bend(replace(problem, floor=floor), plans[int(number)].path, found)
        found.plans += plans
        self._reward = reward
        return found

    def _scores(self, reward: AnytimeReward, candidates: list[Candidate]) -> Array:
        """J of each candidate, with the share of its expected end."""
        scores = np.zeros(len(candidates))
        for number, candidate in enumerate(candidates):
            as_it_is = reward.value(self.context.map_locations(candidate.path)[: min(NEXT_LEGS, reward.legs)])
            common_m, now = _common_m(candidate), as_it_is.expected_end
            each = [
                max(now, followed_m) if np.hypot(*(common_m - there_m)) <= COMMON_M else now
                for there_m, followed_m in self._drawn
            ]
            scores[number] = float(np.mean(each)) if each else now
            scores[number] += END_SHARE * candidate.value.expected_end
        return scores

    def _best(self, s: Situation, candidates: list[Candidate], path_reward: Callable[[], PathReward]) -> Candidate:
        """The first candidate with the largest J."""
        if len(candidates) == 1 or self._reward is None:
            return candidates[int(np.argmax([c.value.weighted for c in candidates]))]
        return candidates[int(np.argmax(self._scores(self._reward, candidates)))]


def _common_m(candidate: Candidate) -> Array:
    """Location (2,) of a plan after `COMMON_LEGS` legs, or at its end."""
    states = candidate.path.states
    return np.asarray(states[min(COMMON_LEGS, len(states) - 1), 1:])
