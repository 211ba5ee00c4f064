"""What counts as a difference between a row and its mission flown again."""

import math

from auv_lse_shore.campaign.rerun import _same


def test_nan_is_the_same_as_nothing():
    assert _same((math.nan, 1.0), [None, 1.0])
    assert _same((math.nan, 1.0), [math.nan, 1.0])
    assert not _same((0.5, 1.0), [math.nan, 1.0])
