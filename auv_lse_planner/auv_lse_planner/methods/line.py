"""The method `line`: locates as much of the isobath as the mission's legs allow.

It searches and budgets as `tour` does, with the isobath's expected unlocated length (`reward/line.py`) in place of the
map's risk. Every choice must satisfy E(chosen) >= E(incumbent) - budget, where E is the length expected to be located
by the mission's end. The first incumbent is the best naive path, so the mission is never expected to locate less than
the fitted lanes.

E assumes that the rest of a plan is travelled unchanged, although a vehicle that finds the line follows it. So among
the plans that the budget allows, the one whose next legs have the largest score wins (`_next_legs`): the benefit of
search (`reward/path.py`) as a share of the largest possible, plus `LOCATED` times the length of the estimated isobath
that they locate per length travelled. The benefit leads to where the line may be. On flat ground near the level it is
at its largest everywhere, and the second term leads along the line. No other rule decides between following and
exploring.

New plans, beside those of `tour`: routes along the expected contours and along those of draws (`line_routes.py`), as
whole plans and as the next legs of the last plan. They are tried at every leg, and every `planner.tour_interval` legs
the best one is bent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from auv_lse_planner.methods.line_routes import LineRoutes
from auv_lse_planner.methods.method import Followed, PlanningContext, Situation
from auv_lse_planner.methods.tour import Tour
from auv_lse_planner.methods.tour_candidates import Candidates, TourProblem
from auv_lse_planner.paths.rollout import PlannedPath
from auv_lse_planner.reward.anytime import AnytimeReward
from auv_lse_planner.reward.line import LineLoss
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.uct import Actions

#: Additional weight of the length that the next legs locate, and the legs over which it decays by e.
NEAR_WEIGHT, NEAR_LEGS = 10.0, 5.0
#: Weight of the estimated isobath that the next legs locate, per length, against their share of the largest benefit.
LOCATED = 0.35
#: Number of routes, those with the largest score, that become candidates.
ROUTES = 3


class Line(Tour):
    """Chooses the path of one vehicle for the goal `line`."""

    def __init__(self, context: PlanningContext) -> None:
        super().__init__(context)
        self._loss = LineLoss(context.settings.level_set.level_m, context.map_grid.resolution_m)
        self._estimated_loss = self._loss.of_estimate()
        self._located: tuple[Situation, AnytimeReward, float] | None = None  # of the last decision's map
        self._follows = self._heads_at_every_leg = True
        self._routes = LineRoutes(context)
        self._stages = None  # stages count in units of risk; `check_planner` limits the legs

    def map_reward(self, situation: Situation) -> AnytimeReward:
        """See `Method`."""
        return self.context.map_reward(situation, None, self._loss, (NEAR_WEIGHT, NEAR_LEGS))

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
        """Adds the routes with the largest scores, alone and as heads of the last plan; returns the best one."""
        s, legs, context = problem.situation, problem.reward.legs, self.context
        if found.deadline_hit:
            return None
        mates_m = np.concatenate([np.empty((0, 2)), *(locations for _, locations in context.mates_ahead(s))])
        plans: list[Followed] = []
        for route in self._routes.routes(context.window.fine, s.state, legs, mates_m):
            if s.out_of_time:
                found.deadline_hit = True
                return None
            if len(route.line_m) > 1:
                plans.append(self._candidates.along(problem, route.line_m))
        best_first = np.argsort([-self._next_legs(s, plan.path, problem.path_reward) for plan in plans], kind="stable")
        for number in best_first[:ROUTES]:
            if s.out_of_time:
                found.deadline_hit = True
                break
            plan = plans[int(number)]
            found.plans.append(self._candidates.evaluated(plan.plan, plan.path, problem.reward))
            if last is not None:
                found.plans.append(self._candidates.joined(problem, plan.path, s.planner.horizon, last.path))
        return plans[int(best_first[0])] if plans else None

    def _next_legs(self, s: Situation, path: PlannedPath, path_reward: Callable[[], PathReward]) -> float:
        """Score of a path's next legs; see the module's text."""
        legs = path.leg_locations_m[: s.planner.horizon]
        if not legs.size:
            return 0.0
        largest = path_reward().level_set.largest_risk * legs[..., 0].size
        travelled_m = len(legs) * self.context.space.motion.leg_length_m
        benefit = super()._next_legs(s, path, path_reward) / largest
        return benefit + LOCATED * self._located_m(s, path) / travelled_m

    def _located_m(self, s: Situation, path: PlannedPath) -> float:
        """Length (m) of the estimated isobath that a path's next legs locate, and mates do not."""
        if self._located is None or self._located[0] is not s:
            reward = self.context.map_reward(s, None, self._estimated_loss)
            self._located = s, reward, reward.value(np.empty((0, 1, 2))).expected_end
        _, reward, by_mates_m = self._located
        locations = self.context.map_locations(path)[: s.planner.horizon]
        return reward.value(locations).expected_end - by_mates_m
