"""Steers along a tour: computes the actions that follow a polyline of equal segments.

A tour is a schedule: after i legs the vehicle should be i leg lengths along the polyline. On each leg the vehicle takes
the feasible action that, with the best next two legs, ends nearest to the three scheduled points. The cost is the sum
of three squared distances. Errors along the polyline have a low weight (`ALONG`), so that a vehicle ahead of schedule
after a bend does not weave to lose time. The next leg has the largest weight (`NEAREST`, `FARTHEST`). After its last
waypoint the polyline continues straight.

The result depends on the area but not on the map, and all arithmetic is scalar, so that every receiver of a packet
computes the same actions.
"""

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import math

import numpy as np

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.support.compiled import compiled
from auv_lse_planner.paths.free_space import FreeSpace, cheapest_action, clearance_at, end_of_leg, safe_reach
from auv_lse_planner.paths.polyline import SHORTEST_M, locations_along

#: Look-ahead of the steering (legs); also the number of next legs of a plan that must be feasible on the map.
LOOK_AHEAD = 3
#: Legs of a new plan that are checked against the map; also the legs of an explicit detour around shallow ground.
DETOUR_LEGS = 8
#: Weight of a squared error along the polyline, relative to one across it.
ALONG = 0.2
#: Weights of the first and the third scheduled point, relative to the second.
NEAREST, FARTHEST = 2.0, 0.5


@compiled
def point_along(waypoints, segment, along):
    """The point and the unit vector at arc length `along` (m) of a polyline (n + 1, 2) of equal segments."""
    k = min(max(int(along / segment), 0), waypoints.shape[0] - 2)
    u = (along - k * segment) / segment
    north_wise = waypoints[k + 1, 0] - waypoints[k, 0]
    east_wise = waypoints[k + 1, 1] - waypoints[k, 1]
    north = waypoints[k, 0] + u * north_wise
    east = waypoints[k, 1] + u * east_wise
    return north, east, north_wise / segment, east_wise / segment


@compiled
def due_on_tour(waypoints, segment, leg, count):
    """Scheduled points (count, 4) at the ends of legs, location and direction, along segments of equal length."""
    due = np.empty((count, 4))
    for i in range(count):
        due[i, 0], due[i, 1], due[i, 2], due[i, 3] = point_along(waypoints, segment, i * leg + leg)
    return due


@compiled
def due_on_line(waypoints, leg, count):
    """Scheduled points (count, 4) every `leg` (m of arc) along any polyline (n + 1, 2), extended straight."""
    locations, segments, _ = locations_along(waypoints, 0.0, leg, count + 1)
    due = np.empty((count, 4))
    for i in range(count):
        k = segments[i + 1]
        north, east = waypoints[k + 1, 0] - waypoints[k, 0], waypoints[k + 1, 1] - waypoints[k, 1]
        length = max(math.sqrt(north * north + east * east), SHORTEST_M)
        due[i, 0], due[i, 1] = locations[i + 1, 0], locations[i + 1, 1]
        due[i, 2], due[i, 3] = north / length, east / length
    return due


@compiled
def off_track(north, east, due):
    """Squared distance from a scheduled point (4,); the part along the polyline has the weight `ALONG`."""
    dn, de = north - due[0], east - due[1]
    ahead = dn * due[2] + de * due[3]
    return dn * dn + de * de - (1.0 - ALONG) * ahead * ahead


