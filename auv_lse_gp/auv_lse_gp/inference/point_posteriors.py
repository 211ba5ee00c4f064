"""The posterior at points, one row per point: mean, variances, whitened covariance.

A planner evaluates the posterior once for the locations of many paths, then selects and joins rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.support.growing_rows import GrowingRows

#: Initial capacity of a pool, in points.
POOL_CAPACITY = 4096


@dataclass(frozen=True, slots=True)
class PointPosteriors:
    """The posterior at P points.

    Attributes:
        scaled: Locations in the kernel's axes and lengths, shape (P, 2).
        white: Whitened covariance w(p) = L^-1 k(X, p) with data and planned locations, a row per point, (P, n + o).
        mean_m: Posterior mean of the depth given the data, shape (P,).
        data_var_m2: Posterior variance given the data, shape (P,).
        planned_var_m2: Posterior variance given the data and the planned locations, shape (P,).
    """

    scaled: Array
    white: Array
    mean_m: Array
    data_var_m2: Array
    planned_var_m2: Array

    def __len__(self) -> int:
        """Number of points."""
        return len(self.mean_m)

    def take(self, index: Any) -> PointPosteriors:
        """The points at an array of indices, or at a slice (without copying)."""
        return PointPosteriors(
            self.scaled[index],
            self.white[index],
            self.mean_m[index],
            self.data_var_m2[index],
            self.planned_var_m2[index],
        )

    def slice(self, begin: int, end: int) -> PointPosteriors:
        """The points from number `begin` to `end`, without copying."""
        return self.take(slice(begin, end))


def join_by_path(first: PointPosteriors, second: PointPosteriors, paths: int) -> PointPosteriors:
    """Joins the first and second parts of `paths` paths; the result has one path after the other.

    Args:
        first: Points of the first part of each path, path after path; all first parts are equally long.
        second: Points of the second part of each path, likewise.
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
    """The points that a search has evaluated, each with a number."""

    def __init__(self, rows: int) -> None:
        self._numbers, self._white = GrowingRows(5, POOL_CAPACITY), GrowingRows(rows, POOL_CAPACITY)

    def add(self, points: PointPosteriors) -> int:
        """Adds points; returns the number of the first one."""
        begin = len(self._white)
        self._white.append(points.white)
        self._numbers.append(np.column_stack([points.scaled, points.mean_m, points.data_var_m2, points.planned_var_m2]))
        return begin

    def take(self, index: Ints) -> PointPosteriors:
        """The points of these numbers."""
        n = self._numbers.rows[index]
        return PointPosteriors(np.ascontiguousarray(n[:, :2]), self._white.rows[index], n[:, 2], n[:, 3], n[:, 4])
