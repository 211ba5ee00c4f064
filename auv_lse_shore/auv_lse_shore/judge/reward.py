"""The team's reward and its lower bound, computed anew from what was measured (docs/design/paper.md).

Joint step i is leg i of every vehicle; D_{i-1} is what all vehicles measured on their legs before it. The judge knows
all of it at once, which no vehicle did. Two readings of the paper's reward are computed, because only one of them can
be compared with the value of a path planned as a whole:

- *Stepwise*, the literal sum: each leg is credited with the drop of Bayes risk at its own place by its own
  measurements, J(gamma_1(s_i)) = sum_k r(p_i^k | D_{i-1}) - r(p_i^k | D_i). The time-varying lower bound is the sum so
  far plus the naive part of Jbar (the caption of the paper's figure). A naive path is credited against the data of
  today at all of its places, a leg only against what was left when it was travelled, so the two do not telescope: the
  bound starts at the value of the whole lawnmower and the sum can end below it, however good the mission was.
- *Whole path*: J(gamma_l(s_0)) = sum over all places of the path of r(p | no data) - r(p | all data), the definition of
  the reward with n = l, i = 0. The matching bound at step i is the expectation of that final value if the plans in
  hand are carried out. It does telescope: in expectation it stays where it is while plans are kept, and grows only by
  better plans.

Both are the paper's, and tell little of the map. What a user gets is the drop of the mean Bayes risk over the whole
map. Its bound is the risk that mowing the lawn is expected to leave (`mowing_risk`), and its expectation with the plans
in hand (`Curves.expected_risk`) telescopes, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.vocabulary.naive_ids import COVERING, FITTED, LAWNMOWERS, MOWING
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.online import OnlineGp
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.paths.naive import NaivePaths
from auv_lse_planner.paths.rollout import PlannedPath, Rollout
from auv_lse_record.run_data import DecisionRecord, RunData, VehicleRun

Array = NDArray[np.float64]

#: Parts of the mission after each of which the map's risk is averaged.
RISK_EVERY = 12

#: Places of the map, at least, by which the best lawnmower is chosen.
MOWING_PLACES = 300


@dataclass(frozen=True, slots=True, kw_only=True)
class Curves:
    """Reward and bounds over joint steps 0..n (n + 1 values; value i is before leg i); unit: that of the costs.

    Attributes:
        stepwise: Realized stepwise reward so far, shape (n + 1,).
        bound: Stepwise reward so far + naive part of Jbar; NaN without naive part or where not computed, (n + 1,).
        whole: Whole-path reward of the places visited so far, given the data so far, shape (n + 1,).
        whole_bound: Expected whole-path reward if the plans in hand are carried out; NaN where not computed, (n + 1,).
        naive_value: Expected whole-path reward, before the first leg, of every vehicle mowing the lawn from its start.
        per_vehicle: Stepwise reward of each vehicle's legs, shape (K, n).
        risk: Mean Bayes risk over the map given the data so far (cost/place), NaN where not computed, shape (n + 1,).
        expected_risk: The same as expected at the end if the plans in hand are carried out, and nothing after them.
        mowing_risk: The same as expected before the first leg of every vehicle mowing the lawn; NaN if not computed.
    """

    stepwise: Array
    bound: Array
    whole: Array
    whole_bound: Array
    naive_value: float
    per_vehicle: Array
    risk: Array
    expected_risk: Array
    mowing_risk: float

    @property
    def bound_max(self) -> Array:
        """Running maximum of `bound` (NaN before its first value)."""
        return running_maximum(self.bound)

    @property
    def whole_bound_max(self) -> Array:
        """Running maximum of `whole_bound`."""
        return running_maximum(self.whole_bound)


def running_maximum(values: Array) -> Array:
    """Largest value so far, passing over NaN; NaN before the first value."""
    filled = np.where(np.isnan(values), -np.inf, values)
    largest = np.maximum.accumulate(filled)
    return np.where(np.isinf(largest), np.nan, largest)


class PlannedPaths:
    """The paths of one vehicle's plans, as its receivers build them."""

    def __init__(self, settings: PlannerSettings, area: OperatingArea) -> None:
        """Prepares to follow plans with the vehicle's settings."""
        motion = MotionTable(settings.motion)
        space = FreeSpace(area, motion, settings.area.raster_m)
        naive = NaivePaths(space, settings.planner, area.polygon, settings.mission.vehicles)
        self.rollout = Rollout(motion, naive, settings.mission.steps, settings.planner.samples_per_leg)
        self._paths: dict[Plan, PlannedPath] = {}

    def ahead(self, decision: DecisionRecord) -> PlannedPath:
        """The path of a decision's plan from the decided leg on."""
        plan = decision.plan
        if plan not in self._paths:
            self._paths[plan] = self.rollout.follow(plan)
        return self._paths[plan].from_step(decision.step)

    def leg(self, decision: DecisionRecord) -> Array:
        """Places (n, 2) of the decided leg that count in the reward; none if the plan ended before."""
        return self.ahead(decision).leg_places_m[:1].reshape(-1, 2)


