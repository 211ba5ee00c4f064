"""Covariance functions: values by hand, compiled against plain, positive definiteness, two axes."""

import math

import numpy as np
import pytest

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.gp import KERNELS
from auv_lse_common.support import compiled
from auv_lse_gp import GpConfig, Kernel
from auv_lse_gp.covariance.kernels import SUPPORT_RATIO

#: rho(0.5), worked by hand from the definitions.
HALF = {
    "matern52": (1 + math.sqrt(5) / 2 + 5 / 12) * math.exp(-math.sqrt(5) / 2),
    "squared_exponential": math.exp(-1 / 8),
    "wendland_c2": 3 / 16,  # (1/2)^4 (2 + 1)
}


@pytest.mark.parametrize("name", KERNELS)
def test_values(name):
    kernel = Kernel(GpConfig(kernel=name, signal_std_m=3.0, length_scale_m=50.0))
    far = kernel.length_m / 2
    value = kernel(np.zeros((1, 2)), np.array([[0.0, 0.0], [far, 0.0], [0.0, -far]]))
    assert value[0] == pytest.approx([9.0, 9.0 * HALF[name], 9.0 * HALF[name]], rel=1e-14)
    assert kernel.variance(np.zeros((2, 2))).tolist() == [9.0, 9.0]


@pytest.mark.parametrize("name", KERNELS)
def test_one_length_scale_means_the_same_for_all_kernels(name):
    kernel = Kernel(GpConfig(kernel=name, signal_std_m=1.0, length_scale_m=50.0))
    correlation = kernel(np.zeros((1, 2)), np.array([[50.0, 0.0]]))[0, 0]
    assert correlation == pytest.approx(0.524, abs=0.09)
    if name in SUPPORT_RATIO:
        assert correlation == pytest.approx(0.52399, abs=1e-4)


@pytest.mark.parametrize("name", KERNELS)
def test_compiled_agrees_with_numpy(name):
    if not compiled.USE_NUMBA:
        pytest.skip("numba is not installed")
    rng = np.random.default_rng(0)
    kernel = Kernel(GpConfig(kernel=name, length_scale_2_m=30.0, rotation_deg=25.0))
    # From the same location to so far away that the exponential underflows.
    a, b = rng.normal(size=(40, 2)) * 10 ** rng.uniform(-6, 4, (40, 1)), rng.normal(size=(203, 2))
    a[0] = b[0]
    fast, slow = kernel.of_scaled(a, b), kernel.of_scaled_numpy(a, b)
    assert np.max(np.abs(fast - slow)) <= 2e-14 * kernel.signal_variance_m2  # sqrt and exp: a few units each
    weights = rng.normal(size=(40, 3))
    out = np.ones((3, 203))
    kernel.subtract_weighted(a, weights, b, out)
    assert out == pytest.approx(1.0 - weights.T @ slow, abs=1e-11)


#: rho'(0.5) / 0.5, worked by hand from the definitions.
HALF_SLOPE = {
    "matern52": -5 / 3 * (1 + math.sqrt(5) / 2) * math.exp(-math.sqrt(5) / 2),
    "squared_exponential": -math.exp(-1 / 8),
    "wendland_c2": -5 / 2,  # -20 (1/2)^3
}


@pytest.mark.parametrize("numba", [True, False])
def test_among_scaled_fills_the_upper_triangle(numba, monkeypatch):
    monkeypatch.setattr(compiled, "USE_NUMBA", numba and compiled.USE_NUMBA)
    kernel, locations = Kernel(GpConfig()), np.random.default_rng(3).random((9, 2))
    out = np.empty((9, 9))
    kernel.among_scaled(locations, out)
    assert np.array_equal(np.triu(out), np.triu(kernel.of_scaled(locations, locations)))


@pytest.mark.parametrize("name", KERNELS)
def test_gradient_worked_by_hand(name):
    kernel = Kernel(GpConfig(kernel=name, signal_std_m=3.0, length_scale_m=50.0))
    location = kernel.scale(np.array([[kernel.length_m / 2, 0.0]]))
    origin = np.zeros((1, 2))
    gradient = kernel.gradient_sums(location, np.array([[2.0]]), origin)
    assert gradient[0] == pytest.approx([2 * 9 * HALF_SLOPE[name] * 0.5 / kernel.length_m, 0.0], rel=1e-14)
    assert kernel.gradient_sums(origin, np.array([[2.0]]), origin).tolist() == [[0.0, 0.0]]