@compiled
def steering_costs(space, heading, north, east, due, cos_t, sin_t, costs):
    """Writes the costs (A,) of the actions in a state: distances from three scheduled points (3, 4).

    The next two legs are optimal. `cos_t`, `sin_t` are the cosines and sines of the actions' turns.
    """
    steps, kinds = space.steps, costs.shape[0]
    n3, e3, north3, east3 = due[2, 0], due[2, 1], due[2, 2], due[2, 3]
    c0, s0 = math.cos(heading), math.sin(heading)
    for a in range(kinds):
        na = north + c0 * steps[a, 0] - s0 * steps[a, 1]
        ea = east + s0 * steps[a, 0] + c0 * steps[a, 1]
        ca = c0 * cos_t[a] - s0 * sin_t[a]
        sa = s0 * cos_t[a] + c0 * sin_t[a]
        best = 1.0e30
        for b in range(kinds):
            nb = na + ca * steps[b, 0] - sa * steps[b, 1]
            eb = ea + sa * steps[b, 0] + ca * steps[b, 1]
            second = off_track(nb, eb, due[1])
            if second >= best:
                continue
            cb = ca * cos_t[b] - sa * sin_t[b]
            sb = sa * cos_t[b] + ca * sin_t[b]
            least = 1.0e30
            for c in range(kinds):  # no branch: this loop runs in vectors
                dn = nb + cb * steps[c, 0] - sb * steps[c, 1] - n3
                de = eb + sb * steps[c, 0] + cb * steps[c, 1] - e3
                ahead = dn * north3 + de * east3
                off = FARTHEST * (dn * dn + de * de - (1.0 - ALONG) * ahead * ahead)
                least = off if off < least else least
            if second + least < best:
                best = second + least
        costs[a] = NEAREST * off_track(na, ea, due[0]) + best


@compiled
def steer(space, state, count, due):
    """Actions (count,) along a polyline from a state.

    Args:
        space: `FreeSpace.arguments(static=True)`.
        state: Heading, north, east, shape (3,).
        due: Scheduled points after each leg and after two more, and the polyline's direction there, shape
            (count + 2, 4): north, east (m), unit vector north, east.
    """
    actions = np.zeros(count, dtype=np.int64)
    kinds = space.turns.shape[0]
    costs, cos_t, sin_t = np.empty(kinds), np.empty(kinds), np.empty(kinds)
    for a in range(kinds):
        cos_t[a], sin_t[a] = math.cos(space.turns[a]), math.sin(space.turns[a])
    heading, north, east = state[0], state[1], state[2]
    reach = safe_reach(space)
    for index in range(count):
        steering_costs(space, heading, north, east, due[index : index + 3], cos_t, sin_t, costs)
        roomy = clearance_at(space, north, east) >= reach
        action = cheapest_action(space, heading, north, east, costs, roomy)
        actions[index] = action
        heading, north, east = end_of_leg(space, heading, north, east, action)
    return actions


class Steering:
    """Follows tours in one operating area."""

    def __init__(self, space: FreeSpace) -> None:
        self._space = space
        self._leg_m = space.motion.leg_length_m

    def actions(
        self, state: Array, waypoints_m: Array, segment_legs: int, legs: int, around_shallows: bool = False
    ) -> Ints:
        """Actions (legs,) from a state (3,) along a polyline (n + 1, 2) of segments of `segment_legs` legs.

        Args:
            waypoints_m: The polyline, its start first.
            around_shallows: Whether to avoid ground that this vehicle's map shows as too shallow; other vehicles then
                cannot rebuild the path.

        Raises:
            ValueError: if the polyline has no segment.
        """
        waypoints = _polyline("waypoints_m", waypoints_m)
        due = due_on_tour(waypoints, segment_legs * self._leg_m, self._leg_m, max(0, legs) + LOOK_AHEAD - 1)
        return self._steer(state, due, legs, around_shallows)

    def along(self, state: Array, line_m: Array, spacing_m: float, legs: int, around_shallows: bool = False) -> Ints:
        """Actions (legs,) from a state (3,) along any polyline (n + 1, 2); each leg covers `spacing_m` of its arc.

        Raises:
            ValueError: if the polyline has no segment.
        """
        due = due_on_line(_polyline("line_m", line_m), spacing_m, max(0, legs) + LOOK_AHEAD - 1)
        return self._steer(state, due, legs, around_shallows)

    def _steer(self, state: Array, due: Array, legs: int, around_shallows: bool) -> Ints:
        space = self._space.arguments(static=not around_shallows)
        return np.asarray(steer(space, np.asarray(state, dtype=float), max(0, legs), due))


def _polyline(name: str, locations_m: Array) -> Array:
    """A polyline (n + 1, 2) for compiled code, which does not check that there is a segment."""
    if len(locations_m) < 2:
        raise ValueError(f"{name}: {len(locations_m)} locations make no segment; give at least two")
    return np.ascontiguousarray(locations_m, dtype=float)
