"""The ground's roughness near a location, from soundings predicted without those near them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_gp.inference.centers import NO_CENTERS, Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.roughness import (
    Roughness,
    degrees_of_freedom,
    left_out_squares,
    scale_of,
    steepness,
    variance_scales,
)
from auv_lse_gp.inference.work import finish

CONFIG = GpConfig()


def given(centers: Centers) -> Posterior:
    posterior = Posterior(CONFIG)
    posterior.follow(centers)
    return posterior


@pytest.mark.parametrize("modes", [0, 3])
def test_left_out_errors_are_those_of_maps_without_the_centers(modes: int) -> None:
    """With uncertain positions their effects are part of the covariance."""
    rng = np.random.default_rng(modes)
    locations = rng.uniform(0.0, 150.0, (40, 2))
    effect = rng.standard_normal((40, modes)) if modes else None
    centers = Centers(locations, rng.normal(15.0, 5.0, 40), rng.uniform(0.2, 0.5, 40), effect)
    posterior = given(centers)
    covariance = posterior.kernel(locations, locations) + np.diag(centers.noise_std_m**2)
    if effect is not None:
        covariance += effect @ effect.T
    expected = []
    for i, location in enumerate(locations):
        rest = np.hypot(*(locations - location).T) > 25.0
        weights = np.linalg.solve(covariance[np.ix_(rest, rest)], covariance[rest, i])
        error = centers.depths_m[i] - 15.0 - weights @ (centers.depths_m[rest] - 15.0)
        expected.append(error**2 / (covariance[i, i] - weights @ covariance[rest, i]))
    assert_allclose(finish(left_out_squares(posterior, 25.0)), expected, rtol=1e-6)


def test_scale_at_a_location_is_the_weighted_mean_of_nearby_squares() -> None:
    """Two centers with squares 4 and 1, worth 100: everywhere (100 + 5) / 102, as 3 soundings at each location."""
    rough = Roughness(locations_m=np.array([[0.0, 0.0], [50.0, 0.0]]), squares=np.array([4.0, 1.0]), length_m=100.0)
    whole, beside = 105.0 / 102.0, math.exp(-0.5)  # 50 m are one standard deviation of the weights
    at = np.array([[0.0, 0.0], [1e4, 0.0]])
    expected = [2.0 * (3.0 * whole + 4.0 + beside) / (4.0 + beside), whole]
    steep = np.array([2.0, 1.0])
    assert_allclose(scale_of(rough.sums(at), steep, 5.0, 2, 100.0), expected, rtol=1e-12)
    assert_allclose(scale_of(rough.sums(at), steep, 5.0, 2, 0.0), [1.0, 1.0])


def test_without_soundings_the_scale_is_the_priors() -> None:
    assert_allclose(variance_scales(given(NO_CENTERS), CONFIG, np.zeros((3, 2)), np.full(3, 64.0)), np.ones(3))


def test_errors_of_centers_whose_left_out_centers_overlap_count_as_one() -> None:
    """Three centers within 51 m and one far away are two independent errors; the prior's 100 soundings count alike.

    Each error leaves out the centers within 25.5 m.
    """
    locations = np.array([[0.0, 0.0], [25.0, 0.0], [50.0, 0.0], [300.0, 0.0]])
    posterior = given(Centers(locations, np.full(4, 12.0), np.full(4, 0.3)))
    assert degrees_of_freedom(posterior, CONFIG) == pytest.approx((100.0 + 4.0) * 2.0 / 4.0)
    assert degrees_of_freedom(given(NO_CENTERS), CONFIG) == 100.0
    assert degrees_of_freedom(posterior, dataclasses.replace(CONFIG, std_soundings=0.0)) == math.inf


def test_steepness_compares_the_expected_squared_slope_with_the_priors() -> None:
    """A plane of slope .3; the prior's mean squared slope is 10/3 (8 m / 85 m)^2, both axes together."""
    locations = np.stack(np.meshgrid(np.arange(0.0, 400.0, 20.0), np.arange(0.0, 400.0, 20.0)), axis=-1).reshape(-1, 2)
    posterior = given(Centers(locations, 15.0 + 0.3 * (locations[:, 0] - 200.0), np.full(len(locations), 0.1)))
    at = np.array([[210.0, 205.0], [1e5, 0.0]])
    variance = posterior.moments(at)[1]
    ratio = 0.3**2 / (10.0 / 3.0 * (8.0 / 85.0) ** 2)
    # The map's slope is that of the plane to within 1 %; between soundings hardly any variance is left.
    assert_allclose(steepness(posterior, at, variance), [0.5 + 0.5 * ratio, 1.0], rtol=0.02)


