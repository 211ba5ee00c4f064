"""The tiled posterior against the dense one, over random surveys, kernels and sizes."""

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.roughness import variance_scales
from auv_lse_gp.inference.tiled_posterior import TiledMoments, TiledPosterior

#: Tolerances of mean (in standard deviations) and standard deviation (relative).
MEAN, STD = 0.02, 0.002


def lanes(seed, side_m=1500.0, widest_m=250.0):
    """Centers along lanes with gaps, in order of time, with uncertain positions."""
    rng = np.random.default_rng(seed)
    found, east = [], rng.uniform(20.0, 60.0)
    while east < side_m:
        north = np.arange(rng.uniform(0.0, 0.3 * side_m), side_m * rng.uniform(0.5, 1.0), 22.0)
        found.append(np.column_stack([north, east + 5.0 * np.sin(north / 50.0)]))
        east += rng.uniform(30.0, widest_m)
    locations = np.concatenate(found)
    depth = 15.0 + 8.0 * np.sin(locations[:, 0] / 90.0) * np.cos(locations[:, 1] / 110.0)
    effect = np.column_stack([0.3 * np.sin(locations[:, 0] / 200.0), 0.2 * np.cos(locations[:, 1] / 300.0)])
    return Centers(locations, depth + 0.3 * rng.normal(size=len(locations)), np.full(len(locations), 0.2), effect)


def both(config, data):
    dense = Posterior(config)
    dense.follow(data)
    tiled = TiledPosterior(Posterior(config))
    tiled.follow(data)
    return dense, tiled


def corners_computed(monkeypatch):
    """The corners of the tiles that are computed from now on."""
    computed = []
    compute = TiledMoments._compute

    def counted(self, stale):
        computed.append(stale.corner)
        return compute(self, stale)

    monkeypatch.setattr(TiledMoments, "_compute", counted)
    return computed


@pytest.mark.parametrize(
    ("prior", "mean", "std"),
    [
        ({}, MEAN, STD),
        ({"length_scale_2_m": 50.0, "rotation_deg": 30.0}, MEAN, STD),
        ({"kernel": "wendland_c2"}, MEAN, STD),
        ({"kernel": "squared_exponential"}, MEAN, STD),
    ],
    ids=["matern52", "anisotropic", "wendland", "squared_exponential"],
)
@pytest.mark.parametrize(("seed", "side_m", "widest_m"), [(0, 1500.0, 250.0), (1, 1500.0, 90.0)])
def test_tiled_is_close_to_dense(prior, mean, std, seed, side_m, widest_m):
    """Tolerances: of the mean in standard deviations of the location, and of the standard deviation, relative."""
    dense, tiled = both(GpConfig(**prior), lanes(seed, side_m, widest_m))
    locations = np.random.default_rng(seed).uniform(0.0, side_m, (300, 2))
    (dense_m, dense_m2), (tiled_m, tiled_m2) = dense.moments(locations), tiled.moments(locations)
    assert np.abs(tiled_m - dense_m).max() < mean * np.sqrt(dense_m2).max()
    ratio = np.sqrt(tiled_m2 / dense_m2)
    assert ratio.max() < 1.0 + std
    assert ratio.min() > 1.0 - std
    assert np.sqrt(((tiled_m - dense_m) ** 2 / dense_m2).mean()) < 0.25 * mean


def test_tiled_is_close_to_dense_at_3000_centers():
    """The same tolerances; slopes within 8 % of the steepest (1 % on average), the roughness within 2 %."""
    data = lanes(2, 2600.0, 100.0)
    assert len(data) > 2900
    dense, tiled = both(GpConfig(), data)
    locations = np.random.default_rng(2).uniform(0.0, 2600.0, (300, 2))
    (dense_m, dense_m2), (tiled_m, tiled_m2) = dense.moments(locations), tiled.moments(locations)
    assert np.abs((tiled_m - dense_m) / np.sqrt(dense_m2)).max() < MEAN
    assert np.abs(np.sqrt(tiled_m2 / dense_m2) - 1.0).max() < STD
    slopes, expected = tiled.slopes(), dense.slopes(data.locations_m)
    assert np.abs(slopes - expected).max() < 0.08 * np.abs(expected).max()
    assert np.abs(slopes - expected).mean() < 0.01 * np.abs(expected).max()
    moments = TiledMoments(tiled, locations, 85.0)
    moments.update()
    exact = dense_m2 - dense.position_variance(dense.kernel.scale(locations))
    assert moments.scales(100.0) == pytest.approx(variance_scales(dense, GpConfig(), locations, exact), rel=0.02)


