"""Schedules a node's periodic work on a clock that may be set back."""

import math


class Periodic:
    """Decides when periodic work is due."""

    def __init__(self, period_s: float) -> None:
        """Args: period_s: period of the work (s); the first round is due immediately."""
        self._period_s = period_s
        self._done_s = -math.inf

    def is_due(self, now_s: float) -> bool:
        """Whether the period has passed since the last round, or the clock was set back to before it."""
        return not 0.0 <= now_s - self._done_s < self._period_s

    def done(self, now_s: float) -> None:
        """Records a round of the work at `now_s` (s)."""
        self._done_s = now_s
