"""Isobaths as lines of locations: resampled, and what lies near them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]

#: Spacing (m) of the points along isobaths between which distances are measured.
POINT_SPACING_M = 2.0

#: A location of the true isobath counts as found if the estimate passes within this distance (m).
FOUND_WITHIN_M = 10.0


def resample(lines: Sequence[Array], spacing_m: float = POINT_SPACING_M) -> Array:
    """Locations (n, 2) at equal distances of about `spacing_m` along lines, each for an equal length."""
    points = []
    for line in lines:
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        count = max(1, round(along[-1] / spacing_m))
        at = (np.arange(count) + 0.5) * along[-1] / count
        points.append(np.column_stack([np.interp(at, along, line[:, 0]), np.interp(at, along, line[:, 1])]))
    return np.concatenate(points) if points else np.empty((0, 2))


def near(lines: Sequence[Array], within_m: float = FOUND_WITHIN_M) -> Callable[[Array], NDArray[np.bool_]]:
    """A function that returns whether locations (P, 2) are within a distance of lines: mask (P,)."""
    points = resample(lines)
    if len(points) == 0:
        return lambda locations_m: np.zeros(len(locations_m), dtype=bool)
    tree = cKDTree(points)
    return lambda locations_m: np.asarray(tree.query(locations_m, distance_upper_bound=within_m)[0] <= within_m)
