"""The anytime reward of a path: the drop of the map's expected risk, counted more the earlier it comes; its gradient.

R_i is the risk expected on the map M once the own vehicle has travelled i legs: V_i holds the own places of those legs
and the places that team mates will have measured by then, S the data, O places planned on the posterior beforehand.

    R_i = sum over p in M of E r(p | S u O u V_i)                                  (paper: expected Bayes risk)
    J   = sum over legs i of w_i (R_{i-1} - R_i),    w_i = 1 + weight (1 - (step + i) / steps)

`weighted` is J, its standard deviations taken for `doubt` times as large. `end` is J with w = 1 and without doubt: it
telescopes to R_0 - R_L, the drop at the mission's end, which own vehicle and mates bring together. Mates are not
conditioned on beforehand: they measure at their time, as the own vehicle does. What they measure after the own last leg
counts at the end.

R is computed at some legs only, the *checkpoints*, and taken to fall evenly in between, so that J is a sum over
checkpoints. `end` does not depend on them.

**Value.** With all places V in time order (RW2006: Rasmussen and Williams 2006, algorithm 2.1, for new rows),

    W = L^-1 k(X, V),  w = L^-1 k(X, M)        L the factor of data and planned places X
    C = k(V, M) - W^T w,   K = k(V, V) + sigma_n^2 I - W^T W = Lv Lv^T,   Y = Lv^-1 C

the variance left at cell p after the first rows of V is s_q^2 = var(p | S u O) - sum of Y^2 over those rows: one
Cholesky factor for all checkpoints. The risk follows from it by the exact integral (`auv_lse_gp.risk`).

**Gradient.** With g = dE / ds_q^2 (`expected_bayes_risk_slope`), and bars for derivatives of J (reverse mode):

    Ybar = 2 Y x (sum over the checkpoints that include the row of (wbar_j - wbar_{j+1}) g)
    Cbar = Lv^-T Ybar
    Kbar = sym(Lv^-T Phi Lv^-1),    Phi = -(lower triangle of Ybar Y^T, its diagonal halved)
    Xbar = -L^-T (w Cbar^T + 2 W Kbar)
    dJ / dV_i = sum_p Cbar_ip k'(V_i, p) + 2 sum_j Kbar_ij k'(V_i, V_j) + sum_x Xbar_xi k'(V_i, x)

It is the exact gradient of the value that `value_and_gradient` gives, which is coarser than `value`: on a wider grid,
without cells whose risk hardly counts, with fewer checkpoints and with some of the mates' places.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dgemm, dsyrk, dtrmm, strmm
from scipy.linalg.lapack import dpotrf, dtrtri, strtri

from auv_lse_gp.kept import KeptColumns
from auv_lse_gp.posterior import Posterior
from auv_lse_gp.risk import LevelSet
from auv_lse_planner.reward.path import not_positive_definite

Array = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int64]

#: Legs between checkpoints of the exact value, about.
LEGS_APART = 4
#: Checkpoints of the gradient, at most.
GRADIENT_CHECKPOINTS = 10
#: The gradient takes one in so many of a mate's places.
GRADIENT_MATES_EVERY = 3
#: Cells of less risk, as a share of the largest that a place can have, are left out of the value, of the gradient.
NO_RISK = 1e-6
LITTLE_RISK = 5e-3
#: Rows of the blocks in which the cells are conditioned on places.
BLOCK = 64
#: How far (m) a measurement tells of the ground, roughly.
NEAR_M = 30.0


@dataclass(frozen=True, slots=True)
class Value:
    """What a path is worth.

    Attributes:
        weighted: Drops of the map's expected risk, those of early legs counted more, by doubted standard deviations.
        end: Drop of the map's expected risk at the mission's end.
    """

    weighted: float
    end: float


@dataclass(frozen=True, slots=True)
class _Schedule:
    """When places are measured, in legs from now.

    Attributes:
        checkpoints: Legs after which the risk is computed, ascending, the last one the mission's end, (J,).
        weights: Mean of w over the legs that end with each checkpoint, (J,).
    """

    checkpoints: Ints
    weights: Array

    @classmethod
    def of(cls, legs: int, step: int, steps: int, weight: float, count: int) -> _Schedule:
        """`count` checkpoints or fewer over `legs` legs."""
        ends = np.unique(np.rint(np.linspace(0.0, legs, min(count, legs) + 1)).astype(np.int64))[1:]
        of_leg = 1.0 + weight * (1.0 - (step + np.arange(1, legs + 1)) / steps)
        sums = np.concatenate([[0.0], np.cumsum(of_leg)])[np.concatenate([[0], ends])]
        return cls(ends, np.diff(sums) / np.diff(ends, prepend=0))

    def after(self, legs: Array) -> Ints:
        """Number of the first checkpoint at which what is measured after so many legs (P,) is known."""
        return np.asarray(np.minimum(np.searchsorted(self.checkpoints, legs), len(self.checkpoints) - 1))

    @property
    def share(self) -> Array:
        """-dJ / dR at each checkpoint (J,)."""
        following: Array = np.append(self.weights[1:], 0.0)
        return self.weights - following

    @property
    def counting(self) -> Ints:
        """The checkpoints whose risk has a part in J: the last one alone if every leg weighs the same."""
        return np.flatnonzero(self.share)


class AnytimeReward:
    """Anytime reward for one decision: data, mates and time are fixed.

    Attributes:
        legs: Legs that the own vehicle has still to travel.
        risk_before: Risk of the map before the first of them, R_0.
        mates: Of each mate, when it measures, in legs of the own vehicle (P,), and where (P, 2).
    """

    def __init__(
        self,
        kept: KeptColumns,
        level_set: LevelSet,
        mates: Sequence[tuple[Array, Array]],
        legs: int,
        step: int,
        steps: int,
        weight: float,
        coarse: KeptColumns | None = None,
        doubt: float = 1.0,
    ) -> None:
        """Takes the posterior as it stands; places planned on it are taken as measured before the first leg.

        Args:
            kept: The map's places, kept up to date with the posterior.
            level_set: Level and costs; the expected risk is always the exact one.
            mates: Of each mate, the number of legs (P,) that the own vehicle will have travelled when the mate measures
                (it need not be whole), and the places (P, 2) where it does.
            legs: Legs that the own vehicle has still to travel.
            step: Its mission step.
            steps: Steps of the mission.
            weight: How much more a drop of risk counts at the mission's start than at its end.
            coarse: Places of the gradient's map, of the same posterior; None: those of `kept`.
            doubt: `weighted` takes the posterior's standard deviations for so many times as large (`reward/doubt.py`).
        """
        self.legs = legs
        self._kept, self._coarse = kept, coarse or kept
        self._level_set = replace(level_set, method="exact")
        self.mates = [(np.asarray(ahead, float), np.asarray(m, float).reshape(-1, 2)) for ahead, m in mates]
        self._time = (legs, step, steps, weight)
        self._doubt = doubt
        self._exact = self._drop(self._kept, 1, -(-legs // LEGS_APART), NO_RISK, often=False)
        self._rough: _Drop | None = None
        self.risk_before = self._exact.risk_before

    def weighing(self, share: float) -> AnytimeReward:
        """The same with this share of the anytime weight; 0: no more for an early drop of risk than for a late one."""
        legs, step, steps, weight = self._time
        other = copy.copy(self)
        other._time = (legs, step, steps, share * weight)
        other._exact = self._exact.at_weights(*other._time)
        other._rough = self._coarsely().at_weights(*other._time)
        return other

    def _drop(self, kept: KeptColumns, every: int, checkpoints: int, share: float, often: bool) -> _Drop:
        mates = [(ahead[every // 2 :: every], m[every // 2 :: every]) for ahead, m in self.mates]
        legs = np.concatenate([np.zeros(0), *(ahead for ahead, _ in mates)])
        places = np.concatenate([np.zeros((0, 2)), *(m for _, m in mates)])
        scale = len(self._kept.places_m) / len(kept.places_m)
        schedule = _Schedule.of(*self._time, checkpoints)
        return _Drop(kept, self._level_set, legs, places, schedule, share, scale, often, self._doubt)

    def value(self, places_m: Array) -> Value:
        """Value of a path, on all of the map.

        Args:
            places_m: Measurement places of each leg from now on, (L, n, 2); fewer legs than are left are allowed.

        Raises:
            ValueError: for more legs than are left, or if the covariance of the places is not positive definite.
        """
        return self._exact.value(*self._timed(places_m))

    def values(self, many_m: Iterable[Array]) -> list[Value]:
        """`value` of several paths."""
        return [self.value(places_m) for places_m in many_m]

    def value_and_gradient(self, places_m: Array) -> tuple[float, Array]:
        """A coarser `weighted` of a path with all its legs, and its exact gradient.

        Args:
            places_m: Measurement places (L * n, 2) of the L legs that are left, leg after leg.

        Returns:
            The value, and its gradient with respect to the places (L * n, 2), per metre.

        Raises:
            ValueError: for another number of places, or if their covariance is not positive definite.
        """
        places = np.asarray(places_m, dtype=float).reshape(-1, 2)
        if self.legs and (len(places) % self.legs or not len(places)):
            raise ValueError(
                f"places_m: got {len(places)} places; expected the same number on each of {self.legs} legs"
            )
        return self._coarsely().weighted_and_gradient(*self._timed(places.reshape(max(self.legs, 1), -1, 2)))

    def coarse_value(self, places_m: Array) -> float:
        """The value of `value_and_gradient` alone."""
        places = np.asarray(places_m, dtype=float).reshape(-1, 2)
        return self._coarsely().weighted(*self._timed(places.reshape(max(self.legs, 1), -1, 2)))

    def risk_near(self, places_m: Array) -> float:
        """Risk before the first leg within `NEAR_M` of places (P, 2): a guess of what they bring, in no time."""
        return self._coarsely().risk_near(np.asarray(places_m, dtype=float).reshape(-1, 2))

    def _coarsely(self) -> _Drop:
        if self._rough is None:
            count = min(GRADIENT_CHECKPOINTS, -(-self.legs // LEGS_APART))
            self._rough = self._drop(self._coarse, GRADIENT_MATES_EVERY, count, LITTLE_RISK, often=True)
        return self._rough

    def _timed(self, places_m: Array) -> tuple[Array, Array]:
        """Places (P, 2), and the legs (P,) after which each is measured, of a path (L, n, 2)."""
        if len(places_m) > self.legs and np.size(places_m):
            raise ValueError(f"places_m: got {len(places_m)} legs; expected at most the {self.legs} that are left")
        places = np.asarray(places_m, dtype=float)
        each = places.shape[1] if places.ndim == 3 else 1
        return places.reshape(-1, 2), np.repeat(np.arange(1.0, len(places) + 1.0), each)


class _Drop:
    """The drop of risk over one set of cells, checkpoint by checkpoint, with one set of mates' places."""

    def __init__(
        self,
        kept: KeptColumns,
        level_set: LevelSet,
        mate_legs: Array,
        mates_m: Array,
        schedule: _Schedule,
        least_share: float,
        scale: float,
        often: bool,
        doubt: float,
    ) -> None:
        """Prepares what does not depend on the own path.

        Args:
            kept: The cells.
            level_set: Level and costs.
            mate_legs: Own legs travelled when mates measure, (Q,).
            mates_m: Where they do, (Q, 2).
            schedule: Checkpoints and their weights.
            least_share: Cells of a smaller share of the largest risk are left out.
            scale: What a cell counts.
            often: Whether it is asked about so many paths that it pays to invert the posterior's factor.
            doubt: How many times as large standard deviations are taken to be for J.
        """
        self.schedule = schedule
        self._often = often
        self._level_set, self._scale = level_set, scale
        self._posterior = kept.posterior
        columns = kept.columns()
        after = np.minimum(columns.planned_var_m2, columns.data_var_m2)
        risk = level_set.expected_risk(columns.mean_m, np.sqrt(columns.data_var_m2 - after), np.sqrt(after))
        self.risk_before = scale * float(risk.sum())
        doubted, known_risk = columns.mean_m, risk
        if doubt != 1.0:  # the risk depends on (mean - level) / standard deviation alone
            doubted = level_set.level_m + (columns.mean_m - level_set.level_m) / doubt
            risk = level_set.expected_risk(doubted, np.sqrt(columns.data_var_m2 - after), np.sqrt(after))
        counted = np.flatnonzero(risk > least_share * level_set.largest_risk)
        self._places_m = kept.places_m[counted]
        self._risk = np.asarray(risk[counted])
        self._before = float(self._risk.sum())
        self._undoubted = None if doubt == 1.0 else (columns.mean_m[counted], float(known_risk[counted].sum()))
        self._cells = _Cells(
            columns.scaled[counted],
            np.take(columns.white.T, counted, axis=1),
            doubted[counted],
            columns.data_var_m2[counted],
            columns.planned_var_m2[counted],
        )
        self._mate_groups = schedule.after(mate_legs)
        self._mates = _Measured(self._posterior, self._posterior.kernel.scale(mates_m), often)
        self._timetables: dict[bytes, _Timetable] = {}

    def at_weights(self, legs: int, step: int, steps: int, weight: float) -> _Drop:
        """The same with other weights of its checkpoints."""
        other = copy.copy(self)
        other.schedule = _Schedule.of(legs, step, steps, weight, len(self.schedule.checkpoints))
        return other

    def value(self, places_m: Array, legs: Array) -> Value:
        """What a path is worth: J, and the drop of the risk, without doubt, at the mission's end."""
        if not len(places_m) + len(self._mates) or not len(self.schedule.checkpoints):
            return Value(0.0, 0.0)
        left = self._joint(places_m, legs).left(np.arange(len(self.schedule.checkpoints)))
        variance = self._cells.data_var_m2
        risks = self._level_set.risk_sums(self._cells.mean_m, variance, left)
        drops = -self._scale * np.diff(risks, prepend=self._before)
        end = float(drops.sum())
        if self._undoubted is not None:
            mean, before = self._undoubted
            end = self._scale * (before - float(self._level_set.risk_sums(mean, variance, left[-1:])[0]))
        return Value(float(self.schedule.weights @ drops), end)

    def weighted(self, places_m: Array, legs: Array) -> float:
        """J."""
        if not len(places_m) + len(self._mates) or not len(self.schedule.checkpoints):
            return 0.0
        left = self._joint(places_m, legs).left(self.schedule.counting)
        return self._weighted(self._level_set.risk_sums(self._cells.mean_m, self._cells.data_var_m2, left))

    def weighted_and_gradient(self, places_m: Array, legs: Array) -> tuple[float, Array]:
        """J, and its gradient with respect to the own places (P, 2)."""
        if not len(places_m) or not len(self.schedule.checkpoints):
            return 0.0, np.zeros_like(places_m)
        joint, cells, counting = self._joint(places_m, legs), self._cells, self.schedule.counting
        left = joint.left(counting)
        risks, slopes = self._level_set.risk_sums_and_slopes(cells.mean_m, cells.data_var_m2, left)
        slopes *= self._scale * self.schedule.share[counting, None]
        later = np.cumsum(slopes[::-1], axis=0)[::-1]  # of all checkpoints that include a row
        return self._weighted(risks), joint.gradient(later, counting)

    def risk_near(self, places_m: Array) -> float:
        """Risk of the cells that lie near places (P, 2)."""
        off = self._places_m[:, None] - places_m
        near = (np.einsum("mpi,mpi->mp", off, off) < NEAR_M**2).any(axis=1)
        return float(self._risk[near].sum())

    def _joint(self, places_m: Array, legs: Array) -> _Joint:
        key = legs.tobytes()
        if key not in self._timetables:
            groups = self.schedule.after(legs), self._mate_groups
            self._timetables[key] = _Timetable(self._posterior, self._cells, self._mates, *groups)
        own = _Measured(self._posterior, self._posterior.kernel.scale(places_m), self._often)
        return _Joint(self._posterior, self._cells, own, self._timetables[key])

    def _weighted(self, risks: Array) -> float:
        """J of the risks at the checkpoints that count."""
        schedule = self.schedule
        return float(self._scale * (schedule.weights[0] * self._before - schedule.share[schedule.counting] @ risks))


