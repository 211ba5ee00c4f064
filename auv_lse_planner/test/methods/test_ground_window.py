"""The window of a long mission against the dense posterior of the whole map."""

import numpy as np
import pytest

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.methods import ground_window
from auv_lse_planner.methods.ground_window import GroundWindow
from auv_lse_planner.reward.anytime import AnytimeReward, Weighting

SIDE_M = 1500.0
PATH_M = np.column_stack([np.linspace(300.0, 1000.0, 120), np.full(120, 700.0)])
#: Largest relative error of the whole map's risk: cells far from all centers are updated late.
RISK = 0.03


def _lanes(seed):
    """Centers along lanes with gaps."""
    rng = np.random.default_rng(seed)
    lanes, east = [], rng.uniform(20.0, 60.0)
    while east < SIDE_M:
        north = np.arange(rng.uniform(0.0, 400.0), SIDE_M * rng.uniform(0.5, 1.0), 22.0)
        lanes.append(np.column_stack([north, east + 5.0 * np.sin(north / 50.0)]))
        east += rng.uniform(50.0, 250.0)
    locations = np.concatenate(lanes)
    depth = 15.0 + 8.0 * np.sin(locations[:, 0] / 90.0) * np.cos(locations[:, 1] / 110.0)
    return Centers(locations, depth + 0.3 * rng.normal(size=len(locations)), np.full(len(locations), 0.2))


def _dense_lanes():
    """Centers as close as after the legs of a team: lanes 20 to 60 m apart, centers every 14 m."""
    rng = np.random.default_rng(6)
    lanes = [np.column_stack([np.arange(rng.uniform(0, 300.0), 1400.0, 14.0)] * 2) for _ in range(30)]
    for lane, east in zip(lanes, np.cumsum(rng.uniform(20.0, 60.0, 30)), strict=True):
        lane[:, 1] = east + 5.0 * np.sin(lane[:, 0] / 50.0)
    locations = np.concatenate(lanes)
    depth = (
        15.0
        + 8.0 * np.sin(locations[:, 0] / 90.0) * np.cos(locations[:, 1] / 110.0)
        + 0.3 * rng.normal(size=len(locations))
    )
    effect = np.column_stack([0.3 * np.sin(locations[:, 0] / 200.0), 0.2 * np.cos(locations[:, 1] / 300.0)])
    return Centers(locations, depth, np.full(len(locations), 0.2), effect)


def _window(config):
    area = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, SIDE_M, 0.0, SIDE_M, SIDE_M, 0.0, SIDE_M)))
    grid = area.grid(20.0)
    return GroundWindow(Posterior(config), config, LevelSetConfig(), grid, area.grid(30.0)), grid


def _total_risk(window):
    now = window.fine.current()
    near = LevelSet.of(LevelSetConfig()).risk(now.mean_m, np.sqrt(now.data_var_m2)).sum()
    return float(near) + window.elsewhere_risk


@pytest.mark.parametrize(
    ("prior", "mean", "std"),
    [
        ({}, 0.04, 0.005),
        ({"length_scale_2_m": 50.0, "rotation_deg": 30.0}, 0.04, 0.005),
        ({"kernel": "squared_exponential"}, 0.15, 0.05),
    ],
    ids=["matern52", "anisotropic", "squared_exponential"],
)
def test_window_is_close_to_the_dense_posterior(monkeypatch, prior, mean, std):
    """Tolerances: of the mean in standard deviations, and of the standard deviation, relative."""
    monkeypatch.setattr(ground_window, "MOST_EXACT", 10**6)
    config = GpConfig(**prior)
    for seed in range(2):
        data, dense = _lanes(seed), Posterior(config)
        dense.follow(data)
        window, grid = _window(config)
        window.set_centers(data)
        window.focus(PATH_M)
        assert window.posterior.data_rows < 0.8 * len(data)
        now, (mean_m, variance) = window.fine.current(), dense.moments(window.fine.locations_m)
        assert np.abs(now.mean_m - mean_m).max() < mean * np.sqrt(variance).max()
        assert np.sqrt(now.data_var_m2 / variance).max() < 1.0 + std
        everywhere, variance = dense.moments(grid.locations_m)
        whole = LevelSet.of(LevelSetConfig()).risk(everywhere, np.sqrt(variance)).sum()
        assert _total_risk(window) == pytest.approx(whole, rel=RISK)


