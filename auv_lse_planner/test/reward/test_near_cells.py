"""The cells near a path: by brute force, and the reward of a path with them against the reward with all cells."""

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.gp import KERNELS, GpConfig
from auv_lse_gp.covariance.kernels import Kernel
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.reward import anytime
from auv_lse_planner.reward.anytime import AnytimeReward, Weighting
from auv_lse_planner.reward.line import LineLoss
from auv_lse_planner.reward.near_cells import RANGE, NearCells

SIDE_M = 2500.0


def _cells(spacing_m):
    axis = np.arange(0.5 * spacing_m, SIDE_M, spacing_m)
    return np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("kernel", KERNELS)
def test_all_cells_within_range_are_found_and_few_others(kernel):
    kernel = Kernel(GpConfig(kernel=kernel, length_scale_2_m=50.0, rotation_deg=30.0))
    cells = kernel.scale(_cells(20.0))
    rng = np.random.default_rng(1)
    near = NearCells(kernel, cells)
    reach = min(RANGE, kernel.support_m / kernel.length_m)
    for path_m in (rng.uniform(0.0, 300.0, (20, 2)), rng.uniform(-900.0, 3400.0, (5, 2)), np.full((1, 2), 9e3)):
        path = kernel.scale(path_m)
        apart = np.sqrt(((cells[:, None] - path) ** 2).sum(axis=2)).min(axis=1)
        found = near.of(path)
        assert np.all(np.diff(found) > 0)
        assert np.isin(np.flatnonzero(apart <= reach), found).all()
        assert apart[found].max(initial=0.0) <= 1.8 * reach
    assert not len(near.of(np.empty((0, 2))))


def _reward(loss, mates, inflation):
    rng = np.random.default_rng(2)
    posterior = Posterior(GpConfig())
    known_m = rng.uniform(0.0, SIDE_M, (80, 2))
    depths_m = 15.0 + 6.0 * np.sin(known_m[:, 0] / 200.0) * np.cos(known_m[:, 1] / 150.0)
    posterior.follow(Centers(known_m, depths_m, np.full(80, 0.3)))
    fine, coarse = (CachedPoints(posterior, _cells(spacing_m)) for spacing_m in (25.0, 40.0))
    return AnytimeReward(fine, loss, mates, Weighting(30, 5, 50, 1.5), coarse, inflation)


MATES = [
    (np.arange(1.0, 31.0), np.column_stack([np.full(30, 1900.0), 1000.0 + 15.0 * np.arange(30.0)])),
    (np.arange(0.5, 20.5), np.column_stack([300.0 + 15.0 * np.arange(20.0), np.full(20, 500.0)])),
]


@pytest.mark.parametrize("inflation", [1.0, 1.4])
@pytest.mark.parametrize("mates", [[], MATES], ids=["alone", "with mates"])
@pytest.mark.parametrize("loss", [LevelSet(), LineLoss(15.0, 25.0)], ids=["risk", "line"])
def test_reward_of_the_cells_near_a_path_is_close_to_that_of_all_cells(monkeypatch, loss, mates, inflation):
    path_m = np.column_stack([400.0 + 14.0 * np.arange(30.0), 600.0 + 40.0 * np.sin(np.arange(30.0) / 5.0)])
    found = []
    for few in (10**9, 100):
        monkeypatch.setattr(anytime, "FEW_CELLS", few)
        reward = _reward(loss, mates, inflation)
        value = reward.value(path_m[:, None])
        coarse, gradient = reward.value_and_gradient(path_m)
        assert reward.coarse_value(path_m) == pytest.approx(coarse, rel=1e-9)
        alone = reward.weighing(0.0)
        end = alone.value_and_gradient(path_m)
        found.append((value.weighted, value.expected_end, coarse, gradient, end[0], end[1], reward.risk_before))
    for whole, near in zip(*found, strict=True):
        assert near == pytest.approx(whole, rel=3e-3, abs=3e-3 * np.abs(whole).max())
    assert found[0][1] != found[1][1], "cells far from the path are left out"


def test_gradient_with_the_cells_near_a_path_agrees_with_finite_differences(monkeypatch):
    monkeypatch.setattr(anytime, "FEW_CELLS", 100)
    reward = _reward(LevelSet(), MATES, 1.4)
    path_m = np.column_stack([400.0 + 14.0 * np.arange(30.0), 600.0 + 40.0 * np.sin(np.arange(30.0) / 5.0)])
    _, gradient = reward.value_and_gradient(path_m)
    aside = np.random.default_rng(0).normal(size=path_m.shape)
    slope = (reward.coarse_value(path_m + 0.02 * aside) - reward.coarse_value(path_m - 0.02 * aside)) / 0.04
    assert (gradient * aside).sum() == pytest.approx(slope, rel=1e-3, abs=1e-3 * np.abs(gradient).max())


@pytest.mark.parametrize("mates", [[], MATES], ids=["alone", "with mates"])
@pytest.mark.parametrize("loss", [LevelSet(), LineLoss(15.0, 25.0)], ids=["risk", "line"])
def test_a_path_far_from_all_cells_that_count_brings_nothing(monkeypatch, loss, mates):
    monkeypatch.setattr(anytime, "FEW_CELLS", 100)
    reward = _reward(loss, mates, 1.4)
    path_m = np.column_stack([9000.0 + 14.0 * np.arange(30.0), np.full(30, 9000.0)])
    none = reward.value(np.empty((0, 1, 2)))
    value = reward.value(path_m[:, None])
    assert value.expected_end == pytest.approx(none.expected_end, abs=1e-9)
    assert value.weighted == pytest.approx(none.weighted, abs=1e-9)
    assert not reward.value_and_gradient(path_m)[1].any()
