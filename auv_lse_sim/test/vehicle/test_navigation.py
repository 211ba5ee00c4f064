"""The navigation filter: its equations against dense ones, its consistency, what it refuses."""

import math
from pathlib import Path

import numpy as np
import pytest
from navigation_dives import measure

from auv_lse_common.mission_file.sections.world import DvlConfig
from auv_lse_common.support.compiled import USE_NUMBA, cache_folder, plain
from auv_lse_sim.vehicle import motion_model as mm
from auv_lse_sim.vehicle import navigation as nav

Q = np.array([1e-6, 4e-4, 1e-12, 1e-10, 1e-6])


def random_state(rng):
    x = np.array([12.0, -30.0, rng.uniform(-3, 3), rng.uniform(0.5, 1.6), rng.uniform(-0.3, 0.3), 1e-4, 0.02, 0.004])
    x = np.append(x, [0.01, -0.02])
    a = rng.standard_normal((10, 10)) * np.array([2, 2, 0.02, 0.05, 0.05, 1e-4, 0.02, 0.004, 0.02, 0.02])
    return x, a.T @ a / 10.0


def rates(x, gyro):
    """The model's equations, written out again."""
    c, s = math.cos(x[2]), math.sin(x[2])
    return np.array(
        [(x[3] * c - x[4] * s) / (1 + x[7]), (x[3] * s + x[4] * c) / (1 + x[7]), gyro - x[5], 0, 0, 0, 0, 0, 0, 0]
    )


@pytest.mark.parametrize(
    ("values", "match"),
    [
        ({"min_altitude_m": 60.0}, r"max_altitude_m is 60 m, but must be above min_altitude_m \(60 m\)"),
        ({"dropout_min_s": 3.0}, r"dropout_min_s is 3 s, but must not exceed dropout_max_s \(2 s\)"),
    ],
)
def test_intervals_out_of_order_are_refused(values, match):
    with pytest.raises(ValueError, match=match):
        DvlConfig(**values)


def test_prediction_by_hand():
    """1 m/s due east for 2 s, turning by 0.1 rad/s of which 0.02 are bias; the DVL reads 25 % too much."""
    x = np.array([0.0, 0.0, math.pi / 2 - 0.08, 1.25, 0.0, 0.02, 0.0, 0.25, 0.0, 0.0])
    p = np.zeros((10, 10))
    nav.predict(x, p, 0.1, 2.0, np.zeros(5))
    # The middle of the step heads due east, so the whole way goes there.
    assert x[:3] == pytest.approx([0.0, 2.0, math.pi / 2 + 0.08], abs=1e-12)
    assert not p.any()


