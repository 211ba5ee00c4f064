"""The anytime reward of a path, and its gradient: the drop of the map's expected risk, with early drops weighted more.

R_i is the expected risk of the map M after this vehicle's first i legs. V_i are its locations on those legs and the
locations that team mates have measured by then; S is the data, and O are locations already planned on the posterior.

    R_i = sum over p in M of E r(p | S u O u V_i)                                  (paper: expected Bayes risk)
    J   = sum over legs i of w_i (R_{i-1} - R_i),    w_i = 1 + weight (1 - (step + i) / steps)

`weighted` is J, with inflated standard deviations (`reward/std_inflation.py`). `expected_end` is J with w = 1 and
without inflation: it telescopes to R_0 - R_L, the drop that this vehicle and its mates cause by the mission's end.

R is computed at a few legs only, the *checkpoints*, and interpolated linearly in between. J is thus a sum over
checkpoints. `expected_end` does not depend on them.

`reward/joint.py` computes the variance left at the map's cells after each checkpoint, and the gradient of J.

`value_and_gradient` returns a coarser value than `value`, and the exact gradient of that coarser value. It uses a wider
grid, fewer checkpoints and a subset of the mates' positions, and it skips cells of negligible risk. In a large area,
both ignore a path's effect on cells far from it (`reward/near_cells.py`).
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.support.arrays import Array, Ints
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_planner.reward.joint import Cells, JointCovariance, Measured, Timetable
from auv_lse_planner.reward.losses import Loss, Losses, RiskLoss
from auv_lse_planner.reward.near_cells import FEW_CELLS, NearCells

#: Approximate number of legs between checkpoints of the exact value.
CHECKPOINT_LEGS = 4
#: `Weighting.near` without effect.
NO_PREFERENCE = (0.0, 1.0)
#: Further checkpoints if the next legs have more weight.
NEAR_CHECKPOINTS = (2, 4, 7)
#: Largest number of checkpoints of the gradient.
GRADIENT_CHECKPOINTS = 10
#: The gradient uses every n-th of a mate's positions.
GRADIENT_MATES_EVERY = 3
#: The value and the gradient skip cells whose risk, relative to the largest possible, is lower than this.
VALUE_RISK_SHARE = 1e-6
GRADIENT_RISK_SHARE = 5e-3
#: Approximate range (m) over which a measurement reduces the variance.
NEAR_M = 30.0


@dataclass(frozen=True, slots=True)
class Value:
    """The value of a path.

    Attributes:
        weighted: Weighted sum of the drops of the map's expected risk (J), with inflated standard deviations.
        expected_end: Drop of the map's expected risk at the mission's end (paper: Jbar, over the map).
    """

    weighted: float
    expected_end: float


@dataclass(frozen=True, slots=True)
class Weighting:
    """Weight of a drop of risk on each leg: w in J.

    Attributes:
        legs: Legs that this vehicle still has to travel.
        weight: Additional weight of a drop of risk at the mission's start.
        near: Additional weight of a drop of risk on the next leg, and the legs over which it decays by e.
    """

    legs: int
    step: int
    steps: int
    weight: float = 0.0
    near: tuple[float, float] = NO_PREFERENCE

    @property
    def of_leg(self) -> Array:
        """w on each leg, (legs,)."""
        after = np.arange(1, self.legs + 1)
        of_leg = 1.0 + self.weight * (1.0 - (self.step + after) / self.steps)
        return of_leg if not self.near[0] else of_leg + self.near[0] * np.exp(-(after - 1.0) / self.near[1])


@dataclass(frozen=True, slots=True)
class ConstantValue:
    """The part of the value that is the same for all paths of a decision: other ground, the rest of a long mission.

    Attributes:
        risk: Part of the risk before the first leg.
        drop: Part of the drop of the risk at the mission's end.
    """

    risk: float = 0.0
    drop: float = 0.0


@dataclass(frozen=True, slots=True)
class _Schedule:
    """Checkpoints and their weights; times are in legs from now.

    Attributes:
        checkpoints: Legs after which the risk is computed, ascending, the last one the mission's end, (J,).
        weights: Mean of w over the legs that end with each checkpoint, (J,).
    """

    checkpoints: Ints
    weights: Array

    @classmethod
    def of(cls, w: Weighting, count: int) -> _Schedule:
        """At most `count` checkpoints."""
        ends = np.rint(np.linspace(0.0, w.legs, min(count, w.legs) + 1)).astype(np.int64)[1:]
        if w.near[0]:
            ends = np.concatenate([ends, np.minimum(NEAR_CHECKPOINTS, w.legs)])
        return cls(np.unique(ends), np.zeros(0)).weighted_by(w)

    def weighted_by(self, w: Weighting) -> _Schedule:
        """The same checkpoints with other weights."""
        ends = self.checkpoints
        sums = np.concatenate([[0.0], np.cumsum(w.of_leg)])[np.concatenate([[0], ends])]
        return _Schedule(ends, np.diff(sums) / np.diff(ends, prepend=0))

    def after(self, legs: Array) -> Ints:
        """Number of the first checkpoint that includes measurements made after `legs` legs (P,)."""
        return np.asarray(np.minimum(np.searchsorted(self.checkpoints, legs), len(self.checkpoints) - 1))

    @property
    def share(self) -> Array:
        """-dJ / dR at each checkpoint (J,)."""
        following: Array = np.append(self.weights[1:], 0.0)
        return self.weights - following

    @property
    def counting(self) -> Ints:
        """The checkpoints whose risk contributes to J: only the last one if all legs have the same weight."""
        return np.flatnonzero(self.share)


class AnytimeReward:
    """Anytime reward for one decision, with fixed data, mates' positions and time.

    Attributes:
        legs: Legs that this vehicle still has to travel.
        risk_before: Risk of the map before the first of them, R_0.
        mates: For each mate, the times (P,) of its measurements, in legs of this vehicle, and their locations (P, 2).
    """

    def __init__(
        self,
        fine: CachedPoints,
        loss: LevelSetConfig | Loss,
        mates: Sequence[tuple[Array, Array]],
        weighting: Weighting,
        coarse: CachedPoints | None = None,
        inflation: float = 1.0,
        constant: ConstantValue = ConstantValue(),
    ) -> None:
        """Locations planned on the posterior count as measured before the first leg.

        Args:
            fine: The map's locations, kept up to date with the posterior.
            loss: The loss that is summed; level and costs select the Bayes risk.
            mates: For each mate, the times (P,) of its measurements, in legs of this vehicle (may be fractional), and
                their locations (P, 2).
            coarse: Locations at which the gradient is computed; None: those of `fine`.
            inflation: Factor on the posterior's standard deviations in `weighted`.
            constant: Added to the risk before the first leg and to `expected_end`.
        """
        self._constant_drop = constant.drop
        self.legs = weighting.legs
        self._fine, self._coarse = fine, coarse or fine
        self._loss: Loss = RiskLoss(loss) if isinstance(loss, LevelSetConfig) else loss
        self.mates = [(np.asarray(ahead, float), np.asarray(m, float).reshape(-1, 2)) for ahead, m in mates]
        self._weighting, self._inflation = weighting, inflation if self._loss.inflates else 1.0
        checkpoints = -(-self.legs // CHECKPOINT_LEGS)
        self._exact = self._drop(fine, 1, _Schedule.of(weighting, checkpoints), VALUE_RISK_SHARE, cache_inverse=False)
        self._rough: _ExpectedRiskDrop | None = None
        self.risk_before = self._exact.risk_before + constant.risk

    def weighing(self, share: float) -> AnytimeReward:
        """The same reward with a share of the anytime weight; with 0, early and late drops of risk count the same."""
        near = share * self._weighting.near[0], self._weighting.near[1]
        weighting = replace(self._weighting, weight=share * self._weighting.weight, near=near)
        other = copy.copy(self)
        other._weighting = weighting
        other._exact = self._exact.weighted_by(other._weighting)
        other._rough = self._coarse_drop().weighted_by(other._weighting)
        return other

    def _drop(
        self, points: CachedPoints, every: int, schedule: _Schedule, least_share: float, *, cache_inverse: bool
    ) -> _ExpectedRiskDrop:
        """The drop of risk at the given points, with every n-th (`every`) of the mates' positions."""
        mates = [(ahead[every // 2 :: every], m[every // 2 :: every]) for ahead, m in self.mates]
        legs = np.concatenate([np.zeros(0), *(ahead for ahead, _ in mates)])
        locations = np.concatenate([np.zeros((0, 2)), *(m for _, m in mates)])
        scale = len(self._fine.locations_m) / len(points.locations_m)
        counted = _RelevantCells.of(points, self._loss, self._inflation, least_share, scale)
        measured = Measured(points.posterior, points.posterior.kernel.scale(locations), cache_inverse)
        groups = schedule.after(legs)
        return _ExpectedRiskDrop(points.posterior, counted, schedule, measured, groups, cache_inverse)

    def value(self, locations_m: Array) -> Value:
        """Value of a path over the whole map.

        Args:
            locations_m: Measurement locations of each leg from now on, (L, n, 2); L may be less than the remaining
                legs.

        Raises:
            ValueError: for more legs than remain, or if the covariance of the locations is not positive definite.
        """
        value = self._exact.value(*self._timed(locations_m))
        return replace(value, expected_end=value.expected_end + self._constant_drop)

    def value_and_gradient(self, locations_m: Array) -> tuple[float, Array]:
        """A coarser `weighted` of a path over all remaining legs, and its exact gradient.

        Args:
            locations_m: Measurement locations (L * n, 2) of the L remaining legs, leg after leg.

        Returns:
            The value, and its gradient with respect to the locations (L * n, 2), per metre.

        Raises:
            ValueError: for a wrong number of locations, or if their covariance is not positive definite.
        """
        locations = np.asarray(locations_m, dtype=float).reshape(-1, 2)
        if self.legs and (len(locations) % self.legs or not len(locations)):
            raise ValueError(f"locations_m: {len(locations)} locations cannot be divided evenly among {self.legs} legs")
        return self._coarse_drop().weighted_and_gradient(*self._timed(locations.reshape(max(self.legs, 1), -1, 2)))

    def coarse_value(self, locations_m: Array) -> float:
        """The value of `value_and_gradient` alone."""
        locations = np.asarray(locations_m, dtype=float).reshape(-1, 2)
        return self._coarse_drop().weighted(*self._timed(locations.reshape(max(self.legs, 1), -1, 2)))

    def risk_near(self, locations_m: Array) -> float:
        """Risk before the first leg within `NEAR_M` of locations (P, 2): a fast estimate of their benefit."""
        return self._coarse_drop().risk_near(np.asarray(locations_m, dtype=float).reshape(-1, 2))

    def _coarse_drop(self) -> _ExpectedRiskDrop:
        if self._rough is None:
            schedule = _Schedule.of(self._weighting, min(GRADIENT_CHECKPOINTS, -(-self.legs // CHECKPOINT_LEGS)))
            self._rough = self._drop(
                self._coarse, GRADIENT_MATES_EVERY, schedule, GRADIENT_RISK_SHARE, cache_inverse=True
            )
        return self._rough

    def _timed(self, locations_m: Array) -> tuple[Array, Array]:
        """Locations (P, 2), and the legs (P,) after which each is measured, of a path (L, n, 2)."""
        if len(locations_m) > self.legs and np.size(locations_m):
            raise ValueError(f"locations_m has {len(locations_m)} legs, but only {self.legs} remain")
        locations = np.asarray(locations_m, dtype=float)
        each = locations.shape[1] if locations.ndim == 3 else 1
        return locations.reshape(-1, 2), np.repeat(np.arange(1.0, len(locations) + 1.0), each)


@dataclass(frozen=True, slots=True)
class _RelevantCells:
    """The cells of a map whose loss is not negligible.

    Attributes:
        locations_m: Their locations, (M, 2).
        losses: Their losses, with inflation.
        uninflated: Their losses without inflation; None if there is no inflation.
        scale: Weight of a cell.
        total: Weighted loss of all cells of the map, without inflation.
    """

    cells: Cells
    locations_m: Array
    losses: Losses
    uninflated: Losses | None
    scale: float
    total: float

    @classmethod
    def of(cls, points: CachedPoints, loss: Loss, inflation: float, least_share: float, scale: float) -> _RelevantCells:
        """Selects the cells with more than `least_share` of the largest possible loss."""
        known = losses = loss.of(points, scale)
        if inflation != 1.0:
            losses = loss.of(points, scale, inflation)
        now = points.current()
        kept = np.flatnonzero(losses.before > least_share * losses.largest)
        cells = Cells(
            now.scaled[kept],
            np.take(now.white.T, kept, axis=1),
            now.mean_m[kept],
            now.data_var_m2[kept],
            now.planned_var_m2[kept],
        )
        uninflated = None if inflation == 1.0 else known.take(kept)
        total = scale * float(known.before.sum())
        return cls(cells, points.locations_m[kept], losses.take(kept), uninflated, scale, total)

    def take(self, kept: Ints) -> _RelevantCells:
        """Some of the cells."""
        uninflated = None if self.uninflated is None else self.uninflated.take(kept)
        cells, losses = self.cells.take(kept), self.losses.take(kept)
        return replace(self, cells=cells, locations_m=self.locations_m[kept], losses=losses, uninflated=uninflated)


@dataclass(frozen=True, slots=True)
class _NearPath:
    """The counted cells that a path can change.

    Attributes:
        kept: Their numbers; None: all cells.
        elsewhere: Sums of the other cells' losses after some checkpoints, given the mates' positions, (J,) or ().
        elsewhere_at_end: The same at the last of them, without inflation.
    """

    counted: _RelevantCells
    kept: Ints | None
    elsewhere: Array
    elsewhere_at_end: float


@dataclass(frozen=True, slots=True)
class _GivenMates:
    """Variance of each cell after each checkpoint given the mates' positions alone, and sums of the cells' losses.

    Attributes:
        left_m2: Variance left (J, M); (1, M) without mates.
        sums: Sums of the cells' losses, (J,) or (1,).
        sum_at_end: The same at the end, without inflation.
    """

    left_m2: Array
    sums: Array
    sum_at_end: float


class _ExpectedRiskDrop:
    """The drop of risk over one set of cells at each checkpoint, with one set of mates' positions."""

    def __init__(
        self,
        posterior: Posterior,
        counted: _RelevantCells,
        schedule: _Schedule,
        mates: Measured,
        mate_groups: Ints,
        cache_inverse: bool,
    ) -> None:
        """Prepares all terms that do not depend on this vehicle's path.

        Args:
            mates: Measurement positions of the mates, (Q,).
            mate_groups: Number of the first checkpoint that includes each of their locations, (Q,).
            cache_inverse: Whether to invert the posterior's factor, which is faster for many paths.
        """
        self.schedule, self.risk_before = schedule, counted.total
        self._posterior, self._cache_inverse = posterior, cache_inverse
        self._counted, self._cells, self._scale = counted, counted.cells, counted.scale
        self._before = float(counted.losses.before.sum())
        self._before_without_inflation = float((counted.uninflated or counted.losses).before.sum())
        self._mates, self._mate_groups = mates, mate_groups
        self._timetables: dict[bytes, Timetable] = {}

    def weighted_by(self, weighting: Weighting) -> _ExpectedRiskDrop:
        """A copy with other weights of the checkpoints."""
        other = copy.copy(self)
        other.schedule = self.schedule.weighted_by(weighting)
        return other

    def value(self, locations_m: Array, legs: Array) -> Value:
        """Value of a path: J, and the drop of the risk at the mission's end without inflation."""
        if not len(locations_m) + len(self._mates) or not len(self.schedule.checkpoints):
            return Value(0.0, 0.0)
        checkpoints = np.arange(len(self.schedule.checkpoints))
        near = self._near(locations_m, checkpoints)
        left = self._joint(locations_m, legs, near).left(checkpoints)
        risks = near.counted.losses.sums(left) + near.elsewhere
        drops = -self._scale * np.diff(risks, prepend=self._before)
        end = float(drops.sum())
        if near.counted.uninflated is not None:
            after = float(near.counted.uninflated.sums(left[-1:])[0]) + near.elsewhere_at_end
            end = self._scale * (self._before_without_inflation - after)
        return Value(float(self.schedule.weights @ drops), end)

    def weighted(self, locations_m: Array, legs: Array) -> float:
        """J of a path, without the drop at the mission's end."""
        if not len(locations_m) + len(self._mates) or not len(self.schedule.checkpoints):
            return 0.0
        counting = self.schedule.counting
        near = self._near(locations_m, counting)
        left = self._joint(locations_m, legs, near).left(counting)
        return self._weighted(near.counted.losses.sums(left) + near.elsewhere)

    def weighted_and_gradient(self, locations_m: Array, legs: Array) -> tuple[float, Array]:
        """J, and its gradient with respect to this vehicle's positions (P, 2)."""
        if not len(locations_m) or not len(self.schedule.checkpoints):
            return 0.0, np.zeros_like(locations_m)
        counting = self.schedule.counting
        near = self._near(locations_m, counting)
        joint = self._joint(locations_m, legs, near)
        left = joint.left(counting)
        risks, slopes = near.counted.losses.sums_and_slopes(left)
        slopes *= self._scale * self.schedule.share[counting, None]
        later = np.cumsum(slopes[::-1], axis=0)[::-1]  # of all checkpoints that include a row
        return self._weighted(risks + near.elsewhere), joint.gradient(later, counting)

    def risk_near(self, locations_m: Array) -> float:
        """Risk of the cells near locations (P, 2)."""
        off = self._counted.locations_m[:, None] - locations_m
        near = (np.einsum("mpi,mpi->mp", off, off) < NEAR_M**2).any(axis=1)
        return float(self._counted.losses.before[near].sum())

    def _near(self, locations_m: Array, checkpoints: Ints) -> _NearPath:
        """The cells near a path, and the others' losses after some checkpoints; all cells if there are few."""
        every = self._counted
        if len(every.locations_m) <= FEW_CELLS:
            return _NearPath(every, None, np.zeros(()), 0.0)
        kept, mates = self._cells_near.of(self._posterior.kernel.scale(locations_m)), self._given_mates
        near, rows = every.take(kept), checkpoints if len(self._mates) else slice(None)
        left_m2 = np.ascontiguousarray(mates.left_m2[rows][:, kept])
        at_end = 0.0
        if near.uninflated is not None:
            at_end = mates.sum_at_end - float(near.uninflated.sums(left_m2[-1:])[0])
        return _NearPath(near, kept, mates.sums[rows] - near.losses.sums(left_m2), at_end)

    @cached_property
    def _cells_near(self) -> NearCells:
        return NearCells(self._posterior.kernel, self._cells.scaled)

    @cached_property
    def _given_mates(self) -> _GivenMates:
        left_m2, known = self._cells.planned_var_m2[None], self._counted.uninflated
        if len(self._mates):
            every = _NearPath(self._counted, None, np.zeros(()), 0.0)
            left_m2 = self._joint(np.empty((0, 2)), np.empty(0), every).left(np.arange(len(self.schedule.checkpoints)))
        sum_at_end = 0.0 if known is None else float(known.sums(left_m2[-1:])[0])
        return _GivenMates(left_m2, self._counted.losses.sums(left_m2), sum_at_end)

    def _joint(self, locations_m: Array, legs: Array, near: _NearPath) -> JointCovariance:
        key = legs.tobytes()
        if key not in self._timetables:
            groups = self.schedule.after(legs), self._mate_groups
            self._timetables[key] = Timetable(self._posterior, self._cells, self._mates, *groups)
        own = Measured(self._posterior, self._posterior.kernel.scale(locations_m), self._cache_inverse)
        return JointCovariance(self._posterior, near.counted.cells, own, self._timetables[key], near.kept)

    def _weighted(self, risks: Array) -> float:
        """J from the risks at the contributing checkpoints."""
        schedule = self.schedule
        return float(self._scale * (schedule.weights[0] * self._before - schedule.share[schedule.counting] @ risks))