def test_steep_ground_has_more_variance_than_flat_ground() -> None:
    """West of 600 m the ground is a plane, east of it ten times as steep; both bear waves in proportion to the slope.

    The factor of the whole map pulls at the true ratio of 100. Without the steepness 3.4 would be left of it.
    """
    north, east = (a.ravel() for a in np.meshgrid(np.arange(5.0, 300.0, 12.0), np.arange(20.0, 1200.0, 60.0)))
    slope = np.where(east < 600.0, 0.03, 0.3)
    depths = 15.0 + slope * (east - 600.0 + 30.0 * np.sin(north / 25.0) * np.cos(east / 25.0))
    posterior = given(Centers(np.column_stack([north, east]), depths, np.full(len(north), 0.05)))
    at = np.array([[150.0, 270.0], [150.0, 930.0]])
    flat, steep = variance_scales(posterior, CONFIG, at, posterior.moments(at)[1])
    assert steep > 10.0 * flat


def test_scale_is_the_true_one_on_ground_of_two_kinds() -> None:
    """East of 600 m a field of the prior has 1/4 of its standard deviation, west of it twice as much.

    A map is estimated to within 0.55 to 1.6 times of the true factor in the mean of ten lakes: their neighbors of the
    other kind, and the global factor, pull at it.
    """
    north, east = (a.ravel() for a in np.meshgrid(np.arange(5.0, 300.0, 12.0), np.arange(20.0, 1200.0, 60.0)))
    locations = np.column_stack([north, east])
    factor = np.linalg.cholesky(Posterior(CONFIG).kernel(locations, locations) + 1e-6 * np.eye(len(locations)))
    std = np.where(east < 600.0, 2.0, 0.25)
    found = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        depths = 40.0 + std * (factor @ rng.standard_normal(len(locations))) + 0.1 * rng.standard_normal(len(locations))
        config = dataclasses.replace(CONFIG, mean_depth_m=40.0, noise_std_m=0.1)
        posterior = Posterior(config)
        posterior.follow(Centers(locations, depths, np.full(len(locations), 0.1)))
        at = np.array([[150.0, 300.0], [150.0, 900.0]])
        found.append(variance_scales(posterior, config, at, posterior.moments(at)[1]))
    rough, smooth = np.mean(found, axis=0)
    assert 0.55 * 4.0 < rough < 1.6 * 4.0
    assert smooth < 0.5


def test_errors_of_some_centers_are_those_of_all():
    rng = np.random.default_rng(3)
    locations = rng.uniform(0.0, 400.0, (120, 2))
    posterior = Posterior(GpConfig())
    effect = rng.normal(size=(120, 3))
    posterior.follow(Centers(locations, 15.0 + rng.normal(size=120), np.full(120, 0.3), effect))
    own = locations[:, 0] < 90.0
    found = finish(left_out_squares(posterior, 25.0, own))
    assert found == pytest.approx(finish(left_out_squares(posterior, 25.0))[own], rel=1e-8)
    assert finish(left_out_squares(posterior, 25.0, np.zeros(120, dtype=bool))).shape == (0,)
