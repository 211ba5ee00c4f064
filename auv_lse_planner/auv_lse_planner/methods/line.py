"""The method `line`: as much of the isobath located as the mission's legs allow.

It searches and keeps account as `tour` does, with the isobath's expected unlocated length (`reward/line.py`) in place
of the map's risk: required of every choice is E(chosen) >= E(incumbent) - budget, where E is the length expected to be
located by the mission's end, and the first incumbent is the best naive path. So the mission is never expected to locate
less than the fitted lanes.

E assumes that the rest of a plan is travelled as it is, although a vehicle that finds the line will follow it. So the
plans that the budget allows are compared by what their next `NEXT_LEGS` legs locate if the vehicle goes on learning:

    J = mean over draws k of ( N_k if the plan begins like the route along the draw's own contours, else N )

N is the length that these legs are expected to locate as they are. N_k is what the draw's route follows in as many
legs, if that is more. A plan begins like a route if both reach the same location after `COMMON_LEGS` legs, from where
the vehicle can still follow whichever draw turns out to be true. Where the line is known, all draws begin alike, and
following counts nearly a metre per metre. Where nothing is known no two draws agree, and a plan counts by what it is
expected to locate as it is. So nothing but J tells a vehicle to follow or to explore.

New plans, beside those of `tour`: routes along the expected contours and along those of draws (`line_routes.py`), as
whole plans and as the next legs of the last plan. They are tried at every leg, and every `planner.tour_interval` legs
the best one is bent.
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
from auv_lse_planner.paths.rollout import PlannedPath
from auv_lse_planner.reward.anytime import AnytimeReward
from auv_lse_planner.reward.line import LineLoss
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.uct import Actions

Array = NDArray[np.float64]

#: Additional weight of what the next legs locate, and the legs over which it decays by e.
NEAR_WEIGHT, NEAR_LEGS = 10.0, 5.0
#: Legs over which plans are compared, those after which a plan and a draw's route must have reached the same location,
#: and how near that is (m).
NEXT_LEGS, COMMON_LEGS, COMMON_M = 8, 2, 20.0
#: In J, what the prior expects on ground without data counts by this share: on the lakes that this was tuned on, the
#: isobath is half as long as a stationary prior about the level expects.
UNKNOWN_SHARE = 0.5
#: Weight of the length located by the mission's end beside J.
END_SHARE = 0.1
#: Number of routes, the best by J, that become candidates.
ROUTES = 3


class Line(Tour):
    """Chooses the path of one vehicle for the goal `line`."""

    def __init__(self, context: PlanningContext) -> None:
        super().__init__(context)
        level_m, cell_m = context.settings.level_set.level_m, context.map_grid.resolution_m
        self._loss = LineLoss(level_m, cell_m)
        self._doubted = self._loss.doubting(UNKNOWN_SHARE)
        self._heads_at_every_leg = True
        self._routes = LineRoutes(context)
        self._stages = None  # their account is in units of risk; `check_planner` limits the legs
        self._next_reward: AnytimeReward | None = None  # of J
        self._mates_m = 0.0  # what the mates locate in it
        self._drawn: list[tuple[Array, float]] = []  # each draw's route: where it is after `COMMON_LEGS`, and N_k

    def map_reward(self, situation: Situation) -> AnytimeReward:
        """See `Method`."""
        return self.context.map_reward(situation, None, self._loss, (NEAR_WEIGHT, NEAR_LEGS))

    def _heads(self, s: Situation, path_reward: Callable[[], PathReward]) -> list[Actions]:
        return self._searched_heads(s, path_reward)

    def _search(self, problem: TourProblem, last: Followed | None, heads: list[Actions], renewed: bool) -> Candidates:
        found = super()._search(problem, last, heads, renewed)
        floor = found.floor if last is None or renewed else problem.floor
        best = self._add_routes(problem, last, found)
        if best is not None and not found.deadline_hit and not problem.situation.out_of_time:
            self._candidates.bend(replace(problem, floor=floor), best.path, found)
        return found

    def _between(self, problem: TourProblem, last: Followed, heads: list[Actions], found: Candidates) -> None:
        super()._between(problem, last, heads, found)
        self._add_routes(problem, last, found)

    def _add_routes(self, problem: TourProblem, last: Followed | None, found: Candidates) -> Followed | None:
        """Adds the best routes, alone and as heads of the last plan; returns the best one by J."""
        self._drawn, self._next_reward = [], None
        if found.deadline_hit:
            return None
        s, reward, context = problem.situation, problem.reward, self.context
        mates = [np.empty((0, 2)), *(locations for _, locations in context.mates_ahead(s))]
        routes = self._routes.routes(context.window.fine, s.state, reward.legs, np.concatenate(mates))
        next_m = min(NEXT_LEGS, reward.legs) * context.space.motion.leg_length_m
        plans: list[Followed] = []
        for number, route in enumerate(routes):
            if s.out_of_time:
                found.deadline_hit = True
                return None
            is_route = len(route.line_m) > 1
            if is_route:
                plans.append(self._candidates.along(problem, route.line_m))
            if number:
                there_m = _common_m(plans[-1].path) if is_route else np.full(2, np.inf)
                self._drawn.append((there_m, route.followed_m(next_m)))
        self._next_reward = context.map_reward(s, None, self._doubted, (NEAR_WEIGHT, NEAR_LEGS))
        self._mates_m = self._next_reward.value(np.empty((0, 1, 2))).expected_end
        best = np.argsort([-self._next(plan.path) for plan in plans], kind="stable")[:ROUTES]
        for number in best:
            if s.out_of_time:
                found.deadline_hit = True
                break
            plan = plans[int(number)]
            found.plans.append(self._candidates.evaluated(plan.plan, plan.path, reward))
            if last is not None:
                found.plans.append(self._candidates.joined(problem, plan.path, NEXT_LEGS, last.path))
        return plans[int(best[0])] if len(best) else None

    def _next(self, path: PlannedPath) -> float:
        """J of a path."""
        assert self._next_reward is not None
        legs = min(NEXT_LEGS, self._next_reward.legs)
        now = self._next_reward.value(self.context.map_locations(path)[:legs]).expected_end - self._mates_m
        here_m = _common_m(path)
        each = [
            max(now, followed_m) if np.hypot(*(here_m - there_m)) <= COMMON_M else now
            for there_m, followed_m in self._drawn
        ]
        return float(np.mean(each)) if each else now

    def _best(self, s: Situation, candidates: list[Candidate], path_reward: Callable[[], PathReward]) -> Candidate:
        """The first candidate with the largest J."""
        if len(candidates) == 1 or self._next_reward is None:
            return candidates[int(np.argmax([c.value.weighted for c in candidates]))]
        scores = [self._next(c.path) + END_SHARE * c.value.expected_end for c in candidates]
        return candidates[int(np.argmax(scores))]


def _common_m(path: PlannedPath) -> Array:
    """Location (2,) on a path after `COMMON_LEGS` legs, or at its end."""
    return np.asarray(path.states[min(COMMON_LEGS, len(path.states) - 1), 1:])
