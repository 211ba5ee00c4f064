"""Lifts the depth of targets where the ground rises, as rarely as possible: ArduSub restarts from rest each time.

A new target is sent with the depth that the ground allows along the straight line to it. It is sent again when that
line comes too near to the ground, and at most every `LOWER_EVERY_S` when it is needlessly high. If the line would be
too steep, the vehicle first climbs where it is, and then continues.
"""

import dataclasses
import math

from auv_lse_common.mission_file.sections.vehicle import SHALLOWEST_M
from auv_lse_common.safety.altitude_keeper import REACH_M, AltitudeKeeper
from auv_lse_mavlink.messages.conversion import Target
from auv_lse_mavlink.messages.events import AutopilotEstimate

#: Least time (s) between two lowerings of a needlessly high target, and between two lifts of a low one.
LOWER_EVERY_S, LIFT_EVERY_S = 8.0, 1.0
#: A climb ends this far (m) below its depth.
CLIMBED_M = 0.15


class Lift:
    """The depth of the current target of one vehicle.

    Attributes:
        keeper: The ground under the vehicle.
        climbs: Whether the vehicle climbs where it is.
    """

    def __init__(self, least_m: float) -> None:
        """Keeps `least_m` (m) above the ground; 0: does nothing."""
        self.keeper = AltitudeKeeper(least_m)
        self.climbs = False
        self._target: Target | None = None  # before it is lifted
        self._depth_m = math.nan  # its depth as lifted, or where a climb ends
        self._changed_s = -math.inf

    def update(self, now_s: float, target: Target | None, position: AutopilotEstimate) -> bool:
        """Updates the climb to the current target; returns whether the target must be sent again."""
        keeper = self.keeper
        if keeper.least_m <= 0.0 or target is None or target.at_surface:
            self._target, self.climbs = None, False
            return False
        depth_m = position.depth_m
        way_m = math.dist((target.north_m, target.east_m), (position.north_m, position.east_m))
        if self._target is None or _differ(self._target, target):
            self._target, self.climbs = target, False
            self._choose(now_s, depth_m, way_m)
            return self.climbs  # it is new, so it is sent anyway
        waited_s = now_s - self._changed_s
        if self.climbs:
            over = depth_m <= self._depth_m + CLIMBED_M and depth_m <= keeper.deepest_m(REACH_M, 0.0)
            if not over and (waited_s < LIFT_EVERY_S or not keeper.is_low(depth_m, self._depth_m, 0.0)):
                return False
        elif not (
            (waited_s >= LIFT_EVERY_S and keeper.is_low(depth_m, self._depth_m, way_m))
            or (waited_s >= LOWER_EVERY_S and keeper.is_high(depth_m, self._depth_m, target.depth_m, way_m))
        ):
            return False
        before = (self.climbs, self._depth_m)
        self._choose(now_s, depth_m, way_m)
        return (self.climbs, self._depth_m) != before

    def _choose(self, now_s: float, depth_m: float, way_m: float) -> None:
        """Chooses the depth of the target, or of a climb."""
        assert self._target is not None
        keeper = self.keeper
        self._changed_s = now_s
        end_m = keeper.line_end_m(depth_m, self._target.depth_m, way_m)
        self.climbs = keeper.must_climb_first(depth_m, end_m, way_m) and depth_m > SHALLOWEST_M
        self._depth_m = max(keeper.deepest_m(REACH_M), SHALLOWEST_M) if self.climbs else end_m

    def lifted(self, target: Target) -> Target:
        """A target with the depth that the ground allows."""
        if self._target is None or math.isnan(self._depth_m):
            return target
        return dataclasses.replace(target, depth_m=min(target.depth_m, self._depth_m))


def _differ(one: Target, other: Target) -> bool:
    return (one.north_m, one.east_m, one.depth_m, one.step) != (other.north_m, other.east_m, other.depth_m, other.step)
