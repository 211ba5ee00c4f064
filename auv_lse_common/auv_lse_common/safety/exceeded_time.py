"""Measures how long a limit has recently been exceeded, robust against single readings."""

from collections import deque

#: Number of last readings whose majority applies in a step without readings.
_HELD = 3
#: Rounding (s) of sums of steps.
_ROUNDING_S = 1e-6


class ExceededTime:
    """The exceeded time of one limit within the last `2 * patience_s`.

    Each step has a share: the fraction of its new readings that exceed the limit, valid until the next step. In a step
    without readings it is the majority of the last three readings, and after `patience_s` of silence the last reading.
    So a single reading does not decide about a short gap, and the last reading counts in a long one.

    Attributes:
        share: Share of the last step, 0 to 1; 0 before the first reading.
    """

    def __init__(self, patience_s: float) -> None:
        self.share = 0.0
        self._patience_s = patience_s
        self._new: list[bool] = []
        self._last: deque[bool] = deque(maxlen=_HELD)
        self._heard_s = 0.0  # time of the last step with a reading
        self._step_s = 0.0  # time of the last step
        self._pieces: deque[tuple[float, float, float]] = deque()  # start, end (s), share > 0; in order of time

    def add(self, exceeded: bool) -> None:
        """Adds a reading for the next step."""
        self._new.append(exceeded)

    def shift(self, passed_s: float) -> None:
        """Shifts all times by `passed_s`, when the clock was set by that much."""
        self._heard_s += passed_s
        self._step_s += passed_s
        self._pieces = deque((start_s + passed_s, end_s + passed_s, share) for start_s, end_s, share in self._pieces)

    def step(self, now_s: float) -> bool:
        """Evaluates the readings since the last step; returns whether the limit has been exceeded for `patience_s`."""
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
