"""Fits a lawnmower of straight lanes to a strip of the area and to the length of the path.

Lanes lie along either axis of the strip. The fit chooses the number of lanes, the distance of the outer lanes from the
strip's sides, and the distance of the lanes' ends from the border. It minimizes the mean distance from locations of the
strip to the path, over all designs that fit the path's length. The mean distance correlates closely with the map's
expected risk (docs/design/planner.md) and needs no map. After the last lane the path returns midway between the lanes.

The result depends only on the number of steps, the start and the area, and all arithmetic is scalar. Every receiver of
a packet therefore computes identical lanes.
"""

from __future__ import annotations

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import math

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support.compiled import compiled
from auv_lse_planner.paths.polyline import locations_along

Array = NDArray[np.float64]

#: Largest number of locations of a strip at which the distance to the path is computed.
LOCATIONS = 400
#: Largest number of lanes.
MAX_LANES = 40
#: Candidate distances of the outer lanes from the strip's sides, and of the lanes' ends from the border, as shares of
#: half the lane spacing.
SIDES = (0.7, 0.85, 1.0)
ENDS = (0.4, 0.55, 0.7, 0.85, 1.0)
#: Largest length of a design, relative to the path's length; the excess at its end is cut off.
MAX_LENGTH_RATIO = 1.25


@compiled
def lay(locations, grid, begin, count, side, end, corners):
    """Writes the corners of `count` lanes and of the return path between them; returns the length of the lanes alone.

    Args:
        locations: Locations of the strip, shape (M, 2): along and across the lanes (m).
        grid: Their spacing along and across (m).
        begin: Start of the path, shape (2,).
        side: Distance of the outer lanes from the strip's sides, relative to half the spacing of evenly spread lanes.
        end: Distance of the lanes' ends from the border, relative to the same.
        corners: Receives the corners, shape (4 count - 1, 2); the first is `begin`.
    """
    low, high, near, far = 1e18, -1e18, 1e18, -1e18
    for p in range(locations.shape[0]):
        near, far = min(near, locations[p, 0]), max(far, locations[p, 0])
        low, high = min(low, locations[p, 1]), max(high, locations[p, 1])
    low -= 0.5 * grid[1]
    high += 0.5 * grid[1]
    half_gap = 0.5 * (high - low) / count
    first, last = low + side * half_gap, high - side * half_gap
    if count == 1:
        first = last = 0.5 * (low + high)
    if abs(begin[1] - first) > abs(begin[1] - last):
        first, last = last, first
    corners[0, 0], corners[0, 1] = begin[0], begin[1]
    at = 1
    for lane in range(2 * count - 1):
        # lanes 0 to count - 1 sweep the strip; the later ones lead back between them
        number = float(lane) if lane < count else 2.0 * count - 1.5 - lane
        across = first + (last - first) * (number / max(count - 1, 1))
        begins, ends = 1e18, -1e18
        for p in range(locations.shape[0]):
            if abs(locations[p, 1] - across) <= 0.75 * grid[1]:
                begins, ends = min(begins, locations[p, 0]), max(ends, locations[p, 0])
        if begins > ends:
            begins, ends = near, far
        begins += end * half_gap - 0.5 * grid[0]
        ends -= end * half_gap - 0.5 * grid[0]
        if begins > ends:
            begins = ends = 0.5 * (begins + ends)
        if abs(corners[at - 1, 0] - begins) > abs(corners[at - 1, 0] - ends):
            begins, ends = ends, begins
        corners[at, 0], corners[at, 1] = begins, across
        corners[at + 1, 0], corners[at + 1, 1] = ends, across
        at += 2
    length = 0.0
    for k in range(2 * count):
        length += math.sqrt((corners[k + 1, 0] - corners[k, 0]) ** 2 + (corners[k + 1, 1] - corners[k, 1]) ** 2)
    return length


@compiled
def mean_distance(locations, corners, length):
    """Mean distance (m) of locations (M, 2) to the first `length` (m) of a polyline (n, 2)."""
    nearest = np.full(locations.shape[0], 1e18)
    left = length
    for k in range(corners.shape[0] - 1):
        du, dv = corners[k + 1, 0] - corners[k, 0], corners[k + 1, 1] - corners[k, 1]
        size = math.sqrt(du * du + dv * dv)
        if size <= 0.0:
            continue
        most = min(left / size, 1.0)
        for p in range(locations.shape[0]):
            u, v = locations[p, 0] - corners[k, 0], locations[p, 1] - corners[k, 1]
            t = min(max((u * du + v * dv) / (size * size), 0.0), most)
            u -= t * du
            v -= t * dv
            nearest[p] = min(nearest[p], u * u + v * v)
        left -= size
        if left <= 0.0:
            break
    total = 0.0
    for p in range(locations.shape[0]):
        total += math.sqrt(nearest[p])
    return total / locations.shape[0]


@compiled
def fit(locations, grid, begin, length, sides, ends):
    """The best design: whether lanes lie across the strip's first axis, their number, and values of `sides`, `ends`."""
    best = 1e18
    best_across, best_count, best_side, best_end = False, 1, sides[0], ends[0]
    for turned in range(2):
        own = np.empty(locations.shape)
        own[:, 0], own[:, 1] = locations[:, turned], locations[:, 1 - turned]
        start = np.array([begin[turned], begin[1 - turned]])
        spacing = np.array([grid[turned], grid[1 - turned]])
        for count in range(1, MAX_LANES + 1):
            shortest = 1e18
            for side in sides:
                for end in ends:
                    corners = np.empty((4 * count - 1, 2))
                    size = lay(own, spacing, start, count, side, end, corners)
                    shortest = min(shortest, size)
                    if count > 1 and size > MAX_LENGTH_RATIO * length:
                        continue
                    distance = mean_distance(own, corners, length)
                    if distance < best:
                        best = distance
                        best_across, best_count, best_side, best_end = turned == 1, count, side, end
            if shortest > MAX_LENGTH_RATIO * length:
                break
    return best_across, best_count, best_side, best_end


def fitted_points(locations_m: Array, grid_m: Array, axis_rad: float, start_m: Array, leg_m: float, legs: int) -> Array:
    """Points (legs + 1, 2), north and east, one leg apart along the fitted lanes of a strip.

    Args:
        locations_m: Locations of the strip along and across `axis_rad`, shape (M, 2).
        grid_m: Their spacing along and across it, (2,).
        axis_rad: The first axis of the strip (rad, clockwise from north); lanes may lie along or across it.
        start_m: Start of the path, north and east, shape (2,).
        leg_m: Length of a leg.
    """
    c, s = math.cos(axis_rad), math.sin(axis_rad)
    north, east = float(start_m[0]), float(start_m[1])
    begin = np.array([north * c + east * s, -north * s + east * c])
    length = legs * leg_m
    turned, count, side, end = fit(locations_m, grid_m, begin, length, np.array(SIDES), np.array(ENDS))
    order = [1, 0] if turned else [0, 1]
    corners = np.empty((4 * count - 1, 2))
    lay(np.ascontiguousarray(locations_m[:, order]), grid_m[order], begin[order], count, side, end, corners)
    along = locations_along(corners, 0.0, leg_m, legs + 1)[0][:, order]
    return np.column_stack([along[:, 0] * c - along[:, 1] * s, along[:, 0] * s + along[:, 1] * c])