@pytest.mark.parametrize("numba", [False, True])
@pytest.mark.parametrize("name", KERNELS)
def test_gradient_agrees_with_finite_differences(name, numba, monkeypatch):
    if numba and not compiled.USE_NUMBA:
        pytest.skip("numba is not installed")
    monkeypatch.setattr(compiled, "USE_NUMBA", numba)
    rng = np.random.default_rng(7)
    kernel = Kernel(GpConfig(kernel=name, length_scale_2_m=30.0, rotation_deg=25.0))
    a_m, b_m, weights = rng.uniform(0, 200, (6, 2)), rng.uniform(0, 200, (41, 2)), rng.normal(size=(6, 41))
    gradient = kernel.gradient_sums(kernel.scale(a_m), weights, kernel.scale(b_m))
    step = 1e-3
    for axis in range(2):
        aside = step * np.eye(2)[axis]
        values = [(weights * kernel(a_m + sign * aside, b_m)).sum(axis=1) for sign in (1, -1)]
        # the kernels' third derivatives times the step squared, and 64 m^2 eps over the step
        assert gradient[:, axis] == pytest.approx((values[0] - values[1]) / (2 * step), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", KERNELS)
def test_compiled_gradient_agrees_with_numpy(name):
    if not compiled.USE_NUMBA:
        pytest.skip("numba is not installed")
    rng = np.random.default_rng(0)
    kernel = Kernel(GpConfig(kernel=name, length_scale_2_m=30.0, rotation_deg=25.0))
    a, b = rng.normal(size=(40, 2)) * 10 ** rng.uniform(-6, 4, (40, 1)), rng.normal(size=(203, 2))
    weights = rng.normal(size=(40, 203))
    expected = kernel.gradient_sums_numpy(a, weights, b) @ kernel._to_scaled.T
    # sqrt and exp: a few units each, summed over 203 locations of slope 3 times the signal's variance
    assert kernel.gradient_sums(a, weights, b) == pytest.approx(expected, rel=1e-11, abs=1e-12)


@pytest.mark.parametrize("name", KERNELS)
def test_positive_definite(name):
    rng = np.random.default_rng(4)
    locations = rng.uniform(0, 300, (300, 2))
    covariance = Kernel(GpConfig(kernel=name, signal_std_m=1.0))(locations, locations)
    assert np.array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12  # rounding of 300 terms of size 1


@pytest.mark.parametrize("name", sorted(SUPPORT_RATIO))
def test_compact_support(name):
    kernel = Kernel(GpConfig(kernel=name, length_scale_m=120.0 / SUPPORT_RATIO[name]))
    assert kernel.support_m == pytest.approx(120.0)
    value = kernel(np.zeros((1, 2)), np.array([[119.0, 0.0], [120.1, 0.0], [500.0, 0.0]]))[0]
    assert value[0] > 0.0
    assert value[1:].tolist() == [0.0, 0.0]


def test_two_axes():
    config = GpConfig(kernel="squared_exponential", signal_std_m=1.0, length_scale_m=100.0, length_scale_2_m=20.0,
                      rotation_deg=30.0)  # fmt: skip
    kernel = Kernel(config)
    along = np.array([math.cos(math.radians(30)), math.sin(math.radians(30))])  # north, east: clockwise from north
    across = np.array([-along[1], along[0]])
    value = kernel(np.zeros((1, 2)), np.array([100 * along, 20 * across, 20 * along]))[0]
    assert value == pytest.approx([math.exp(-0.5), math.exp(-0.5), math.exp(-0.02)], rel=1e-12)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"kernel": "matern12"}, r"GpConfig\.kernel must be one of 'matern52', .*, not 'matern12'"),
        ({"noise_std_m": 0.0}, r"GpConfig\.noise_std_m must be a number above 0 and at most 1000 m, not 0\.0"),
        ({"noise_std_m": 1e-6}, r"gp\.noise_std_m: 1e-06 m is too small .*; use at least 1e-4 of gp\.signal_std_m"),
        ({"length_scale_m": math.inf}, r"GpConfig\.length_scale_m must be .*, not inf"),
        ({"mean": "survey"}, r"gp\.survey_file is empty"),
        ({"min_depth_m": 5.0, "max_depth_m": 5.0}, r"gp\.min_depth_m is 5\.0 m, but must be below gp\.max_depth_m"),
    ],
)
def test_invalid_configurations_are_named(wrong, message):
    with pytest.raises(ParameterError, match=message):
        GpConfig(**wrong)
