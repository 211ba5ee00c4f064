"""The safety watch over random sequences: with dropouts, outliers and flicker it misses nothing and trips for nothing.

`auv_lse faults watch` plays 200,000 of them.
"""

from __future__ import annotations

import pytest

from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.safety.fence import Fence
from auv_lse_common.safety.watch import SafetyWatch
from benchmarks.faults.watch import FAULTS, Sequence

NUMBER = 70


@pytest.mark.parametrize("fault", FAULTS)
def test_a_limit_that_is_exceeded_for_twice_its_patience_is_never_unanswered(fault: str) -> None:
    for seed in range(NUMBER):
        sequence = Sequence(f"{fault} {seed}", fault)
        assert sequence.play(), (seed, sequence.answered_s, sequence.wrong_limits)


def test_a_healthy_vehicle_with_a_few_outliers_never_trips() -> None:
    for seed in range(10 * NUMBER):
        sequence = Sequence(f"healthy {seed}")
        assert sequence.play(), (seed, sequence.wrong_limits)


def test_the_sequences_exceed_every_limit_of_the_watch() -> None:
    watch = SafetyWatch(SafetyConfig(), Fence((0.0, 0.0, 1.0, 0.0, 1.0, 1.0), 0.0), 10.0)
    assert {Sequence("any", fault).limit for fault in FAULTS} == set(watch._responses)
