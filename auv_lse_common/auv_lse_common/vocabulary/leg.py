"""A leg: one action, an arc at the turning radius and then a straight (paper, section 4)."""

import math
from dataclasses import dataclass

import numpy as np

from auv_lse_common.support.arrays import Array


def leg_point(action_rad: float, radius_m: float, along_m: float) -> tuple[float, float, float]:
    """A point of a leg in the frame of the body at its start.

    Args:
        action_rad: Heading change (rad, positive clockwise).
        radius_m: Turning radius of the arc.
        along_m: Distance along the leg: on the arc, then on the straight, which is infinite here. Negative values lead
            straight back from the start.

    Returns:
        Heading change up to the point (rad, positive clockwise), distance ahead and to starboard (m).
    """
    on_arc = min(max(along_m, 0.0), abs(action_rad) * radius_m)
    on_straight = along_m - on_arc
    angle = on_arc / radius_m
    side = math.copysign(1.0, action_rad)
    ahead = radius_m * math.sin(angle) + on_straight * math.cos(angle)
    starboard = side * (radius_m * (1.0 - math.cos(angle)) + on_straight * math.sin(angle))
    return side * angle, ahead, starboard


def arc_stray_m(turn_rad: float, radius_m: float, early_m: float) -> float:
    """Largest distance (m) of a vehicle from its legs' arcs if it travels straight to each leg's end.

    An autopilot that moves sideways, as ArduSub, cuts each arc and corner.

    Args:
        turn_rad: Largest heading change of a leg (rad).
        radius_m: Turning radius of the arc.
        early_m: Distance (m) before each leg's end at which the vehicle heads for the next one.
    """
    half_rad = 0.5 * turn_rad
    return radius_m * (1.0 - math.cos(half_rad)) + early_m * math.sin(half_rad)


def corner_stray_m(turn_rad: float, early_m: float) -> float:
    """Largest distance (m) of such a vehicle from the straight lines between its legs' ends; arguments as above.

    Two of these lines form an angle of at most the legs' largest heading change.
    """
    return early_m * math.sin(min(turn_rad, 0.5 * math.pi))


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """One action: an arc, then a straight.

    Attributes:
        step: Mission step of its start.
        heading_rad: Heading at its start (rad, clockwise from north).
        north_m, east_m: Position of its start.
        action_rad: Heading change (rad, positive clockwise).
        radius_m: Turning radius of the arc.
        straight_m: Length of the straight.
        surface: Whether the vehicle surfaces for a fix at the end of the leg.
    """

    step: int
    heading_rad: float
    north_m: float
    east_m: float
    action_rad: float
    radius_m: float
    straight_m: float
    surface: bool = False

    @property
    def arc_m(self) -> float:
        """Length of the arc."""
        return abs(self.action_rad) * self.radius_m

    @property
    def length_m(self) -> float:
        """Length of the leg."""
        return self.arc_m + self.straight_m

    def state_at(self, along_m: float) -> Array:
        """Heading (rad), north, east (m) after `along_m` metres; straight on beyond the end."""
        turned, ahead, starboard = leg_point(self.action_rad, self.radius_m, along_m)
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        heading = self.heading_rad + turned
        return np.array(
            [
                (heading + math.pi) % (2.0 * math.pi) - math.pi,
                self.north_m + c * ahead - s * starboard,
                self.east_m + s * ahead + c * starboard,
            ]
        )

    @property
    def end_state(self) -> Array:
        """Heading (rad), north, east (m) at the end."""
        return self.state_at(self.length_m)

    def progress_m(self, north_m: float, east_m: float) -> float:
        """Arc length (m) of the leg's point nearest to a position.

        Negative before the start; more than `length_m` beyond the end, along the extended straight.
        """
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        dn, de = north_m - self.north_m, east_m - self.east_m
        ahead, starboard = c * dn + s * de, -s * dn + c * de
        size, side = abs(self.action_rad), math.copysign(1.0, self.action_rad)
        candidates: list[tuple[float, float]] = []
        if ahead < 0.0:
            candidates.append((abs(starboard), ahead))
        if size > 0.0:
            # angle turned about the center, which lies `radius` to the side
            x, y = ahead, self.radius_m - side * starboard
            angle = math.atan2(x, y)
            angle = min(max(angle, 0.0), size)
            on_n, on_s = self.radius_m * math.sin(angle), self.radius_m * (1.0 - math.cos(angle))
            candidates.append((math.hypot(ahead - on_n, side * starboard - on_s), angle * self.radius_m))
        arc_n, arc_s = self.radius_m * math.sin(size), self.radius_m * (1.0 - math.cos(size))
        rn, rs = ahead - arc_n, side * starboard - arc_s
        along = rn * math.cos(size) + rs * math.sin(size)
        if along >= 0.0:
            candidates.append((abs(-rn * math.sin(size) + rs * math.cos(size)), self.arc_m + along))
        if not candidates:
            return 0.0
        return min(candidates)[1]

    def distance_off_m(self, north_m: float, east_m: float) -> float:
        """Distance (m) of a position from the leg and its straight continuation."""
        at = self.state_at(self.progress_m(north_m, east_m))
        return math.hypot(north_m - at[1], east_m - at[2])
