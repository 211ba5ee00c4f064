"""Isobaths as lines of locations: contours of a map, resampling, and locations near lines."""

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import cKDTree

from auv_lse_common.support.arrays import Array, Mask

#: Spacing (m) of the points along isobaths between which distances are measured.
POINT_SPACING_M = 2.0

#: A location of the true isobath counts as found if the estimate passes within this distance (m).
FOUND_WITHIN_M = 10.0

#: Number of cells beyond the area's border through which contours continue.
BEYOND_CELLS = 2


def resample(lines: Sequence[Array], spacing_m: float = POINT_SPACING_M) -> Array:
    """Locations (n, 2) at equal distances of about `spacing_m` along lines, each for an equal length."""
    points = []
    for line in lines:
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        count = max(1, round(along[-1] / spacing_m))
        at = (np.arange(count) + 0.5) * along[-1] / count
        points.append(np.column_stack([np.interp(at, along, line[:, 0]), np.interp(at, along, line[:, 1])]))
    return np.concatenate(points) if points else np.empty((0, 2))


def near(lines: Sequence[Array], within_m: float = FOUND_WITHIN_M) -> Callable[[Array], Mask]:
    """A function that returns whether locations (P, 2) are within a distance of lines: mask (P,)."""
    points = resample(lines)
    if len(points) == 0:
        return lambda locations_m: np.zeros(len(locations_m), dtype=bool)
    tree = cKDTree(points)
    return lambda locations_m: np.asarray(tree.query(locations_m, distance_upper_bound=within_m)[0] <= within_m)


def contours(north_m: Array, east_m: Array, values: Array, level: float, informed: Mask) -> list[Array]:
    """Contour lines of a map; closed ones repeat their start.

    Beside informed ground they continue for `BEYOND_CELLS` cells beyond the area's border: on a steep bank all of the
    isobath may lie between the last cell's center and the shore.

    Args:
        north_m: North of the rows, equally spaced, shape (R,).
        east_m: East of the columns, as far apart, shape (C,).
        values: A value of each cell, shape (R, C); NaN outside the area.
        informed: Where the ground is known from data, shape (R, C) (`DepthField.informed`).

    Returns:
        Lines, each of shape (n, 2): north, east (m).
    """
    from contourpy import contour_generator  # takes 20 ms: when a map is first drawn

    if min(values.shape) < 2:
        return []
    n, cell_m = BEYOND_CELLS, float(north_m[1] - north_m[0])
    z = np.ma.masked_invalid(beyond_border(np.pad(values, n, constant_values=np.nan), n, np.pad(informed, n)))
    first_m = north_m[0] - n * cell_m, east_m[0] - n * cell_m
    north, east = (first + cell_m * np.arange(size) for first, size in zip(first_m, z.shape, strict=True))
    return [np.asarray(line)[:, ::-1] for line in contour_generator(x=east, y=north, z=z).lines(level)]


def beyond_border(values: Array, cells: int, informed: Mask | None = None) -> Array:
    """Values (R, C) with NaN up to `cells` from informed ones extrapolated, linearly and one cell after another.

    Args:
        values: Values of the cells; NaN outside the area.
        cells: Number of cells to extrapolate.
        informed: Cells to extrapolate from (R, C); None: all.
    """
    outside = np.isnan(values)
    used = np.ones_like(outside) if informed is None else outside | informed
    known = np.where(used, values, np.nan)
    for _ in range(cells):
        known = np.where(used, _one_beyond(known), np.nan)
    return np.where(outside, known, values)


def _one_beyond(values: Array) -> Array:
    """Values (R, C) with each NaN extrapolated from the two cells next to it in a direction, if both are known.

    Of several directions, also diagonal ones, it is the mean, with weights of 1 / distance.
    """
    around = np.pad(values, 2, constant_values=np.nan)
    rows, columns = np.nonzero(np.isnan(values))
    total, weights = np.zeros(len(rows)), np.zeros(len(rows))
    for down, right in itertools.product((-1, 0, 1), repeat=2):
        if not (down or right):
            continue
        beside = around[rows + 2 + down, columns + 2 + right]
        there = 2.0 * beside - around[rows + 2 + 2 * down, columns + 2 + 2 * right]
        weight = np.where(np.isnan(there), 0.0, 1.0 / math.hypot(down, right))
        total += weight * np.nan_to_num(there)
        weights += weight
    filled = values.copy()
    with np.errstate(invalid="ignore"):
        filled[rows, columns] = total / weights
    return filled