@pytest.mark.parametrize(
    ("most", "share", "mean", "std"), [(10**6, 0.85, 0.04, 0.005), (400, 0.65, 0.2, 0.12)], ids=["wide", "narrow"]
)
def test_centers_near_the_border_of_the_window_are_averaged(monkeypatch, most, share, mean, std):
    """With many centers the margins are narrower and the tolerances of mean and standard deviation wider."""
    monkeypatch.setattr(ground_window, "MOST_EXACT", most)
    data, (window, _) = _dense_lanes(), _window(GpConfig())
    window.set_centers(data)
    window.focus(PATH_M)
    near = data.take(np.flatnonzero(window.near(data.locations_m)))
    assert window.posterior.data_rows < share * len(near)
    exact = Posterior(GpConfig())
    exact.follow(near)
    now, (mean_m, variance) = window.fine.current(), exact.moments(window.fine.locations_m)
    off, ratio = (now.mean_m - mean_m) / np.sqrt(variance), np.sqrt(now.data_var_m2 / variance)
    assert np.abs(off).max() < mean
    assert np.abs(ratio - 1.0).max() < std
    assert np.sqrt(np.mean(off**2)) < 0.2 * mean
    risk = LevelSet.of(LevelSetConfig()).risk
    assert risk(now.mean_m, np.sqrt(now.data_var_m2)).sum() == pytest.approx(
        risk(mean_m, np.sqrt(variance)).sum(), rel=0.02
    )


def test_settled_ground_is_covered_with_the_mean_of_the_last_focus_but_not_planned_with():
    data, (window, grid) = _dense_lanes(), _window(GpConfig())
    deep = Centers(data.locations_m, data.depths_m + 20.0, data.noise_std_m, data.position_effect_m)
    window.set_centers(deep)
    window.focus(PATH_M)
    covered = grid.locations_m[window.covers(grid.locations_m)]
    assert len(window.fine.locations_m) < 0.9 * len(covered)
    dense = Posterior(GpConfig())
    dense.follow(deep)
    exact_m, variance = dense.moments(covered)
    assert np.abs((window.mean_m(covered) - exact_m) / np.sqrt(variance)).max() < 0.3
    levels = LevelSet.of(LevelSetConfig())
    planned = {tuple(location) for location in window.fine.locations_m.tolist()}
    settled = [tuple(location) not in planned for location in covered.tolist()]
    assert levels.risk(exact_m, np.sqrt(variance))[settled].max() < 2e-3 * levels.largest_risk


def test_focused_window_takes_centers_when_it_is_updated():
    data, (window, _) = _lanes(1), _window(GpConfig())
    window.set_centers(data.slice(0, 100))
    window.focus(PATH_M)
    before = window.posterior.data_rows
    window.set_centers(data)
    assert window.posterior.data_rows == before
    near = window.around(PATH_M[60], 100.0)
    dense = Posterior(GpConfig())
    dense.follow(data)
    assert near.mean_m(PATH_M[55:65]) == pytest.approx(dense.mean_m(PATH_M[55:65]), abs=1.0)
    window.update()
    assert window.posterior.data_rows > before


def test_refused_centers_are_reported_until_others_are_taken():
    window, _ = _window(GpConfig())
    window.set_centers(Centers(np.zeros((2, 2)), np.full(2, 9.0), np.full(2, 1e-9)))
    assert "not positive definite" in window.refused
    window.set_centers(_lanes(1).slice(0, 3))
    assert not window.refused


def test_many_centers_are_averaged_until_the_first_focus():
    data, (window, grid) = _dense_lanes(), _window(GpConfig())
    window.most_centers = 300
    window.set_centers(data)
    assert 50 < window.posterior.data_rows <= 300
    dense = Posterior(GpConfig())
    dense.follow(data)
    off = window.posterior.mean_m(grid.locations_m) - dense.mean_m(grid.locations_m)
    assert np.sqrt(np.mean(off**2)) < 2.0  # of a ground that varies by 8 m: enough to find shallows and a first line
    window.focus(PATH_M)
    assert window.posterior.data_rows > 300
    window.release()
    assert window.posterior.data_rows == len(data)


