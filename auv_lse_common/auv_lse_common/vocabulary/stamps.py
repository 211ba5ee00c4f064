"""Times with the resolution of ROS stamps, so that numbers are equal with and without ROS."""

from typing import Any


def stamped(time_s: float) -> float:
    """A time (s) rounded to the nanosecond, as a ROS stamp stores it."""
    nanoseconds = round(time_s * 1e9)
    return float(nanoseconds // 10**9) + (nanoseconds % 10**9) * 1e-9


def seconds(stamp: Any) -> float:
    """Seconds of a stamp (an object with `sec` and `nanosec`)."""
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9
