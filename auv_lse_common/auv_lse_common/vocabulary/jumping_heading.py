"""Detects a heading that jumps: faster than a vehicle can turn, again and again."""

from collections import deque
from math import degrees

from auv_lse_common.vocabulary.frames import wrap_pi

#: No vehicle turns faster than this (rad/s), beyond what an estimate's correction may add (rad).
FASTEST_RADPS, SLACK_RAD = 1.5, 0.5
#: This many jumps within this time (s) cannot be corrections.
JUMPS, WITHIN_S = 3, 10.0
#: Estimates that are farther apart than this (s) are not compared.
LONGEST_GAP_S = 1.5


class JumpingHeading:
    """The headings of one vehicle, in order of time."""

    def __init__(self) -> None:
        self._last: tuple[float, float] | None = None  # time (s), heading (rad)
        self._jumps: deque[tuple[float, float]] = deque(maxlen=JUMPS)  # time (s), size (deg)

    @property
    def largest_deg(self) -> float:
        """Largest of the recent jumps (deg)."""
        return max((size for _, size in self._jumps), default=0.0)

    def update(self, stamp_s: float, heading_rad: float) -> bool:
        """Adds a heading; returns whether headings have recently jumped several times."""
        last, self._last = self._last, (stamp_s, heading_rad)
        if last is not None and 0.0 < (passed_s := stamp_s - last[0]) <= LONGEST_GAP_S:
            turned_rad = abs(float(wrap_pi(heading_rad - last[1])))
            if turned_rad > SLACK_RAD + FASTEST_RADPS * passed_s:
                self._jumps.append((stamp_s, degrees(turned_rad)))
        return len(self._jumps) == JUMPS and 0.0 <= stamp_s - self._jumps[0][0] <= WITHIN_S