def leg_times(vehicle: VehicleRun, paths: PlannedPaths) -> Array:
    """Times (s) at which a vehicle began the legs it decided, and infinity, (n + 1,).

    A decision is taken shortly before its leg begins, so state i is passed between decisions i and i + 1: when the
    odometry is nearest to it.
    """
    track, decisions = vehicle.odometry, vehicle.decisions
    times = []
    for index, decision in enumerate(decisions):
        following = decisions[index + 1].now_s if index + 1 < len(decisions) else np.inf
        if index + 1 == len(decisions) and index:
            following = decision.now_s + 2.0 * (decision.now_s - decisions[index - 1].now_s)
        first = np.searchsorted(track[:, 0], decision.now_s, side="left")
        rows = track[first : np.searchsorted(track[:, 0], following, side="right")]
        if len(rows) == 0:
            times.append(decision.now_s)
            continue
        _, north, east = paths.ahead(decision).states[0]
        distance = np.hypot(rows[:, 1] - north, rows[:, 2] - east)
        times.append(float(rows[np.argmin(distance), 0]))
    return np.array([*times, np.inf])


def reward_curves(
    run: RunData, settings: Sequence[PlannerSettings], area: OperatingArea, bounds: int = 34, map_m: Array | None = None
) -> Curves:
    """Replays a mission's reward and bounds from its soundings.

    Args:
        run: The mission.
        settings: The planner's settings of each vehicle, in order.
        area: The operating area.
        bounds: At most about this many steps get their bounds computed (each takes some 20 ms for 300 places).
        map_m: Places (P, 2) over which the map's risk is averaged, at start, end and each `RISK_EVERY` of the steps.
    """
    steps, level_set = run.steps, LevelSet.of(settings[0].level_set)
    paths = [PlannedPaths(s, area) for s in settings]
    decisions = [{d.step: d for d in v.decisions} for v in run.vehicles]
    soundings = [_by_leg(v, path, steps) for v, path in zip(run.vehicles, paths, strict=True)]
    gp, blank = OnlineGp(settings[0].gp), OnlineGp(settings[0].gp)
    visited = np.empty((0, 2))
    prior_visited = np.empty(0)
    stepwise, whole = np.zeros(steps + 1), np.zeros(steps + 1)
    bound, whole_bound = np.full(steps + 1, np.nan), np.full(steps + 1, np.nan)
    per_vehicle = np.zeros((len(run.vehicles), steps))
    risk, expected_risk = np.full(steps + 1, np.nan), np.full(steps + 1, np.nan)
    if map_m is not None:
        risk[0] = _risk(gp, level_set, map_m).mean()
    averaged = {round(steps * i / RISK_EVERY) for i in range(RISK_EVERY + 1)}
    augmented = any(d.plan.naive_path != NONE for v in run.vehicles for d in v.decisions)
    chosen = set(np.linspace(0, steps - 1, min(max(bounds, 2), steps)).round().astype(int).tolist()) if steps else set()
    for step in range(steps):
        plans = [own.get(step) for own in decisions]
        wanted = step in chosen or (map_m is not None and step in averaged)
        if wanted and all(plan is not None for plan in plans):
            ahead = [own.ahead(plan) for own, plan in zip(paths, plans, strict=True) if plan is not None]
            searched = np.concatenate([path.own_places_m for path in ahead])
            naive = np.concatenate([path.naive_places_m for path in ahead])
            if map_m is not None and step in averaged:
                planned = np.concatenate([searched, naive])
                expected_risk[step] = _expected(gp, level_set, planned, map_m)[1][len(planned) :].mean()
        if step in chosen and all(plan is not None for plan in plans):
            before, after = _expected(gp, level_set, np.concatenate([searched, naive]), visited)
            prior = _risk(blank, level_set, np.concatenate([searched, naive, visited]))
            if augmented:
                bound[step] = stepwise[step] + float((before - after)[len(searched) : len(searched) + len(naive)].sum())
            whole_bound[step] = float((prior - after).sum())
        places = [
            path.leg(plan) if plan is not None else np.empty((0, 2)) for path, plan in zip(paths, plans, strict=True)
        ]
        owner = np.repeat(np.arange(len(places)), [len(p) for p in places])
        here = np.concatenate(places)
        before_leg = _risk(gp, level_set, here)
        for own in soundings:
            gp.add_all(own[step].points_m)  # a vehicle's own map refuses the same ones, and counts them
        drop = before_leg - _risk(gp, level_set, here)
        per_vehicle[:, step] = np.bincount(owner, drop, minlength=len(places))
        stepwise[step + 1] = stepwise[step] + drop.sum()
        if map_m is not None and step + 1 in averaged:
            risk[step + 1] = _risk(gp, level_set, map_m).mean()
        visited = np.concatenate([visited, here])
        prior_visited = np.concatenate([prior_visited, _risk(blank, level_set, here)])
        whole[step + 1] = float((prior_visited - _risk(gp, level_set, visited)).sum())
    bound[steps] = stepwise[steps] if augmented else np.nan
    whole_bound[steps] = whole[steps]
    expected_risk[steps] = risk[steps]
    return Curves(
        stepwise=stepwise,
        bound=bound,
        whole=whole,
        whole_bound=whole_bound,
        naive_value=_naive_value(run, settings, paths),
        per_vehicle=per_vehicle,
        risk=risk,
        expected_risk=expected_risk,
        mowing_risk=np.nan if map_m is None else _mowing_risk(run, settings, paths, map_m),
    )


