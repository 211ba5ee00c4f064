"""Keeps a vehicle's time continuous when its clock is set, because tracks are ordered by time."""

import math

#: Two stamps in a row more than this (s) before the last one mean that the clock was set back.
SET_BACK_S = 1.0
#: ... and two that are more than this (s) after it, that it was set ahead: no vehicle is without positions for so long.
SET_AHEAD_S = 1800.0


class MonotonicClock:
    """Times of a vehicle's dead-reckoned positions, soundings, fixes and receptions.

    Attributes:
        set_back_s: Total time by which the clock was set back (s); negative: ahead.
    """

    def __init__(self) -> None:
        self.set_back_s = 0.0
        self._last_s = -math.inf  # time of the last dead-reckoned position
        self._step_s = 0.0  # between the last two
        self._suspect_s = math.nan  # stamp of a dead-reckoned position that came too early, or is too far ahead

    def monotonic_s(self, stamp_s: float) -> float:
        """The monotonic time (s) of a stamp."""
        return stamp_s + self.set_back_s

    def advance(self, stamp_s: float) -> float:
        """The monotonic time (s) of the next dead-reckoned position; detects a clock that was set.

        NaN for a single position that is too far ahead.
        """
        time_s = self.monotonic_s(stamp_s)
        is_early, is_ahead = time_s < self._last_s - SET_BACK_S, self._last_s + SET_AHEAD_S < time_s
        if is_early or (is_ahead and math.isfinite(self._last_s)):
            was_set = self._suspect_s < stamp_s <= self._suspect_s + SET_AHEAD_S
            self._suspect_s = stamp_s
            if not was_set:
                return time_s if is_early else math.nan
            self.set_back_s += self._last_s + self._step_s - time_s
            time_s = self.monotonic_s(stamp_s)
        if time_s > self._last_s:
            self._step_s = time_s - self._last_s if math.isfinite(self._last_s) else 0.0
            self._last_s, self._suspect_s = time_s, math.nan
        return time_s
