"""The anytime reward of a path: the drop of the map's expected risk, counted more the earlier it comes; its gradient.

R_i is the risk expected on the map M once the own vehicle has travelled i legs: V_i holds the own places of those legs
and the places that team mates will have measured by then, S the data, O places planned on the posterior beforehand.

    R_i = sum over p in M of E r(p | S u O u V_i)                                  (paper: expected Bayes risk)
    J   = sum over legs i of w_i (R_{i-1} - R_i),    w_i = 1 + weight (1 - (step + i) / steps)

`weighted` is J. `end` is J with w = 1: it telescopes to R_0 - R_L, the drop at the mission's end, which own vehicle and
mates bring together. Mates are not conditioned on beforehand: they measure at their time, as the own vehicle does. What
they measure after the own last leg counts at the end.

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

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dgemm, dtrmm
from scipy.linalg.lapack import dpotrf, dtrtri

from auv_lse_gp.kept import KeptColumns
from auv_lse_gp.posterior import Posterior
from auv_lse_gp.risk import LevelSet
from auv_lse_planner.reward.path import not_positive_definite

Array = NDArray[np.float64]
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
        weighted: Drops of the map's expected risk, those of early legs counted more.
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


class AnytimeReward:
    """Anytime reward for one decision: data, mates and time are fixed.

    Attributes:
        legs: Legs that the own vehicle has still to travel.
        risk_before: Risk of the map before the first of them, R_0.
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
        """
        self.legs = legs
        self._kept, self._coarse = kept, coarse or kept
        self._level_set = replace(level_set, method="exact")
        self._mates = [(np.asarray(ahead, float), np.asarray(m, float).reshape(-1, 2)) for ahead, m in mates]
        self._time = (legs, step, steps, weight)
        self._exact = self._drop(self._kept, 1, -(-legs // LEGS_APART), NO_RISK)
        self._rough: _Drop | None = None
        self.risk_before = self._exact.risk_before

    def of_the_end(self) -> AnytimeReward:
        """The same with no more for an early drop of risk than for a late one: w = 1."""
        legs, step, steps, _ = self._time
        return AnytimeReward(self._kept, self._level_set, self._mates, legs, step, steps, 0.0, self._coarse)

    def _drop(self, kept: KeptColumns, every: int, checkpoints: int, share: float) -> _Drop:
        mates = [(ahead[every // 2 :: every], m[every // 2 :: every]) for ahead, m in self._mates]
        legs = np.concatenate([np.zeros(0), *(ahead for ahead, _ in mates)])
        places = np.concatenate([np.zeros((0, 2)), *(m for _, m in mates)])
        scale = len(self._kept.places_m) / len(kept.places_m)
        schedule = _Schedule.of(*self._time, checkpoints)
        return _Drop(kept, self._level_set, legs, places, schedule, share, scale)

    def value(self, places_m: Array) -> Value:
        """Value of a path, on all of the map.

        Args:
            places_m: Measurement places of each leg from now on, (L, n, 2); fewer legs than are left are allowed.

        Raises:
            ValueError: for more legs than are left, or if the covariance of the places is not positive definite.
        """
        drops = self._exact.drops(*self._timed(places_m))
        return Value(float(self._exact.schedule.weights @ drops), float(drops.sum()))

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
        drops = self._coarsely().drops(*self._timed(places.reshape(max(self.legs, 1), -1, 2)))
        return float(self._coarsely().schedule.weights @ drops)

    def risk_near(self, places_m: Array) -> float:
        """Risk before the first leg within `NEAR_M` of places (P, 2): a guess of what they bring, in no time."""
        return self._coarsely().risk_near(np.asarray(places_m, dtype=float).reshape(-1, 2))

    def risk_left(self, places_m: Array) -> tuple[Array, Array]:
        """Where risk is expected to be left at the mission's end: cells (M, 2) of the gradient's map, their risk (M,).

        Args:
            places_m: Measurement places (L * n, 2) of the L legs that are left, leg after leg.
        """
        places = np.asarray(places_m, dtype=float).reshape(-1, 2)
        return self._coarsely().risk_left(*self._timed(places.reshape(max(self.legs, 1), -1, 2)))

    def _coarsely(self) -> _Drop:
        if self._rough is None:
            count = min(GRADIENT_CHECKPOINTS, -(-self.legs // LEGS_APART))
            self._rough = self._drop(self._coarse, GRADIENT_MATES_EVERY, count, LITTLE_RISK)
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
        """
        self.schedule = schedule
        self._level_set, self._scale = level_set, scale
        self._posterior = kept.posterior
        columns = kept.columns()
        after = np.minimum(columns.planned_var_m2, columns.data_var_m2)
        risk = level_set.expected_risk(columns.mean_m, np.sqrt(columns.data_var_m2 - after), np.sqrt(after))
        self.risk_before = scale * float(risk.sum())
        counted = np.flatnonzero(risk > least_share * level_set.largest_risk)
        self._places_m = kept.places_m[counted]
        self._risk = np.asarray(risk[counted])
        self._before = float(self._risk.sum())
        self._cells = _Cells(
            columns.scaled[counted],
            np.ascontiguousarray(columns.white.T[:, counted]),
            columns.mean_m[counted],
            columns.data_var_m2[counted],
            columns.planned_var_m2[counted],
        )
        self._mate_groups = schedule.after(mate_legs)
        self._mates = _Measured(self._posterior, self._posterior.kernel.scale(mates_m))
        self._timetables: dict[bytes, _Timetable] = {}

    def drops(self, places_m: Array, legs: Array) -> Array:
        """Drop of risk up to each checkpoint since the one before (J,)."""
        if not len(places_m) + len(self._mates):
            return np.zeros(len(self.schedule.checkpoints))
        left = self._joint(places_m, legs).left(len(self.schedule.checkpoints))
        return self._drops(self._level_set.risk_sums(self._cells.mean_m, self._cells.data_var_m2, left))

    def weighted_and_gradient(self, places_m: Array, legs: Array) -> tuple[float, Array]:
        """J, and its gradient with respect to the own places (P, 2)."""
        if not len(places_m) or not len(self.schedule.checkpoints):
            return 0.0, np.zeros_like(places_m)
        joint, cells = self._joint(places_m, legs), self._cells
        left = joint.left(len(self.schedule.checkpoints))
        risks, slopes = self._level_set.risk_sums_and_slopes(cells.mean_m, cells.data_var_m2, left)
        slopes *= self._scale * self.schedule.share[:, None]
        later = np.cumsum(slopes[::-1], axis=0)[::-1]  # of all checkpoints that include a row
        return float(self.schedule.weights @ self._drops(risks)), joint.gradient(later)

    def risk_near(self, places_m: Array) -> float:
        """Risk of the cells that lie near places (P, 2)."""
        off = self._places_m[:, None] - places_m
        near = (np.einsum("mpi,mpi->mp", off, off) < NEAR_M**2).any(axis=1)
        return float(self._risk[near].sum())

    def risk_left(self, places_m: Array, legs: Array) -> tuple[Array, Array]:
        """The cells (M, 2), and their expected risk (M,) after the last checkpoint."""
        cells = self._cells
        left = np.minimum(self._joint(places_m, legs).left(len(self.schedule.checkpoints))[-1], cells.data_var_m2)
        risk = self._level_set.expected_risk(cells.mean_m, np.sqrt(cells.data_var_m2 - left), np.sqrt(left))
        return self._places_m, np.asarray(risk)

    def _joint(self, places_m: Array, legs: Array) -> _Joint:
        key = legs.tobytes()
        if key not in self._timetables:
            groups = self.schedule.after(legs), self._mate_groups
            self._timetables[key] = _Timetable(self._posterior, self._cells, self._mates, *groups)
        own = _Measured(self._posterior, self._posterior.kernel.scale(places_m))
        return _Joint(self._posterior, self._cells, own, self._timetables[key])

    def _drops(self, risks: Array) -> Array:
        return np.asarray(-self._scale * np.diff(risks, prepend=self._before))


