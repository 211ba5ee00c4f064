"""The method `tour`: one tour over the rest of the mission, re-optimized within a budget, so that it meets the bound.

A decision evaluates all plans with the same reward (`reward/anytime.py`), with the team mates' positions in time order.
The incumbent is the last plan, continued; it is kept unless another plan has a higher value. `tour_candidates.py` makes
new plans every `planner.tour_interval` legs, and whenever the incumbent is void.

The budget enforces the bound. Let E be the drop of the map's risk expected at the mission's end
(`Value.expected_end`):

    required   E(chosen) >= E(reference) - budget
    then       budget += E(chosen) - E(reference)

At the start the reference is the best naive path and the budget is 0; afterwards the reference is the incumbent. E
telescopes, so the mission's expected end is never below that of the best naive path. An incumbent that the map or a
current makes void stays the reference, so its loss is charged to the budget. If no plan is left that the budget allows,
the one with the largest expected end is chosen, and the bound falls by the rest; the bound record gives the reason.

A vehicle whose position is uncertain keeps farther from the border (`position_margin.py`): plans that come too near
are ignored if others keep clear. The incumbent's loss by this is charged to the budget, and beyond it to the bound.

A vehicle alone among shores, on ground that it cannot cover (`coverage.py`), follows the isobath: it tries heads at
every leg, and the plan with the largest path reward of its next legs wins among those that the budget allows. The
reference at the start is then the covering strip, which leaves a larger budget.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_planner.methods.coverage import follows_isobath
from auv_lse_planner.methods.method import Candidate, Choice, Followed, Method, PlanningContext, Situation
from auv_lse_planner.methods.stages import INTERVALS, Stages, is_staged
from auv_lse_planner.methods.tour_candidates import NO_FLOOR, Candidates, TourCandidates, TourProblem
from auv_lse_planner.paths.position_margin import LEGS, TOLERATED_M2
from auv_lse_planner.paths.rollout import PlannedPath
from auv_lse_planner.paths.steering import LOOK_AHEAD
from auv_lse_planner.reward.anytime import AnytimeReward, Value
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.path_search import search_path
from auv_lse_planner.search.tour import ROOM_WEIGHT
from auv_lse_planner.search.uct import Actions

Array = NDArray[np.float64]

#: Number of sequences of a tree search that candidates start with (heads).
MAX_HEADS = 3
#: Share of the mission after which heads are used; in trials none was chosen earlier.
HEADS_FROM_SHARE = 0.4
#: Number of sequences that the next tree search tries first.
SEEDS = 4


class Tour(Method):
    """Chooses the tour of one vehicle, decision by decision.

    Attributes:
        budget: Amount by which later decisions may lower the expected end.
    """

    def __init__(self, context: PlanningContext) -> None:
        self.context = context
        self.budget = 0.0
        self._candidates = TourCandidates(context)
        self._optimized_at = -1
        self._seeds: list[Actions] = []
        self._planned_to = context.horizon.end
        self._stages = Stages(context) if is_staged(context.settings.mission) else None
        self._value: Value | None = None  # of the last plan, when it was evaluated; None after a shift
        self._follows = self._heads_at_every_leg = follows_isobath(context.settings)

    def decide(self, situation: Situation) -> Choice:
        """See `Method`."""
        s, context, last = situation, self.context, situation.last
        void = self._void(s)
        if last is not None and self._value is not None and not void and not s.evaluates:
            return self._continued(last, self._value)
        context.assume_plans(s)
        renewed = self._update_horizon() and last is not None
        if last is not None and not context.horizon.is_whole:
            last = Followed(last.plan, last.path.to_step(context.horizon.end))
        if self._stages is not None:
            s = replace(s, last=self._stages.last_plan(s))
            last = s.last
        reward = self.map_reward(s)
        mates_m = np.concatenate([np.empty((0, 2)), *(locations for _, locations in context.mates_ahead(s))])
        due = situation.last is None or bool(void) or renewed or self._interval_is_over(s.step, s.planner)
        path_reward = cache(lambda: context.path_reward(s, mates_m))
        heads = self._heads(s, path_reward) if (due or self._heads_at_every_leg) and last is not None else []
        incumbent = reference = None  # `reference`: expected end that the budget refers to
        if last is not None:
            followed = self._candidates.evaluated(last.plan, last.path, reward)
            reference = followed.value.expected_end
            incumbent = None if void or renewed else followed
        void_value = reference if void and reference is not None else math.nan
        found = Candidates(deadline_hit=due and incumbent is not None and s.out_of_time)
        floor = NO_FLOOR if reference is None or renewed else reference - self.budget
        problem = TourProblem(s, reward, floor, path_reward, self._stages)
        if due and not found.deadline_hit:
            found = self._search(problem, last, heads, renewed)
            self._optimized_at = s.step
        elif last is not None:
            self._between(problem, last, heads, found)
        if last is None or renewed:
            reference = floor = found.floor
            self.budget = 0.0
        every = found.plans if incumbent is None else [incumbent, *found.plans]
        chosen = self._chosen(s, every, floor, path_reward)
        if reference is not None:
            self.budget = max(0.0, self.budget + (chosen.value.expected_end - reference))
        self._value = chosen.value
        if chosen is not incumbent:
            self._candidates.follow(chosen, s.step)
        return Choice(
            chosen=chosen,
            incumbent=incumbent,
            assured=chosen.value.expected_end - self.budget,
            map_risk=reward.risk_before,
            budget=self.budget,
            void=void,
            void_value=void_value,
            infeasible=void == "shallow ground",
            team_locations=len(mates_m),
            iterations=found.gradients,
            evaluations=len(every),
            best_new_value=max((c.value.expected_end for c in found.plans), default=math.nan),
            deadline_hit=found.deadline_hit,
        )

    def evaluates(self, step: int, planner: PlannerConfig) -> bool:
        """See `Method`. Between two searches the last plan is the only one; its value would change nothing."""
        end = self.context.horizon.end
        if self._heads_at_every_leg or self._value is None or end != self._planned_to or step == end - 1:
            return True
        begins = self._stages is not None and self._stages.begins(step)
        return begins or self._interval_is_over(step, planner)

    def _continued(self, last: Followed, value: Value) -> Choice:
        """The last plan, with the value that it had when it was evaluated."""
        same = Candidate(last.plan, last.path, value)
        return Choice(
            chosen=same,
            incumbent=same,
            assured=value.expected_end - self.budget,
            budget=self.budget,
        )

    def map_reward(self, situation: Situation) -> AnytimeReward:
        """See `Method`."""
        return self.context.map_reward(situation, None if self._stages is None else self._stages.rest())

    def spend(self, cost: float) -> float:
        """See `Method`."""
        self.budget = max(0.0, self.budget - cost)
        return self.budget

    def shift(self, legs: int) -> None:
        """See `Method`."""
        self._optimized_at += legs
        self._value = None
        self._candidates.shift(legs)
        if self._stages is not None:
            self._stages.shift(legs)

    def snapshot(self) -> dict[str, Any]:
        """See `Method`."""
        return {
            "budget": self.budget,
            "optimized_at": self._optimized_at,
            "planned_to": self._planned_to,
            "value": None if self._value is None else [self._value.weighted, self._value.expected_end],
            "seeds": [[int(a) for a in actions] for actions in self._seeds],
            "candidates": self._candidates.snapshot(),
            "stages": None if self._stages is None else self._stages.snapshot(),
        }

    def restore(self, values: Mapping[str, Any]) -> None:
        """See `Method`."""
        self.budget, self._optimized_at = values["budget"], values["optimized_at"]
        self._planned_to = values["planned_to"]
        value = values.get("value")
        self._value = None if value is None else Value(*value)
        self._seeds = [tuple(actions) for actions in values["seeds"]]
        self._candidates.restore(values["candidates"])
        if self._stages is not None and values.get("stages") is not None:
            self._stages.restore(values["stages"])

    def _void(self, s: Situation) -> str:
        """Reason why the last plan cannot be followed from here; "" if it can."""
        if s.last is None:
            return ""
        if s.off_plan:
            return "off the plan"
        space, actions = self.context.space, s.last.path.actions
        if space.path_feasible(s.state, actions, LOOK_AHEAD):
            return ""
        in_area = space.path_feasible(s.state, actions, LOOK_AHEAD, static=True)
        return "shallow ground" if in_area else "border of the area"

    def _margin_shortfall_m2(self, s: Situation, path: PlannedPath) -> float:
        """Sum of the squared clearances (m^2) that a path's next legs lack for the present uncertainty of the
        position."""
        if not s.margin.is_wider(self.context.space):
            return 0.0
        return s.margin.shortfall_m2(self.context.space, self.context.map_locations(path)[:LEGS].reshape(-1, 2))[0]

    def _chosen(
        self, s: Situation, candidates: list[Candidate], floor: float, path_reward: Callable[[], PathReward]
    ) -> Candidate:
        """The best candidate that the budget and the position's margin allow.

        If there is none, the one with the largest expected end, less a penalty for its shortfall of the margin.
        """
        shortfall_m2 = np.array([self._margin_shortfall_m2(s, c.path) for c in candidates])
        end = np.array([c.value.expected_end for c in candidates])
        allowed = np.flatnonzero((end >= floor) & (shortfall_m2 <= TOLERATED_M2))
        if len(allowed):
            return self._best(s, [candidates[i] for i in allowed], path_reward)
        return candidates[int(np.argmax(end - ROOM_WEIGHT * np.abs(end).max() * shortfall_m2))]

    def _interval_is_over(self, step: int, planner: PlannerConfig) -> bool:
        every = planner.tour_interval * (1 if self._stages is None else INTERVALS)
        return bool(every and step - self._optimized_at >= every)

    def _update_horizon(self) -> bool:
        """Records the horizon; returns whether it has changed since the last decision."""
        end = self.context.horizon.end
        changed, self._planned_to = end != self._planned_to, end
        return changed

    def _search(self, problem: TourProblem, last: Followed | None, heads: list[Actions], renewed: bool) -> Candidates:
        if last is None or renewed:
            return self._candidates.at_start(problem, None if last is None else last.path)
        return self._candidates.under_way(problem, last.path, heads)

    def _between(self, problem: TourProblem, last: Followed, heads: list[Actions], found: Candidates) -> None:
        """Adds new plans between two optimizations of the tour."""
        self._candidates.headed(problem, last.path, heads, found)

    def _heads(self, s: Situation, path_reward: Callable[[], PathReward]) -> list[Actions]:
        """The best sequences of a tree search for the path reward, given the mates' positions."""
        early = s.step < HEADS_FROM_SHARE * self.context.horizon.end and not self._follows
        early = early or (self._stages is not None and not self._stages.is_last)
        if early or not s.planner.tour_interval or s.out_of_time:
            return []
        problem = self.context.search_problem(s, self._seeds)
        found = search_path(problem, self.context.space, self.context.rollout, path_reward())
        ranking = found.found.ranking
        self._seeds = [a[1:] for a, _ in ranking if len(a) > 1][:SEEDS]
        return [a for a, _ in ranking[:MAX_HEADS]]

    def _best(self, s: Situation, candidates: list[Candidate], path_reward: Callable[[], PathReward]) -> Candidate:
        """The first candidate with the largest score: its anytime value plus `planner.own_share` times its path reward.

        The path reward is that of its next legs, given the mates' positions. A vehicle that follows the isobath goes by
        its path reward alone.
        """
        score = np.array([0.0 if self._follows else c.value.weighted for c in candidates])
        share = 1.0 if self._follows else s.planner.own_share
        if share and len(candidates) > 1:
            score = score + share * np.array([self._next_legs(s, c.path, path_reward) for c in candidates])
        return candidates[int(np.argmax(score))]

    def _next_legs(self, s: Situation, path: PlannedPath, path_reward: Callable[[], PathReward]) -> float:
        """Path reward of a path's next legs."""
        reward = path_reward()
        return reward.value(reward.posterior.at(path.leg_locations_m[: s.planner.horizon].reshape(-1, 2)))
