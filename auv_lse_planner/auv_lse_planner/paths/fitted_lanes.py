"""Fits a lawnmower of straight lanes to a strip of the area and to the length of the path.

Lanes lie along either axis of the strip. The fit chooses the number of lanes, the distance of the outer lanes from the
strip's sides, and the distance of the lanes' ends from the border. It minimizes the mean distance from locations of the
strip to the path, over all designs that fit the path's length. The mean distance correlates closely with the map's
expected risk (docs/design/planner.md) and needs no map. After the last lane the path returns midway between the lanes.

The result depends only on the number of steps, the start and the area, and all arithmetic is scalar. Every receiver of
a packet therefore computes identical lanes.
"""

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import math

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_common.support.compiled import compiled
from auv_lse_planner.paths.polyline import locations_along

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
#: Distance (m) by which a segment must be too far to be skipped: far more than coordinates are rounded by.
ROUNDING_M = 1e-6


@compiled
def rows_of(locations):
    """Rows (R, 3) of locations (M, 2): each distinct second coordinate, ascending, and the range of the first there."""
    rows, count = np.empty((locations.shape[0], 3)), 0
    for p in np.argsort(locations[:, 1]):
        u, v = locations[p, 0], locations[p, 1]
        if count == 0 or rows[count - 1, 0] != v:
            rows[count, 0], rows[count, 1], rows[count, 2] = v, u, u
            count += 1
        rows[count - 1, 1], rows[count - 1, 2] = min(rows[count - 1, 1], u), max(rows[count - 1, 2], u)
    return rows[:count]


@compiled
def lane_spans(rows, grid, begin, count, side, lanes):
    """Writes where `count` lanes lie and the lanes that lead back between them; returns half their spacing (m).

    Args:
        rows: From `rows_of` the strip's locations along and across the lanes (m).
        grid: Spacing of these locations along and across (m).
        begin: Start of the path, shape (2,).
        side: Distance of the outer lanes from the strip's sides, relative to half the spacing of evenly spread lanes.
        lanes: Receives the location across, and the strip's begin and end along, of each lane, (2 count - 1, 3).
    """
    near, far = np.min(rows[:, 1]), np.max(rows[:, 2])
    low, high = rows[0, 0] - 0.5 * grid[1], rows[-1, 0] + 0.5 * grid[1]
    half_gap = 0.5 * (high - low) / count
    first, last = low + side * half_gap, high - side * half_gap
    if count == 1:
        first = last = 0.5 * (low + high)
    if abs(begin[1] - first) > abs(begin[1] - last):
        first, last = last, first
    for lane in range(2 * count - 1):
        # lanes 0 to count - 1 sweep the strip; the later ones lead back between them
        number = float(lane) if lane < count else 2.0 * count - 1.5 - lane
        across = first + (last - first) * (number / max(count - 1, 1))
        begins, ends = 1e18, -1e18
        for row in range(rows.shape[0]):
            if abs(rows[row, 0] - across) <= 0.75 * grid[1]:
                begins, ends = min(begins, rows[row, 1]), max(ends, rows[row, 2])
        if begins > ends:
            begins, ends = near, far
        lanes[lane, 0], lanes[lane, 1], lanes[lane, 2] = across, begins, ends
    return half_gap


@compiled
def lay(lanes, half_gap, grid, begin, end, corners):
    """Writes the corners of lanes and of the return path between them; returns the length of the lanes alone.

    Args:
        lanes, half_gap: From `lane_spans`.
        grid: Spacing of the strip's locations along and across (m).
        begin: Start of the path, shape (2,).
        end: Distance of the lanes' ends from the border, relative to `half_gap`.
        corners: Receives the corners, shape (4 count - 1, 2); the first is `begin`.
    """
    corners[0, 0], corners[0, 1] = begin[0], begin[1]
    at = 1
    for lane in range(lanes.shape[0]):
        begins, ends = lanes[lane, 1], lanes[lane, 2]
        begins += end * half_gap - 0.5 * grid[0]
        ends -= end * half_gap - 0.5 * grid[0]
        if begins > ends:
            begins = ends = 0.5 * (begins + ends)
        if abs(corners[at - 1, 0] - begins) > abs(corners[at - 1, 0] - ends):
            begins, ends = ends, begins
        corners[at, 0], corners[at, 1] = begins, lanes[lane, 0]
        corners[at + 1, 0], corners[at + 1, 1] = ends, lanes[lane, 0]
        at += 2
    length = 0.0
    for k in range(lanes.shape[0] + 1):
        length += math.sqrt((corners[k + 1, 0] - corners[k, 0]) ** 2 + (corners[k + 1, 1] - corners[k, 1]) ** 2)
    return length


