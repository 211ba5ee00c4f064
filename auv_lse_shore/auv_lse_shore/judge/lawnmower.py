"""The bounds of a mission: the expected results of a lawnmower mission of the same length.

If a mission ended early, the lawnmower mission, planned for the whole, ends at the same step.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.naive_ids import COVERING, FITTED, LAWNMOWERS, MOWING, STRIPS, id_in_packet
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_gp.inference.banks import Banks
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.online import MAX_DENSE, OnlineGp
from auv_lse_planner.methods.coverage import follows_isobath
from auv_lse_record.run_data import RunData
from auv_lse_shore.judge.planned_paths import PlannedPaths

#: Number of map locations, or a few more, over which each vehicle's lawnmower is chosen.
CHOICE_LOCATIONS = 300


def blank_map(settings: PlannerSettings) -> OnlineGp:
    """A map without soundings."""
    return OnlineGp(settings.gp, banks=Banks.of(settings.area, settings.level_set.level_m))


def risk_if_measured(gp: OnlineGp, planned_m: Array, level_set: LevelSet, locations_m: Array) -> tuple[Array, Array]:
    """Bayes risk at locations (P, 2) now, and expected once `planned_m` (O, 2) are measured too, shape (P,) each.

    With more than `MAX_DENSE` centers and planned locations it is computed tile by tile.
    """
    if len(locations_m) == 0:
        return np.empty(0), np.empty(0)
    if len(gp) + len(planned_m) > MAX_DENSE:
        mean, variance, left = gp.tiled.planned_moments(locations_m, planned_m)
    else:
        found = gp.posterior.with_planned(planned_m).at(locations_m)
        mean, variance, left = found.mean_m, found.data_var_m2, found.planned_var_m2
    before = level_set.risk(mean, np.sqrt(variance))
    return before, level_set.expected_risk(mean, np.sqrt(np.maximum(variance - left, 0.0)), np.sqrt(left))


class _Start(NamedTuple):
    """A vehicle's first plan, its paths, and the legs of a lawnmower mission with which it is compared."""

    vehicle: int
    plan: Plan
    paths: PlannedPaths
    legs: int

    def naive(self, naive_path: int) -> Array:
        """Locations (n, 2) of those legs of a naive path."""
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

    If a vehicle follows the isobath, it covers its strip instead. Otherwise the lesser of two: every vehicle follows
    the lanes fitted to its own strip, or each in turn takes the lawnmower that is best given those before it.
    """
    level_set, blank = LevelSet.of(settings[0].level_set), blank_map(settings[0])
    some = map_m[:: max(1, len(map_m) // CHOICE_LOCATIONS)]
    starts = list(_starts(run, settings, paths))

    def expected(planned: Sequence[Array], locations: Array) -> float:
        joined = np.concatenate([np.empty((0, 2)), *planned])
        return float(risk_if_measured(blank, joined, level_set, locations)[1].mean())

    def strips(ids: Sequence[int]) -> list[Array]:
        return [start.naive(ids[(start.vehicle - 1) % len(ids)]) for start in starts]

    if follows_isobath(settings[0]):
        return expected(strips(STRIPS), map_m)
    in_turn: list[Array] = []
    ids = [naive_path for naive_path in MOWING if id_in_packet(naive_path) == naive_path]
    for start in starts:
        candidates = [[*in_turn, start.naive(naive_path)] for naive_path in ids]
        in_turn = min(candidates, key=lambda planned: expected(planned, some))
    return min(expected(in_turn, map_m), expected(strips(FITTED), map_m))


def flown_map_risk(
    run: RunData, settings: Sequence[PlannerSettings], paths: Sequence[PlannedPaths], map_m: Array
) -> float:
    """Map risk over `map_m` (P, 2) that the prior expects after the legs that all vehicles travelled."""
    legs = [own.leg(d) for v, own in zip(run.vehicles, paths, strict=True) for d in v.travelled]
    flown = np.concatenate([np.empty((0, 2)), *legs])
    blank, level_set = blank_map(settings[0]), LevelSet.of(settings[0].level_set)
    return float(risk_if_measured(blank, flown, level_set, map_m)[1].mean())


def lawnmower_path_reward(run: RunData, settings: Sequence[PlannerSettings], paths: Sequence[PlannedPaths]) -> float:
    """Expected whole-path reward of a lawnmower mission: each vehicle in turn takes the one that adds most."""
    level_set, blank = LevelSet.of(settings[0].level_set), blank_map(settings[0])
    team, value = np.empty((0, 2)), 0.0
    for start in _starts(run, settings, paths):
        ids = [start.plan.naive_path] if start.plan.naive_path != NONE else [*LAWNMOWERS, *COVERING]
        joint = [np.concatenate([team, start.naive(naive_path)]) for naive_path in ids]
        rewards = []
        for locations in joint:
            before, after = risk_if_measured(blank, locations, level_set, locations)
            rewards.append(float((before - after).sum()))
        best = int(np.argmax(rewards))
        value, team = rewards[best], joint[best]
    return value
