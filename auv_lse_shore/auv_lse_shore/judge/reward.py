"""The team's reward and its lower bound, recomputed from what was measured (docs/design/paper.md).

Joint step i is leg i of every vehicle; D_{i-1} is what all vehicles measured on their legs before it. The paper's
reward is computed in two ways, because only the second can be compared with the value of a path planned as a whole:

- *Stepwise*, the literal sum: each leg is credited with the drop of Bayes risk at its own position by its own
  measurements, J(gamma_1(s_i)) = sum_k r(p_i^k | D_{i-1}) - r(p_i^k | D_i). The time-varying lower bound is the sum so
  far plus the naive part of Jbar (the caption of the paper's figure). The bound credits all locations of a naive path
  against today's data, the sum credits a leg only against the risk left when it was travelled. The two do not
  telescope: the sum can end below the bound, however good the mission was.
- *Whole path*: J(gamma_l(s_0)) = sum over all locations of the path of r(p | no data) - r(p | all data), the definition
  of the reward with n = l, i = 0. Its bound at step i is the expectation of that final value if the current plans are
  carried out. It telescopes: its expectation changes only with better plans.

Neither reward measures the map. Map risk, the mean Bayes risk over the whole map, does. Its bound is the risk expected
after a lawnmower mission (`mowing_risk`), and its expectation with the current plans (`expected_risk`) telescopes too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.vocabulary.plan import NONE
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.online import MAX_DENSE, OnlineGp
from auv_lse_record.run_data import RunData
from auv_lse_run.process.background import run_in_background
from auv_lse_shore.judge.lawnmower import (
    blank_map,
    flown_map_risk,
    lawnmower_map_risk,
    lawnmower_path_reward,
    risk_if_measured,
)
from auv_lse_shore.judge.planned_paths import PlannedPaths, soundings_by_leg

#: Number of parts of the mission after each of which map risk is computed.
RISK_EVERY = 12

#: Largest number of steps at which the whole-path reward is computed. Its cost of a step grows with the steps before.
#: Beyond it, only methods that maximize this reward (the paper's) get this many; for others the end alone.
WHOLE_STEPS = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Curves:
    """Reward and bounds over joint steps 0..n (n + 1 values; value i is before leg i), in the unit of the costs.

    Attributes:
        stepwise: Realized stepwise reward so far, shape (n + 1,).
        bound: Stepwise reward so far + naive part of Jbar; NaN without naive part or where not computed, (n + 1,).
        whole: Whole-path reward of the locations visited so far, given the data so far, shape (n + 1,);
            in missions of more than `WHOLE_STEPS` legs linear between computed steps (exact at the end).
        whole_bound: Whole-path reward expected if the current plans are carried out; NaN where not computed, (n + 1,).
        naive_value: Whole-path reward expected of a lawnmower mission before the first leg.
        per_vehicle: Stepwise reward of each vehicle's legs, shape (K, n).
        risk: Map risk given the data so far (cost/location); NaN where not computed, shape (n + 1,).
        expected_risk: Map risk expected at the end if only the current plans are carried out, shape (n + 1,).
        mowing_risk: Map risk expected of a lawnmower mission before the first leg; NaN if not computed.
        flown_risk: Map risk that the prior expects of the legs that were travelled; NaN if not computed.
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
    flown_risk: float

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


class _Replay:
    """A mission replayed leg by leg from its soundings; the curves are filled on the way."""

    def __init__(self, run: RunData, settings: Sequence[PlannerSettings], paths: Sequence[PlannedPaths]) -> None:
        self.level_set = LevelSet.of(settings[0].level_set)
        self.gp, self.blank = blank_map(settings[0]), blank_map(settings[0])
        self.paths = paths
        self.soundings = [soundings_by_leg(v, own, run.steps) for v, own in zip(run.vehicles, paths, strict=True)]
        self.decisions = [{d.step: d for d in v.decisions} for v in run.vehicles]
        self.visited, self.prior_visited = np.empty((0, 2)), np.empty(0)
        self._tiles: dict[tuple[int, int], Posterior] = {}  # of the last leg, in a large map

    def risk(self, gp: OnlineGp, locations: Array) -> Array:
        """Bayes risk at locations (P, 2), shape (P,)."""
        return self.level_set.risk(*gp.predict(locations)) if len(locations) else np.empty(0)

    def risk_here(self, locations: Array) -> Array:
        """As `risk`, for the locations (P, 2) of a leg; in a large map it updates the posteriors of the last call."""
        if not self.gp.is_tiled:
            return self.risk(self.gp, locations)
        tiled, before, risk = self.gp.tiled, self._tiles, np.empty(len(locations))
        self._tiles = {tile: tiled.of_tile(tile, start=before.get(tile)) for tile, _ in tiled.tiles(locations)}
        for tile, members in tiled.tiles(locations):
            mean, variance = self._tiles[tile].moments(locations[members])
            risk[members] = self.level_set.risk(mean, np.sqrt(variance))
        return risk

    def ahead(self, step: int) -> tuple[Array, Array] | None:
        """Locations (n, 2) ahead of all vehicles by their plans, searched and naive; None if a plan is missing."""
        plans = [own.get(step) for own in self.decisions]
        if any(plan is None for plan in plans):
            return None
        ahead = [own.ahead(plan) for own, plan in zip(self.paths, plans, strict=True) if plan is not None]
        return (
            np.concatenate([path.own_locations_m for path in ahead]),
            np.concatenate([path.naive_locations_m for path in ahead]),
        )

    def expected(self, planned: Array, others: Array) -> tuple[Array, Array]:
        """Risk now and once `planned` (V, 2) is measured too, at `planned` then `others` (O, 2); (V + O,) each."""
        locations = np.concatenate([planned, others])
        return risk_if_measured(self.gp, planned, self.level_set, locations)

    def bounds(self, step: int) -> tuple[float, float]:
        """Expected reward of the naive part of the plans, and expected whole-path reward; NaN if a plan is missing."""
        if (ahead := self.ahead(step)) is None:
            return np.nan, np.nan
        searched, planned = len(ahead[0]), np.concatenate(ahead)
        before, after = self.expected(planned, self.visited)
        prior = self.risk(self.blank, np.concatenate([planned, self.visited]))
        return float((before - after)[searched : len(planned)].sum()), float((prior - after).sum())

    def map_risk(self, step: int, map_m: Array) -> tuple[float, float]:
        """Map risk over `map_m` (P, 2) now, and expected at the end of the plans (NaN if a plan is missing)."""
        if (ahead := self.ahead(step)) is None:
            return float(self.risk(self.gp, map_m).mean()), np.nan
        planned = np.concatenate(ahead)
        before, after = (risk[len(planned) :] for risk in self.expected(planned, map_m))
        if not self.gp.is_tiled:  # `before` differs by rounding
            before = self.risk(self.gp, map_m)
        return float(before.mean()), float(after.mean())

    def travel(self, step: int) -> tuple[Array, Ints]:
        """Adds the soundings of a leg of all vehicles; drop of risk at each location of it, and index of its
        vehicle."""
        plans = [own.get(step) for own in self.decisions]
        locations = [
            own.leg(plan) if plan is not None else np.empty((0, 2)) for own, plan in zip(self.paths, plans, strict=True)
        ]
        here = np.concatenate(locations)
        before = self.risk_here(here)
        for own in self.soundings:
            self.gp.add_all(own[step].points_m)  # a vehicle's own map discards the same ones, and counts them
        self.visited = np.concatenate([self.visited, here])
        self.prior_visited = np.concatenate([self.prior_visited, self.risk(self.blank, here)])
        owner = np.repeat(np.arange(len(locations)), [len(p) for p in locations])
        return before - self.risk_here(here), owner

    def whole(self) -> float:
        """Whole-path reward of the locations visited so far."""
        return float((self.prior_visited - self.risk(self.gp, self.visited)).sum())


