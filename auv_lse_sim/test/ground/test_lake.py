"""The synthetic lakes: what the default mission may rely on, over many seeds."""

import math

import numpy as np
import pytest

from auv_lse_common.mission_file.parameters import ParameterError, from_mapping
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.world import LakeConfig
from auv_lse_common.vocabulary.extent import Extent
from auv_lse_sim.ground.lake import SyntheticLake, _closed_shoals

WINDOW = LakeConfig().window


def grid(spacing_m: float = 10.0) -> tuple[np.ndarray, np.ndarray]:
    return np.meshgrid(*WINDOW.axes(spacing_m), indexing="ij")


def test_default_window_is_the_default_operating_area():
    assert Extent(north_min_m=-50.0, north_max_m=550.0, east_min_m=-50.0, east_max_m=650.0) == WINDOW
    corners = np.reshape(AreaConfig().polygon_m, (-1, 2))
    assert (*corners.min(axis=0), *corners.max(axis=0)) == (-50.0, -50.0, 550.0, 650.0)
    assert (WINDOW.height_m, WINDOW.width_m) == (600.0, 700.0)


@pytest.mark.parametrize("seed", range(50))
def test_every_lake_has_a_contour_an_island_and_both_sides(seed):
    lake = SyntheticLake(mission_seed=seed)
    depth = lake.depth_m(*grid())
    assert np.isfinite(depth).all()
    assert 8.0 < depth.min() < 15.0 < depth.max() < 35.0 + 2 * 0.7
    assert 0.25 <= (depth > 15.0).mean() <= 0.75
    assert _closed_shoals(depth < 15.0, 100.0, 800.0) >= 1
    # An inlet or a bend makes the contour longer than the straight crossing of the window.
    crossings = (np.diff(depth > 15.0, axis=0).sum() + np.diff(depth > 15.0, axis=1).sum()) * 10.0
    assert crossings > 900.0
    # The start can be navigated: deeper than the deepest vehicle with clearance, over a turning circle.
    angle = np.linspace(0.0, 2 * math.pi, 24)
    assert lake.depth_m(30 * np.cos(angle), 30 * np.sin(angle)).min() > 8.0


def test_same_seed_same_lake_and_other_seed_other_lake():
    locations = grid(50.0)
    assert np.array_equal(
        SyntheticLake(mission_seed=4).depth_m(*locations), SyntheticLake(mission_seed=4).depth_m(*locations)
    )
    own = SyntheticLake(LakeConfig(seed=4), mission_seed=99)
    assert np.array_equal(own.depth_m(*locations), SyntheticLake(mission_seed=4).depth_m(*locations))
    assert not np.allclose(SyntheticLake(mission_seed=5).depth_m(*locations), own.depth_m(*locations), atol=1.0)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_lake_is_smooth(seed):
    """Central differences converge as h^2: a kink in depth or slope would leave a term of order h or 1."""
    lake = SyntheticLake(mission_seed=seed)
    rng = np.random.default_rng(seed)
    north, east = rng.uniform(-190, 690, 400), rng.uniform(-190, 790, 400)

    def slope(h: float) -> np.ndarray:
        return (lake.depth_m(north + h, east) - lake.depth_m(north - h, east)) / (2 * h)

    coarse, fine = slope(0.02), slope(0.01)
    ok = np.isfinite(coarse) & np.isfinite(fine)
    assert ok.mean() > 0.95
    assert np.abs(coarse - fine)[ok].max() < 1e-4
    assert np.abs(fine[ok]).max() < 1.0  # no cliffs: under 45 degrees


def test_banks_rise_to_land_and_beyond_is_unknown():
    lake = SyntheticLake(mission_seed=1)
    e = lake.extent
    assert np.isnan(lake.depth_m(e.north_max_m + 1.0, 300.0))
    depth = lake.depth_m(250.0, np.linspace(WINDOW.east_max_m, e.east_max_m, 40)[:-1])
    assert depth[-1] < 0.2
    assert (np.diff(depth[20:]) < 0).all()


def test_shapes_broadcast():
    lake = SyntheticLake(mission_seed=1)
    assert lake.depth_m(0.0, 0.0).shape == ()
    assert lake.depth_m(np.zeros((3, 1)), np.zeros(4)).shape == (3, 4)


def test_emergent_islands_are_land():
    lake = SyntheticLake(LakeConfig(terrace_m=0.0, roughness_m=0.5, steepness=2.0), mission_seed=3)
    depth = lake.depth_m(*grid())
    assert np.isnan(depth).any()
    assert np.nanmin(depth) > 0.0


def test_steepness_makes_slopes_steeper():
    def slope(steepness: float) -> float:
        depth = SyntheticLake(LakeConfig(steepness=steepness, roughness_m=0.0), mission_seed=2).depth_m(*grid())
        return float(np.percentile(np.hypot(*np.gradient(depth, 10.0)), 95))

    assert slope(2.0) > 1.4 * slope(1.0)


def test_no_islands_when_none_are_asked_for():
    found = [
        _closed_shoals(SyntheticLake(LakeConfig(islands=0), seed).depth_m(*grid()) < 15.0, 100.0, 800.0)
        for seed in range(10)
    ]
    assert np.mean(found) < 0.5


@pytest.mark.parametrize(
    ("values", "match"),
    [
        ({"terrace_m": 20.0}, "terrace_m, level_m, deepest_m must be ascending depths, not 20, 15"),
        ({"deep_share_low": 0.6, "deep_share_high": 0.5}, "deep_share_low is 0.6, but must not exceed"),
        ({"island": 2}, "did you mean 'islands'"),
    ],
)
def test_bad_lakes_are_refused(values, match):
    with pytest.raises(ParameterError, match=match):
        from_mapping(LakeConfig, values, "test: sim.lake")


def test_impossible_lake_is_an_error():
    with pytest.raises(
        ValueError, match=r"islands 1: none of 200 lakes .* within 2000 m x 100 m\. .* sim\.lake\.inlets"
    ):
        SyntheticLake(LakeConfig(islands=1, height_m=2000.0, width_m=100.0), mission_seed=1)


def test_closed_shoals_counts_only_those_off_the_edge():
    shallow = np.zeros((20, 20), dtype=bool)
    shallow[5:8, 5:8] = True  # 9 cells
    shallow[0:3, 10:13] = True  # touches the edge
    shallow[15, 15] = True  # too small
    assert _closed_shoals(shallow, 100.0, 800.0) == 1
