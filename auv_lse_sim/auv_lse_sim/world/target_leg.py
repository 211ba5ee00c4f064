"""The leg to a target: an arc and a straight at the vehicle's turn radius."""

from __future__ import annotations

import math

from auv_lse_common.leg import Leg

#: An end that lies inside the turning circle by less than this is taken to lie on it (m).
ON_CIRCLE_M = 0.05


def leg_to(
    heading_rad: float, north_m: float, east_m: float, target_m: tuple[float, float], radius_m: float, step: int = 0
) -> Leg:
    """The shortest leg (one arc, then a straight) from a state to a target, given by its north and east.

    There always is one: the two turning circles touch at the state, so no target lies inside both.
    """
    d_north, d_east = target_m[0] - north_m, target_m[1] - east_m
    forward = d_north * math.cos(heading_rad) + d_east * math.sin(heading_rad)
    starboard = d_east * math.cos(heading_rad) - d_north * math.sin(heading_rad)
    best: tuple[float, float, float] | None = None  # length, turn, straight
    for side in (1.0, -1.0):
        across = side * starboard - radius_m  # from the circle's center, in its own sense of turn
        distance = math.hypot(forward, across)
        if distance < radius_m - ON_CIRCLE_M:
            continue
        straight = math.sqrt(max(0.0, distance**2 - radius_m**2))
        turn = (math.atan2(across, forward) + math.atan2(radius_m, straight)) % (2.0 * math.pi)
        if 2.0 * math.pi - turn < 1e-3:
            turn -= 2.0 * math.pi  # straight ahead, to rounding
        length = abs(turn) * radius_m + straight
        if best is None or length < best[0]:
            best = (length, side * turn, straight)
    assert best is not None
    return Leg(
        step=step,
        heading_rad=heading_rad,
        north_m=north_m,
        east_m=east_m,
        action_rad=best[1],
        radius_m=radius_m,
        straight_m=best[2],
    )
