"""Variance of the map's cells after measurements of this vehicle and its mates, conditioned jointly in time order.

S is the data, O are locations planned on the posterior beforehand, and M the map's cells. In the reward J of
`reward/anytime.py`, the risk after checkpoint j has the weight wbar_j - wbar_{j+1}.

**Value.** With all locations V in time order (RW2006: Rasmussen and Williams 2006, algorithm 2.1, for new rows),

    W = L^-1 k(X, V),  w = L^-1 k(X, M)        L the factor of data and planned locations X
    C = k(V, M) - W^T w,   K = k(V, V) + sigma_n^2 I - W^T W = Lv Lv^T,   Y = Lv^-1 C

the variance left at cell p after the first rows of V is s_q^2 = var(p | S u O) - sum of Y^2 over those rows. One
Cholesky factor serves all checkpoints. The exact integral (`auv_lse_gp.level_set.bayes_risk`) gives the risk.

**Gradient.** g is the derivative of a cell's expected risk with respect to s_q^2 (`expected_bayes_risk_slope`); bars
mark derivatives of J (reverse mode):

    Ybar = 2 Y x (sum over the checkpoints that include the row of (wbar_j - wbar_{j+1}) g)
    Cbar = Lv^-T Ybar
    Kbar = sym(Lv^-T Phi Lv^-1),    Phi = -(lower triangle of Ybar Y^T, its diagonal halved)
    Xbar = -L^-T (w Cbar^T + 2 W Kbar)
    dJ / dV_i = sum_p Cbar_ip k'(V_i, p) + 2 sum_j Kbar_ij k'(V_i, V_j) + sum_x Xbar_xi k'(V_i, x)

If only the last checkpoint counts, the order of the locations does not matter, and fewer systems are solved:

    Z = Lv^-T Y,   Cbar = 2 Z diag(wbar g),   Kbar = -Z diag(wbar g) Z^T
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dgemm, dsyrk, dtrmm, dtrsm, strsm
from scipy.linalg.lapack import dpotrf

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_planner.reward.path import not_positive_definite

Singles = NDArray[np.float32]
Real = TypeVar("Real", np.float32, np.float64)

#: Number of rows of a block of a symmetric product.
BLOCK = 64


@dataclass(frozen=True)
class Cells:
    """Posterior of the map's cells, as in `PointPosteriors`, but `white` has the shape (n, M)."""

    scaled: Array
    white: Array
    mean_m: Array
    data_var_m2: Array
    planned_var_m2: Array

    def take(self, kept: Ints) -> Cells:
        """Some of the cells."""
        return Cells(
            self.scaled[kept],
            np.take(self.white, kept, axis=1),
            self.mean_m[kept],
            self.data_var_m2[kept],
            self.planned_var_m2[kept],
        )

    @cached_property
    def white_single(self) -> Singles:
        """`white` in single precision."""
        return self.white.astype(np.float32)


class Measured:
    """Locations to be measured.

    Attributes:
        scaled: The locations in the kernel's axes and length scales, (P, 2).
        white: Their whitened covariance with data and planned locations, (P, n).
    """

    def __init__(self, posterior: Posterior, scaled: Array, cache_inverse: bool) -> None:
        """Prepares scaled locations (P, 2); `cache_inverse` inverts the posterior's factor: faster for many paths."""
        self._kernel = posterior.kernel
        self.scaled = scaled
        covariance = posterior.kernel.of_scaled(scaled, posterior.scaled)
        if cache_inverse and covariance.size:
            dtrmm(1.0, posterior.factor.inverse, covariance.T, lower=1, overwrite_b=1)  # BLAS reads rows as columns
            self.white = covariance
        else:
            self.white = posterior.factor.solve_rows_in_place(covariance)

    def __len__(self) -> int:
        """Number of locations."""
        return len(self.scaled)

    def covariance_with_cells(self, cells: Cells, out: Array) -> Array:
        """Writes the covariance (P, M) with the cells into `out` and returns it."""
        self._kernel.of_scaled(self.scaled, cells.scaled, out)
        if out.size and self.white.shape[1]:
            dgemm(-1.0, cells.white.T, self.white.T, beta=1.0, c=out.T, overwrite_c=1)
        return out


class Timetable:
    """Positions of this vehicle and its mates in time order, the mates' part of their covariances, and scratch memory.

    The next call of a method overwrites its last result: allocating new memory would take a third of the time.

    Attributes:
        groups: Number of the first checkpoint that includes each location, ascending, (P + Q,).
        own: Row numbers of this vehicle's positions, ascending, (P,).
        scaled: All locations in the kernel's scale, (P + Q, 2); `matrix` inserts this vehicle's.
        white: Their whitened covariance with data and planned locations, (P + Q, n).
    """

    def __init__(
        self, posterior: Posterior, cells: Cells, mates: Measured, own_groups: Ints, mate_groups: Ints
    ) -> None:
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
        self._own_cross, self._cross = np.empty(len(own_groups) * count), np.empty(total * count)
        self._spare = np.empty(total * count, dtype=np.float32)

    def matrix(self, own: Measured) -> Array:
        """Lower triangle of the covariance of all measurements in time order, Fortran-ordered."""
        self.scaled[self.own], self.white[self.own] = own.scaled, own.white
        self._kernel.among_scaled(self.scaled, self._matrix)
        matrix = self._matrix.T
        np.einsum("ii->i", matrix)[:] += self._noise_m2
        if self.white.shape[1]:
            dsyrk(-1.0, self.white.T, beta=1.0, c=matrix, trans=1, lower=1, overwrite_c=1)
        return matrix

    def cross(self, own: Measured, cells: Cells, kept: Ints | None) -> Array:
        """Covariance C of all locations in time order with the cells, or with those of numbers `kept`."""
        count = len(cells.mean_m)
        cross = _begin_of(self._cross, len(self.groups), count)
        if not len(self._others):
            return own.covariance_with_cells(cells, cross)
        cross[self.own] = own.covariance_with_cells(cells, _begin_of(self._own_cross, len(self.own), count))
        cross[self._others] = self._mates_cross if kept is None else np.take(self._mates_cross, kept, axis=1)
        return cross

    def spare(self, count: int) -> Singles:
        """Scratch memory of the size of the covariance with `count` cells."""
        return _begin_of(self._spare, len(self.groups), count)


