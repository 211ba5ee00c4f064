"""Keeps a vehicle above the ground: limits its depth along its way, from its echo sounder. No ROS, no clock.

Theory of operation
-------------------
`ping` takes each altitude with the vehicle's position and depth. Their sum is the depth of the ground. A ping that
contradicts the ground so far by more than `JUMP_M` and a slope of one counts only if the next one agrees with it.

A straight line is fitted over the last `WINDOW_M` of travel. Ground that rises along it is expected to keep rising for
`REACH_M` ahead; ground that falls counts as flat. A sounder shows the ground `LAG_S` late. So rising ground is
expected to have risen further during that time, and the smallest depth within that time counts.

The vehicle is kept `SPARE_M` higher than asked, because the onset of a slope is seen late. Without pings the ground
seen last counts: weed and steep ground return no echo either. Ground out of the sounder's range was seen deep before.

A vehicle whose autopilot travels a straight line in space to its target (`line_end_m`) climbs along that line. If it
would have to be steeper than `STEEPEST`, it must climb where it is first.
"""

import math
from collections import deque

import numpy as np

from auv_lse_common.mission_file.sections.vehicle import SHALLOWEST_M

#: A sounder shows the ground with a delay of up to this (s).
LAG_S = 0.8
#: A vehicle keeps this much (m) more than the altitude asked for, and reacts when this much of it is left.
SPARE_M, LEFT_M = 0.6, 0.3
#: The slope is measured over the first of these distances (m), and expected to continue over the second.
WINDOW_M, REACH_M = 4.0, 4.0
#: Ground that differs by more than this (m), beyond a slope of one, must be seen twice.
JUMP_M = 0.7
#: Time (s) without a ping after which the next one counts, whatever its value.
SILENT_S = 5.0
#: Steepest line (m/m) along which a vehicle climbs while it travels, and steepest slope that is expected to continue.
STEEPEST = 0.6
#: A vehicle looks ahead for this time (s) of travel: it reacts late, and coasts until it follows a new target.
AHEAD_S = 3.4
#: It returns towards its depth if it is this much (m) higher than it has to be.
SLACK_M = 1.5