def test_later_centers_elsewhere_count_at_the_next_focus():
    window, grid = _window(GpConfig())
    data = _lanes(1)
    window.focus(PATH_M)
    prior = window.elsewhere_risk
    window.set_centers(data)
    assert window.elsewhere_risk == prior
    window.focus(PATH_M)
    assert window.elsewhere_risk < 0.9 * prior
    window.release()
    assert window.posterior.data_rows == len(data)
    assert len(window.fine.locations_m) == len(grid.locations_m)


def _reward(window, path_m, mates_m):
    """Reward of a path without the data's first part, and its gradient's direction."""
    mates = [(np.arange(1.0, 1.0 + len(mates_m)), mates_m[window.near(mates_m)])] if len(mates_m) else []
    reward = AnytimeReward(window.fine, LevelSetConfig(), mates, Weighting(len(path_m), 0, 40, 1.5), window.coarse)
    none = reward.value(np.empty((0, 1, 2)))
    value = reward.value(path_m[:, None])
    gradient = reward.value_and_gradient(path_m)[1]
    return value.expected_end - none.expected_end, value.weighted - none.weighted, gradient


@pytest.mark.parametrize(
    "mates_m", [np.zeros((0, 2)), np.column_stack([np.linspace(150.0, 150.0, 40), np.arange(0.0, 600.0, 15.0)])]
)
def test_cells_out_of_reach_have_no_part_in_the_value_of_a_path(monkeypatch, mates_m):
    data, (whole, grid), (window, _) = _lanes(3), _window(GpConfig()), _window(GpConfig())
    start, legs_m = np.array([300.0, 500.0]), 250.0
    monkeypatch.setattr(ground_window, "MANY_CELLS", len(grid.locations_m))
    assert not window.limit(start, legs_m), "a map of so few cells is not limited"
    monkeypatch.setattr(ground_window, "MANY_CELLS", len(grid.locations_m) - 1)
    assert window.limit(start, legs_m)
    assert len(window.grid.locations_m) < 0.4 * len(grid.locations_m)
    for each in (whole, window):
        each.set_centers(data)
    assert len(window.fine.locations_m) == len(window.grid.locations_m)
    path_m = start + np.column_stack([np.linspace(0.0, 240.0, 16), 30.0 * np.sin(np.arange(16.0))])
    (end, weighted, gradient), (all_end, all_weighted, all_gradient) = (
        _reward(w, path_m, mates_m) for w in (window, whole)
    )
    assert end == pytest.approx(all_end, rel=0.01)
    assert weighted == pytest.approx(all_weighted, rel=0.01)
    assert np.abs(gradient - all_gradient).max() < 0.02 * np.abs(all_gradient).max()


def test_map_is_limited_anew_only_after_a_drift(monkeypatch):
    monkeypatch.setattr(ground_window, "MANY_CELLS", 1000)
    (window, grid), (small, _) = _window(GpConfig()), _window(GpConfig())
    assert not small.limit(np.array([700.0, 700.0]), 2000.0), "the legs reach all of the map"
    assert window.limit(np.array([200.0, 200.0]), 300.0)
    window.set_centers(_lanes(2))
    window.focus(PATH_M - [0.0, 400.0])
    on_plan = np.array([350.0, 250.0])
    assert not window.limit(on_plan, 140.0)
    assert not window.limit(on_plan + 60.0, 140.0), "a little drift is allowed for"
    drifted = np.array([1000.0, 900.0])
    assert window.limit(drifted, 140.0)
    assert not window.is_focused
    off_m = np.hypot(*(window.grid.locations_m - drifted).T)
    assert off_m.max() <= 140.0 + 3.0 * 85.0
    assert len(off_m) == np.count_nonzero(np.hypot(*(grid.locations_m - drifted).T) <= 140.0 + 3.0 * 85.0)
    window.focus(drifted + np.column_stack([np.arange(0.0, 140.0, 14.0), np.zeros(10)]))
    assert window.limit(np.array([9000.0, 9000.0]), 140.0)
    assert len(window.grid.locations_m) == len(grid.locations_m), "from far outside, all of the map counts"
