"""The bounds of a mission: the expected results of a lawnmower mission of the same length.

If a mission ended early, the lawnmower mission, planned for the whole, ends at the same step.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.vocabulary.naive_ids import COVERING, FITTED, LAWNMOWERS, MOWING
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.online import OnlineGp
from auv_lse_record.run_data import RunData
from auv_lse_shore.judge.planned_paths import PlannedPaths

Array = NDArray[np.float64]

#: Number of map places, or a few more, over which each vehicle's lawnmower is chosen.
CHOICE_PLACES = 300


def risk_if_measured(posterior: Posterior, level_set: LevelSet, places_m: Array) -> tuple[Array, Array]:
    """Bayes risk at places (P, 2) now, and expected once the planned places are measured too, shape (P,) each."""
    if len(places_m) == 0:
        return np.empty(0), np.empty(0)
    columns = posterior.at(places_m)
    variance, left = columns.data_var_m2, columns.planned_var_m2
    before = level_set.risk(columns.mean_m, np.sqrt(variance))
    return before, level_set.expected_risk(columns.mean_m, np.sqrt(np.maximum(variance - left, 0.0)), np.sqrt(left))


def _starts(run: RunData, paths: Sequence[PlannedPaths]) -> Iterator[tuple[int, Plan, PlannedPaths]]:
    """Number, first plan and paths of each vehicle that decided anything."""
    for vehicle, own in zip(run.vehicles, paths, strict=True):
        if vehicle.decisions:
            yield vehicle.vehicle, vehicle.decisions[0].plan, own


def lawnmower_map_risk(
    run: RunData, settings: Sequence[PlannerSettings], paths: Sequence[PlannedPaths], map_m: Array
) -> float:
    """Map risk over `map_m` (P, 2) expected after a lawnmower mission of all vehicles.

    The lesser of two: every vehicle follows the lanes fitted to its own strip, or each in turn takes the lawnmower that
    is best given those before it.
    """
    level_set = LevelSet.of(settings[0].level_set)
    fitted = in_turn = OnlineGp(settings[0].gp).posterior
    some = map_m[:: max(1, len(map_m) // CHOICE_PLACES)]

    def expected(posterior: Posterior, places: Array) -> float:
        return float(risk_if_measured(posterior, level_set, places)[1].mean())

    for number, start, own in _starts(run, paths):
        candidates = [in_turn.with_planned(own.naive(start, naive_path, run.steps)) for naive_path in MOWING]
        in_turn = min(candidates, key=lambda posterior: expected(posterior, some))
        fitted = fitted.with_planned(own.naive(start, FITTED[(number - 1) % len(FITTED)], run.steps))
    return min(expected(in_turn, map_m), expected(fitted, map_m))


def lawnmower_path_reward(run: RunData, settings: Sequence[PlannerSettings], paths: Sequence[PlannedPaths]) -> float:
    """Expected whole-path reward of a lawnmower mission: each vehicle in turn takes the one that adds most."""
    level_set, posterior = LevelSet.of(settings[0].level_set), OnlineGp(settings[0].gp).posterior
    team, value = np.empty((0, 2)), 0.0
    for _, start, own in _starts(run, paths):
        ids = [start.naive_path] if start.naive_path != NONE else [*LAWNMOWERS, *COVERING]
        joint = [np.concatenate([team, own.naive(start, naive_path, run.steps)]) for naive_path in ids]
        rewards = []
        for places in joint:
            before, after = risk_if_measured(posterior.with_planned(places), level_set, places)
            rewards.append(float((before - after).sum()))
        best = int(np.argmax(rewards))
        value, team = rewards[best], joint[best]
    return value
