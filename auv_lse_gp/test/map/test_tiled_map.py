"""A map of many centers: computed tile by tile, close to the dense map, and nothing is discarded."""

import numpy as np
import pytest

from auv_lse_gp import AreaConfig, DepthMap, GpConfig, LevelSet, OperatingArea, Outcome
from auv_lse_gp.map import online

AREA = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 900.0, 0.0, 900.0, 900.0, 0.0, 900.0), raster_m=20.0))
CONFIG = {"map_resolution_m": 20.0, "length_scale_m": 60.0}


def soundings(seed=0, step_m=8.0):
    """Soundings along lanes: stamp, north, east, depth (m)."""
    rng = np.random.default_rng(seed)
    north = np.arange(20.0, 880.0, step_m)
    locations = np.concatenate([np.column_stack([north, np.full_like(north, east)]) for east in range(40, 900, 90)])
    depth = (
        15.0
        + 6.0 * np.sin(locations[:, 0] / 90.0) * np.cos(locations[:, 1] / 110.0)
        + rng.normal(0, 0.2, len(locations))
    )
    return np.column_stack([np.arange(len(locations)), locations, depth])


def built():
    """A map that took soundings step by step."""
    depth_map = DepthMap(GpConfig(**CONFIG), LevelSet(), AREA)
    for part in np.array_split(soundings(), 12):
        depth_map.add_soundings(part)
        depth_map.gp.set_position_effect(np.full((len(depth_map.gp), 3), 0.1))
        depth_map.field()
    return depth_map


def test_tiled_field_is_close_to_dense(monkeypatch):
    """Tolerances: means .02 standard deviations, standard deviations .5 %, rescaled ones 2 %."""
    dense = built().field()
    monkeypatch.setattr(online, "MAX_DENSE", 150)
    depth_map = built()
    tiled, inside = depth_map.field(), AREA.grid(20.0).inside
    assert depth_map.gp.is_tiled
    assert len(depth_map.gp.posterior.centers) == len(depth_map.gp)  # still there for who asks
    assert np.abs((tiled.mean_m - dense.mean_m) / dense.prior_std_m)[inside].max() < 0.02
    assert np.abs(tiled.prior_std_m / dense.prior_std_m - 1.0)[inside].max() < 0.005
    assert tiled.std_m[inside] == pytest.approx(dense.std_m[inside], rel=0.02)
    locations = np.array([[100.0, 100.0], [800.0, 95.0]])
    mean, std = depth_map.gp.predict(locations)
    near = depth_map.gp.posterior.moments(locations)
    assert mean == pytest.approx(near[0], abs=0.02)
    assert std == pytest.approx(np.sqrt(near[1]), rel=0.005)


def test_field_is_right_whenever_the_map_becomes_dense_or_tiled(monkeypatch):
    monkeypatch.setattr(online, "MAX_DENSE", 150)
    depth_map, few = built(), soundings()[:200]
    for rows in (few, soundings(), few):
        depth_map.clear()
        depth_map.add_soundings(rows)
        fresh = DepthMap(GpConfig(**CONFIG), LevelSet(), AREA)
        fresh.add_soundings(rows)
        assert depth_map.gp.is_tiled == (len(rows) > 200)
        for name in ("mean_m", "std_m", "risk"):
            found, expected = getattr(depth_map.field(), name), getattr(fresh.field(), name)
            assert np.array_equal(found, expected, equal_nan=True), "as a map that was never anything else"


def test_samples_must_fit_a_tiled_map(monkeypatch):
    monkeypatch.setattr(online, "MAX_DENSE", 150)
    depth_map = built()
    locations = soundings(1)[::40, 1:3] + 12.0
    mean, _ = depth_map.gp.predict(locations)
    good = depth_map.add_samples(np.column_stack([locations, mean + 0.1]), 2)
    assert Outcome.OUTLIER not in good
    wrong = depth_map.add_samples(np.column_stack([locations + 1.0, mean + 30.0]), 3)
    assert set(wrong) == {Outcome.OUTLIER}
    assert depth_map.team[3].suspicious


def test_day_of_soundings_is_kept():
    gp = DepthMap(GpConfig(min_spacing_m=20.0), LevelSet(), AREA).gp
    along = 21.0 * np.arange(6000.0)
    outcomes = gp.add_all(np.column_stack([along % 2000.0, 21.0 * (along // 2000.0), np.full(6000, 15.0)]))
    assert outcomes.count(Outcome.FULL) == 0
    assert outcomes.count(Outcome.KEPT) > 5000
