"""Rate and bandwidth, by hand-worked cases."""

from __future__ import annotations

from auv_lse_run.inspect.rates import Bandwidth, Rate


def test_rate_over_the_last_intervals() -> None:
    rate = Rate(window=3)
    assert rate.text() == ""
    for now_s in (0.0, 9.0, 10.0, 10.5, 12.0):  # the last three intervals: 1, 0.5, 1.5 s
        rate.note(now_s)
    assert rate.text() == "average rate: 1.000\n\tmin: 0.500s max: 1.500s std dev: 0.40825s window: 3"
    assert rate.text() == "", "no message since"


def test_bandwidth_of_the_last_messages() -> None:
    bandwidth = Bandwidth(window=3)
    assert bandwidth.text(1.0) == ""
    for now_s, size in ((0.0, 9), (1.0, 100), (2.0, 200), (3.0, 1500)):
        bandwidth.note(now_s, size)
    assert bandwidth.text(3.0) == "900 B/s from 3 messages\n\tMessage size mean: 600 B min: 100 B max: 1.50 KB"
