"""The spacing index against a loop over all locations, after forgetting too."""

import numpy as np
import pytest

from auv_lse_common.support import compiled
from auv_lse_gp.map.spacing import SpacingIndex


@pytest.fixture(params=[True, False], ids=["numba", "numpy"], autouse=True)
def either(request, monkeypatch):
    if request.param and not compiled.USE_NUMBA:
        pytest.skip("numba is not installed")
    monkeypatch.setattr(compiled, "USE_NUMBA", request.param)


def nearest(kept, location, spacing_m):
    distance = np.hypot(*(kept - location).T)
    return int(np.argmin(distance)) if len(kept) and distance.min() < spacing_m else None


@pytest.mark.parametrize("max_new", [0, 5, 1000])
def test_take_equals_adding_locations_one_by_one(max_new):
    rng = np.random.default_rng(2)
    index, kept, room = SpacingIndex(5.0), np.zeros((0, 2)), max_new
    for count in (0, 1, 150):  # with more than the table has room for at first
        locations = rng.uniform(-50.0, 50.0, (count, 2))
        room = max_new
        near, new = index.take(locations, max_new)
        for location, number, is_new in zip(locations, near.tolist(), new.tolist(), strict=True):
            wanted = nearest(kept, location, 5.0)
            if wanted is not None:
                assert (number, is_new) == (wanted, False)
            elif room:
                assert (number, is_new) == (len(kept), True)
                kept, room = np.vstack([kept, location]), room - 1
            else:
                assert (number, is_new) == (-1, False)
        assert len(index) == len(kept)


def test_dropped_locations_are_not_found():
    rng = np.random.default_rng(1)
    index = SpacingIndex(5.0)
    locations = rng.uniform(-500.0, 500.0, (80, 2))
    index.take(locations, 80)
    index.truncate(30)
    near, _ = index.take(locations, 0)
    assert near[:30].tolist() == list(range(30))
    assert (near[30:] < 30).all()


def test_location_at_exactly_the_spacing_is_not_too_close():
    index = SpacingIndex(10.0)
    near, new = index.take(np.array([[0.0, 0.0], [10.0, 0.0], [-6.0, 7.9]]), 3)
    assert (near.tolist(), new.tolist()) == ([0, 1, 0], [True, True, False])