@dataclass(frozen=True)
class _Cells:
    """What the posterior says about the map's cells; see `Columns`, but w is (n, M): a row for each measurement.

    With doubt the mean is as much nearer to the level.
    """

    scaled: Array
    white: Array
    mean_m: Array
    data_var_m2: Array
    planned_var_m2: Array

    @cached_property
    def white_single(self) -> Singles:
        """`white` in single precision."""
        return self.white.astype(np.float32)


class _Measured:
    """Places that will be measured.

    Attributes:
        scaled: The places in the kernel's axes and lengths, (P, 2).
        white: Their whitened covariance with data and planned places, (P, n).
    """

    def __init__(self, posterior: Posterior, scaled: Array, often: bool) -> None:
        """Takes places (P, 2) already scaled; asked `often`, it pays to invert the posterior's factor."""
        self._kernel = posterior.kernel
        self.scaled = scaled
        covariance = posterior.kernel.of_scaled(scaled, posterior.scaled)
        if often and covariance.size:
            dtrmm(1.0, posterior.factor.inverse, covariance.T, lower=1, overwrite_b=1)  # BLAS takes rows for columns
            self.white = covariance
        else:
            self.white = posterior.factor.solve_rows_in_place(covariance)

    def __len__(self) -> int:
        """Number of places."""
        return len(self.scaled)

    def covariance_with_cells(self, cells: _Cells, out: Array) -> Array:
        """Covariance (P, M) with the cells, into `out`."""
        self._kernel.of_scaled(self.scaled, cells.scaled, out)
        if out.size and self.white.shape[1]:
            dgemm(-1.0, cells.white.T, self.white.T, beta=1.0, c=out.T, overwrite_c=1)
        return out