def reward_curves(
    run: RunData, settings: Sequence[PlannerSettings], area: OperatingArea, bounds: int = 34, map_m: Array | None = None
) -> Curves:
    """Replays a mission's reward and bounds from its soundings.

    Args:
        settings: The planner's settings of each vehicle, in order.
        bounds: At most about this many steps get their bounds computed (each takes some 20 ms for 300 locations).
        map_m: Locations (P, 2) over which the map's risk is averaged, at start, end and `RISK_EVERY` times between.
    """
    steps, paths = run.steps, [PlannedPaths(s, area) for s in settings]
    replay = _Replay(run, settings, paths)
    expected = partial(_expected, run, settings, paths, map_m)
    expected_values = run_in_background(expected) if steps * len(paths) > MAX_DENSE else expected
    stepwise = np.zeros(steps + 1)
    bound, whole_bound, risk, expected_risk, whole = (np.full(steps + 1, np.nan) for _ in range(5))
    parts = steps if steps <= WHOLE_STEPS else WHOLE_STEPS if settings[0].planner.entry.of_paper else 1
    whole_at = set(np.linspace(0, steps, parts + 1).round().astype(int).tolist())
    per_vehicle = np.zeros((len(run.vehicles), steps))
    averaged = {round(steps * i / RISK_EVERY) for i in range(RISK_EVERY + 1)}
    augmented = any(d.plan.naive_path != NONE for v in run.vehicles for d in v.decisions)
    chosen = set(np.linspace(0, steps - 1, min(max(bounds, 2), steps)).round().astype(int).tolist()) if steps else set()
    for step in range(steps + 1):
        if map_m is not None and step in averaged:
            risk[step], expected_risk[step] = replay.map_risk(step, map_m)
        if step == steps:
            expected_risk[step] = risk[step]
            break
        if step in chosen:
            naive, whole_bound[step] = replay.bounds(step)
            bound[step] = stepwise[step] + naive if augmented else np.nan
        drop, owner = replay.travel(step)
        per_vehicle[:, step] = np.bincount(owner, drop, minlength=len(paths))
        stepwise[step + 1] = stepwise[step] + drop.sum()
        if step + 1 in whole_at:
            whole[step + 1] = replay.whole()
    whole[0] = 0.0
    known = np.flatnonzero(np.isfinite(whole))
    whole = np.interp(np.arange(steps + 1), known, whole[known])
    bound[steps] = stepwise[steps] if augmented else np.nan
    whole_bound[steps] = whole[steps]
    naive_value, mowing_risk, flown_risk = expected_values()
    return Curves(
        stepwise=stepwise,
        bound=bound,
        whole=whole,
        whole_bound=whole_bound,
        naive_value=naive_value,
        per_vehicle=per_vehicle,
        risk=risk,
        expected_risk=expected_risk,
        mowing_risk=mowing_risk,
        flown_risk=flown_risk,
    )


def _expected(
    run: RunData, settings: Sequence[PlannerSettings], paths: Sequence[PlannedPaths], map_m: Array | None
) -> tuple[float, float, float]:
    """Prior expectations for a lawnmower mission and the legs travelled: `naive_value`, `mowing_risk`, `flown_risk`."""
    value = lawnmower_path_reward(run, settings, paths)
    if map_m is None:
        return value, np.nan, np.nan
    return value, lawnmower_map_risk(run, settings, paths, map_m), flown_map_risk(run, settings, paths, map_m)
