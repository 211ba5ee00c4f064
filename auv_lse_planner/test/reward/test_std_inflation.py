"""How much the map is doubted: by what soundings show of the ground, within limits."""

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_planner.reward.std_inflation import MAX_INFLATION, std_inflation


def drawn(std_m: float) -> Posterior:
    """A map of ground drawn from the prior, but with another standard deviation."""
    config, rng = GpConfig(), np.random.default_rng(3)
    locations = rng.uniform(0.0, 600.0, (150, 2))
    posterior = Posterior(config)
    covariance = posterior.kernel(locations, locations) + config.noise_std_m**2 * np.eye(len(locations))
    depths = 15.0 + std_m / config.signal_std_m * np.linalg.cholesky(covariance) @ rng.standard_normal(len(locations))
    posterior.follow(Centers(locations, depths, np.full(len(locations), config.noise_std_m)))
    return posterior


def test_inflation_is_proportional_to_the_residual_ratio():
    half = drawn(8.0 * np.sqrt(0.5))
    assert half.residual_ratio == pytest.approx(0.5, rel=0.3)
    assert std_inflation(half) == pytest.approx(MAX_INFLATION * half.residual_ratio)


def test_inflation_is_1_on_flat_ground_and_limited():
    assert drawn(2.0).residual_ratio < 1.0 / MAX_INFLATION
    assert std_inflation(drawn(2.0)) == 1.0
    assert std_inflation(drawn(24.0)) == MAX_INFLATION
    assert std_inflation(Posterior(GpConfig())) == 1.0


def test_planned_measurements_do_not_change_the_inflation():
    posterior = drawn(6.0)
    before = std_inflation(posterior)
    posterior = posterior.with_planned(np.array([[10.0, 20.0], [300.0, 40.0]]))
    assert std_inflation(posterior) == before