@compiled
def segments_of(corners, length, segments):
    """Writes the segments of the first `length` (m) of a polyline (n, 2); returns their number.

    Args:
        segments: Receives for each its start (2), its step (2), the square of its length, the share of it that counts,
            and its lowest and highest location across, (n - 1, 8).
    """
    left = length
    for k in range(corners.shape[0] - 1):
        du, dv = corners[k + 1, 0] - corners[k, 0], corners[k + 1, 1] - corners[k, 1]
        size = math.sqrt(du * du + dv * dv)
        own = segments[k]
        own[0], own[1], own[2], own[3], own[4] = corners[k, 0], corners[k, 1], du, dv, size * size
        own[5] = min(left / size, 1.0) if size > 0.0 else 0.0
        own[6], own[7] = min(corners[k, 1], corners[k + 1, 1]), max(corners[k, 1], corners[k + 1, 1])
        left -= size
        if left <= 0.0:
            return k + 1
    return corners.shape[0] - 1


@compiled
def nearer(u, v, segments, k, nearest):
    """The smaller of `nearest` and the square of the distance of (u, v) to segment `k`."""
    du, dv, square = segments[k, 2], segments[k, 3], segments[k, 4]
    if square <= 0.0:
        return nearest
    u -= segments[k, 0]
    v -= segments[k, 1]
    t = min(max((u * du + v * dv) / square, 0.0), segments[k, 5])
    u -= t * du
    v -= t * dv
    return min(nearest, u * u + v * v)


@compiled
def nearest_of_lanes(u, v, segments, first, end, at, rising, nearest):
    """`nearest`, or the square of the distance of (u, v) to the nearest of segments `first` to `end` - 1, if smaller.

    Their locations across must be monotonic, so the search goes from segment `at` to both sides until all others are
    too far across.
    """
    for k in range(at, end):
        gap = segments[k, 6] - v if rising else v - segments[k, 7]
        if gap > ROUNDING_M and (gap - ROUNDING_M) ** 2 > nearest:
            break
        nearest = nearer(u, v, segments, k, nearest)
    for k in range(at - 1, first - 1, -1):
        gap = v - segments[k, 7] if rising else segments[k, 6] - v
        if gap > ROUNDING_M and (gap - ROUNDING_M) ** 2 > nearest:
            break
        nearest = nearer(u, v, segments, k, nearest)
    return nearest


@compiled
def mean_distance(locations, corners, length, most):
    """Mean distance (m) of locations (M, 2) to the first `length` (m) of the lanes of `lay`; infinite above `most`.

    Args:
        most: Mean distance (m) above which the value does not matter.
    """
    segments = np.empty((corners.shape[0] - 1, 8))
    end = segments_of(corners, length, segments)
    back = (corners.shape[0] + 1) // 2  # number of the segment with which the way back begins
    first, last = corners[1, 1], corners[back - 1, 1]
    rising, step = last >= first, (last - first) / max(back // 2 - 1, 1)
    total = 0.0
    for p in range(locations.shape[0]):
        u, v = locations[p, 0], locations[p, 1]
        number = (v - first) / step if step != 0.0 else 0.0
        nearest = nearer(u, v, segments, 0, 1e18)
        at = min(max(1 + 2 * round(number), 1), min(back, end))
        nearest = nearest_of_lanes(u, v, segments, 1, min(back, end), at, rising, nearest)
        if end > back:
            at = min(max(2 * back - 2 - 2 * round(number), back), end)
            nearest = nearest_of_lanes(u, v, segments, back, end, at, not rising, nearest)
        total += math.sqrt(nearest)
        if total / locations.shape[0] > most:
            return np.inf
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
        spacing, rows = np.array([grid[turned], grid[1 - turned]]), rows_of(own)
        for count in range(1, MAX_LANES + 1):
            shortest = 1e18
            lanes, corners = np.empty((2 * count - 1, 3)), np.empty((4 * count - 1, 2))
            for side in sides:
                half_gap = lane_spans(rows, spacing, start, count, side, lanes)
                for end in ends:
                    size = lay(lanes, half_gap, spacing, start, end, corners)
                    shortest = min(shortest, size)
                    if count > 1 and size > MAX_LENGTH_RATIO * length:
                        continue
                    distance = mean_distance(own, corners, length, best)
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
    lanes, corners = np.empty((2 * count - 1, 3)), np.empty((4 * count - 1, 2))
    rows, grid, begin = rows_of(np.ascontiguousarray(locations_m[:, order])), grid_m[order], begin[order]
    lay(lanes, lane_spans(rows, grid, begin, count, side, lanes), grid, begin, end, corners)
    along = locations_along(corners, 0.0, leg_m, legs + 1)[0][:, order]
    return np.column_stack([along[:, 0] * c - along[:, 1] * s, along[:, 0] * s + along[:, 1] * c])
