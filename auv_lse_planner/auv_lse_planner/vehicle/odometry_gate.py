"""Rejects odometry places that the vehicle cannot have reached since the last accepted one.

A fix after a long dive moves the place permanently, so `CONSISTENT_PLACES` consistent places in a row pass.
"""

from __future__ import annotations

import math

#: Largest accepted speed, as a multiple of the speed through the water (currents add to it).
MAX_SPEED_RATIO = 3.0
#: Margin (m) added to the distance covered at that speed.
MARGIN_M = 30.0
#: Consistent places in a row that are accepted despite a jump.
CONSISTENT_PLACES = 4

Place = tuple[float, float, float]


class OdometryGate:
    """Checks the places of one vehicle in the order of arrival.

    Attributes:
        jumps: Number of places rejected.
    """

    def __init__(self, speed_mps: float) -> None:
        self.jumps = 0
        self._speed_mps = speed_mps
        self._last: Place | None = None
        self._refused: Place | None = None
        self._in_a_row = 0

    def passes(self, stamp_s: float, north_m: float, east_m: float) -> bool:
        """Whether the place is reachable from the last accepted one, or the last of `CONSISTENT_PLACES` in a row."""
        place = (stamp_s, north_m, east_m)
        if self._last is not None and not self._follows(self._last, place):
            agrees = self._refused is not None and self._follows(self._refused, place)
            self._in_a_row = self._in_a_row + 1 if agrees else 1
            self._refused = place
            if self._in_a_row < CONSISTENT_PLACES:
                self.jumps += 1
                return False
        self._last, self._refused, self._in_a_row = place, None, 0
        return True

    def _follows(self, last: Place, place: Place) -> bool:
        moved_m = math.hypot(place[1] - last[1], place[2] - last[2])
        return moved_m <= MAX_SPEED_RATIO * self._speed_mps * abs(place[0] - last[0]) + MARGIN_M
