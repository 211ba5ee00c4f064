"""The ground's roughness near a place, from soundings predicted without those near them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_gp.inference.centers import NO_CENTERS, Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.roughness import Roughness, left_out_squares, scale_of

CONFIG = GpConfig()


def given(centers: Centers) -> Posterior:
    posterior = Posterior(CONFIG)
    posterior.follow(centers)
    return posterior


@pytest.mark.parametrize("modes", [0, 3])
def test_left_out_errors_are_those_of_maps_without_the_centers(modes: int) -> None:
    """With uncertain positions their effects are part of the covariance."""
    rng = np.random.default_rng(modes)
    places = rng.uniform(0.0, 150.0, (40, 2))
    effect = rng.standard_normal((40, modes)) if modes else None
    centers = Centers(places, rng.normal(15.0, 5.0, 40), rng.uniform(0.2, 0.5, 40), effect)
    posterior = given(centers)
    covariance = posterior.kernel(places, places) + np.diag(centers.noise_std_m**2)
    if effect is not None:
        covariance += effect @ effect.T
    expected = []
    for i, place in enumerate(places):
        rest = np.hypot(*(places - place).T) > 25.0
        weights = np.linalg.solve(covariance[np.ix_(rest, rest)], covariance[rest, i])
        error = centers.depths_m[i] - 15.0 - weights @ (centers.depths_m[rest] - 15.0)
        expected.append(error**2 / (covariance[i, i] - weights @ covariance[rest, i]))
    assert_allclose(left_out_squares(posterior, 25.0), expected, rtol=1e-6)


def test_scale_at_a_place_is_the_weighted_mean_of_nearby_squares() -> None:
    """Two centers with squares 4 and 1, worth 100: everywhere (100 + 5) / 102, as 3 soundings at each place."""
    rough = Roughness(places_m=np.array([[0.0, 0.0], [50.0, 0.0]]), squares=np.array([4.0, 1.0]), length_m=100.0)
    whole, beside = 105.0 / 102.0, math.exp(-0.5)  # 50 m are one standard deviation of the weights
    at = np.array([[0.0, 0.0], [1e4, 0.0]])
    expected = [(3.0 * whole + 4.0 + beside) / (4.0 + beside), whole]
    assert_allclose(rough.scale(at, 100.0), expected, rtol=1e-12)
    assert_allclose(scale_of(rough.sums(at), 5.0, 2, 0.0), [1.0, 1.0])


def test_without_soundings_the_scale_is_the_priors() -> None:
    assert_allclose(Roughness.of(given(NO_CENTERS), 85.0).scale(np.zeros((3, 2)), 100.0), np.ones(3))


def test_scale_is_the_true_one_on_ground_of_two_kinds() -> None:
    """East of 600 m a field of the prior has 1/4 of its standard deviation, west of it twice as much.

    A map is estimated to within 0.55 to 1.6 times of the true factor in the mean of ten lakes: their neighbors of the
    other kind, and the global factor, pull at it.
    """
    north, east = (a.ravel() for a in np.meshgrid(np.arange(5.0, 300.0, 12.0), np.arange(20.0, 1200.0, 60.0)))
    places = np.column_stack([north, east])
    factor = np.linalg.cholesky(Posterior(CONFIG).kernel(places, places) + 1e-6 * np.eye(len(places)))
    std = np.where(east < 600.0, 2.0, 0.25)
    found = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        depths = 40.0 + std * (factor @ rng.standard_normal(len(places))) + 0.1 * rng.standard_normal(len(places))
        config = dataclasses.replace(CONFIG, mean_depth_m=40.0, noise_std_m=0.1)
        posterior = Posterior(config)
        posterior.follow(Centers(places, depths, np.full(len(places), 0.1)))
        at = np.array([[150.0, 300.0], [150.0, 900.0]])
        found.append(Roughness.of(posterior, config.length_scale_m).scale(at, config.std_soundings))
    rough, smooth = np.mean(found, axis=0)
    assert 0.55 * 4.0 < rough < 1.6 * 4.0
    assert smooth < 0.5


def test_errors_of_some_centers_are_those_of_all():
    rng = np.random.default_rng(3)
    places = rng.uniform(0.0, 400.0, (120, 2))
    posterior = Posterior(GpConfig())
    effect = rng.normal(size=(120, 3))
    posterior.follow(Centers(places, 15.0 + rng.normal(size=120), np.full(120, 0.3), effect))
    own = places[:, 0] < 90.0
    found = left_out_squares(posterior, 25.0, own)
    assert found == pytest.approx(left_out_squares(posterior, 25.0)[own], rel=1e-8)
    assert left_out_squares(posterior, 25.0, np.zeros(120, dtype=bool)).shape == (0,)