@dataclass(frozen=True, slots=True)
class _Cells:
    """What the posterior says about the map's cells; see `Columns`, but w is (n, M): a row for each measurement."""

    scaled: Array
    white: Array
    mean_m: Array
    data_var_m2: Array
    planned_var_m2: Array


class _Measured:
    """Places that will be measured.

    Attributes:
        scaled: The places in the kernel's axes and lengths, (P, 2).
        white: Their whitened covariance with data and planned places, (P, n).
    """

    def __init__(self, posterior: Posterior, scaled: Array) -> None:
        """Takes places (P, 2) already scaled."""
        self._kernel = posterior.kernel
        self.scaled = scaled
        self.white = posterior.factor.solve_rows_in_place(posterior.kernel.of_scaled(scaled, posterior.scaled))

    def __len__(self) -> int:
        """Number of places."""
        return len(self.scaled)

    def covariance(self, other: _Measured) -> Array:
        """Covariance (P, Q) with other places, without noise."""
        prior: Array = self._kernel.of_scaled(self.scaled, other.scaled)
        return prior - self.white @ other.white.T if self.white.shape[1] else prior

    def covariance_with_cells(self, cells: _Cells, out: Array) -> Array:
        """Covariance (P, M) with the cells, into `out`."""
        self._kernel.of_scaled(self.scaled, cells.scaled, out)
        if out.size and self.white.shape[1]:
            dgemm(-1.0, cells.white.T, self.white.T, beta=1.0, c=out.T, overwrite_c=1)  # BLAS takes rows for columns
        return out


