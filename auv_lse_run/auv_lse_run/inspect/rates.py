"""Rate and bandwidth over the last messages, printed as `ros2 topic hz` and `bw` do."""

import math
from collections import deque
from itertools import pairwise


class Rate:
    """The rate of a topic over its last messages."""

    def __init__(self, window: int) -> None:
        """Args: window: number of intervals between messages."""
        self._times: deque[float] = deque(maxlen=window + 1)
        self._reported_count = 0
        self._count = 0

    def note(self, now_s: float) -> None:
        """Counts a message received at `now_s` (s)."""
        self._times.append(now_s)
        self._count += 1

    def text(self) -> str:
        """The rate in two lines; "" without a message since the last call, or before the second message."""
        if self._count == self._reported_count or len(self._times) < 2:
            return ""
        self._reported_count = self._count
        times = list(self._times)
        gaps = [b - a for a, b in pairwise(times)]
        mean = sum(gaps) / len(gaps)
        deviation = math.sqrt(sum((gap - mean) ** 2 for gap in gaps) / len(gaps))
        rate = 1.0 / mean if mean > 0.0 else math.inf
        return (
            f"average rate: {rate:.3f}\n"
            f"\tmin: {min(gaps):.3f}s max: {max(gaps):.3f}s std dev: {deviation:.5f}s window: {len(gaps)}"
        )


class Bandwidth:
    """The bandwidth of a topic over its last messages."""

    def __init__(self, window: int) -> None:
        """Args: window: number of messages."""
        self._messages: deque[tuple[float, int]] = deque(maxlen=window)

    def note(self, now_s: float, size: int) -> None:
        """Counts a message of `size` bytes received at `now_s` (s)."""
        self._messages.append((now_s, size))

    def text(self, now_s: float) -> str:
        """Bandwidth and sizes in two lines, up to `now_s` (s); "" before the second message."""
        if len(self._messages) < 2:
            return ""
        sizes = [size for _, size in self._messages]
        span = now_s - self._messages[0][0]
        rate = sum(sizes) / span if span > 0.0 else math.inf
        mean = sum(sizes) / len(sizes)
        return (
            f"{_bytes(rate)}/s from {len(sizes)} messages\n"
            f"\tMessage size mean: {_bytes(mean)} min: {_bytes(min(sizes))} max: {_bytes(max(sizes))}"
        )


def _bytes(count: float) -> str:
    if count < 1000.0:
        return f"{count:.0f} B"
    return f"{count / 1000.0:.2f} KB" if count < 1e6 else f"{count / 1e6:.2f} MB"
