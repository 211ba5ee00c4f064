"""Rectangles of ground."""

import pytest

from auv_lse_common.vocabulary.extent import Extent


def test_empty_extent_is_refused():
    with pytest.raises(ValueError, match="is empty"):
        Extent(north_min_m=0, north_max_m=0, east_min_m=0, east_max_m=5)