def _begin_of(memory: NDArray[Real], rows: int, count: int) -> NDArray[Real]:
    """An array (rows, count) at the beginning of one-dimensional memory."""
    return memory[: rows * count].reshape(rows, count)


class JointCovariance:
    """Conditions the cells on the positions of this vehicle and its mates in time order."""

    def __init__(
        self, posterior: Posterior, cells: Cells, own: Measured, timetable: Timetable, kept: Ints | None = None
    ) -> None:
        """Factorizes the covariance of the locations.

        Args:
            kept: Numbers of the cells among those of the timetable; None: the same cells.

        Raises:
            ValueError: if it is not positive definite.
        """
        self._posterior, self._cells, self._own, self._timetable = posterior, cells, own, timetable
        matrix = timetable.matrix(own)
        self._lower, failed = dpotrf(matrix, lower=1, clean=1, overwrite_a=1)
        if failed:
            raise ValueError(not_positive_definite(len(matrix)))
        cross = timetable.cross(own, cells, kept).T  # Fortran-ordered: BLAS works in place
        self._reductions = dtrsm(1.0, self._lower, cross, side=1, lower=1, trans_a=1, overwrite_b=1).T  # Y

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
        """Gradient (P, 2) with respect to this vehicle's positions.

        Args:
            later: -dJ / ds_q^2 of the cells, summed over each checkpoint and those after it, (J, M).
            checkpoints: Numbers of these checkpoints, including the last one, (J,).
        """
        kernel, scaled, timetable = self._posterior.kernel, self._own.scaled, self._timetable
        c_bar, k_bar = (bar[timetable.own] for bar in self._bars(later.astype(np.float32), checkpoints))
        gradient = kernel.gradient_sums(scaled, c_bar, self._cells.scaled)
        gradient += kernel.gradient_sums(scaled, k_bar, timetable.scaled)
        if len(self._posterior):
            x_bar = c_bar @ self._cells.white_single.T
            x_bar += k_bar @ timetable.white.astype(np.float32)
            of_data = np.asfortranarray(x_bar.T, dtype=float)
            dtrmm(-1.0, self._posterior.factor.inverse, of_data, lower=1, trans_a=1, overwrite_b=1)
            gradient += kernel.gradient_sums(scaled, of_data.T, self._posterior.scaled)
        return 2.0 * gradient

    def _bars(self, later: Singles, checkpoints: Ints) -> tuple[Singles, Singles]:
        """Cbar / 2 (P + Q, M) and Kbar (P + Q, P + Q); arguments as in `gradient`.

        Single precision halves the time. The result keeps at least four digits, which is enough for a search direction.
        """
        y, lower = self._reductions.astype(np.float32), self._lower.astype(np.float32)
        spare = self._timetable.spare(y.shape[1])
        if len(checkpoints) == 1:
            z = _solve_transposed(lower, y)
            c_bar = np.multiply(later, z, out=spare)
            return c_bar, -_symmetric_product(c_bar, z)
        first = np.searchsorted(checkpoints, self._timetable.groups)  # that includes a row
        y_bar = np.take(later, first, axis=0, out=spare, mode="clip")
        y_bar *= y
        # Phi of the module's formula times -1/2, and Ybar without its factor 2; symmetric
        k_bar = _solve_transposed(lower, _symmetric_product(y_bar, y))
        k_bar = -_solve_transposed(lower, np.ascontiguousarray(k_bar.T))
        return _solve_transposed(lower, y_bar), k_bar


def _solve_transposed(lower: Singles, right: Singles) -> Singles:
    """L^-T right for right (P, M), C-ordered, solved in place."""
    return np.asarray(strsm(1.0, lower, right.T, side=1, lower=1, overwrite_b=1).T)


def _symmetric_product(a: Singles, b: Singles) -> Singles:
    """a b^T (P, P), which is symmetric, for a and b (P, M): the lower triangle, one block of rows at a time."""
    product = np.zeros((len(a), len(a)), dtype=np.float32)
    for begin in range(0, len(a), BLOCK):
        end = begin + BLOCK
        np.matmul(a[begin:end], b[:end].T, out=product[begin:end, :end])
    lower = np.tril(product)
    lower += np.tril(product, -1).T
    return lower
