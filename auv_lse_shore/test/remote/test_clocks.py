"""Clocks are compared with what their round trips allow to say; the one that is wrong is named."""

from __future__ import annotations

import pytest

from auv_lse_shore.remote.clocks import ClockOffset, clock_offset, wrong_clocks


def offsets(**seconds: float) -> dict[str, ClockOffset]:
    return {name: ClockOffset(value, 0.01) for name, value in seconds.items()}


def test_an_offset_is_as_uncertain_as_its_round_trip() -> None:
    assert clock_offset(100.0, 107.0, 102.0) == ClockOffset(6.0, 1.0)


@pytest.mark.parametrize(
    ("clocks", "wrong"),
    [
        (offsets(auv1=0.1, auv2=0.2), {}),
        (offsets(auv1=0.1, auv2=3.0, auv3=0.0), {"auv2": "error"}),
        (offsets(auv1=60.0, auv2=60.1, auv3=60.2), {"laptop": "warning"}),
        (offsets(auv1=0.0, auv2=3.0), {"auv2": "error"}),
        (offsets(auv1=9.0), {"auv1": "error"}),
        ({}, {}),
    ],
)
def test_the_clock_that_disagrees_with_most_is_wrong(clocks: dict[str, ClockOffset], wrong: dict[str, str]) -> None:
    assert {name: level for name, (level, _) in wrong_clocks(clocks, 0.5).items()} == wrong


def test_a_slow_link_is_not_called_a_wrong_clock() -> None:
    found = wrong_clocks({"auv1": ClockOffset(0.2, 2.0)}, 0.5)
    assert found["auv1"][0] == "warning"
    assert "too slow to tell" in found["auv1"][1]
