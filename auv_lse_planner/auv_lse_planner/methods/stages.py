"""Plans a long mission in stages: the next legs in detail, and the rest as a line that is followed later.

At the start, the best naive path over the whole mission becomes the *line*. A stage covers the next `STAGE_LEGS` legs.
It bends them as if they were a short mission, except that it ends on the line and is bent less often. Planning is
limited to the ground near the stage (`ground_window.py`); the locations of the line after it count as measured at its
end. After `RENEW_LEGS` legs, the next stage begins: the rest of this one, and more of the line.

The account of the bound covers the whole map. The drop of risk expected until the mission's end is E = E_s + d. The
stage computes E_s for its ground; d belongs to the cells elsewhere. They are expected to end with the risk e or less,
and not to lose more than the share of the legs left:

    d = min(sum of max(r - e, 0) over the risk r of these cells, E_0 (legs left) / (all legs))

E_0 is the drop expected of the best naive path, and e is chosen so that E = E_0 at the start. A new stage computes
d again. It is never negative, so the reward expected at the end is never below the reward so far.

Plans are evaluated at a bend and when a stage begins. In between the last plan is followed, and its value is carried
on, unless the ground ahead makes it void.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.mission import MissionConfig
from auv_lse_common.vocabulary.naive_ids import COVERING, FITTED, LAWNMOWERS
from auv_lse_common.vocabulary.plan import NONE, Plan, Tour, length_m
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.methods.method import Followed, PlanningContext, RemainingTour, Situation
from auv_lse_planner.paths.steering import LOOK_AHEAD, Steering
from auv_lse_planner.reward.anytime import AnytimeReward, Weighting

Array = NDArray[np.float64]

#: A mission with more legs, or with more legs of all vehicles, is planned in stages.
MAX_WHOLE_LEGS, MAX_WHOLE_TEAM_LEGS = 200, 800
#: Legs of a stage, and legs after which the next one begins. The last one is longer by up to as many legs.
STAGE_LEGS, RENEW_LEGS = 100, 40
#: Number of `planner.tour_interval`s between bends of the stage.
INTERVALS = 2
#: Largest number of centers with which a restarted planner makes its first stage.
MAX_UNFOCUSED = 1000
#: Largest number of segments of the tour that stands for the rest in a packet, and their smallest length in legs.
REST_SEGMENTS, REST_SEGMENT_LEGS = 30, 4
#: Largest numbers of the map's cells, of a path's legs, and of the team's legs for which the naive paths are compared.
COMPARED_CELLS, COMPARED_LEGS, COMPARED_TEAM_LEGS = 1500, 300, 1500


def is_staged(mission: MissionConfig) -> bool:
    """Whether a mission is planned in stages."""
    return mission.steps > MAX_WHOLE_LEGS or mission.steps * mission.vehicles > MAX_WHOLE_TEAM_LEGS


class Stages:
    """The stages of one vehicle's mission."""

    def __init__(self, context: PlanningContext) -> None:
        self._context = context
        self._steering = Steering(context.space)
        self._steps = context.settings.mission.steps
        self._begin = self._end = 0  # steps at which the stage begins and ends
        self._line_m = np.zeros((0, 2))  # locations at the steps from `_line_step` on
        self._line_step = 0
        self._drop = 0.0
        self._first_drop = math.nan  # drop expected of the line at the start, E_0
        self._end_level = math.nan  # risk with which a cell elsewhere is expected to end, e
        context.window.most_centers = MAX_UNFOCUSED

    @property
    def is_last(self) -> bool:
        """Whether the stage reaches the mission's end."""
        return self._end >= self._steps

    def rest(self) -> RemainingTour:
        """The rest of the mission after the stage."""
        first = max(self._end - self._line_step, 0)
        return RemainingTour(self._end, self._line_m[first + 1 : self._steps - self._line_step + 1], self._drop)

    def begins(self, step: int) -> bool:
        """Whether a stage begins at this step."""
        return not self._context.window.is_focused or step - self._begin >= RENEW_LEGS

    def shift(self, legs: int) -> None:
        """Delays the stage and the line by `legs`; legs beyond the mission's end are dropped."""
        self._begin, self._end = self._begin + legs, min(self._end + legs, self._steps)
        self._line_step += legs

    def last_plan(self, s: Situation) -> Followed:
        """The last plan, or the best naive path at the start; extended if a new stage begins."""
        last = s.last
        if last is not None:
            return self._extended(s, last) if self.begins(s.step) else last
        last, self._first_drop = self._best_naive(s)
        self._line_m, self._line_step, self._end = last.path.states[:, 1:].copy(), s.step, s.step
        return self._extended(s, last)

    def tour(self, end_m: Array) -> Tour | None:
        """The rest of the line as a tour from a location (2,); None if there is no rest."""
        rest = self.rest().locations_m
        if not len(rest):
            return None
        leg_m = self._context.space.motion.leg_length_m
        every = max(REST_SEGMENT_LEGS, math.ceil(len(rest) / REST_SEGMENTS))
        corners = np.concatenate([np.reshape(end_m, (1, 2)), rest])
        return Tour.through(corners, every, leg_m) if length_m(corners) > 0.0 else None

    def snapshot(self) -> dict[str, Any]:
        """The state, for a journal."""
        line = self._line_m[max(self._end - self._line_step, 0) :]
        return {
            "end": self._end,
            "first_drop": self._first_drop,
            "end_level": self._end_level,
            "line_step": self._line_step + len(self._line_m) - len(line),
            "line": np.round(line, 2).tolist(),
        }

    def restore(self, values: Mapping[str, Any]) -> None:
        """Continues from a `snapshot`; the next decision begins a stage."""
        self._end, self._first_drop, self._end_level = values["end"], values["first_drop"], values["end_level"]
        self._line_m, self._line_step = np.array(values["line"]).reshape(-1, 2), values["line_step"]

    # ------------------------------------------------------------------ a new stage

    def _extended(self, s: Situation, last: Followed) -> Followed:
        """Begins a stage; the last plan, extended along the line to the stage's end."""
        context, path, old_end = self._context, last.path, max(self._end, s.step)
        self._begin, self._end = s.step, min(s.step + STAGE_LEGS, self._steps)
        if self._steps - self._end < RENEW_LEGS:
            self._end = self._steps
        own = min(old_end - s.step, len(path))
        actions, state = path.actions[:own], path.states[own]
        line = np.concatenate([state[None, 1:], self._line(s.step + own + 1, self._end + LOOK_AHEAD)])
        legs = self._end - s.step - own
        if own == 0:
            actions = path.actions[:legs]
        elif legs > 0 and len(line) > 1:
            spacing = length_m(line) / (len(line) - 1)
            actions = np.concatenate([actions, self._steering.along(state, line, spacing, legs)])
        start = path.states[0]
        plan = Plan.at(s.step, start, tuple(int(a) for a in actions), NONE)
        followed = context.rollout.follow(plan)
        plan = replace(plan, tour=self.tour(followed.states[-1, 1:]))
        context.window.focus(followed.locations_m)
        self._drop = 0.0
        risks = context.window.risks_elsewhere
        if math.isnan(self._end_level):
            reward = context.map_reward(s, self.rest())
            elsewhere = self._first_drop - reward.value(context.map_locations(followed)[: reward.legs]).expected_end
            self._end_level = max(0.0, float(risks.mean()) - elsewhere / len(risks)) if len(risks) else 0.0
        most = max(self._first_drop, 0.0) * (1.0 - s.step / self._steps)
        self._drop = min(float(np.maximum(risks - self._end_level, 0.0).sum()), most)
        return Followed(plan, followed)

    def _line(self, begin: int, end: int) -> Array:
        """Locations of the line at the steps `begin` to `end` - 1, or to its end."""
        return self._line_m[max(begin - self._line_step, 0) : max(end - self._line_step, 0)]

    # ------------------------------------------------------------------ the start

    def _best_naive(self, s: Situation) -> tuple[Followed, float]:
        """The best naive path over the mission, and its expected drop of risk, from some of its legs and cells."""
        context, number = self._context, self._context.vehicle - 1
        legs = self._steps - s.step
        every = math.ceil(legs * max(1 / COMPARED_LEGS, context.settings.mission.vehicles / COMPARED_TEAM_LEGS))
        grid = context.map_grid
        apart = math.ceil(math.sqrt(int(grid.inside.sum()) / COMPARED_CELLS))
        chosen = np.zeros_like(grid.inside)
        chosen[apart // 2 :: apart, apart // 2 :: apart] = True
        cells = grid.locations_m[chosen[grid.inside]]
        cells = cells if len(cells) else grid.locations_m
        reward, by_mates = self._given_mates(s, cells, every)
        best, best_drop = None, -math.inf
        for naive in dict.fromkeys((FITTED[number % len(FITTED)], *COVERING, *LAWNMOWERS)):
            plan = Plan.at(s.step, s.state, (), naive)
            path = context.rollout.follow(plan)
            drop = reward.value(path.leg_locations_m[every // 2 :: every]).expected_end
            if drop > best_drop:
                best, best_drop = Followed(plan, path), drop
            if s.out_of_time:
                break
        assert best is not None
        return best, (best_drop + by_mates) * int(grid.inside.sum()) / len(cells)

    def _given_mates(self, s: Situation, cells_m: Array, every: int) -> tuple[AnytimeReward, float]:
        """Reward of paths over every n-th (`every`) leg given the mates' locations, and the drop of risk by these.

        For the expected end it does not matter when the mates measure. So all paths share one posterior that is already
        conditioned on the mates' locations.

        Args:
            cells_m: Cells whose risk counts, (M, 2).
        """
        context, legs = self._context, self._steps - s.step
        mates_m = [locations[::every] for _, locations in context.mates_ahead(s)]
        given = context.posterior.with_planned(np.concatenate([np.empty((0, 2)), *mates_m]))
        points, weighting = CachedPoints(given, cells_m), Weighting(-(-legs // every), 0, legs)
        reward = AnytimeReward(points, context.settings.level_set, [], weighting)
        now = points.current()
        before = LevelSet.of(context.settings.level_set).risk(now.mean_m, np.sqrt(now.data_var_m2))
        return reward, float(before.sum()) - reward.risk_before