def _mowing_risk(
    run: RunData, settings: Sequence[PlannerSettings], paths: Sequence[PlannedPaths], map_m: Array
) -> float:
    """Expected mean risk at `map_m` (P, 2) after everybody mowed the lawn, the best that they can.

    That is each the lanes fitted to its own strip, or each in order the lawnmower that is best then: whichever is less.
    """
    level_set = LevelSet.of(settings[0].level_set)
    posterior = OnlineGp(settings[0].gp).posterior
    some = map_m[:: max(1, len(map_m) // MOWING_PLACES)]

    def expected(places: Array) -> float:
        columns = posterior.at(places)
        variance, left = columns.data_var_m2, columns.planned_var_m2
        of_mean, after = np.sqrt(np.maximum(variance - left, 0.0)), np.sqrt(left)
        return float(level_set.expected_risk(columns.mean_m, of_mean, after).mean())

    for vehicle, path in zip(run.vehicles, paths, strict=True):
        if not vehicle.decisions:
            continue
        start, mark = vehicle.decisions[0].plan.state, len(posterior)
        best: tuple[float, Array] | None = None
        for naive_path in MOWING:
            places = path.rollout.path(0, start, (), naive_path).places_m
            posterior.plan(places)
            worth = expected(some)
            posterior.truncate(mark)
            if best is None or worth < best[0]:
                best = (worth, places)
        if best is not None:
            posterior.plan(best[1])
    in_order = expected(map_m)
    posterior.forget_planned()
    for vehicle, path in zip(run.vehicles, paths, strict=True):
        if vehicle.decisions:
            own = FITTED[(vehicle.vehicle - 1) % len(FITTED)]
            posterior.plan(path.rollout.path(0, vehicle.decisions[0].plan.state, (), own).places_m)
    return min(in_order, expected(map_m))


def _naive_value(run: RunData, settings: Sequence[PlannerSettings], paths: Sequence[PlannedPaths]) -> float:
    """Expected whole-path reward of everybody mowing the lawn: each takes the lawnmower that adds most, in order."""
    gp, level_set = OnlineGp(settings[0].gp), LevelSet.of(settings[0].level_set)
    team = np.empty((0, 2))
    value = 0.0
    for vehicle, path in zip(run.vehicles, paths, strict=True):
        if not vehicle.decisions:
            continue
        first = vehicle.decisions[0].plan
        ids = [first.naive_path] if first.naive_path != NONE else [*LAWNMOWERS, *COVERING]
        best: tuple[float, Array] | None = None
        for naive_path in ids:
            joint = np.concatenate([team, path.rollout.path(0, first.state, (), naive_path).places_m])
            before, after = _expected(gp, level_set, joint, np.empty((0, 2)))
            worth = float((before - after).sum())
            if best is None or worth > best[0]:
                best = (worth, joint)
        if best is not None:
            value, team = best
    return value


def _by_leg(vehicle: VehicleRun, path: PlannedPaths, steps: int) -> list[Soundings]:
    """A vehicle's soundings by the leg they were made on; those before the first leg count to it."""
    times = leg_times(vehicle, path)
    legs = [Soundings.from_rows(())] * steps
    if len(vehicle.decisions) == 0:
        return legs
    index = np.clip(np.searchsorted(times[:-1], vehicle.soundings.stamp_s, side="right") - 1, 0, None)
    for number, decision in enumerate(vehicle.decisions):
        legs[decision.step] = Soundings.join([legs[decision.step], vehicle.soundings[index == number]])
    return legs


def _risk(gp: OnlineGp, level_set: LevelSet, places: Array) -> Array:
    if len(places) == 0:
        return np.empty(0)
    return level_set.risk(*gp.predict(places))


def _expected(gp: OnlineGp, level_set: LevelSet, planned: Array, others: Array) -> tuple[Array, Array]:
    """Risk now and once `planned` (V, 2) is measured too, at `planned` then `others` (O, 2); (V + O,) each."""
    places = np.concatenate([planned, others])
    if len(places) == 0:
        return np.empty(0), np.empty(0)
    posterior = gp.posterior
    posterior.plan(planned)
    try:
        columns = posterior.at(places)
    finally:
        posterior.forget_planned()
    variance, left = columns.data_var_m2, columns.planned_var_m2
    before = level_set.risk(columns.mean_m, np.sqrt(variance))
    return before, level_set.expected_risk(columns.mean_m, np.sqrt(np.maximum(variance - left, 0.0)), np.sqrt(left))
