"""Rejects odometry positions that the vehicle cannot have reached since the last accepted one.

A fix after a long dive moves the position permanently, so `CONSISTENT_POSITIONS` consistent positions in a row pass.
"""

import math

#: Largest accepted speed, as a multiple of the speed through the water (currents add to it).
MAX_SPEED_RATIO = 3.0
#: Margin (m) added to the distance covered at that speed.
MARGIN_M = 30.0
#: Number of consistent positions in a row that are accepted despite a jump.
CONSISTENT_POSITIONS = 4

Position = tuple[float, float, float]


class OdometryGate:
    """Checks the positions of one vehicle in the order of arrival.

    Attributes:
        jumps: Number of positions rejected.
    """

    def __init__(self, speed_mps: float) -> None:
        self.jumps = 0
        self._speed_mps = speed_mps
        self._last: Position | None = None
        self._refused: Position | None = None
        self._in_a_row = 0

    def passes(self, stamp_s: float, north_m: float, east_m: float) -> bool:
        """Whether the position can be reached from the last accepted one, or is consistent with those before it."""
        position = (stamp_s, north_m, east_m)
        if self._last is not None and not self._follows(self._last, position):
            agrees = self._refused is not None and self._follows(self._refused, position)
            self._in_a_row = self._in_a_row + 1 if agrees else 1
            self._refused = position
            if self._in_a_row < CONSISTENT_POSITIONS:
                self.jumps += 1
                return False
        self._last, self._refused, self._in_a_row = position, None, 0
        return True

    def _follows(self, last: Position, position: Position) -> bool:
        moved_m = math.hypot(position[1] - last[1], position[2] - last[2])
        return moved_m <= MAX_SPEED_RATIO * self._speed_mps * abs(position[0] - last[0]) + MARGIN_M