class _Timetable:
    """Own and mates' places in time order, with the mates' part of their covariances; and room to work in.

    What the methods give is overwritten by their next call: memory that is used again need not be asked for and
    cleared, which would take a third of the time.

    Attributes:
        groups: Number of the first checkpoint that includes each place, ascending, (P + Q,).
        own: Rows of the own places, ascending, (P,).
        scaled: All places, once `matrix` has put the own ones in, (P + Q, 2).
        white: Their whitened covariance with data and planned places, (P + Q, n).
        spare: Room of the size of the covariance with the cells, (P + Q, M).
    """

    def __init__(
        self, posterior: Posterior, cells: _Cells, mates: _Measured, own_groups: Ints, mate_groups: Ints
    ) -> None:
        """Sorts the places."""
        groups = np.concatenate([own_groups, mate_groups])
        order = np.argsort(groups, kind="stable")
        self.groups = groups[order]
        rows = np.empty_like(order)
        rows[order] = np.arange(len(order))
        self.own, self._others = rows[: len(own_groups)], rows[len(own_groups) :]
        total, count = len(order), len(cells.mean_m)
        self._kernel, self._noise_m2 = posterior.kernel, posterior.noise_var_m2
        self.scaled, self.white = np.empty((total, 2)), np.empty((total, mates.white.shape[1]))
        self.scaled[self._others], self.white[self._others] = mates.scaled, mates.white
        self._mates_cross = mates.covariance_with_cells(cells, np.empty((len(mates), count)))
        self._matrix = np.empty((total, total))
        self._own_cross, self._cross = np.empty((len(own_groups), count)), np.empty((total, count))
        self.spare = np.empty((total, count), dtype=np.float32)

    def matrix(self, own: _Measured) -> Array:
        """Covariance of all measurements in time order, Fortran-ordered, its lower triangle."""
        self.scaled[self.own], self.white[self.own] = own.scaled, own.white
        self._kernel.among_scaled(self.scaled, self._matrix)
        matrix = self._matrix.T
        np.einsum("ii->i", matrix)[:] += self._noise_m2
        if self.white.shape[1]:
            dsyrk(-1.0, self.white.T, beta=1.0, c=matrix, trans=1, lower=1, overwrite_c=1)
        return matrix

    def cross(self, own: _Measured, cells: _Cells) -> Array:
        """Covariance of all places in time order with the cells, C."""
        if not len(self._others):
            return own.covariance_with_cells(cells, self._cross)
        self._cross[self.own] = own.covariance_with_cells(cells, self._own_cross)
        self._cross[self._others] = self._mates_cross
        return self._cross


