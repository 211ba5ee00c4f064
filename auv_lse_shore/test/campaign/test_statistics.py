"""Means, shares and paired differences with their intervals."""

import math

import numpy as np
import pytest

from auv_lse_shore.campaign.statistics import bootstrap, interval, paired, proportion


def test_interval_of_known_numbers():
    found = interval([1.0, 2.0, 3.0, 4.0, None, float("nan")])
    assert (found.mean, found.count) == (2.5, 4)
    # t(3 degrees of freedom, 97.5 %) = 3.182446; standard error sqrt(5/3)/2 = 0.645497
    assert found.half == pytest.approx(3.182446 * 0.645497, rel=1e-5)
    assert str(found) == "2.5 ± 2.1"


def test_too_few_values_have_no_interval():
    assert interval([]).count == 0
    assert str(interval([])) == "–"
    assert math.isnan(interval([3.0]).low)
    assert str(interval([3.0])) == "3"


def test_pairs_cancel_what_the_seeds_share():
    lake = {1: 10.0, 2: 20.0, 3: 90.0, 4: None}
    better = {1: 9.0, 2: 19.0, 3: 89.0, 5: 0.0}
    difference = paired(better, lake)
    assert (difference.mean, difference.half, difference.count) == (-1.0, 0.0, 3)


def test_shares_have_limits_that_shares_can_have():
    assert proportion([False] * 16) == "0.00 (0.00 to 0.19)"
    assert proportion([True] * 16) == "1.00 (0.81 to 1.00)"
    assert proportion([True] * 5 + [False] * 11 + [None]) == "0.31 (0.14 to 0.56)"  # Wilson 1927
    assert proportion([None]) == "–"


def test_the_bootstrap_resamples_pairs_together():
    rng = np.random.default_rng(1)
    cells = rng.integers(50, 150, 40).astype(float)
    safe = rng.binomial(cells.astype(int), 0.3).astype(float)
    low, high = bootstrap((safe, cells), lambda s, c, axis: s.sum(axis) / c.sum(axis), 500)
    share, error = safe.sum() / cells.sum(), math.sqrt(0.3 * 0.7 / cells.sum())
    assert low < share < high
    assert high - low == pytest.approx(2.0 * 1.96 * error, rel=0.4)  # binomial; 40 missions estimate it within 30 %
    assert (low, high) == bootstrap((safe, cells), lambda s, c, axis: s.sum(axis) / c.sum(axis), 500), "same seed"
