"""The map: updated step by step it is what a map made at once would be; isobath and counts."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from auv_lse_common.mission_file.sections.gp import KERNELS
from auv_lse_common.vocabulary.health import Level
from auv_lse_gp import AreaConfig, DepthMap, GpConfig, LevelSet, OperatingArea, Outcome, Posterior, contours
from auv_lse_gp.health import map_health, map_totals
from auv_lse_gp.inference.roughness import variance_scales
from auv_lse_gp.level_set.lines import beyond_border

AREA = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 200.0, 0.0, 200.0, 240.0, 0.0, 240.0), raster_m=4.0))


def depth(north, east):
    return 15.0 + (north - 100.0) / 10.0 + 1.5 * np.sin(east / 30.0)


def track(n, seed=0):
    """Soundings of a wandering vehicle: it comes back to where it was."""
    rng = np.random.default_rng(seed)
    heading = np.cumsum(rng.normal(0, 0.3, n))
    path = 100.0 + np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]) * 3.0, axis=0)
    path = np.abs((path + 200.0) % 400.0 - 200.0)  # reflected into the area
    return np.column_stack([np.arange(n) * 1.0, path, depth(path[:, 0], path[:, 1]) + rng.normal(0, 0.3, n)])


@pytest.mark.usefixtures("numba_or_numpy")
@pytest.mark.parametrize("merge", [False, True])
@pytest.mark.parametrize("name", KERNELS)
def test_field_updated_in_steps_equals_one_update(name, merge):
    config = GpConfig(kernel=name, merge=merge, min_spacing_m=8.0, length_scale_m=50.0)
    level_set = LevelSet()
    step_by_step = DepthMap(config, level_set, AREA)
    soundings = track(300)
    for part in np.array_split(soundings, 40):
        step_by_step.add_soundings(part)
        step_by_step.field()
    field = step_by_step.field()
    fresh = Posterior(config)
    fresh.extend(step_by_step.centers)
    mean, variance = fresh.moments(step_by_step.grid.locations_m)
    std = np.sqrt(variance)
    inside = step_by_step.grid.inside
    assert_allclose(field.mean_m[inside], mean, rtol=1e-9)
    assert_allclose(field.prior_std_m[inside], std, rtol=1e-9)
    scales = variance_scales(fresh, config, step_by_step.grid.locations_m, std**2)
    std = std * np.sqrt(scales)
    assert_allclose(field.std_m[inside], std, rtol=1e-9)
    assert_allclose(field.risk[inside], level_set.risk(mean, std), rtol=1e-7, atol=1e-12)
    assert_allclose(field.p_safe[inside], level_set.p_safe(mean, std), rtol=1e-7, atol=1e-12)
    assert field.revision == step_by_step.revision == step_by_step.field().revision
    if merge:
        assert step_by_step.counts.merged > 30


def test_soundings_are_sorted_by_stamp_and_samples_keep_their_order():
    depth_map = DepthMap(GpConfig(min_spacing_m=10.0, merge=False), LevelSet(), AREA)
    outcomes = depth_map.add_soundings([[2.0, 104.0, 100.0, 15.0], [1.0, 100.0, 100.0, 15.0]])
    assert outcomes == [Outcome.TOO_CLOSE, Outcome.KEPT]
    outcomes = depth_map.add_samples([[50.0, 50.0, 10.0], [50.0, 53.0, 10.0]], 2)
    assert outcomes == [Outcome.KEPT, Outcome.TOO_CLOSE]
    assert depth_map.centers.locations_m.tolist() == [[100.0, 100.0], [50.0, 50.0]]
    assert depth_map.add_soundings(np.zeros((0, 4))) == []
    with pytest.raises(ValueError, match=r"soundings: rows must have the shape \(n, 4\).*, not \(1, 3\)"):
        depth_map.add_soundings([[1.0, 2.0, 3.0]])


def test_rejected_soundings_are_counted_and_the_others_taken():
    depth_map = DepthMap(GpConfig(), LevelSet(), AREA)
    outcomes = depth_map.add_soundings([[0.0, 1.0, 1.0, math.nan], [1.0, 50.0, 50.0, 12.0], [2.0, 9.0, 9.0, -4.0]])
    assert outcomes == [None, Outcome.KEPT, None]
    assert depth_map.counts.refused == 2
    assert "depth_m=-4.0 is implausible; plausible are 0 to 1000 m" in depth_map.last_problem
    assert np.isfinite(depth_map.field().mean_m[depth_map.grid.inside]).all()


def told_of(depth_map):
    """What diagnostics say when all that was counted is recent."""
    return map_health(depth_map, 0.0, 0.0, {}, map_totals(depth_map, {}))


def surveyed(**values):
    """A map with own soundings on a grid of the true depth, and locations between them."""
    depth_map = DepthMap(GpConfig(length_scale_m=60.0, **values), LevelSet(level_m=15.0), AREA)
    rng = np.random.default_rng(2)
    north, east = (axis.ravel() for axis in np.meshgrid(np.arange(10.0, 200.0, 20.0), np.arange(10.0, 240.0, 20.0)))
    own = np.column_stack([np.arange(len(north)), north, east, depth(north, east) + rng.normal(0, 0.3, len(north))])
    depth_map.add_soundings(own)
    return depth_map, rng.uniform([20, 20], [180, 220], (200, 2)), rng


def test_forged_samples_do_not_take_over_the_map():
    depth_map, locations, rng = surveyed()
    before = depth_map.field().p_safe.copy()
    samples = np.column_stack([locations, depth(*locations.T) + rng.normal(0, 0.3, len(locations))])
    forged = rng.random(len(samples)) < 0.5
    samples[forged, 2] = np.where(samples[forged, 2] > 15.0, 2.0, 874.0)
    outcomes = np.array([o for packet in np.split(samples, 10) for o in depth_map.add_samples(packet, 3)])
    assert (outcomes[forged] == Outcome.OUTLIER).all()
    assert (outcomes[~forged] != Outcome.OUTLIER).mean() > 0.98
    inside = depth_map.grid.inside
    assert (((depth_map.field().p_safe > 0.5) != (before > 0.5))[inside]).mean() < 0.03
    health = told_of(depth_map)
    assert health.level is Level.WARN
    assert "samples of auv3 do not fit this vehicle's map" in health.text
    assert health.values["samples of auv3 that do not fit"] == f"{forged.sum()} of 200"


def test_samples_with_a_position_error_fit_without_a_warning():
    depth_map, locations, rng = surveyed()
    off = locations + rng.normal(0.0, 3.0, locations.shape)  # what drift leaves in a mate's positions
    depth_map.add_samples(np.column_stack([locations, depth(*off.T) + rng.normal(0, 0.3, len(locations))]), 2)
    assert not depth_map.team[2].suspicious
    assert told_of(depth_map).level is Level.OK


def test_centers_are_limited_and_samples_to_half_of_them():
    depth_map, locations, _ = surveyed(max_centers=150, min_spacing_m=0.0, merge=False)
    own = len(depth_map.centers)
    assert own < 150
    told = [depth_map.add_samples([[*location, depth(*location)]], 2)[0] for location in locations]
    assert len(depth_map.centers) == min(150, own + 75)
    assert told[-1] is Outcome.FULL
    assert "soundings discarded: the map is full (gp.max_centers = 150)" in told_of(depth_map).text


def test_samples_beyond_the_limit_are_still_merged():
    depth_map = DepthMap(GpConfig(max_centers=4, min_spacing_m=15.0), LevelSet(level_m=15.0), AREA)
    samples = [[20.0, 20.0, 12.0], [60.0, 20.0, 12.0], [100.0, 20.0, 12.0], [62.0, 20.0, 12.0]]
    kept, merged, full = Outcome.KEPT, Outcome.MERGED, Outcome.FULL
    assert depth_map.add_samples(samples, 2) == [kept, kept, full, merged]
    assert depth_map.counts.full == 1


def test_isobath_and_its_band():
    depth_map = DepthMap(GpConfig(mean_depth_m=15.0, length_scale_m=60.0), LevelSet(level_m=15.0), AREA)
    rng = np.random.default_rng(1)
    locations = rng.uniform([0, 0], [200, 240], (500, 2))
    depth_map.add_samples(np.column_stack([locations, depth(*locations.T) + rng.normal(0, 0.3, 500)]), 2)
    isobath = depth_map.isobath()
    assert isobath.band_probability == 0.95
    line = max(isobath.lines, key=len)
    true_north = 100.0 - 15.0 * np.sin(line[:, 1] / 30.0)
    off = np.abs(line[:, 0] - true_north)
    assert np.median(off) < 1.5
    assert off.max() < 8.0  # at the edge of the data
    assert np.ptp(line[:, 1]) > 225.0  # from side to side
    for edge, side in ((isobath.shallow_edge, -1.0), (isobath.deep_edge, 1.0)):
        points = max(edge, key=len)
        offset = side * (points[:, 0] - np.interp(points[:, 1], *line[np.argsort(line[:, 1])].T[::-1]))
        assert np.all(offset > 0.0)
        points = points[AREA.contains(points)]  # without the cells beyond the border
        mean, std = depth_map.gp.predict(points)
        gp = depth_map.gp
        std = std * np.sqrt(variance_scales(gp.posterior, gp.config, points, std**2))
        # Linear between cells of 5 m, over which the band's edges are a few metres apart.
        assert (mean - 15.0) / std == pytest.approx(np.full(len(points), side * 1.96), abs=0.5)
        assert np.mean((mean - 15.0) / std) == pytest.approx(side * 1.96, abs=0.1)


def test_contours_of_a_cone():
    grid = AREA.grid(2.0)
    north, east = np.meshgrid(grid.north_m, grid.east_m, indexing="ij")
    lines = contours(grid.north_m, grid.east_m, np.hypot(north - 100.0, east - 120.0), 50.0, grid.inside)
    assert len(lines) == 1
    assert np.hypot(lines[0][:, 0] - 100.0, lines[0][:, 1] - 120.0) == pytest.approx(50.0, abs=0.05)
    assert lines[0][0].tolist() == lines[0][-1].tolist()
    assert contours(grid.north_m, grid.east_m, np.full(grid.inside.shape, np.nan), 50.0, grid.inside) == []


@pytest.mark.parametrize("at_m", [-1.5, -5.5, 201.5, 205.5])
def test_a_contour_goes_on_through_two_cells_beyond_the_border(at_m):
    """Cells of 4 m: the last centers are at 2 and 198 m, and a bank may cross the level between them and the shore."""
    grid = AREA.grid(4.0)
    north, east = np.meshgrid(grid.north_m, grid.east_m, indexing="ij")
    (line,) = contours(grid.north_m, grid.east_m, north + 0.0 * east, at_m, grid.inside)
    assert line[:, 0] == pytest.approx(at_m)
    assert np.ptp(line[:, 1]) >= 240.0
    assert contours(grid.north_m, grid.east_m, north, at_m, np.zeros_like(grid.inside)) == []  # unknown ground


@pytest.mark.parametrize("at_m", [-6.5, 206.5])
def test_a_contour_farther_beyond_the_border_is_not_drawn(at_m):
    grid = AREA.grid(4.0)
    north, _ = np.meshgrid(grid.north_m, grid.east_m, indexing="ij")
    assert contours(grid.north_m, grid.east_m, north, at_m, grid.inside) == []


def test_values_go_on_into_a_no_go_zone():
    hole = (100.0, 60.0, 160.0, 60.0, 160.0, 160.0, 100.0, 160.0)
    area = OperatingArea(AreaConfig(polygon_m=AREA.config.polygon_m, no_go={"hole": hole}))
    grid = area.grid(4.0)
    north, _ = np.meshgrid(grid.north_m, grid.east_m, indexing="ij")
    values = np.where(grid.inside, north, np.nan)
    hole = values[25:40, 15:40]
    assert np.isnan(hole).all()
    filled = beyond_border(values, 2)[25:40, 15:40]
    assert filled[0] == pytest.approx(102.0)
    assert filled[1] == pytest.approx(106.0)
    assert filled[:, 1] == pytest.approx(north[25:40, 0])
    assert np.isnan(filled[2:-2, 2:-2]).all()
    informed = north < 150.0  # only from the south
    filled = beyond_border(values, 2, informed)
    assert filled[25, 15:40] == pytest.approx(102.0)
    assert np.isnan(filled[38:40, 20:35]).all()
    assert np.array_equal(filled[grid.inside], values[grid.inside])


@pytest.mark.parametrize(("side_m", "factor"), [(500.0, 1.0), (2000.0, 3.2)])
def test_large_map_is_published_less_often(side_m, factor):
    polygon = (0.0, 0.0, side_m, 0.0, side_m, side_m, 0.0, side_m)
    area = OperatingArea(AreaConfig(polygon_m=polygon))
    made = DepthMap(GpConfig(publish_period_s=10.0, map_resolution_m=5.0), LevelSet(), area)
    assert made.publish_period_s == pytest.approx(10.0 * factor, rel=0.01)
