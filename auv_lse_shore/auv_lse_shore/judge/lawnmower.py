"""The bounds of a mission: the expected results of a lawnmower mission of the same length.

If a mission ended early, the lawnmower mission, planned for the whole, ends at the same step.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.planner import PlannerConfig, PlannerSettings
from auv_lse_common.vocabulary.naive_ids import COVERING, FITTED, LAWNMOWERS, MOWING, STRIPS
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.online import OnlineGp
from auv_lse_record.run_data import RunData
from auv_lse_shore.judge.planned_paths import PlannedPaths

Array = NDArray[np.float64]

#: Number of map places, or a few more, over which each vehicle's lawnmower is chosen.
CHOICE_PLACES = 300


def covers_strips(planner: PlannerConfig) -> bool:
    """Whether the method's bound is that of the covering strips."""
    return planner.floor == "strips" and planner.family.bound_of == "map"


def risk_if_measured(posterior: Posterior, level_set: LevelSet, places_m: Array) -> tuple[Array, Array]:
    """Bayes risk at places (P, 2) now, and expected once the planned places are measured too, shape (P,) each."""
    if len(places_m) == 0:
        return np.empty(0), np.empty(0)
    columns = posterior.at(places_m)
    variance, left = columns.data_var_m2, columns.planned_var_m2
    before = level_set.risk(columns.mean_m, np.sqrt(variance))
    return before, level_set.expected_risk(columns.mean_m, np.sqrt(np.maximum(variance - left, 0.0)), np.sqrt(left))


class _Start(NamedTuple):
    """A vehicle's first plan, its paths, and the legs of a lawnmower mission with which it is compared."""

    vehicle: int
    plan: Plan
    paths: PlannedPaths
    legs: int

    def naive(self, naive_path: int) -> Array:
        """Places (n, 2) of those legs of a naive path."""
        return self.paths.naive(self.plan, naive_path, self.legs)


def _starts(run: RunData, settings: Sequence[PlannerSettings], paths: Sequence[PlannedPaths]) -> Iterator[_Start]:
    """The start of each vehicle that decided anything; if the mission ended early, with the legs that it travelled."""
    early = run.steps < settings[0].mission.steps
    for vehicle, own in zip(run.vehicles, paths, strict=True):
        if vehicle.decisions:
            yield _Start(vehicle.vehicle, vehicle.decisions[0].plan, own, vehicle.steps if early else run.steps)


def lawnmower_map_risk(
    run: RunData, settings: Sequence[PlannerSettings], paths: Sequence[PlannedPaths], map_m: Array
) -> float:
    """Map risk over `map_m` (P, 2) expected after a lawnmower mission of all vehicles.

    With a method whose floor is that of the covering strips, every vehicle covers its own strip. Otherwise the lesser
    of two: every vehicle follows the lanes fitted to its own strip, or each in turn takes the lawnmower that is best
    given those before it.
    """
    level_set = LevelSet.of(settings[0].level_set)
    fitted = in_turn = OnlineGp(settings[0].gp).posterior
    some = map_m[:: max(1, len(map_m) // CHOICE_PLACES)]

    def expected(posterior: Posterior, places: Array) -> float:
        return float(risk_if_measured(posterior, level_set, places)[1].mean())

    if covers_strips(settings[0].planner):
        covered = fitted
        for start in _starts(run, settings, paths):
            covered = covered.with_planned(start.naive(STRIPS[(start.vehicle - 1) % len(STRIPS)]))
        return expected(covered, map_m)
    for start in _starts(run, settings, paths):
        candidates = [in_turn.with_planned(start.naive(naive_path)) for naive_path in MOWING]
        in_turn = min(candidates, key=lambda posterior: expected(posterior, some))
        fitted = fitted.with_planned(start.naive(FITTED[(start.vehicle - 1) % len(FITTED)]))
    return min(expected(in_turn, map_m), expected(fitted, map_m))


def flown_map_risk(
    run: RunData, settings: Sequence[PlannerSettings], paths: Sequence[PlannedPaths], map_m: Array
) -> float:
    """Map risk over `map_m` (P, 2) that the prior expects after the legs that all vehicles travelled."""
    legs = [own.leg(d) for v, own in zip(run.vehicles, paths, strict=True) for d in v.decisions]
    posterior = OnlineGp(settings[0].gp).posterior.with_planned(np.concatenate([np.empty((0, 2)), *legs]))
    return float(risk_if_measured(posterior, LevelSet.of(settings[0].level_set), map_m)[1].mean())


def lawnmower_path_reward(run: RunData, settings: Sequence[PlannerSettings], paths: Sequence[PlannedPaths]) -> float:
    """Expected whole-path reward of a lawnmower mission: each vehicle in turn takes the one that adds most."""
    level_set, posterior = LevelSet.of(settings[0].level_set), OnlineGp(settings[0].gp).posterior
    team, value = np.empty((0, 2)), 0.0
    for start in _starts(run, settings, paths):
        ids = [start.plan.naive_path] if start.plan.naive_path != NONE else [*LAWNMOWERS, *COVERING]
        joint = [np.concatenate([team, start.naive(naive_path)]) for naive_path in ids]
        rewards = []
        for places in joint:
            before, after = risk_if_measured(posterior.with_planned(places), level_set, places)
            rewards.append(float((before - after).sum()))
        best = int(np.argmax(rewards))
        value, team = rewards[best], joint[best]
    return value
