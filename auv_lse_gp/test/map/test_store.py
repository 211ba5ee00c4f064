"""The table of centers: spacing against a loop over all locations, and noise."""

import numpy as np
import pytest

from auv_lse_gp import GpConfig, Kernel, Outcome
from auv_lse_gp.map.store import CenterStore

pytestmark = pytest.mark.usefixtures("numba_or_numpy")


def made(**options):
    config = GpConfig(merge=False, **options)
    return CenterStore(config, Kernel(config))


def nearest(kept, location, spacing_m):
    distance = np.hypot(*(kept - location).T)
    return int(np.argmin(distance)) if len(kept) and distance.min() < spacing_m else None


@pytest.mark.parametrize("max_new", [0, 5, 1000])
def test_take_equals_adding_locations_one_by_one(max_new):
    rng = np.random.default_rng(2)
    store, kept, room = made(min_spacing_m=5.0), np.zeros((0, 2)), max_new
    for count in (0, 1, 150):  # with more than the table has room for at first
        locations = rng.uniform(-50.0, 50.0, (count, 2))
        room = max_new
        near, new = store._spaced(locations, max_new)
        for location, number, is_new in zip(locations, near.tolist(), new.tolist(), strict=True):
            wanted = nearest(kept, location, 5.0)
            if wanted is not None:
                assert (number, is_new) == (wanted, False)
            elif room:
                assert (number, is_new) == (len(kept), True)
                kept, room = np.vstack([kept, location]), room - 1
            else:
                assert (number, is_new) == (-1, False)
        assert len(store) == len(kept)


def test_location_at_exactly_the_spacing_is_not_too_close():
    near, new = made(min_spacing_m=10.0)._spaced(np.array([[0.0, 0.0], [10.0, 0.0], [-6.0, 7.9]]), 3)
    assert (near.tolist(), new.tolist()) == ([0, 1, 0], [True, True, False])


def test_centers_have_the_noise_with_which_they_can_be_factorized_wherever_they_are():
    store = made(signal_std_m=50.0, noise_std_m=0.005, min_spacing_m=0.0)
    outcomes = store.take(np.tile([10.0, 20.0, 15.0], (300, 1)), np.full(300, 0.005), 300)
    assert outcomes == [Outcome.KEPT] * 300
    assert 0.02 < store.centers.noise_std_m.min() < 0.05
    usual = made()
    usual.take(np.array([[10.0, 20.0, 15.0]]), np.array([0.3]), 1)
    assert usual.centers.noise_std_m.tolist() == [0.3]
