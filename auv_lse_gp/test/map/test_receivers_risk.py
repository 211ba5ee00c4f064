"""What a sample is worth to receivers, against dense algebra."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_gp.covariance.kernels import Kernel
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.receivers_risk import ASSUMED_RECEIVERS, ReceiverMap, ReceiversRisk

Array = NDArray[np.float64]
AREA = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 200.0, 0.0, 200.0, 240.0, 0.0, 240.0)))
GP = GpConfig(length_scale_m=50.0, min_spacing_m=4.0)
LEVEL = LevelSet(cost_false_safe=10.0, cost_false_unsafe=3.0)


def samples(rng: np.random.Generator, n: int) -> Array:
    places = rng.uniform(0.0, 200.0, (n, 2))
    return np.column_stack([places, 15.0 + 8.0 * np.sin(places[:, 0] / 40.0) * np.cos(places[:, 1] / 50.0)])


def dense(known: Array, at: Array, gp: GpConfig = GP) -> tuple[Array, Array]:
    """Mean and covariance at places given the samples that are known."""
    kernel = Kernel(gp)
    prior = np.asarray(kernel(at, at))
    if not len(known):
        return np.full(len(at), gp.mean_depth_m), prior
    gram = kernel(known[:, :2], known[:, :2]) + gp.noise_std_m**2 * np.eye(len(known))
    cross = kernel(at, known[:, :2])
    mean = gp.mean_depth_m + cross @ np.linalg.solve(gram, known[:, 2] - gp.mean_depth_m)
    return mean, prior - cross @ np.linalg.solve(gram, cross.T)


def dense_gain(known: Array, place: Array, grid: Array) -> float:
    mean, cov = dense(known, np.concatenate([grid, place[None]]))
    before = np.diag(cov)[:-1]
    explained = np.minimum(cov[:-1, -1] ** 2 / (cov[-1, -1] + GP.noise_std_m**2), before)
    return float(LEVEL.benefit(mean[:-1], np.sqrt(explained), np.sqrt(before - explained)).sum())


@pytest.mark.parametrize("n", [0, 1, 30])
def test_gains_against_dense_algebra(n: int) -> None:
    rng = np.random.default_rng(n)
    known = samples(rng, n)
    receivers = ReceiverMap(GpConfig(length_scale_m=50.0, min_spacing_m=0.0), LEVEL, AREA)
    receivers.add(known)
    candidates = samples(rng, 12)
    expected = [dense_gain(known, place, receivers.places_m) for place in candidates[:, :2]]
    # what is negligible at one place (1e-4 of its variance) may sum up to a little over the map
    np.testing.assert_allclose(receivers.gains(candidates), expected, rtol=0.02, atol=1e-3)
    mean, cov = dense(known, receivers.places_m)
    assert receivers.risk == pytest.approx(
        float(LEVEL.risk(mean, np.sqrt(np.maximum(np.diag(cov), 0.0))).mean()), rel=1e-9
    )


def test_gain_equals_the_expected_drop_of_the_risk() -> None:
    """Mean over depths drawn from the receivers' own belief of the drop that the sample does cause."""
    rng = np.random.default_rng(5)
    known, place = samples(rng, 10), np.array([[90.0, 130.0]])
    before = ReceiverMap(GP, LEVEL, AREA)
    before.add(known)
    mean, cov = dense(known, place)
    depths = rng.normal(mean[0], np.sqrt(cov[0, 0] + GP.noise_std_m**2), 1500)
    drops = []
    for depth in depths:
        after = ReceiverMap(GP, LEVEL, AREA)
        after.add(known)
        after.add(np.array([[90.0, 130.0, depth]]))
        drops.append((before.risk - after.risk) * len(before.places_m))
    error = np.std(drops) / np.sqrt(len(drops))
    assert before.gains(np.array([[90.0, 130.0, 0.0]]))[0] == pytest.approx(np.mean(drops), abs=4.0 * error)


def test_gain_of_a_known_sample_is_lower() -> None:
    rng = np.random.default_rng(6)
    receivers = ReceiverMap(GP, LEVEL, AREA)
    candidates = samples(rng, 40)
    first = receivers.gains(candidates)
    best = int(np.argmax(first))
    receivers.add(candidates[best : best + 1])
    again = receivers.gains(candidates)
    assert again[best] < 0.05 * first[best]
    near = np.hypot(*(candidates[:, :2] - candidates[best, :2]).T) < 30.0
    assert (again[near] < first[near]).all()
    assert (again >= 0.0).all()


