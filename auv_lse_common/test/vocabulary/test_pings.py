"""Pings become soundings."""

import numpy as np
import pytest

from auv_lse_common.vocabulary.pings import by_period, period_of, sounding_of


def test_period_includes_its_end() -> None:
    assert period_of([0.0, 0.1, 1.0, 1.1, 2.0], 1.0).tolist() == [0.0, 1.0, 1.0, 2.0, 2.0]
    # a stamp that rounding has put a little past the end still belongs to the period
    assert period_of(3.0 + 1e-7, 1.0) == 3.0


def test_pings_are_split_by_period() -> None:
    stamps = np.array([0.2, 0.9, 1.0, 1.5, 4.1])
    pings = np.column_stack([stamps, stamps, stamps, stamps])
    assert [group[:, 0].tolist() for group in by_period(pings, 1.0)] == [[0.2, 0.9, 1.0], [1.5], [4.1]]
    assert by_period(pings[:0], 1.0) == []


@pytest.mark.parametrize(("depths", "median"), [([3.0], 3.0), ([3.0, 90.0, 4.0], 4.0), ([1.0, 2.0, 4.0, 90.0], 3.0)])
def test_sounding_has_the_median_depth_at_the_mean_position(depths: list[float], median: float) -> None:
    count = len(depths)
    rows = np.column_stack([np.arange(count), 10.0 * np.arange(count), np.full(count, -3.0), depths])
    mean = (count - 1) / 2.0
    assert sounding_of(rows) == pytest.approx(np.array([mean, 10.0 * mean, -3.0, median]))
