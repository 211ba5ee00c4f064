"""The spacing index against a loop over all places, after forgetting too."""

import numpy as np
import pytest

from auv_lse_gp.spacing import SpacingIndex


@pytest.mark.parametrize("spacing_m", [0.0, 3.0, 10.0])
def test_finds_the_nearest_place_within_the_spacing(spacing_m):
    rng = np.random.default_rng(1)
    index, kept = SpacingIndex(spacing_m), np.zeros((0, 2))
    for size in (80, 30, 60, 0, 40):  # grows and is cut back
        index.truncate(size)
        kept = kept[:size]
        while len(kept) < size:
            kept = np.vstack([kept, rng.uniform(-50.0, 50.0, 2)])
            index.add(*kept[-1].tolist())
        assert len(index) == size
        for north, east in rng.uniform(-60.0, 60.0, (200, 2)).tolist():
            distance = np.hypot(kept[:, 0] - north, kept[:, 1] - east)
            near = int(np.argmin(distance)) if size and distance.min() < spacing_m else None
            assert index.too_close(north, east) == near


def test_a_place_at_exactly_the_spacing_is_not_too_close():
    index = SpacingIndex(10.0)
    index.add(0.0, 0.0)
    assert index.too_close(10.0, 0.0) is None
    assert index.too_close(6.0, 7.9) == 0
