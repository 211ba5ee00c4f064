"""The scale by which a map is told: what the soundings show of the prior's standard deviation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.roughness import variance_scales
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.depth_map import DepthMap

AREA = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 200.0, 0.0, 200.0, 240.0, 0.0, 240.0), raster_m=4.0))
LOCATIONS_M = np.random.default_rng(4).uniform(0.0, 600.0, (300, 2))


def drawn(config: GpConfig, std_m: float, rng: np.random.Generator, effect_m: np.ndarray | None = None) -> Centers:
    """Soundings of a lake drawn from the prior, with another standard deviation of depth and noise alike."""
    n = len(LOCATIONS_M)
    kernel = Posterior(config).kernel
    covariance = kernel(LOCATIONS_M, LOCATIONS_M) + config.noise_std_m**2 * np.eye(n)
    depths = 15.0 + std_m / config.signal_std_m * np.linalg.cholesky(covariance) @ rng.standard_normal(n)
    if effect_m is not None:
        depths = depths + effect_m @ rng.standard_normal(effect_m.shape[1])
    return Centers(LOCATIONS_M, depths, np.full(n, config.noise_std_m), effect_m)


@pytest.mark.parametrize("modes", [0, 3])
def test_variance_scale_agrees_with_the_dense_solve(modes: int) -> None:
    """(100 + r' S^-1 r) / (100 + n), S with the position effects."""
    rng = np.random.default_rng(modes)
    config = GpConfig()
    effect = rng.standard_normal((len(LOCATIONS_M), modes)) if modes else None
    centers = drawn(config, 5.0, rng, effect)
    posterior = Posterior(config)
    posterior.follow(centers)
    s = posterior.kernel(LOCATIONS_M, LOCATIONS_M) + np.diag(centers.noise_std_m**2)
    if effect is not None:
        s = s + effect @ effect.T
    residuals = centers.depths_m - 15.0
    expected = (100.0 + residuals @ np.linalg.solve(s, residuals)) / (100.0 + len(residuals))
    assert_allclose(posterior.variance_scale, expected, rtol=1e-9)
    posterior = posterior.with_planned(rng.uniform(0.0, 600.0, (20, 2)))  # what will be measured says nothing yet
    assert_allclose(posterior.variance_scale, expected, rtol=1e-9)
    as_given = Posterior(GpConfig(std_soundings=0.0))
    as_given.follow(centers)
    assert as_given.variance_scale == 1.0


@pytest.mark.parametrize("std_m", [3.0, 8.0, 16.0])
def test_variance_scale_recovers_the_true_standard_deviation(std_m: float) -> None:
    config = GpConfig(std_soundings=1e-6)
    found = []
    for seed in range(20):
        posterior = Posterior(config)
        posterior.follow(drawn(config, std_m, np.random.default_rng(seed)))
        found.append(posterior.variance_scale)
    expected = (std_m / 8.0) ** 2
    # |b|^2 is chi-squared with n degrees of freedom; four standard errors of the mean of 20
    assert abs(np.mean(found) / expected - 1.0) < 4.0 * np.sqrt(2.0 / len(LOCATIONS_M) / 20)


def test_known_position_uncertainty_does_not_raise_the_scale() -> None:
    config, rng = GpConfig(), np.random.default_rng(1)
    centers = drawn(config, 8.0, rng, 30.0 * rng.standard_normal((len(LOCATIONS_M), 2)))
    told, untold = Posterior(config), Posterior(config)
    told.follow(centers)
    untold.follow(Centers(centers.locations_m, centers.depths_m, centers.noise_std_m))
    assert told.variance_scale == pytest.approx(1.0, abs=0.25)
    assert untold.variance_scale > 10.0


def test_map_without_soundings_has_the_priors_scale() -> None:
    field = DepthMap(GpConfig(), LevelSet(), AREA).field()
    assert field.variance_scale == 1.0
    assert_allclose(field.std_m, field.prior_std_m)


def test_published_map_is_rescaled_except_the_position_variance() -> None:
    config = GpConfig(length_scale_m=30.0)
    depth_map = DepthMap(config, LevelSet(), AREA)
    rng = np.random.default_rng(2)
    at = rng.uniform(0.0, 200.0, (40, 2))
    depth_map.add_soundings(np.column_stack([np.arange(40.0), at, rng.normal(15.0, 2.0, 40)]))
    depth_map.gp.set_position_effect(0.5 * rng.standard_normal((len(depth_map.gp), 2)))
    field, inside, posterior = depth_map.field(), depth_map.grid.inside, depth_map.gp.posterior
    assert 0.0 < field.variance_scale < 0.9
    cells = depth_map.grid.locations_m
    floor = posterior.position_variance(posterior.kernel.scale(cells))
    prior, told = field.prior_std_m[inside] ** 2, field.std_m[inside] ** 2
    scales = variance_scales(posterior, config, cells, prior - floor)
    assert field.variance_scale == pytest.approx(scales.mean())
    assert_allclose(told, scales * (prior - floor) + floor, rtol=1e-9)
    assert_allclose(field.risk[inside], LevelSet().risk(field.mean_m[inside], field.std_m[inside]), rtol=1e-9)


def test_weight_0_keeps_the_priors_standard_deviation() -> None:
    depth_map = DepthMap(GpConfig(std_soundings=0.0), LevelSet(), AREA)
    depth_map.add_soundings([[0.0, 50.0, 50.0, 14.0], [1.0, 150.0, 150.0, 14.0]])
    field = depth_map.field()
    assert field.variance_scale == 1.0
    assert_allclose(field.std_m, field.prior_std_m)