class _Joint:
    """Own and mates' places, conditioned on one after another in time order."""

    def __init__(self, posterior: Posterior, cells: _Cells, own: _Measured, timetable: _Timetable) -> None:
        """Factorizes their covariance.

        Raises:
            ValueError: if it is not positive definite.
        """
        self._posterior, self._cells, self._own, self._timetable = posterior, cells, own, timetable
        matrix = timetable.matrix(own)
        self._lower, failed = dpotrf(matrix, lower=1, clean=1, overwrite_a=1)
        if failed:
            raise ValueError(not_positive_definite(len(matrix)))
        self._reductions = _solve_in_place(self._lower, timetable.cross(own, cells))  # Y

    def left(self, checkpoints: Ints) -> Array:
        """Variance left at the cells after each of some checkpoints (J, M), ascending."""
        ends = np.searchsorted(self._timetable.groups, checkpoints, side="right")
        left = np.empty((len(checkpoints), len(self._cells.mean_m)))
        now, begin = self._cells.planned_var_m2, 0
        for j, end in enumerate(ends):
            part = self._reductions[begin:end]
            np.maximum(now - np.einsum("pm,pm->m", part, part), 0.0, out=left[j])
            now, begin = left[j], end
        return left

    def gradient(self, later: Array, checkpoints: Ints) -> Array:
        """Gradient (P, 2) with respect to the own places.

        Only what is not zero is computed of products with triangles, a block of rows at a time, and in single
        precision: half the time, and no search needs a direction to more than the four digits that are left at least.

        Args:
            later: -dJ / ds_q^2 of the cells, summed over each checkpoint and those after it, (J, M).
            checkpoints: Numbers of these checkpoints, the last one among them, (J,).
        """
        kernel, scaled, timetable = self._posterior.kernel, self._own.scaled, self._timetable
        y, lower = self._reductions.astype(np.float32), self._lower.astype(np.float32)
        first = np.searchsorted(checkpoints, timetable.groups)  # that includes a row
        y_bar = np.take(later.astype(np.float32), first, axis=0, out=timetable.spare, mode="clip")
        y_bar *= y
        inverse_v = _inverse(lower)
        phi = np.empty(lower.shape, dtype=np.float32)  # less its factor -1/2, and that of 2 of Ybar; with its transpose
        for begin in range(0, len(y), BLOCK):
            rows, end = slice(begin, begin + BLOCK), min(begin + BLOCK, len(y))
            np.matmul(y_bar[rows], y[:end].T, out=phi[rows, :end])
            phi[:begin, rows] = phi[rows, :begin].T
            phi[rows, rows] = np.tril(phi[rows, rows]) + np.tril(phi[rows, rows], -1).T
        c_bar = np.empty((len(scaled), y.shape[1]), dtype=np.float32)
        k_bar = np.empty((len(scaled), len(y)), dtype=np.float32)
        for begin in range(0, len(scaled), BLOCK):
            own = timetable.own[begin : begin + BLOCK]
            of_own = inverse_v.T[own, own[0] :]  # zero before the first of these rows
            np.matmul(of_own, y_bar[own[0] :], out=c_bar[begin : begin + BLOCK])
            np.matmul(of_own, phi[own[0] :], out=k_bar[begin : begin + BLOCK])
        k_bar = -strmm(1.0, inverse_v, k_bar.T, lower=1, trans_a=1, overwrite_b=1).T
        gradient = kernel.gradient_sums(scaled, c_bar.astype(float), self._cells.scaled)
        gradient += kernel.gradient_sums(scaled, k_bar.astype(float), timetable.scaled)
        if len(self._posterior):
            x_bar = c_bar @ self._cells.white_single.T
            x_bar += k_bar @ timetable.white.astype(np.float32)
            of_data = np.asfortranarray(x_bar.T, dtype=float)
            dtrmm(-1.0, self._posterior.factor.inverse, of_data, lower=1, trans_a=1, overwrite_b=1)
            gradient += kernel.gradient_sums(scaled, of_data.T, self._posterior.scaled)
        return 2.0 * gradient


def _inverse(lower: Singles) -> Singles:
    """L^-1, Fortran-ordered, by products of blocks, much faster than LAPACK's."""
    inverse = np.zeros(lower.shape, dtype=np.float32, order="F")
    for begin in range(0, len(lower), BLOCK):
        rows = slice(begin, begin + BLOCK)
        inverse[rows, rows], _ = strtri(lower[rows, rows], lower=1)
        if begin:
            inverse[rows, :begin] = -inverse[rows, rows] @ (lower[rows, :begin] @ inverse[:begin, :begin])
    return inverse


def _solve_in_place(lower: Array, right: Array) -> Array:
    """L^-1 right, for right (P, M), C-ordered: by products with small inverses, much faster than a triangular solve."""
    for begin in range(0, len(lower) if right.size else 0, BLOCK):
        rows = slice(begin, begin + BLOCK)
        part = right[rows].T  # Fortran-ordered: BLAS works in place
        if begin:
            dgemm(-1.0, right[:begin].T, lower[rows, :begin], beta=1.0, c=part, trans_b=1, overwrite_c=1)
        inverse, _ = dtrtri(lower[rows, rows], lower=1)
        dtrmm(1.0, inverse, part, side=1, lower=1, trans_a=1, overwrite_b=1)
    return right
