"""Computes the leg to a target: an arc and a straight with the vehicle's turn radius."""

import math

from auv_lse_common.vocabulary.leg import Leg

#: A target less than this (m) inside the turning circle counts as on it.
ON_CIRCLE_M = 0.05
#: Largest distance (m) by which the tightest turn may miss a target: autopilots count it as reached.
PASSED_BY_M = 4.0


def leg_to(
    heading_rad: float,
    north_m: float,
    east_m: float,
    target_m: tuple[float, float],
    radius_m: float,
    step: int = 0,
    tightest_m: float | None = None,
) -> Leg:
    """The shortest leg (one arc, then a straight) from a state to a target.

    A leg always exists: the two turning circles touch at the state, so no target lies inside both.

    Args:
        heading_rad: Heading of the state.
        north_m: Its north.
        east_m: Its east.
        target_m: North, east of the target.
        radius_m: Turning radius.
        step: Step of the leg.
        tightest_m: Minimum radius for a target inside the turning circle, which it may miss by `PASSED_BY_M`; None: it
            reaches the target by the other circle.
    """
    d_north, d_east = target_m[0] - north_m, target_m[1] - east_m
    forward = d_north * math.cos(heading_rad) + d_east * math.sin(heading_rad)
    starboard = d_east * math.cos(heading_rad) - d_north * math.sin(heading_rad)
    best: tuple[float, float, float, float] | None = None  # length, turn, straight, radius
    for side in (1.0, -1.0):
        radius = radius_m
        if math.hypot(forward, side * starboard - radius) < radius - ON_CIRCLE_M:
            if tightest_m is None:
                continue
            exact = (forward**2 + starboard**2) / (2.0 * abs(starboard))  # radius of the circle through the target
            radius = max(exact, tightest_m)
            if math.hypot(forward, side * starboard - radius) < radius - PASSED_BY_M:
                continue
        across = side * starboard - radius  # from the circle's center, in its own sense of turn
        distance = math.hypot(forward, across)
        straight = math.sqrt(max(0.0, distance**2 - radius**2))
        turn = (math.atan2(across, forward) + math.atan2(radius, straight)) % (2.0 * math.pi)
        if 2.0 * math.pi - turn < 1e-3:
            turn -= 2.0 * math.pi  # straight ahead, to rounding
        length = abs(turn) * radius + straight
        if best is None or length < best[0]:
            best = (length, side * turn, straight, radius)
    assert best is not None
    return Leg(
        step=step,
        heading_rad=heading_rad,
        north_m=north_m,
        east_m=east_m,
        action_rad=best[1],
        radius_m=best[3],
        straight_m=best[2],
    )
