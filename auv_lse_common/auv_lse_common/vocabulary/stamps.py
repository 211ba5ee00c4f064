"""Times as ROS stamps hold them, for what must give the same numbers with and without ROS."""

from __future__ import annotations

from typing import Any


def stamped(time_s: float) -> float:
    """A time (s) as a ROS stamp gives it back: to the nanosecond."""
    nanoseconds = round(time_s * 1e9)
    return float(nanoseconds // 10**9) + (nanoseconds % 10**9) * 1e-9


def seconds(stamp: Any) -> float:
    """Seconds of a recorded stamp (any object with `sec` and `nanosec`), as the nodes reckon them."""
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9
