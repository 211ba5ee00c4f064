"""Samples that contradict the map and each other are down-weighted; honest ones are not."""

from __future__ import annotations

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_gp.covariance.kernels import Kernel
from auv_lse_gp.map.consistency import blocks_of, noise_of_samples
from auv_lse_gp.map.online import OnlineGp

CONFIG = GpConfig(team_outlier_sigmas=5.0)
MEAN_M = CONFIG.mean_depth_m
ONE = np.zeros(19, dtype=np.int64)


def track(n, spacing_m=6.0, north_m=0.0):
    return np.column_stack([np.full(n, north_m), spacing_m * np.arange(n)])


def drawn(locations_m, seed):
    """Depths (n,) of a ground drawn from the prior, with noise."""
    kernel, rng = Kernel(CONFIG), np.random.default_rng(seed)
    scaled = kernel.scale(locations_m)
    covariance = kernel.of_scaled(scaled, scaled) + CONFIG.noise_std_m**2 * np.eye(len(locations_m))
    return MEAN_M + np.linalg.cholesky(covariance) @ rng.standard_normal(len(locations_m))


@pytest.mark.parametrize("seed", range(10))
def test_honest_samples_are_not_weighed_down(seed):
    locations = np.concatenate([track(100), track(100, north_m=40.0)])
    rows, gp = np.column_stack([locations, drawn(locations, seed)]), OnlineGp(CONFIG)
    gp.add_all(rows[:60])
    for begin in range(60, 200, 20):
        _, fit = gp.add_if_fitting(rows[begin : begin + 20], 5.0, 100)
        assert fit.all()
    assert set(gp.centers.noise_std_m.tolist()) <= {CONFIG.noise_std_m} or CONFIG.merge


def test_samples_that_contradict_each_other_are_weighed_down_where_the_map_is_uncertain():
    locations = track(19)
    depths = drawn(locations, 1)
    depths[[4, 9, 14]] += 6.0  # less than one standard deviation of the prior
    kernel = Kernel(CONFIG)
    scaled = kernel.scale(locations)
    noise = noise_of_samples(kernel.of_scaled(scaled, scaled), depths - MEAN_M, CONFIG.noise_std_m, 5.0, ONE)
    assert np.flatnonzero(noise > CONFIG.noise_std_m).tolist() == [4, 9, 14]
    assert noise[[4, 9, 14]].min() > 3.0


def test_a_packet_that_contradicts_the_other_packets_is_weighed_down_as_a_whole():
    moved = np.array([[0.0, 0.0], [15.0, 60.0], [0.0, 114.0], [0.0, 228.0]])
    locations = np.concatenate([track(19) + by for by in moved])
    depths, packets = drawn(locations, 3), np.repeat(np.arange(4), 19)
    depths[packets == 1] += 6.0  # consistent in itself
    kernel = Kernel(CONFIG)
    scaled = kernel.scale(locations)
    noise = noise_of_samples(kernel.of_scaled(scaled, scaled), depths - MEAN_M, CONFIG.noise_std_m, 5.0, packets)
    assert np.unique(packets[noise > CONFIG.noise_std_m]).tolist() == [1]


def test_no_sample_gets_less_noise_than_one_that_contradicts_nothing():
    residuals_m = np.zeros(42)
    residuals_m[[1, 20]] = 1.1, 1.1
    packets = np.repeat([0, 1], [2, 40])
    found = noise_of_samples(1e-9 * np.eye(42), residuals_m, 0.2, 5.0, packets)
    assert found.min() >= 0.2


def test_blocks_are_of_whole_packets():
    packets = np.repeat(np.arange(30), np.arange(30) % 7)
    blocks = blocks_of(packets)
    assert np.concatenate(blocks).tolist() == list(range(len(packets)))
    assert sum(len(np.unique(packets[block])) for block in blocks) == len(np.unique(packets))
    assert blocks_of(packets[:0]) == []


def test_forged_samples_beside_own_soundings_hardly_change_the_map():
    locations = track(100)
    rows = np.column_stack([locations, drawn(locations, 2)])
    forged = rows[10:90:4] + np.array([8.0, 0.0, 6.0])
    gp, alone = OnlineGp(CONFIG), OnlineGp(CONFIG)
    for one in (gp, alone):
        one.add_all(rows[::4])
    _, fit = gp.add_if_fitting(forged, 50.0, 100)
    assert fit.mean() > 0.9, "the gate alone lets them through, if it is wide"
    gp = OnlineGp(CONFIG)
    gp.add_all(rows[::4])
    _, fit = gp.add_if_fitting(forged, 5.0, 100)
    assert not fit.any()
    assert np.abs(gp.predict(locations)[0] - alone.predict(locations)[0]).max() < 0.5


def test_a_sounding_replaces_a_sample_that_was_weighed_down():
    gp = OnlineGp(GpConfig(merge=True))
    gp.add(0.0, 0.0, 10.0, noise_std_m=6.0)
    gp.add(0.5, 0.0, 20.0)
    assert gp.centers.depths_m.tolist() == [20.0]
    assert gp.centers.noise_std_m.tolist() == [gp.config.noise_std_m]