class AltitudeKeeper:
    """The ground under one vehicle, and how deep the vehicle may be.

    Attributes:
        least_m: Altitude asked for (m); 0: none.
    """

    def __init__(self, least_m: float) -> None:
        self.least_m = least_m
        self._ground: deque[tuple[float, float]] = deque(maxlen=64)  # way travelled, depth of the ground (m)
        self._depths: deque[tuple[float, float]] = deque(maxlen=64)  # time (s), depth of the vehicle (m)
        self._doubted_m = math.nan  # ground that waits for a second ping
        self._last: tuple[float, float] | None = None  # north, east (m)
        self._way_m = self._speed_mps = 0.0
        self._ping_s = -math.inf
        self._now_s = -math.inf
        self._rise: float | None = None  # slope of rising ground (m/m), where it is known for the present ground

    def move(self, now_s: float, north_m: float, east_m: float, depth_m: float, speed_mps: float) -> None:
        """Updates the vehicle's position."""
        if now_s < self._now_s:  # the clock was set back
            self._ping_s = -math.inf
            self._depths.clear()
        if self._last is not None:
            moved_m = math.dist(self._last, (north_m, east_m))
            self._way_m += moved_m
            if moved_m > WINDOW_M + 2.0 * max(speed_mps, 1.0):  # a jump of the estimate
                self._keep_last()
        self._now_s, self._last, self._speed_mps = now_s, (north_m, east_m), speed_mps
        self._depths.append((now_s, depth_m))

    def ping(self, altitude_m: float) -> None:
        """Adds the altitude (m) at the last position; ignores one that is not positive and finite."""
        if not (math.isfinite(altitude_m) and altitude_m > 0.0) or not self._depths:
            return
        ground_m = self._least_depth_m() + altitude_m
        is_recent = bool(self._ground) and self._now_s - self._ping_s <= SILENT_S
        if is_recent and not self._agrees(ground_m, self._ground[-1][1], self._way_m - self._ground[-1][0]):
            doubted_m, self._doubted_m = self._doubted_m, ground_m
            if math.isnan(doubted_m) or not self._agrees(ground_m, doubted_m, 1.0):
                return
            self._ground.clear()
        self._doubted_m, self._ping_s = math.nan, self._now_s
        self._ground.append((self._way_m, ground_m))
        while self._ground[0][0] < self._way_m - WINDOW_M:
            self._ground.popleft()
        self._rise = None

    def _least_depth_m(self) -> float:
        """Smallest depth (m) of the vehicle within the last `LAG_S`."""
        from_s, least_m = self._depths[-1][0] - LAG_S, math.inf
        for stamp_s, depth_m in reversed(self._depths):
            if stamp_s < from_s:
                break
            if depth_m < least_m:
                least_m = depth_m
        return least_m

    @staticmethod
    def _agrees(ground_m: float, other_m: float, way_m: float) -> bool:
        return abs(ground_m - other_m) <= JUMP_M + way_m

    def _keep_last(self) -> None:
        """Forgets the slope of the ground, not its depth."""
        self._rise = None
        if self._ground:
            self._ground = deque([(self._way_m, self._ground[-1][1])], maxlen=64)

    @property
    def _rising(self) -> float:
        if self._rise is None:
            self._rise = self._fitted_rise()
        return self._rise

    def _fitted_rise(self) -> float:
        ways, depths = np.array(self._ground).T
        if len(ways) < 3 or np.ptp(ways) < 0.25 * WINDOW_M:
            return 0.0
        off = ways - ways.mean()
        slope = float(off @ (depths - depths.mean())) / float(off @ off)
        return min(max(-slope, 0.0), STEEPEST)

    def ground_m(self, ahead_m: float = 0.0) -> float:
        """Depth (m) of the ground expected at `ahead_m` (m) ahead; infinite before the first ping."""
        if not self._ground:
            return math.inf
        return self._ground[-1][1] - self._rising * (min(ahead_m, REACH_M) + self._speed_mps * LAG_S)

    def deepest_m(self, ahead_m: float, spare_m: float = SPARE_M) -> float:
        """Depth (m) that keeps the altitude and `spare_m` more at `ahead_m` (m) ahead; infinite without a limit."""
        return self.ground_m(ahead_m) - self.least_m - spare_m if self.least_m > 0.0 else math.inf

    def limited_m(self, wanted_m: float) -> float:
        """The depth (m) to keep now by a vehicle that follows a depth at once: the wanted one, or a smaller one."""
        limit_m = min(self.deepest_m(0.0), self.deepest_m(AHEAD_S * self._speed_mps))
        return min(wanted_m, max(limit_m, SHALLOWEST_M))

    def is_low(self, depth_m: float, end_m: float, way_m: float) -> bool:
        """Whether a line from the present depth to `end_m` (m), in `way_m`, comes too near to the ground soon."""
        ahead_m = AHEAD_S * self._speed_mps
        for part in (0.0, 0.5, 1.0):
            share = min(part * ahead_m / way_m, 1.0) if way_m > 0.0 else 1.0
            line_m = depth_m + share * (end_m - depth_m) if part else depth_m
            if line_m > max(self.deepest_m(part * ahead_m, LEFT_M), SHALLOWEST_M):
                return True
        return False

    def is_high(self, depth_m: float, end_m: float, wanted_m: float, way_m: float) -> bool:
        """Whether the line is higher than it has to be, by more than `SLACK_M`."""
        return min(self.line_end_m(depth_m, wanted_m, way_m), wanted_m) > end_m + SLACK_M and (
            depth_m < min(self.deepest_m(REACH_M), wanted_m) - SLACK_M
        )

    def line_end_m(self, depth_m: float, wanted_m: float, way_m: float) -> float:
        """Depth (m) at the end of a straight way of `way_m`, so that all of it keeps the altitude.

        Args:
            depth_m: Present depth.
            wanted_m: Depth at the end if the ground allows it.
            way_m: Length of the way.
        """
        end_m = wanted_m
        for ahead_m in (0.5 * REACH_M, REACH_M, way_m):
            if 0.0 < ahead_m <= way_m:
                end_m = min(end_m, depth_m + (self.deepest_m(ahead_m) - depth_m) * way_m / ahead_m)
        if way_m < 0.5 * REACH_M:
            end_m = min(end_m, self.deepest_m(0.0))
        return max(end_m, min(wanted_m, SHALLOWEST_M))

    def must_climb_first(self, depth_m: float, end_m: float, way_m: float) -> bool:
        """Whether the line is too steep, or already too low, so that the vehicle climbs where it is."""
        too_low = depth_m > max(self.deepest_m(0.0, 0.0), SHALLOWEST_M)
        return too_low or depth_m - end_m > STEEPEST * way_m
