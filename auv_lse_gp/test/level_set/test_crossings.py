"""Crossing intensity: hand-worked values, and contour lengths of fields drawn from a dense posterior."""

from __future__ import annotations

import math

import contourpy
import numpy as np
import pytest

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.crossings import DepthAndSlope, crossing_intensity, mean_norm


def test_the_mean_length_of_a_vector_is_right_where_it_is_known() -> None:
    mean = np.array([[0.0, 0.0], [3.0, 4.0], [0.0, 0.0], [2.0, 0.0]])
    covariance = np.array([np.eye(2) * 4.0, np.zeros((2, 2)), np.diag([9.0, 0.0]), np.eye(2)])
    # Rayleigh: 2 sqrt(pi / 2); certain: 5; one axis only: 3 sqrt(2 / pi); Rice with mean 2: sqrt(pi / 2) L_1/2(-2)
    expected = [2.0 * math.sqrt(math.pi / 2.0), 5.0, 3.0 * math.sqrt(2.0 / math.pi), 2.2723805]
    assert mean_norm(mean, covariance) == pytest.approx(expected, rel=3e-3)


def test_a_stationary_field_has_rices_crossings_and_known_ground_none() -> None:
    """At the mean's level, a field of standard deviation s and slope g has g / (2 s) meters of line per m2."""
    count = 2
    at = DepthAndSlope(
        mean_m=np.full(count, 15.0),
        variance_m2=np.array([64.0, 0.0]),
        slope=np.zeros((count, 2)),
        covariance_m=np.zeros((count, 2)),
        slope_covariance=np.tile(np.eye(2) * 0.01, (count, 1, 1)),
    )
    assert crossing_intensity(at, 15.0) == pytest.approx([0.1 / (2.0 * 8.0), 0.0], rel=1e-6)


@pytest.mark.parametrize("kernel", ["matern52", "squared_exponential", "wendland_c2"])
def test_it_is_the_mean_contour_length_of_fields_drawn_from_a_dense_posterior(kernel: str) -> None:
    """The oracle conditions by textbook formulas and measures contours; 5 %: four standard errors of its 500 draws."""
    config = GpConfig(
        kernel=kernel, length_scale_m=45.0, length_scale_2_m=30.0, rotation_deg=30.0, signal_std_m=6.0, noise_std_m=0.5,
        mean="plane", mean_depth_m=14.0, mean_slope_north=0.02,
    )  # fmt: skip
    rng = np.random.default_rng(5)
    data = rng.uniform(0.0, 120.0, (6, 2))
    depths = 14.0 + 0.02 * data[:, 0] + rng.normal(0.0, 6.0, 6)
    posterior = Posterior(config)
    posterior.extend(Centers(data, depths, np.full(6, 0.5)))
    axis = np.linspace(0.0, 120.0, 25)
    nodes = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    cross = posterior.kernel.of_scaled_numpy(*(posterior.kernel.scale(x) for x in (nodes, data)))
    among = posterior.kernel.of_scaled_numpy(*[posterior.kernel.scale(data)] * 2) + 0.25 * np.eye(6)
    covariance = posterior.kernel.of_scaled_numpy(*[posterior.kernel.scale(nodes)] * 2)
    covariance = covariance - cross @ np.linalg.solve(among, cross.T) + 1e-6 * np.eye(len(nodes))
    mean = 14.0 + 0.02 * nodes[:, 0] + cross @ np.linalg.solve(among, depths - 14.0 - 0.02 * data[:, 0])
    fields = mean + rng.standard_normal((500, len(nodes))) @ np.linalg.cholesky(covariance).T
    lengths = [
        sum(np.hypot(*np.diff(line, axis=0).T).sum() for line in contourpy.contour_generator(z=z).lines(15.0)) * 5.0
        for z in fields.reshape(-1, 25, 25)
    ]
    middle = axis[:-1] + 2.5
    cells = np.stack(np.meshgrid(middle, middle, indexing="ij"), axis=-1).reshape(-1, 2)
    found = 25.0 * crossing_intensity(posterior.depth_and_slope(cells), 15.0).sum()
    assert found == pytest.approx(np.mean(lengths), rel=0.05)


def test_slopes_are_those_of_the_mean() -> None:
    posterior = Posterior(GpConfig(mean="plane", mean_slope_east=0.1))
    locations = np.random.default_rng(1).uniform(0.0, 100.0, (20, 2))
    posterior.extend(Centers(locations, 15.0 + locations[:, 0] / 20.0, np.full(20, 0.3)))
    at = posterior.depth_and_slope(locations + 7.0)
    assert at.slope == pytest.approx(posterior.slopes(locations + 7.0), abs=1e-9)
    assert at.mean_m == pytest.approx(posterior.moments(locations + 7.0)[0], abs=1e-9)
    assert at.variance_m2 == pytest.approx(posterior.moments(locations + 7.0)[1], abs=1e-9)