def test_updates_equal_a_new_start():
    """But for slopes: 6 % (rms), at any center 20 % of the steepest."""
    config, data = GpConfig(), lanes(3)
    locations = np.random.default_rng(3).uniform(0.0, 1500.0, (200, 2))
    tiled = TiledPosterior(Posterior(config))
    moments = TiledMoments(tiled, locations, 85.0)
    for size in range(len(data) // 2, len(data) + 1, 25):
        moved = data.slice(0, size).take(np.arange(size))
        moved.locations_m[-3:] += 0.5 * np.sin(size)  # as merging does
        tiled.follow(moved)
        updated = moments.update()
        tiled.slopes()
    anew = TiledPosterior(Posterior(config))
    anew.follow(moved)
    for found, expected in zip(updated, TiledMoments(anew, locations, 85.0).update(), strict=True):
        assert np.allclose(found, expected, rtol=1e-7, atol=1e-7)
    slopes, expected = tiled.slopes(), anew.slopes()
    assert np.sqrt(((slopes - expected) ** 2).mean()) < 0.06 * np.sqrt((expected**2).mean())
    assert np.abs(slopes - expected).max() < 0.2 * np.abs(expected).max()


def test_slopes_are_recomputed_only_near_new_centers(monkeypatch):
    """However large the map: at most the nine tiles around a new center, and none if nothing has changed."""
    data, computed = lanes(4), []
    tiled = TiledPosterior(Posterior(GpConfig(length_scale_m=40.0)))
    slopes = Posterior.slopes

    def counted(self, locations_m):
        computed.append(len(locations_m))
        return slopes(self, locations_m)

    monkeypatch.setattr(Posterior, "slopes", counted)
    tiled.follow(data.slice(0, len(data) - 8))
    tiled.slopes()
    assert len(computed) > 100
    for size in range(len(data) - 7, len(data) + 1):
        computed.clear()
        tiled.follow(data.slice(0, size))
        tiled.slopes()
        assert 1 <= len(computed) <= 9
        computed.clear()
        tiled.slopes()
        assert not computed


def test_only_tiles_near_a_change_are_recomputed(monkeypatch):
    tiled = TiledPosterior(Posterior(GpConfig(length_scale_m=40.0)))
    data = lanes(4)
    moments = TiledMoments(tiled, data.locations_m, 85.0)
    computed = corners_computed(monkeypatch)
    tiled.follow(data.slice(0, len(data) - 1))
    moments.update()
    everywhere = len(computed)
    moments.update()
    assert len(computed) == everywhere
    tiled.follow(data)
    moments.update()
    assert 0 < len(computed) - everywhere <= 49
    assert everywhere > 100
    small = Centers(data.locations_m, data.depths_m, data.noise_std_m, 1.01 * data.position_effect_m)
    tiled.follow(small)
    before = len(computed)
    moments.update()
    assert len(computed) == before
    tiled.follow(Centers(data.locations_m, data.depths_m, data.noise_std_m, 1.1 * data.position_effect_m))
    moments.update()
    assert len(computed) - before == everywhere


def test_planned_locations_are_close_to_dense():
    dense, tiled = both(GpConfig(), lanes(5))
    rng = np.random.default_rng(5)
    locations, planned = rng.uniform(0.0, 1500.0, (100, 2)), rng.uniform(0.0, 1500.0, (400, 2))
    at = dense.with_planned(planned).at(locations)
    mean, variance, planned_variance = tiled.planned_moments(locations, planned)
    assert np.abs((mean - at.mean_m) / np.sqrt(at.data_var_m2)).max() < MEAN
    assert np.sqrt(variance / at.data_var_m2) == pytest.approx(1.0, abs=STD)
    assert np.sqrt(planned_variance / at.planned_var_m2) == pytest.approx(1.0, abs=STD)
    assert (planned_variance < variance).all()


def test_new_position_effects_alone_equal_a_new_start():
    data, config = lanes(6), GpConfig()
    locations = np.random.default_rng(6).uniform(0.0, 1500.0, (200, 2))
    tiled = TiledPosterior(Posterior(config))
    moments = TiledMoments(tiled, locations, config.length_scale_m)
    for effect in (None, data.position_effect_m, 3.0 * data.position_effect_m[:, ::-1]):
        tiled.follow(Centers(data.locations_m, data.depths_m, data.noise_std_m, effect))
        updated = moments.update()
    anew = TiledPosterior(Posterior(config))
    anew.follow(tiled.centers)
    fresh = TiledMoments(anew, locations, config.length_scale_m)
    for found, expected in zip(updated, fresh.update(), strict=True):
        assert np.allclose(found, expected, rtol=1e-7, atol=1e-7)
    assert moments.scales(100.0) == pytest.approx(fresh.scales(100.0), rel=1e-6)


def test_bounded_updates_start_where_centers_are_new_and_reach_every_tile(monkeypatch):
    computed = corners_computed(monkeypatch)
    config, data = GpConfig(length_scale_m=40.0), lanes(4)
    tiled = TiledPosterior(Posterior(config))
    locations = np.random.default_rng(4).uniform(0.0, 1500.0, (2000, 2))
    moments = TiledMoments(tiled, locations, 85.0)
    tiled.follow(data.slice(0, len(data) - 4))
    moments.update(1e6)
    everywhere = len(computed)
    assert everywhere > 100  # tiles without results are always computed
    moved = data.take(np.arange(len(data)))
    moved.locations_m[:] += 0.4  # as a correction does
    tiled.follow(moved)
    computed.clear()
    moments.update(1e6)
    assert 2 <= len(computed) < 0.5 * everywhere
    home = next(iter(tiled.tiles(data.locations_m[-1:])))[0]
    assert home in computed[: len(computed) // 2 + 1]
    before = 0
    while len(computed) > before:
        before, updated = len(computed), moments.update(1e6)
    assert len(computed) > 0.8 * everywhere  # all near data
    assert sorted(computed) == sorted(set(computed))  # none twice
    for found, expected in zip(updated, TiledMoments(tiled, locations, 85.0).update(), strict=True):
        assert np.allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_locations_far_apart_do_not_take_the_centers_between_them():
    """A packet's samples may lie anywhere in a mate's strip: no factor may grow with the area that they span."""
    data = lanes(2, 2600.0, 100.0)
    dense, tiled = both(GpConfig(), data)
    locations = np.random.default_rng(5).uniform(0.0, 2600.0, (40, 2))
    found = list(tiled.near(locations))
    assert sorted(np.concatenate([members for members, _ in found]).tolist()) == list(range(40))
    assert max(len(posterior) for _, posterior in found) < 0.1 * len(data)
    for members, posterior in found:
        mean, variance = posterior.moments(locations[members])
        expected, of_dense = dense.moments(locations[members])
        assert np.abs(mean - expected).max() < 0.2 * np.sqrt(of_dense).max()  # a gate is of several of these
        assert np.sqrt(variance / of_dense).max() < 1.05
