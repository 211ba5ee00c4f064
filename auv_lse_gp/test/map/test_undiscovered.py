"""The isobath that a survey may have missed."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_gp.inference.centers import NO_CENTERS, Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.work import finish
from auv_lse_gp.map.undiscovered import (
    STD_WORTH,
    Hypothesis,
    along_channel_m,
    coarse_grid,
    draws,
    hypotheses_in_parts,
    undiscovered,
)

AREA = OperatingArea(AreaConfig(polygon_m=[0.0, 0.0, 300.0, 0.0, 300.0, 300.0, 0.0, 300.0]))
CONFIG = GpConfig()


def hypotheses(data: Centers) -> list[Hypothesis]:
    return finish(hypotheses_in_parts(CONFIG, data, None))


def nowhere(locations: Array) -> Mask:
    return np.zeros(len(locations), dtype=bool)


def surveyed(length_scale_m: float, north_m: float = 300.0) -> Centers:
    """Soundings every 10 m along tracks 40 m apart, up to `north_m`, of a field of this length scale about 15 m."""
    north, east = np.meshgrid(np.arange(5.0, north_m, 10.0), np.arange(20.0, 300.0, 40.0), indexing="ij")
    locations = np.column_stack([north.ravel(), east.ravel()])
    field = Posterior(dataclasses.replace(CONFIG, length_scale_m=length_scale_m, signal_std_m=4.0))
    return Centers(
        locations, draws(field, locations, np.ones(len(locations)), 3, math.inf)[0], np.full(len(locations), 0.3)
    )


@pytest.mark.parametrize("length_scale_m", [50.0, 120.0])
def test_soundings_tell_the_length_scale(length_scale_m: float) -> None:
    found = hypotheses(surveyed(length_scale_m))
    mean = sum(h.weight * h.posterior.kernel.length_m for h in found)
    assert sum(h.weight for h in found) == pytest.approx(1.0)
    assert mean == pytest.approx(length_scale_m, rel=0.4)


def test_hypotheses_are_weighted_by_their_marginal_likelihood() -> None:
    """Against dense algebra: the variance c^2 counts as one sounding of 1, and is integrated out."""
    data = surveyed(85.0, 60.0)
    worth, logs = STD_WORTH, {}
    for hypothesis in hypotheses(data):
        kernel = hypothesis.posterior.kernel
        covariance = kernel(data.locations_m, data.locations_m) + np.diag(data.noise_std_m**2)
        residual = data.depths_m - hypothesis.posterior.prior_mean(data.locations_m)
        squares = float(residual @ np.linalg.solve(covariance, residual))
        total = 0.5 * (worth + len(data)) * np.log(worth + squares)
        logs[hypothesis.weight] = -0.5 * float(np.linalg.slogdet(covariance)[1]) - total
    weights, likelihoods = np.array(list(logs)), np.exp(np.array(list(logs.values())) - max(logs.values()))
    assert len(weights) > 1
    assert weights == pytest.approx(likelihoods / likelihoods.sum(), rel=1e-6)  # of those that are not left out


def test_without_soundings_every_length_scale_counts_the_same() -> None:
    found = hypotheses(NO_CENTERS)
    assert [h.weight for h in found] == pytest.approx([1.0 / 21.0] * 21)


def test_rough_ground_hides_more_than_smooth_ground() -> None:
    """And what is located, or measured, hides nothing."""
    grid = coarse_grid(AREA, 10.0)
    rough, smooth = (undiscovered(CONFIG, surveyed(s, 150.0), 15.0, grid, nowhere) for s in (40.0, 150.0))
    assert rough.expected_m > 1.5 * smooth.expected_m
    assert rough.limit_m > rough.expected_m
    located = undiscovered(CONFIG, surveyed(40.0), 15.0, grid, lambda p: p[:, 0] < 250.0)
    assert np.nansum(located.per_cell_m[grid.north_m < 250.0]) == 0.0
    assert located.per_cell_m.sum() == pytest.approx(located.expected_m)
    (north, _, length), *_ = located.patches()
    assert north > 250.0
    assert 0.0 < length <= located.expected_m
    assert undiscovered(CONFIG, surveyed(40.0), 15.0, grid, lambda p: ~nowhere(p)).limit_m == 0.0


def test_the_same_soundings_give_the_same_limit() -> None:
    grid, data = coarse_grid(AREA, 10.0), surveyed(85.0, 150.0)
    first, second = (undiscovered(CONFIG, data, 15.0, grid, nowhere) for _ in range(2))
    assert first.limit_m == second.limit_m


def test_draws_have_the_posteriors_mean_and_variance() -> None:
    """Between tracks, where the short waves matter: 5 % is four standard errors of 400 draws over 60 locations."""
    posterior = Posterior(dataclasses.replace(CONFIG, std_soundings=0.0))
    effect = np.random.default_rng(2).normal(0.0, 0.2, (210, 2))
    data = surveyed(85.0)
    posterior.extend(dataclasses.replace(data, position_effect_m=effect))
    locations = np.random.default_rng(3).uniform(10.0, 290.0, (60, 2))
    mean, variance = posterior.moments(locations)
    scales = np.linspace(0.3, 2.0, len(locations))
    drawn = draws(posterior, locations, scales, 400, math.inf)
    floor = posterior.position_variance(posterior.kernel.scale(locations))
    variance = scales * (variance - floor) + floor
    assert np.mean((drawn - mean) ** 2 / variance) == pytest.approx(1.0, abs=0.05)
    assert np.abs(drawn.mean(axis=0) - mean).max() < 0.25 * np.sqrt(variance.max())


def test_draws_share_an_uncertain_standard_deviation() -> None:
    """The mean square of a draw over all locations has a relative variance of 2 / (f - 4) with f degrees of freedom."""
    locations = np.random.default_rng(3).uniform(0.0, 20_000.0, (400, 2))  # far apart: independent
    drawn = draws(Posterior(CONFIG), locations, np.ones(len(locations)), 400, 20.0)
    squares = np.mean((drawn - 15.0) ** 2, axis=1) / CONFIG.signal_std_m**2
    assert squares.mean() == pytest.approx(20.0 / 18.0, abs=0.06)  # three standard errors
    # Of 400 locations alone it would be 2 / 400. The estimate of a heavy-tailed variance is rough.
    assert 0.06 < squares.var() / squares.mean() ** 2 < 0.25


def test_many_soundings_are_thinned_and_a_large_area_has_larger_cells() -> None:
    grid = OperatingArea(AreaConfig(polygon_m=[0.0, 0.0, 2000.0, 0.0, 2000.0, 2000.0, 0.0, 2000.0]))
    assert coarse_grid(grid, 5.0).inside.sum() < 5500
    rng = np.random.default_rng(4)
    many = Centers(rng.uniform(0.0, 2000.0, (1500, 2)), rng.normal(15.0, 3.0, 1500), np.full(1500, 0.3))
    assert hypotheses(many)[0].posterior.data_rows == 1200


@pytest.mark.parametrize("turn_deg", [0.0, 60.0])
def test_the_isobath_may_run_along_both_sides_of_a_channel(turn_deg: float) -> None:
    """Soundings along the middle of a channel 80 m wide, in its first 500 m of 1,500: the banks are not seen."""
    turn = math.radians(turn_deg)
    axes = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])  # along, across
    corners = np.array([[0.0, -40.0], [1500.0, -40.0], [1500.0, 40.0], [0.0, 40.0]]) @ axes
    area = OperatingArea(AreaConfig(polygon_m=corners.ravel().tolist()))
    along, across = np.meshgrid(np.arange(5.0, 500.0, 10.0), [-20.0, 0.0, 20.0], indexing="ij")
    u = np.column_stack([along.ravel(), across.ravel()])
    depths = 18.0 + np.sin(u[:, 0] / 150.0) - 6.0 * (u[:, 1] / 25.0) ** 2
    soundings = Centers(u @ axes, depths, np.full(len(u), 0.3))

    def seen(locations: Array) -> Mask:
        return np.asarray(locations @ axes[0] < 520.0)

    found = undiscovered(CONFIG, soundings, 15.0, coarse_grid(area, 5.0), seen)
    assert found.limit_m == pytest.approx(2 * 980.0, rel=0.1)  # the slices of cells


def test_sides_of_a_channel_count_where_the_isobath_may_be_and_is_not_located() -> None:
    north, east = np.meshgrid(np.arange(5.0, 1000.0, 10.0), np.arange(5.0, 60.0, 10.0), indexing="ij")
    cells = np.column_stack([north.ravel(), east.ravel() + 50.0 * np.sin(north.ravel() / 200.0)])  # it bends
    west = east.ravel() < 30.0
    lengths, nowhere_located = np.full(len(cells), 1.0), np.zeros(len(cells), dtype=bool)
    assert along_channel_m(cells, 10.0, lengths, nowhere_located) == pytest.approx(2000.0, rel=0.05)
    assert along_channel_m(cells, 10.0, lengths, west) == pytest.approx(1000.0, rel=0.1)
    assert along_channel_m(cells, 10.0, np.where(west, 0.1, 1.0), nowhere_located) == pytest.approx(1000.0, rel=0.1)
    assert along_channel_m(cells[north.ravel() < 150.0], 10.0, lengths, nowhere_located) == 0.0  # not long
    assert along_channel_m(cells[:2], 10.0, lengths, nowhere_located) == 0.0
