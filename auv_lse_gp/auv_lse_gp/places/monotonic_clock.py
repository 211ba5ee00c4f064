"""A vehicle's own clock, made to run forward: a track by time has no place for a second that comes twice."""

from __future__ import annotations

import math

#: A stamp this much before the last one (s), and the next one after it, are those of a clock that was set back.
SET_BACK_S = 1.0


class MonotonicClock:
    """Times of a vehicle's raw places, soundings, fixes and receptions.

    Attributes:
        set_back_s: By how much the clock was set back since the start (s).
    """

    def __init__(self) -> None:
        """The clock is right."""
        self.set_back_s = 0.0
        self._last_s = -math.inf  # time of the last raw place
        self._step_s = 0.0  # from the one before
        self._early_s = math.nan  # stamp of a raw place that came too early

    def monotonic_s(self, stamp_s: float) -> float:
        """The time (s) of a stamp, which goes on where the clock was set back."""
        return stamp_s + self.set_back_s

    def advance(self, stamp_s: float) -> float:
        """The time (s) of the next raw place; notices that the clock was set back when the second such place comes."""
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
