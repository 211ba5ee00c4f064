"""Work that a node repeats by a clock that may be set back."""

from __future__ import annotations

import math


class Periodic:
    """When some work was done last, and whether it is due again."""

    def __init__(self, period_s: float) -> None:
        """Args: period_s: time between two rounds of the work (s); the first is due at once."""
        self._period_s = period_s
        self._done_s = -math.inf

    def is_due(self, now_s: float) -> bool:
        """Whether the period has passed since the work was done, or the clock was set back behind that."""
        return not 0.0 <= now_s - self._done_s < self._period_s

    def done(self, now_s: float) -> None:
        """The work is done at `now_s` (s)."""
        self._done_s = now_s
