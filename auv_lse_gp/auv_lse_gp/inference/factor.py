"""A growing Cholesky factor, L L^T = K + N, with one row per measurement.

Many right-hand sides are solved with matrix products, three times as fast as LAPACK's triangular solve. Block b of X =
L^-1 R is D_b R_b - M_b X_above, where D_b is the inverse of the diagonal block and M_b = D_b L_b. Appending rows does
not change full blocks.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, blas, lapack

from auv_lse_common.support import compiled
from auv_lse_common.support.arrays import Array
from auv_lse_gp.compiled.modules import compiled_gp
from auv_lse_gp.inference.triangular import cholesky, solve_lower

BLOCK = 128


class IllConditionedError(ValueError):
    """The covariance of the centers cannot be factorized in double precision; no jitter is added."""


class Factor:
    """Lower Cholesky factor L (n, n) of the measurements' covariance with noise."""

    def __init__(self, capacity: int = 64) -> None:
        self._buffer = np.zeros((capacity, capacity))
        self._blocks: list[tuple[Array, Array]] = []  # D_b^T and M_b^T, Fortran-ordered
        self._blocked = 0  # number of rows of L in `_blocks`
        self._contiguous: Array | None = None  # L without the buffer's spare columns, for BLAS
        self._inverse: Array | None = None
        self.size = 0

    @property
    def lower(self) -> Array:
        """L (n, n): a read-only view that later changes overwrite."""
        return self._buffer[: self.size, : self.size]

    @property
    def inverse(self) -> Array:
        """L^-1 (n, n), Fortran-ordered, cached until L changes; for callers that solve hundreds of times."""
        if self._inverse is None:
            self._inverse, _ = lapack.dtrtri(np.array(self.lower, order="F"), lower=1, overwrite_c=1)
        return self._inverse

    def copy(self, room: int = 0) -> Factor:
        """An independent copy, with room for `room` more rows."""
        other = Factor(self.size + room)
        other._buffer[: self.size, : self.size] = self.lower
        other._blocks = list(self._blocks)  # the arrays in it are never written to
        other._blocked, other._contiguous, other.size = self._blocked, self._contiguous, self.size
        other._inverse = self._inverse
        return other

    def truncate(self, size: int) -> None:
        """Drops all rows from number `size` on; without rows, the memory is released."""
        if size >= self.size:
            return
        self.size = size
        if not size:
            self._buffer = np.zeros((min(64, len(self._buffer)),) * 2)
        self._contiguous = self._inverse = None
        if size < self._blocked:
            self._blocked = size - size % BLOCK
            del self._blocks[self._blocked // BLOCK :]

    def append(self, cross: Array, own: Array) -> None:
        """Appends m rows.

        Args:
            cross: Covariance (m, n) of the new measurements with those in the factor.
            own: Covariance (m, m) among the new ones, with noise on the diagonal.

        Raises:
            IllConditionedError: if the result is not positive definite in double precision; the factor is unchanged.
        """
        old, new = self.size, self.size + len(own)
        if new == old:
            return
        self.reserve(new)
        rows = self.solve(cross.T).T
        remainder = own - rows @ rows.T
        # Reject pivots of the size of their rounding error, about n eps k(p, p).
        floor = 4.0 * new * np.finfo(float).eps * float(np.max(np.diag(own)))
        try:
            corner = cholesky(remainder)
        except LinAlgError:
            corner = None
        if corner is None or not float(np.min(np.diag(corner))) ** 2 > floor:
            raise IllConditionedError(
                f"the covariance of {new} centers is not positive definite in double precision (no pivot may be "
                f"below {floor:.2g} m^2). The centers are too close together for their noise: choose a larger "
                "gp.noise_std_m or gp.min_spacing_m."
            )
        self._buffer[old:new, :old] = rows
        self._buffer[old:new, old:new] = corner
        self.size = new
        self._contiguous = self._inverse = None

    def solve(self, right: Array) -> Array:
        """L^-1 right, for right (n, P) or (n,)."""
        if right.ndim == 1 or right.shape[1] == 1:
            flat = np.array(right, dtype=float).ravel()
            return self.solve_from(0, flat).reshape(right.shape)
        return self.solve_in_place(np.array(right, dtype=float, order="C"))

    def solve_from(self, begin: int, right: Array) -> Array:
        """L^-1 right (n,), where `right[:begin]` already holds the result; O(n m) for m remaining rows."""
        if compiled.USE_NUMBA:
            return np.asarray(compiled_gp().forward(self._buffer, begin, self.size, right))
        solved = np.array(right, dtype=float)
        if begin < self.size:
            solved[begin:] -= self._buffer[begin : self.size, :begin] @ solved[:begin]
            own = self._buffer[begin : self.size, begin : self.size]
            solved[begin:] = solve_lower(own, solved[begin:])
        return solved

    def solve_in_place(self, right: Array) -> Array:
        """`solve` that overwrites `right` (n, P), C-ordered, and returns it.

        Raises:
            ValueError: if `right` is not C-ordered float64 of n rows.
        """
        if right.dtype != np.float64 or not right.flags.c_contiguous or len(right) != self.size:
            raise ValueError(
                f"right must be C-ordered float64 with {self.size} rows, not {right.dtype} of shape {right.shape}"
            )
        if not right.size:
            return right
        if right.shape[1] == 1:
            right[:, 0] = self.solve_from(0, right[:, 0].copy())
            return right
        self._make_blocks()
        for begin, (inverse, multiplier) in zip(range(0, self.size, BLOCK), self._blocks, strict=True):
            part = right[begin : begin + len(inverse)].T  # Fortran-ordered: BLAS works in place
            blas.dtrmm(1.0, inverse, part, side=1, overwrite_b=1)
            if begin:
                blas.dgemm(-1.0, right[:begin].T, multiplier, beta=1.0, c=part, overwrite_c=1)
        return right

    def solve_rows_in_place(self, rows: Array) -> Array:
        """L^-1 r for each row r of `rows` (P, n), C-ordered, which is overwritten and returned."""
        if rows.size:
            if self._contiguous is None:
                self._contiguous = np.ascontiguousarray(self.lower)
            # BLAS reads these rows as columns: L^T is upper, and the right side is overwritten without a copy.
            blas.dtrsm(1.0, self._contiguous.T, rows.T, lower=0, trans_a=1, overwrite_b=1)
        return rows

    def solve_transposed(self, right: Array, size: int | None = None) -> Array:
        """L^-T right, for right (n,) or (n, P); with `size`, of the leading part of L of that size."""
        n = self.size if size is None else size
        solved = np.array(right, dtype=float)
        lower = self._buffer[:n, :n]
        for begin in reversed(range(0, n, BLOCK)):
            end = min(begin + BLOCK, n)
            if end < n:
                solved[begin:end] -= lower[end:, begin:end].T @ solved[end:]
            solved[begin:end] = solve_lower(lower[begin:end, begin:end], solved[begin:end], transposed=True)
        return solved

    def _make_blocks(self) -> None:
        """Computes the blocks with new rows."""
        if self._blocked == self.size:
            return
        first = self._blocked // BLOCK
        del self._blocks[first:]
        for begin in range(first * BLOCK, self.size, BLOCK):
            end = min(begin + BLOCK, self.size)
            inverse = solve_lower(self._buffer[begin:end, begin:end], np.eye(end - begin))
            multiplier = inverse @ self._buffer[begin:end, :begin]
            self._blocks.append((np.asfortranarray(inverse.T), np.asfortranarray(multiplier.T)))
        self._blocked = self.size

    def reserve(self, size: int) -> None:
        """Makes room for `size` rows in all."""
        if size <= len(self._buffer):
            return
        grown = np.zeros((max(size, len(self._buffer) * 5 // 4),) * 2)
        grown[: self.size, : self.size] = self.lower
        self._buffer = grown
