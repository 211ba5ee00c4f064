"""Locations along a polyline, and their derivatives with respect to its corners."""

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import math

import numpy as np

from auv_lse_common.support.compiled import compiled

#: Smallest length of a segment (m); below it the direction is undefined.
SHORTEST_M = 1e-3


@compiled
def locations_along(waypoints, first, spacing, count):
    """Locations (count, 2) along a polyline (n + 1, 2) at arc lengths first + i * spacing (m), extended straight.

    Also returns the segment of each location, shape (count,), and its distance (m) from that segment's first corner.
    """
    locations = np.empty((count, 2))
    segments = np.empty(count, dtype=np.int64)
    along = np.empty(count)
    last = waypoints.shape[0] - 2
    k = 0
    begin = 0.0
    north, east = waypoints[1, 0] - waypoints[0, 0], waypoints[1, 1] - waypoints[0, 1]
    length = max(math.sqrt(north * north + east * east), SHORTEST_M)
    for i in range(count):
        at = first + i * spacing
        while at > begin + length and k < last:
            begin += length
            k += 1
            north, east = waypoints[k + 1, 0] - waypoints[k, 0], waypoints[k + 1, 1] - waypoints[k, 1]
            length = max(math.sqrt(north * north + east * east), SHORTEST_M)
        t = (at - begin) / length
        locations[i, 0] = waypoints[k, 0] + t * north
        locations[i, 1] = waypoints[k, 1] + t * east
        segments[i] = k
        along[i] = at - begin
    return locations, segments, along


@compiled
def pull_back(waypoints, segments, along, gradient):
    """Gradient (n + 1, 2) with respect to the waypoints, from that with respect to the locations of
    `locations_along`."""
    result = np.zeros(waypoints.shape)
    count = waypoints.shape[0] - 1
    units = np.empty((count, 2))
    lengths = np.empty(count)
    pushed = np.zeros(count)  # by segment: sum of its locations' gradients along it
    for k in range(count):
        north, east = waypoints[k + 1, 0] - waypoints[k, 0], waypoints[k + 1, 1] - waypoints[k, 1]
        lengths[k] = max(math.sqrt(north * north + east * east), SHORTEST_M)
        units[k, 0], units[k, 1] = north / lengths[k], east / lengths[k]
    for i in range(segments.shape[0]):
        k = segments[i]
        ahead = gradient[i, 0] * units[k, 0] + gradient[i, 1] * units[k, 1]
        t = along[i] / lengths[k]
        turn_n = t * (gradient[i, 0] - ahead * units[k, 0])
        turn_e = t * (gradient[i, 1] - ahead * units[k, 1])
        result[k, 0] += gradient[i, 0] - turn_n
        result[k, 1] += gradient[i, 1] - turn_e
        result[k + 1, 0] += turn_n
        result[k + 1, 1] += turn_e
        pushed[k] += ahead
    behind = 0.0  # effect of lengthening a segment on all locations after it
    for k in range(count - 1, -1, -1):
        result[k + 1, 0] -= behind * units[k, 0]
        result[k + 1, 1] -= behind * units[k, 1]
        result[k, 0] += behind * units[k, 0]
        result[k, 1] += behind * units[k, 1]
        behind += pushed[k]
    return result