@pytest.mark.parametrize("seed", range(5))
def test_covariance_prediction_is_f_p_f_transposed(seed):
    rng = np.random.default_rng(seed)
    x, p = random_state(rng)
    gyro, dt = 0.1, 1e-3  # so short that Euler's step and the middle of the step agree
    jacobian, h = np.zeros((10, 10)), 1e-6
    for j in range(10):
        up, down = x.copy(), x.copy()
        up[j] += h
        down[j] -= h
        jacobian[:, j] = (rates(up, gyro) - rates(down, gyro)) / (2 * h)
    f = np.eye(10) + dt * jacobian
    q = np.diag([Q[4], Q[4], Q[0], Q[1], Q[1], Q[2], Q[3], 0.0, 0.0, 0.0]) * dt
    expected = f @ p @ f.T + q
    nav.predict(x, p, gyro, dt, Q)
    # Second order in dt: what is left of the middle of the step.
    assert np.abs(p - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("seed", range(5))
def test_update_is_the_kalman_update(seed):
    rng = np.random.default_rng(seed)
    x, p = random_state(rng)
    h = rng.standard_normal(10)
    residual, variance = 0.01, 0.04
    s = h @ p @ h + variance
    gain = p @ h / s
    expected_x, expected_p = x + gain * residual, (np.eye(10) - np.outer(gain, h)) @ p
    nis = nav.update(x, p, h, residual, variance, 4.0)
    assert nis == pytest.approx(residual**2 / s)
    assert np.allclose(x, expected_x, atol=1e-12)
    assert np.allclose(p, expected_p, atol=1e-12)
    assert np.array_equal(p, p.T)


def test_update_refuses_what_is_too_far_off():
    x, p = random_state(np.random.default_rng(1))
    before_x, before_p = x.copy(), p.copy()
    std = math.sqrt(p[3, 3] + 1e-4)
    assert nav.update_dvl(x, p, x[3] + 5.0 * std, x[4] + 100.0, 1e-4, nav.GATE) == 0
    assert np.array_equal(x, before_x)
    assert np.array_equal(p, before_p)


def test_compass_and_its_bias_share_the_correction():
    x, p = np.zeros(10), np.zeros((10, 10))
    p[2, 2], p[6, 6] = 0.03**2, 0.04**2
    nav.update_compass(x, p, 0.05, 1e-12, nav.GATE)
    assert x[2] + x[6] == pytest.approx(0.05)
    assert x[6] / x[2] == pytest.approx(16.0 / 9.0)


def test_turns_show_how_the_compass_depends_on_the_heading_and_not_its_bias():
    """A perfect gyro, a full turn: the harmonics (0.02, -0.01) are learned, a bias of 0.03 is not told from heading."""
    x, p = np.zeros(10), np.zeros((10, 10))
    p[2, 2] = p[6, 6] = p[8, 8] = p[9, 9] = 0.03**2
    q = np.zeros(5)
    for i in range(720):
        heading = 0.01 * i
        reading = heading + 0.03 + 0.02 * math.sin(heading) - 0.01 * math.cos(heading)
        nav.update_compass(x, p, reading, 1e-6, nav.GATE)
        nav.predict(x, p, 0.1, 0.1, q)
    # The harmonics are those of the reading, which is off by up to 0.05: so is their phase, 2 or 3 % of them.
    assert x[8:] == pytest.approx([0.02, -0.01], abs=8e-4)
    assert x[6] == pytest.approx(0.015, abs=1e-3)


def test_compass_works_across_the_wrap():
    x, p = np.zeros(10), np.eye(10) * 1e-4
    x[2] = math.pi - 0.001
    nav.update_compass(x, p, -math.pi + 0.001, 1e-4, nav.GATE)
    assert abs(nav.wrap(x[2] - math.pi)) < 0.002


def test_gps_moves_the_position_and_learns_the_scale():
    """After a long straight the position and the DVL's scale are correlated: a fix corrects both."""
    x, p = np.zeros(10), np.zeros((10, 10))
    x[3] = 1.5
    p[7, 7] = 0.01**2
    for _ in range(4000):
        nav.predict(x, p, 0.0, 0.1, np.zeros(5))
    assert x[0] == pytest.approx(600.0)
    assert math.sqrt(p[0, 0]) == pytest.approx(6.0, rel=1e-3)  # 1 % of 600 m
    nav.update_gps(x, p, 594.0, 0.0, 0.01)
    assert x[0] == pytest.approx(594.0, abs=0.01)
    assert x[7] == pytest.approx(0.01, rel=1e-2)  # the DVL had read 1 % too much
    assert math.sqrt(p[7, 7]) < 3e-4


def test_the_dvl_does_not_estimate_its_own_scale():
    x, p = np.zeros(10), np.zeros((10, 10))
    p[7, 7] = 0.003**2
    rng = np.random.default_rng(0)
    for i in range(2000):
        nav.predict(x, p, 0.0, 0.1, Q)
        nav.update_dvl(
            x, p, 1.5 * min(i / 30, 1.0) + 0.01 * rng.standard_normal(), 0.01 * rng.standard_normal(), 1e-4, 1e9
        )
    assert math.sqrt(p[7, 7]) == pytest.approx(0.003, rel=1e-6)


def test_plain_functions_give_the_same_numbers():
    rng = np.random.default_rng(3)
    x, p = random_state(rng)
    y, r = x.copy(), p.copy()
    h = rng.standard_normal(10)
    nav.predict(x, p, 0.1, 0.1, Q)
    nav.update(x, p, h, 0.01, 0.1, 4.0)
    plain(nav.predict)(y, r, 0.1, 0.1, Q)
    plain(nav.update)(y, r, h, 0.01, 0.1, 4.0)
    assert np.allclose(x, y, rtol=1e-13, atol=1e-15)
    assert np.allclose(p, r, rtol=1e-12, atol=1e-15)


def test_filter_is_consistent():
    """30 dives with every instrument error on: the mean NEES stays within 99 % bounds (120 dives: 95 %)."""
    result = measure(30, duration_s=400.0, every_s=200.0, first_seed=1000)
    for states, nees in ((3, result.nees), (2, result.nees_position)):
        low, high = result.bounds(states, 0.99)
        assert low < nees.mean(axis=0).min()
        assert nees.mean(axis=0).max() < high
    # Dead reckoning that drifts, but by no more than a good INS: 0.1 to 2 % of the distance gone.
    assert 0.001 < result.drift < 0.02


def test_a_filter_without_the_compass_harmonics_is_overconfident():
    """The check of consistency detects a filter that leaves out a part of the error."""
    result = measure(10, duration_s=400.0, every_s=200.0, first_seed=1000, harmonics=False)
    assert result.nees_position[:, -1].mean() > result.bounds(2, 0.99)[1]


@pytest.mark.skipif(not USE_NUMBA, reason="numba is not installed")
def test_compiled_code_is_kept_by_the_text_of_all_its_files():
    """Numba alone would go on using what it once compiled of another, since changed, file."""
    assert Path(mm.advance.stats.cache_path).is_relative_to(cache_folder(Path(nav.__file__).resolve().parents[1]))
    assert Path(nav.predict.stats.cache_path).is_relative_to(cache_folder(Path(nav.__file__).resolve().parents[1]))
