"""How long a limit has been exceeded of late: a time that single readings can neither reset nor reach."""

from __future__ import annotations

from collections import deque

#: Without new readings the majority of this many stands.
_HELD = 3
#: Rounding (s) of sums of steps.
_ROUNDING_S = 1e-6


class ExceededTime:
    """The exceeded time of one limit within the last `2 * patience_s`.

    Each step has a share: the part of its new readings that exceed the limit. It counts until the next step. A step
    without readings takes the majority of the last three, and after `patience_s` of silence the last one. So neither
    an outlier nor a good reading decides about a short gap, and silence hides no last reading.

    Attributes:
        share: Share of the last step, 0 to 1; 0 before the first reading.
    """

    def __init__(self, patience_s: float) -> None:
        """Starts without readings."""
        self.share = 0.0
        self._patience_s = patience_s
        self._new: list[bool] = []
        self._last: deque[bool] = deque(maxlen=_HELD)
        self._heard_s = 0.0  # time of the last step with a reading
        self._step_s = 0.0  # time of the last step
        self._pieces: deque[tuple[float, float, float]] = deque()  # start, end (s), share > 0; in order of time

    def add(self, exceeded: bool) -> None:
        """Takes a reading for the next step."""
        self._new.append(exceeded)

    def shift(self, passed_s: float) -> None:
        """The clock was set by `passed_s`: moves all times with it."""
        self._heard_s += passed_s
        self._step_s += passed_s
        self._pieces = deque((start_s + passed_s, end_s + passed_s, share) for start_s, end_s, share in self._pieces)

    def step(self, now_s: float) -> bool:
        """Takes the readings since the last step; returns whether the limit has been exceeded for `patience_s`."""
        if self.share > 0.0:
            self._append(now_s)
        while self._pieces and self._pieces[0][1] <= now_s - 2.0 * self._patience_s:
            self._pieces.popleft()
        self._step_s = now_s
        if self._new:
            self.share = sum(self._new) / len(self._new)
            self._last.extend(self._new)
            self._heard_s = now_s
            self._new = []
        elif self._last:
            silent = now_s - self._heard_s >= self._patience_s
            self.share = float(self._last[-1] if silent else 2 * sum(self._last) > len(self._last))
        return self.share > 0.0 and self._exceeded_s(now_s) >= self._patience_s - _ROUNDING_S

    def _append(self, now_s: float) -> None:
        start_s = self._step_s
        if self._pieces and self._pieces[-1][1:] == (start_s, self.share):
            start_s = self._pieces.pop()[0]
        self._pieces.append((start_s, now_s, self.share))

    def _exceeded_s(self, now_s: float) -> float:
        begin_s = now_s - 2.0 * self._patience_s
        return sum(share * (end_s - max(start_s, begin_s)) for start_s, end_s, share in self._pieces)