def test_samples_too_close_are_dropped_and_an_empty_array_accepted() -> None:
    receivers = ReceiverMap(GP, LEVEL, AREA)
    receivers.add(np.array([[10.0, 10.0, 12.0], [10.0, 13.9, 12.0], [10.0, 14.0, 12.0], [50.0, 50.0, 9.0]]))
    assert len(receivers) == 3
    receivers.add(np.zeros((0, 3)))
    assert receivers.gains(np.zeros((0, 3))).shape == (0,)


def test_truncate_drops_samples_added_since_a_mark() -> None:
    rng = np.random.default_rng(7)
    first, second, third, candidates = (samples(rng, n) for n in (10, 10, 5, 20))
    once, twice = ReceiverMap(GP, LEVEL, AREA), ReceiverMap(GP, LEVEL, AREA)
    once.add(first)
    mark = len(once)
    for _ in range(2):
        once.add(second)
        once.truncate(mark)
    for knowledge in (once, twice):
        if knowledge is twice:
            twice.add(first)
        knowledge.add(third)
    assert once.risk == twice.risk
    assert (once.gains(candidates) == twice.gains(candidates)).all()


def test_simulated_receivers_miss_whole_packets() -> None:
    rng = np.random.default_rng(8)
    receivers = ReceiversRisk(GP, LEVEL, AREA, np.random.default_rng(1))
    packets = 300
    for i in range(packets):
        # two places of a row per packet, far from all others
        receivers.suppose(np.array([[10.0 * (i % 20), 5.0 * (i // 20), 15.0]]))
        receivers.suppose(np.array([[10.0 * (i % 20) + 4.5, 5.0 * (i // 20), 15.0]]))
        receivers.send(0.4)
    known = [len(receiver) for receiver in receivers._receivers]
    assert len(known) == ASSUMED_RECEIVERS
    assert len(set(known)) > 1
    for n in known:
        assert n % 2 == 0
        assert n / 2 == pytest.approx(0.6 * packets, abs=4.0 * np.sqrt(packets * 0.24))  # 4 sigma
    candidates = samples(rng, 5)
    mean = np.mean([r.gains(candidates) for r in receivers._receivers], axis=0)
    np.testing.assert_allclose(receivers.gains(candidates), mean, rtol=1e-12)


def test_receivers_have_all_samples_without_loss_and_none_with_total_loss() -> None:
    rng = np.random.default_rng(9)
    heard, candidates = samples(rng, 10), samples(rng, 5)
    sure = ReceiversRisk(GP, LEVEL, AREA, np.random.default_rng(1))
    sure.receive(heard, 0.0)
    reference = ReceiverMap(GP, LEVEL, AREA, spacing_m=20.0)
    reference.add(heard)
    np.testing.assert_allclose(sure.gains(candidates), reference.gains(candidates), rtol=1e-12)
    deaf = ReceiversRisk(GP, LEVEL, AREA, np.random.default_rng(1))
    deaf.receive(heard, 1.0)
    np.testing.assert_allclose(deaf.gains(candidates), ReceiverMap(GP, LEVEL, AREA).gains(candidates), rtol=1e-12)


@pytest.mark.parametrize("loss", [0.0, 0.5, 1.0])
def test_undone_packet_leaves_no_trace(loss: float) -> None:
    rng = np.random.default_rng(10)
    before, sent, heard, candidates = (samples(rng, n) for n in (10, 12, 8, 20))
    receivers, never = (ReceiversRisk(GP, LEVEL, AREA, np.random.default_rng(s)) for s in (1, 1))
    for r in (receivers, never):
        r.receive(before, loss)
    receivers.suppose(sent)
    receivers.send(loss)
    never.suppose(sent[:0])
    never.send(loss)  # draws who misses it, as the other one did; it holds nothing
    for r in (receivers, never):
        r.receive(heard, loss)
    receivers.take_back()
    np.testing.assert_array_equal(receivers.gains(candidates), never.gains(candidates))
    receivers.take_back()  # nothing is left to take back
    np.testing.assert_array_equal(receivers.gains(candidates), never.gains(candidates))


def test_receivers_from_mission_parameters() -> None:
    parameters = {"gp": {"length_scale_m": 50.0}, "area": {"polygon_m": [0.0, 0.0, 100.0, 0.0, 100.0, 100.0]}}
    one, again = (ReceiversRisk.from_parameters(parameters, "test", 2) for _ in range(2))
    for receivers in (one, again):
        for t in range(10):
            receivers.receive([[10.0 * t, 50.0, 15.0]], 0.3)
    assert one.gains([[50.0, 60.0, 15.0]]) == again.gains([[50.0, 60.0, 15.0]]) > 0.0
