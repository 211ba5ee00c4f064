"""The benchmark of missed pieces."""

import numpy as np
import pytest

from benchmarks.planning.missed import missed_m, pairs, table

NORTH = np.arange(0.0, 200.5, 1.0)
LINE = np.column_stack([NORTH, np.zeros_like(NORTH)])
#: A closed line of 160 m that begins in the middle of its eastern side.
SQUARE = np.array([[20.0, 340.0], [40.0, 340.0], [40.0, 300.0], [0.0, 300.0], [0.0, 340.0], [20.0, 340.0]])


def test_a_stretch_that_the_estimate_does_not_come_near_is_missed():
    assert missed_m([LINE], [np.add(LINE, (0.0, 9.0))]) == []
    assert missed_m([LINE], [LINE[:101]]) == [pytest.approx(90.0, abs=3.0)]  # it is near up to 10 m beyond its end
    assert missed_m([LINE], [LINE[:171]]) == []  # 20 m is short
    assert missed_m([LINE], []) == [pytest.approx(200.0, abs=3.0)]


def test_a_stretch_through_a_closed_lines_start_is_one_piece():
    west = np.column_stack([np.linspace(0.0, 40.0, 21), np.full(21, 300.0)])
    (length,) = missed_m([SQUARE, LINE], [LINE, west])
    assert length == pytest.approx(40.0 + 2.0 * 30.0, abs=4.0)
    assert missed_m([SQUARE], [LINE]) == [pytest.approx(160.0, abs=4.0)]


def test_variants_are_compared_lake_by_lake():
    def line(variant, lake, error, missed):
        figures = {"isobath_error_m": error, "isobath_found": 0.9, "risk_third": 2.0, "risk_after": error / 10.0}
        losses = {"loss_expected": 0.1, "loss_after": 0.2, "isobath_undiscovered_m": 1.0}
        names = {"variant": variant, "vehicles": 3, "lake": lake, "missed_m": missed}
        return {**names, **figures, **losses, "isobath_undiscovered_limit_m": 2.0}

    lines = [line("tour", "1", 2.0, []), line("tour", "2", 4.0, [50.0]), line("joint routes", "2", 5.0, [])]
    text = table(lines)
    assert "| made up, 3: tour | 2 | 1 | 1 | 50 | 3.0 | 4.0 |" in text[2]
    assert "| 3, 2: tour | 50 | 4.0 |" in text[-1]
    assert "| 3: joint routes | 1 | +1.00 (" in pairs(lines)[-1]
    assert "+25 %" in pairs(lines)[-1]
