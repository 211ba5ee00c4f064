"""The gate of own soundings: spikes, steps, a frozen sensor, time that runs back, worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from auv_lse_common.vocabulary.frozen_sensor import REPEATS
from auv_lse_common.vocabulary.sounding_gate import AGREEING, SoundingGate, passing

Row = tuple[float, float, float, float]


def track(depths: list[float], start_s: float = 0.0) -> list[Row]:
    """Soundings every second at 1.5 m/s to the north."""
    return [(start_s + i, 1.5 * (start_s + i), 0.0, depth) for i, depth in enumerate(depths)]


def depths(rows: list[Row]) -> list[float]:
    return [row[3] for row in rows]


def test_ground_with_a_slope_of_1_passes() -> None:
    gate = SoundingGate()
    rng = np.random.default_rng(1)
    ground = (20.0 + 10.0 * np.sin(np.arange(400) / 15.0) + rng.normal(0.0, 0.3, 400)).tolist()
    assert depths(gate.passed(track(ground))) == ground
    assert not gate.counts


def test_spike_is_rejected_and_later_soundings_pass() -> None:
    gate = SoundingGate()
    assert depths(gate.passed(track([10.0, 10.1, 15.0, 10.2, 3.0, 10.3]))) == [10.0, 10.1, 10.2, 10.3]
    assert gate.counts == {"jump": 2}


def test_lasting_step_of_the_ground_is_accepted() -> None:
    gate = SoundingGate()
    assert depths(gate.passed(track([10.0, 10.1, *[20.0 + 0.1 * i for i in range(8)]]))) == [
        10.0,
        10.1,
        *[20.0 + 0.1 * i for i in range(AGREEING - 1, 8)],
    ]
    scattered = SoundingGate()
    wild = [10.0, *[30.0 if i % 2 else 60.0 for i in range(10)]]
    assert depths(scattered.passed(track(wild))) == [10.0], "jumps that do not agree are never believed"


def test_frozen_sensor_is_rejected_until_its_value_changes() -> None:
    gate = SoundingGate()
    rows = gate.passed(track([10.0, 10.004, *[11.0] * 40, 11.1, 11.2]))
    assert depths(rows) == [10.0, 10.004, *[11.0] * (REPEATS + 1), 11.1, 11.2]
    assert gate.counts["frozen"] == 40 - REPEATS - 1
    still = SoundingGate()
    assert len(still.passed([(float(i), 5.0, 5.0, 11.0) for i in range(40)])) == 40, "it lies still"


def test_late_stamps_are_rejected_and_a_set_clock_accepted() -> None:
    gate = SoundingGate()
    gate.passed([(100.0, 0.0, 0.0, 10.0)])
    back = [(50.0 + i, 0.0, 0.0, 10.0 + 0.1 * i) for i in range(8)]
    assert gate.passed(back) == back[AGREEING - 1 :]
    assert gate.counts == {"late": AGREEING - 1}


def test_non_finite_soundings_pass_to_their_readers() -> None:
    gate = SoundingGate()
    rows = [(0.0, 0.0, 0.0, 10.0), (1.0, 1.5, 0.0, math.nan), (2.0, 3.0, 0.0, 10.1)]
    assert gate.passed(rows) == rows


def test_sounder_with_decimetre_resolution_passes_over_flat_ground() -> None:
    ground = [round(10.0 + 0.004 * 1.5 * i, 1) for i in range(400)]  # rises 4 mm a metre: 17 equal ones in a row
    gate = SoundingGate()
    assert depths(gate.passed(track(ground))) == ground
    hangs = SoundingGate()
    passed = hangs.passed(track([*ground, *[ground[-1]] * 100]))
    assert len(passed) < len(ground) + 40, "one that hangs is found after 50 m"


@pytest.mark.parametrize("seed", range(60))
def test_a_whole_survey_passes_as_its_soundings_do_one_by_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(0, 300))
    rows = np.column_stack([np.arange(n), *np.cumsum(rng.normal(0.0, 1.5, (2, n)), axis=1), np.zeros(n)])
    rows[:, 3] = np.round(15.0 + np.cumsum(rng.normal(0.0, 0.3, n)), int(rng.integers(0, 3)))
    for _ in range(int(rng.integers(0, 8))) if n else ():
        at, many = rng.integers(n), rng.integers(1, 12)
        kind = rng.integers(5)
        if kind == 0:
            rows[at : at + many, 3] += rng.normal(0.0, 30.0, len(rows[at : at + many]))  # spikes
        elif kind == 1:
            rows[at:, 3] += 12.0  # a step
        elif kind == 2:
            rows[at : at + 8 * many, 3] = rows[at, 3]  # frozen
        elif kind == 3:
            rows[at : at + many, 0] -= 50.0  # late
        else:
            rows[at, rng.integers(4)] = rng.choice([np.nan, np.inf])
    gate = SoundingGate()
    one_by_one = np.array([bool(gate.passed([row])) for row in rows.tolist()], dtype=bool)
    passes, counts = passing(rows)
    assert passes.tolist() == one_by_one.tolist()
    assert counts == gate.counts