class _Timetable:
    """Own and mates' places in time order, with the mates' part of their covariances; and room to work in.

    Attributes:
        mates: The mates' places.
        groups: Number of the first checkpoint that includes each place, ascending, (P + Q,).
        order: Number of each place among own and then mates', (P + Q,).
        own: Rows of the own places, (P,).
        others: Rows of the mates' places, (Q,).
    """

    def __init__(
        self, posterior: Posterior, cells: _Cells, mates: _Measured, own_groups: Ints, mate_groups: Ints
    ) -> None:
        """Sorts the places."""
        groups = np.concatenate([own_groups, mate_groups])
        self.mates = mates
        self.order = np.argsort(groups, kind="stable")
        self.groups = groups[self.order]
        rows = np.empty_like(self.order)
        rows[self.order] = np.arange(len(self.order))
        self.own, self.others = rows[: len(own_groups)], rows[len(own_groups) :]
        total, count = len(self.order), len(cells.mean_m)
        self._mates_cross = mates.covariance_with_cells(cells, np.empty((len(mates), count)))
        self._matrix = np.zeros((total, total))
        self._matrix[np.ix_(self.others, self.others)] = mates.covariance(mates)
        self._matrix[np.diag_indices(total)] += posterior.noise_var_m2
        # Memory that is used again need not be asked for and cleared: a third of the time.
        self._own_cross, self._cross = np.empty((len(own_groups), count)), np.empty((total, count))
        self.spare = np.empty((total, count))

    def matrix(self, own: _Measured) -> Array:
        """Covariance of all measurements in time order, its lower triangle."""
        matrix = self._matrix.copy()
        if not len(self.others):
            matrix += own.covariance(own)
            return matrix
        matrix[np.ix_(self.own, self.own)] += own.covariance(own)
        both = own.covariance(self.mates)
        matrix[np.ix_(self.own, self.others)] = both
        matrix[np.ix_(self.others, self.own)] = both.T
        return matrix

    def cross(self, own: _Measured, cells: _Cells) -> Array:
        """Covariance of all places in time order with the cells, C; overwritten by the next call."""
        if not len(self.others):
            return own.covariance_with_cells(cells, self._cross)
        self._cross[self.own] = own.covariance_with_cells(cells, self._own_cross)
        self._cross[self.others] = self._mates_cross
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
        self._lower, failed = dpotrf(matrix.T, lower=1, clean=1, overwrite_a=1)  # symmetric; Fortran-ordered
        if failed:
            raise ValueError(not_positive_definite(len(matrix)))
        self._reductions = _solve_in_place(self._lower, timetable.cross(own, cells))  # Y

    def left(self, checkpoints: int) -> Array:
        """Variance left at the cells after each checkpoint (J, M)."""
        bounds = np.searchsorted(self._timetable.groups, np.arange(checkpoints + 1))
        left = np.empty((checkpoints, len(self._cells.mean_m)))
        now = self._cells.planned_var_m2
        for j in range(checkpoints):
            part = self._reductions[bounds[j] : bounds[j + 1]]
            np.maximum(now - np.einsum("pm,pm->m", part, part), 0.0, out=left[j])
            now = left[j]
        return left

    def gradient(self, later: Array) -> Array:
        """Gradient (P, 2) with respect to the own places.

        Args:
            later: -dJ / ds_q^2 of the cells, summed over each checkpoint and those after it, (J, M).
        """
        kernel, scaled, timetable = self._posterior.kernel, self._own.scaled, self._timetable
        y_bar = np.take(later, timetable.groups, axis=0, out=timetable.spare, mode="clip")
        y_bar *= self._reductions
        lower = np.tril(y_bar @ self._reductions.T)  # halves: the factor 2 of Ybar comes last
        lower[np.diag_indices(len(lower))] *= 0.5
        inverse, _ = dtrtri(self._lower, lower=1)
        of_own = np.ascontiguousarray(inverse[:, timetable.own].T)
        c_bar = of_own @ y_bar
        k_bar = of_own @ (-0.5 * (lower + lower.T)) @ inverse  # Phi and its transpose first: own rows are enough
        every = np.concatenate([scaled, timetable.mates.scaled])[timetable.order]
        gradient = kernel.gradient_sums(scaled, c_bar, self._cells.scaled)
        gradient += kernel.gradient_sums(scaled, 2.0 * k_bar, every)
        if len(self._posterior):
            white = np.concatenate([self._own.white, timetable.mates.white])[timetable.order]
            both = self._cells.white @ c_bar.T + 2.0 * (white.T @ k_bar.T)
            x_bar = -self._posterior.factor.solve_transposed(both)
            gradient += kernel.gradient_sums(scaled, x_bar.T, self._posterior.scaled)
        return 2.0 * gradient


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
