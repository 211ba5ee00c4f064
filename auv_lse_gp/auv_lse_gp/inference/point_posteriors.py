"""What a posterior says about places, one row for each place: mean, variances, whitened covariance.

Whoever values many paths asks the posterior once for all their places, and then picks and joins the rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Places that a pool has room for before it grows: those of 300 sequences of ten legs, and more.
POOLED = 4096


@dataclass(frozen=True, slots=True)
class PointPosteriors:
    """Places, with what the posterior says about them.

    Attributes:
        scaled: Places in the kernel's axes and lengths, shape (P, 2).
        white: Whitened covariance w(p) = L^-1 k(X, p) with data and planned places, a row for each place, (P, n + o).
        mean_m: Posterior mean of the depth given the data, shape (P,).
        data_var_m2: Posterior variance given the data, shape (P,).
        planned_var_m2: Posterior variance given the data and the planned places, shape (P,).
    """

    scaled: Array
    white: Array
    mean_m: Array
    data_var_m2: Array
    planned_var_m2: Array

    def __len__(self) -> int:
        """Number of places."""
        return len(self.mean_m)

    def slice(self, begin: int, end: int) -> PointPosteriors:
        """The places from number `begin` to `end`, without copying."""
        return PointPosteriors(
            self.scaled[begin:end],
            self.white[begin:end],
            self.mean_m[begin:end],
            self.data_var_m2[begin:end],
            self.planned_var_m2[begin:end],
        )

    def take(self, index: NDArray[np.int64]) -> PointPosteriors:
        """The places at `index`."""
        return PointPosteriors(
            self.scaled[index],
            self.white[index],
            self.mean_m[index],
            self.data_var_m2[index],
            self.planned_var_m2[index],
        )


def join_by_path(first: PointPosteriors, second: PointPosteriors, paths: int) -> PointPosteriors:
    """Places of `paths` paths, path after path, from the places of their first parts and of their second parts.

    Args:
        first: Places of the first part of each path, path after path; all first parts are equally long.
        second: The same of the second parts.
        paths: Number of paths.
    """

    def both(one: Array, two: Array) -> Array:
        by_path = [part.reshape(paths, len(part) // paths, *part.shape[1:]) for part in (one, two)]
        return np.concatenate(by_path, axis=1).reshape(len(one) + len(two), *one.shape[1:])

    return PointPosteriors(
        both(first.scaled, second.scaled),
        both(first.white, second.white),
        both(first.mean_m, second.mean_m),
        both(first.data_var_m2, second.data_var_m2),
        both(first.planned_var_m2, second.planned_var_m2),
    )


class PointPool:
    """PointPosteriors of many places, asked for by number: what a search keeps of the places it has looked up."""

    def __init__(self, rows: int) -> None:
        """Makes an empty pool for whitened covariances with `rows` measurements."""
        self._size = 0
        # Memory that is not touched costs nothing; growing does.
        self._numbers = np.empty((POOLED, 5))
        self._white = np.empty((POOLED, rows))

    def add(self, columns: PointPosteriors) -> int:
        """Adds places; returns the number of the first of them."""
        begin, end = self._size, self._size + len(columns)
        if end > len(self._white):
            capacity = max(end, 2 * len(self._white))
            self._numbers = _grown(self._numbers, begin, capacity)
            self._white = _grown(self._white, begin, capacity)
        self._white[begin:end] = columns.white
        self._numbers[begin:end, :2] = columns.scaled
        self._numbers[begin:end, 2] = columns.mean_m
        self._numbers[begin:end, 3] = columns.data_var_m2
        self._numbers[begin:end, 4] = columns.planned_var_m2
        self._size = end
        return begin

    def take(self, index: NDArray[np.int64]) -> PointPosteriors:
        """The places of these numbers."""
        n = self._numbers[index]
        return PointPosteriors(np.ascontiguousarray(n[:, :2]), self._white[index], n[:, 2], n[:, 3], n[:, 4])


def _grown(rows: Array, used: int, capacity: int) -> Array:
    """A copy of the first `used` rows with room for `capacity`."""
    grown = np.empty((capacity, rows.shape[1]))
    grown[:used] = rows[:used]
    return grown
