"""What a sample is worth to receivers, against dense algebra."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from auv_lse_gp.area import AreaConfig, OperatingArea
from auv_lse_gp.config import GpConfig
from auv_lse_gp.kernels import Kernel
from auv_lse_gp.receivers_risk import ReceiversRisk
from auv_lse_gp.risk import LevelSet

Array = NDArray[np.float64]
AREA = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 200.0, 0.0, 200.0, 240.0, 0.0, 240.0)))
GP = GpConfig(length_scale_m=50.0, min_spacing_m=4.0)
LEVEL = LevelSet(cost_false_safe=10.0, cost_false_unsafe=3.0)


def samples(rng: np.random.Generator, n: int) -> Array:
    places = rng.uniform(0.0, 200.0, (n, 2))
    return np.column_stack([places, 15.0 + 8.0 * np.sin(places[:, 0] / 40.0) * np.cos(places[:, 1] / 50.0)])


def dense(told: Array, at: Array, gp: GpConfig = GP) -> tuple[Array, Array]:
    """Mean and covariance at places given what was told."""
    kernel = Kernel(gp)
    prior = np.asarray(kernel(at, at))
    if not len(told):
        return np.full(len(at), gp.mean_depth_m), prior
    gram = kernel(told[:, :2], told[:, :2]) + gp.noise_std_m**2 * np.eye(len(told))
    cross = kernel(at, told[:, :2])
    mean = gp.mean_depth_m + cross @ np.linalg.solve(gram, told[:, 2] - gp.mean_depth_m)
    return mean, prior - cross @ np.linalg.solve(gram, cross.T)


def dense_gain(told: Array, place: Array, grid: Array) -> float:
    mean, cov = dense(told, np.concatenate([grid, place[None]]))
    before = np.diag(cov)[:-1]
    explained = np.minimum(cov[:-1, -1] ** 2 / (cov[-1, -1] + GP.noise_std_m**2), before)
    return float(LEVEL.benefit(mean[:-1], np.sqrt(explained), np.sqrt(before - explained)).sum())


@pytest.mark.parametrize("n", [0, 1, 30])
def test_gains_against_dense_algebra(n: int) -> None:
    rng = np.random.default_rng(n)
    told = samples(rng, n)
    receivers = ReceiversRisk(GpConfig(length_scale_m=50.0, min_spacing_m=0.0), LEVEL, AREA, capacity=4)
    receivers.tell(told)
    candidates = samples(rng, 12)
    expected = [dense_gain(told, place, receivers.places_m) for place in candidates[:, :2]]
    # what is negligible at one place (1e-4 of its variance) may sum up to a little over the map
    np.testing.assert_allclose(receivers.gains(candidates), expected, rtol=0.02, atol=1e-3)
    mean, cov = dense(told, receivers.places_m)
    assert receivers.risk == pytest.approx(
        float(LEVEL.risk(mean, np.sqrt(np.maximum(np.diag(cov), 0.0))).mean()), rel=1e-9
    )


def test_gain_is_the_expected_drop_of_the_risk() -> None:
    """Mean over depths drawn from the receivers' own belief of the drop that telling the sample does cause."""
    rng = np.random.default_rng(5)
    told, place = samples(rng, 10), np.array([[90.0, 130.0]])
    before = ReceiversRisk(GP, LEVEL, AREA)
    before.tell(told)
    mean, cov = dense(told, place)
    depths = rng.normal(mean[0], np.sqrt(cov[0, 0] + GP.noise_std_m**2), 1500)
    drops = []
    for depth in depths:
        after = ReceiversRisk(GP, LEVEL, AREA)
        after.tell(told)
        after.tell(np.array([[90.0, 130.0, depth]]))
        drops.append((before.risk - after.risk) * len(before.places_m))
    error = np.std(drops) / np.sqrt(len(drops))
    assert before.gains(np.array([[90.0, 130.0, 0.0]]))[0] == pytest.approx(np.mean(drops), abs=4.0 * error)


def test_what_is_told_is_worth_less_again() -> None:
    rng = np.random.default_rng(6)
    receivers = ReceiversRisk(GP, LEVEL, AREA)
    candidates = samples(rng, 40)
    first = receivers.gains(candidates)
    best = int(np.argmax(first))
    receivers.tell(candidates[best : best + 1])
    again = receivers.gains(candidates)
    assert again[best] < 0.05 * first[best]
    near = np.hypot(*(candidates[:, :2] - candidates[best, :2]).T) < 30.0
    assert (again[near] < first[near]).all()
    assert (again >= 0.0).all()


def test_samples_too_close_are_left_out_and_none_is_fine() -> None:
    receivers = ReceiversRisk(GP, LEVEL, AREA, capacity=1)
    receivers.tell(np.array([[10.0, 10.0, 12.0], [10.0, 13.9, 12.0], [10.0, 14.0, 12.0], [50.0, 50.0, 9.0]]))
    assert len(receivers) == 3
    receivers.tell(np.zeros((0, 3)))
    assert receivers.gains(np.zeros((0, 3))).shape == (0,)


def test_from_a_missions_parameters() -> None:
    receivers = ReceiversRisk.from_parameters(
        {"gp": {"length_scale_m": 50.0}, "area": {"polygon_m": [0.0, 0.0, 100.0, 0.0, 100.0, 100.0]}, "packet": {}},
        "test",
    )
    assert len(receivers.places_m) == pytest.approx(12, abs=4)
