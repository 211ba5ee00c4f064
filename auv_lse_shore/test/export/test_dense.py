"""The certificate's dense Gaussian process, against sums worked out by hand and against the vehicles' map."""

import ast
import dataclasses
from pathlib import Path

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import KERNELS, GpConfig
from auv_lse_gp.inference.banks import Banks, width_factor
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.roughness import variance_scales
from auv_lse_gp.map.online import OnlineGp
from auv_lse_shore.certify import dense
from auv_lse_shore.certify.dense import Measurements, dense_map
from auv_lse_shore.certify.final_map import dense_prior

RNG = np.random.default_rng(5)
LOCATIONS = RNG.uniform(0.0, 300.0, (40, 2))
DEPTHS = 15.0 + 3.0 * np.sin(LOCATIONS[:, 0] / 60.0) + RNG.normal(0.0, 0.3, 40)
AT = RNG.uniform(-50.0, 350.0, (30, 2))


def test_it_shares_no_code_with_the_map():
    tree = ast.parse(Path(dense.__file__).read_text())
    modules = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    modules += [name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names]
    assert not [name for name in modules if name.startswith("auv_lse")]


@pytest.mark.parametrize("kernel", KERNELS)
def test_it_equals_the_vehicles_posterior(kernel):
    config = GpConfig(kernel=kernel, length_scale_m=70.0, length_scale_2_m=40.0, rotation_deg=30.0)
    effect = RNG.normal(0.0, 0.1, (40, 3))
    noise = RNG.uniform(0.2, 0.5, 40)
    posterior = Posterior(config)
    posterior.extend(Centers(LOCATIONS, DEPTHS, noise, effect))
    mean, variance = posterior.moments(AT)
    found = dense_map(dense_prior(config, AreaConfig()), Measurements.of_centers(LOCATIONS, DEPTHS, noise, effect), AT)
    assert found.mean_m == pytest.approx(mean, abs=1e-6)
    assert found.prior_std_m == pytest.approx(np.sqrt(variance), abs=1e-6)
    floor = posterior.position_variance(posterior.kernel.scale(AT))
    scales = variance_scales(posterior, config, AT, variance - floor)
    assert found.std_m == pytest.approx(np.sqrt(scales * (variance - floor) + floor), rel=1e-6)
    assert found.variance_scale == pytest.approx(scales.mean(), rel=1e-6)


def test_it_equals_the_vehicles_posterior_near_a_shore():
    area = AreaConfig(shore={"a": (0.0, -80.0, 10.0, 400.0), "b": (120.0, 120.0, 160.0, 130.0)}, shore_depth_m=4.0)
    config, effect, noise = GpConfig(), RNG.normal(0.0, 0.1, (40, 3)), RNG.uniform(0.2, 0.5, 40)
    gp = OnlineGp(config, banks=Banks.of(area, 15.0))
    gp.posterior.extend(Centers(LOCATIONS, DEPTHS, noise, effect))
    relative, variance = gp.posterior.moments(AT)
    mean, std = gp.depths(AT, relative, variance)
    found = dense_map(dense_prior(config, area), Measurements.of_centers(LOCATIONS, DEPTHS, noise, effect), AT)
    assert found.mean_m == pytest.approx(mean, abs=1e-6)
    assert found.prior_std_m == pytest.approx(std, abs=1e-6)
    floor = gp.posterior.position_variance(gp.kernel.scale(AT))
    scales = variance_scales(gp.posterior, config, AT, variance - floor)
    scales = scales + width_factor(gp.banks, AT, relative, config.signal_std_m)
    _, std = gp.depths(AT, relative, scales * (variance - floor) + floor)
    assert found.std_m == pytest.approx(std, rel=1e-6)


def test_averages_are_exact():
    config = dataclasses.replace(GpConfig(), length_scale_m=60.0)
    prior, square = dense_prior(config, AreaConfig()), 60.0
    given = Measurements.averaged(LOCATIONS, DEPTHS, 0.3, square)
    assert 1 < len(given.starts) < 40
    cells = [tuple(cell) for cell in np.floor(LOCATIONS / square)]
    average = np.array([[c == cell for c in cells] for cell in dict.fromkeys(cells)], dtype=float)
    average /= average.sum(axis=1, keepdims=True)
    covariance = average @ (prior.covariance(LOCATIONS, LOCATIONS) + 0.09 * np.eye(40)) @ average.T
    cross = prior.covariance(AT, LOCATIONS) @ average.T
    mean = config.mean_depth_m + cross @ np.linalg.solve(covariance, average @ (DEPTHS - config.mean_depth_m))
    variance = config.signal_std_m**2 - np.einsum("pn,np->p", cross, np.linalg.solve(covariance, cross.T))
    found = dense_map(prior, given, AT)
    assert found.mean_m == pytest.approx(mean, abs=1e-8)
    assert found.prior_std_m == pytest.approx(np.sqrt(variance), abs=1e-8)


def test_squares_grow_until_memory_suffices(monkeypatch):
    monkeypatch.setattr(dense, "MAX_AVERAGES", 9)
    given = Measurements.averaged(LOCATIONS, DEPTHS, 0.3, 10.0)
    assert 1 < len(given.starts) <= 9
    assert len(given.locations_m) == 40


def test_without_soundings_it_is_the_prior():
    config = GpConfig()
    found = dense_map(
        dense_prior(config, AreaConfig()), Measurements.averaged(np.zeros((0, 2)), np.zeros(0), 0.3, 10.0), AT
    )
    assert (found.mean_m == config.mean_depth_m).all()
    assert (found.std_m == config.signal_std_m).all()


@pytest.mark.parametrize("kernel", KERNELS)
def test_by_squares_it_is_nearly_the_same(kernel, monkeypatch):
    """Within .02 standard deviations, .2 for the smoothest kernel, as the tiles of vehicles' maps, and 1 %."""
    config = GpConfig(kernel=kernel, length_scale_m=12.0, length_scale_2_m=9.0, rotation_deg=30.0)
    effect = np.random.default_rng(1).normal(0.0, 0.1, (40, 3))
    given = Measurements.of_centers(LOCATIONS, DEPTHS, np.full(40, 0.3), effect)
    whole = dense_map(dense_prior(config, AreaConfig()), given, AT)
    monkeypatch.setattr(dense, "MAX_WHOLE", 10)
    assert max(len(near) for near, _, _ in dense._squares(dense_prior(config, AreaConfig()), LOCATIONS, AT)) < 40
    found = dense_map(dense_prior(config, AreaConfig()), given, AT)
    smooth = kernel == "squared_exponential"
    assert np.abs((found.mean_m - whole.mean_m) / whole.std_m).max() < (0.2 if smooth else 0.02)
    assert found.prior_std_m == pytest.approx(whole.prior_std_m, rel=0.01)
    assert found.variance_scale == pytest.approx(whole.variance_scale, rel=0.01)


def test_many_soundings_count_at_the_centroid_of_their_square(monkeypatch):
    exact = Measurements.averaged(LOCATIONS, DEPTHS, 0.3, 10.0)
    monkeypatch.setattr(dense, "MAX_EXACT", 30)
    given = Measurements.averaged(LOCATIONS, DEPTHS, 0.3, 10.0)
    assert given.depths_m.tolist() == exact.depths_m.tolist()
    assert (given.counts == 1).all()
    prior = dense_prior(GpConfig(), AreaConfig())
    apart = dense_map(prior, given, AT).mean_m - dense_map(prior, exact, AT).mean_m
    assert 0.0 < np.abs(apart).max() < 0.05
