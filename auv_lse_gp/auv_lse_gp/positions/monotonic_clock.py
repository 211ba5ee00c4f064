"""Keeps a vehicle's time monotonic when its clock is set back, because tracks are ordered by time."""

from __future__ import annotations

import math

#: Two stamps in a row more than this (s) before the last one mean that the clock was set back.
SET_BACK_S = 1.0


class MonotonicClock:
    """Times of a vehicle's dead-reckoned positions, soundings, fixes and receptions.

    Attributes:
        set_back_s: Total time by which the clock was set back (s).
    """

    def __init__(self) -> None:
        self.set_back_s = 0.0
        self._last_s = -math.inf  # time of the last dead-reckoned position
        self._step_s = 0.0  # between the last two
        self._early_s = math.nan  # stamp of a dead-reckoned position that came too early

    def monotonic_s(self, stamp_s: float) -> float:
        """The monotonic time (s) of a stamp."""
        return stamp_s + self.set_back_s

    def advance(self, stamp_s: float) -> float:
        """The monotonic time (s) of the next dead-reckoned position; detects a clock that was set back."""
        time_s = self.monotonic_s(stamp_s)
        if time_s < self._last_s - SET_BACK_S:
            if self._early_s < stamp_s:
                self.set_back_s += self._last_s + self._step_s - time_s
                time_s = self.monotonic_s(stamp_s)
            self._early_s = stamp_s
        if time_s > self._last_s:
            self._step_s = time_s - self._last_s if math.isfinite(self._last_s) else 0.0
            self._last_s, self._early_s = time_s, math.nan
        return time_s
