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
from scipy.linalg.lapack import dpotrf, dtrtri

from auv_lse_gp.columns import Columns
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
NO_RISK = 1e-9
LITTLE_RISK = 1e-3


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
        return np.asarray(self.weights - np.append(self.weights[1:], 0.0))


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
            mates: Of each mate, the places (P, 2) that it has still to visit, and the number of legs (P,) that the own
                vehicle will have travelled when the mate measures there; it need not be whole.
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
        if self._rough is None:
            count = min(GRADIENT_CHECKPOINTS, -(-self.legs // LEGS_APART))
            self._rough = self._drop(self._coarse, GRADIENT_MATES_EVERY, count, LITTLE_RISK)
        return self._rough.weighted_and_gradient(*self._timed(places.reshape(max(self.legs, 1), -1, 2)))

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
        risk = _expected(level_set, columns, columns.planned_var_m2)
        self.risk_before = scale * float(risk.sum())
        counts = np.flatnonzero(risk > least_share * level_set.largest_risk)
        self._cells = columns.take(counts)
        self._cells_white = np.ascontiguousarray(self._cells.white.T)
        self._before = risk[counts]
        self._mate_groups = schedule.after(mate_legs)
        self._mates = _Measured(self._posterior, self._posterior.kernel.scale(mates_m), self._cells, self._cells_white)
        self._mates_own = self._mates.covariance(self._mates)

    def drops(self, places_m: Array, legs: Array) -> Array:
        """Drop of risk up to each checkpoint since the one before (J,)."""
        if not len(self.schedule.checkpoints):
            return np.zeros(0)
        joint = _Joint(self, places_m, legs)
        return self._drops(joint.left())

    def weighted_and_gradient(self, places_m: Array, legs: Array) -> tuple[float, Array]:
        """J, and its gradient with respect to the own places (P, 2)."""
        if not len(places_m) or not len(self.schedule.checkpoints):
            return 0.0, np.zeros_like(places_m)
        joint = _Joint(self, places_m, legs)
        left = joint.left()
        slopes = self._level_set.expected_risk_slope(
            self._cells.mean_m, np.sqrt(self._cells.data_var_m2 - left), np.sqrt(left)
        )
        slopes *= self._scale * self.schedule.share[:, None]
        later = np.cumsum(slopes[::-1], axis=0)[::-1]  # of all checkpoints that include a row
        value = float(self.schedule.weights @ self._drops(left))
        return value, joint.gradient(later)

    def _drops(self, left: Array) -> Array:
        risks = _expected(self._level_set, self._cells, left)
        return np.asarray(-self._scale * np.diff(risks.sum(axis=1), prepend=self._before.sum()))


class _Measured:
    """Places that will be measured, with what the posterior says of them and of the cells together.

    Attributes:
        scaled: The places in the kernel's axes and lengths, (P, 2).
        white: Their whitened covariance with data and planned places, (P, n).
        cross: Their covariance with the cells, C (P, M).
    """

    def __init__(self, posterior: Posterior, scaled: Array, cells: Columns, cells_white: Array) -> None:
        """Takes places (P, 2) already scaled."""
        kernel = posterior.kernel
        self._kernel = kernel
        self.scaled = scaled
        self.white = posterior.factor.solve_rows_in_place(kernel.of_scaled(scaled, posterior.scaled))
        self.cross = kernel.of_scaled(scaled, cells.scaled)
        if self.white.shape[1]:
            self.cross -= self.white @ cells_white

    def __len__(self) -> int:
        """Number of places."""
        return len(self.scaled)

    def covariance(self, other: _Measured) -> Array:
        """Covariance with other places, without noise."""
        own: Array = self._kernel.of_scaled(self.scaled, other.scaled)
        return own - self.white @ other.white.T if self.white.shape[1] else own


class _Joint:
    """Own and mates' places in time order, conditioned on one after another."""

    def __init__(self, drop: _Drop, places_m: Array, legs: Array) -> None:
        """Factorizes their covariance.

        Raises:
            ValueError: if it is not positive definite.
        """
        self._drop, self._posterior = drop, drop._posterior
        mates = drop._mates
        own = _Measured(self._posterior, self._posterior.kernel.scale(places_m), drop._cells, drop._cells_white)
        groups = np.concatenate([drop.schedule.after(legs), drop._mate_groups])
        order = np.argsort(groups, kind="stable")
        self._own, self._mates = own, mates
        self._groups, self._order = groups[order], order
        rows = np.empty(len(order), dtype=np.int64)
        rows[order] = np.arange(len(order))
        self._rows = rows[: len(own)]  # of the own places, in time order
        count, total = len(own), len(order)
        matrix = np.empty((total, total))
        matrix[:count, :count] = own.covariance(own)
        if len(mates):
            matrix[count:, :count] = mates.covariance(own)
            matrix[:count, count:] = matrix[count:, :count].T
            matrix[count:, count:] = drop._mates_own
        matrix[np.diag_indices(total)] += self._posterior.noise_var_m2
        cross = np.concatenate([own.cross, mates.cross])
        if len(mates):
            matrix, cross = matrix[np.ix_(order, order)], cross[order]
        lower, failed = dpotrf(matrix, lower=1, clean=1)
        if failed:
            raise ValueError(not_positive_definite(total))
        self._inverse, _ = dtrtri(lower, lower=1)  # products with it run four times as fast as triangular solves
        self._reductions: Array = self._inverse @ cross  # Y

    def left(self) -> Array:
        """Variance left at the cells after each checkpoint (J, M)."""
        cells, count = self._drop._cells, len(self._drop.schedule.checkpoints)
        bounds = np.searchsorted(self._groups, np.arange(count + 1))
        left = np.empty((count, len(cells)))
        now = cells.planned_var_m2
        for j in range(count):
            part = self._reductions[bounds[j] : bounds[j + 1]]
            now = np.maximum(now - np.einsum("pm,pm->m", part, part), 0.0)
            left[j] = now
        return left

    def gradient(self, later: Array) -> Array:
        """Gradient (P, 2) with respect to the own places.

        Args:
            later: -dJ / ds_q^2 of the cells, summed over each checkpoint and those after it, (J, M).
        """
        kernel, cells, own = self._posterior.kernel, self._drop._cells, self._rows
        reductions, inverse = self._reductions, self._inverse
        y_bar = 2.0 * reductions * later[self._groups]
        phi = -np.tril(y_bar @ reductions.T)
        phi[np.diag_indices(len(phi))] *= 0.5
        c_bar = inverse[:, own].T @ y_bar
        k_bar = inverse.T @ phi @ inverse
        k_bar = (0.5 * (k_bar + k_bar.T))[own]
        every = np.concatenate([self._own.scaled, self._mates.scaled])[self._order]
        gradient = kernel.gradient_sums(self._own.scaled, c_bar, cells.scaled)
        gradient += kernel.gradient_sums(self._own.scaled, 2.0 * k_bar, every)
        if len(self._posterior):
            white = np.concatenate([self._own.white, self._mates.white])[self._order]
            both = self._drop._cells_white @ c_bar.T + 2.0 * (white.T @ k_bar.T)
            x_bar = -self._posterior.factor.solve_transposed(both)
            gradient += kernel.gradient_sums(self._own.scaled, x_bar.T, self._posterior.scaled)
        return gradient


def _expected(level_set: LevelSet, cells: Columns, left: Array) -> Array:
    """Expected risk (..., M) at the cells once the variances (..., M) are left."""
    after = np.minimum(left, cells.data_var_m2)
    return level_set.expected_risk(cells.mean_m, np.sqrt(cells.data_var_m2 - after), np.sqrt(after))
