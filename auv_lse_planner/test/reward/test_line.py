"""The line's objective: against contours of posterior draws, its gradient, and that it telescopes."""

from __future__ import annotations

import contourpy
import numpy as np
import pytest
from planner_helpers import area

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.crossings import crossing_intensity
from auv_lse_planner.reward.anytime import AnytimeReward, Weighting
from auv_lse_planner.reward.line import CachedSlopes, LineLoss

LEVEL_M, CELL_M, SIDE_M, DRAWS = 15.0, 6.0, 150.0, 700


def posterior(count: int = 4, seed: int = 3) -> Posterior:
    rng = np.random.default_rng(seed)
    found = Posterior(GpConfig())
    at = rng.uniform(0.0, SIDE_M, (count, 2))
    if count:
        found.extend(Centers(at, 15.0 + 6.0 * np.sin(at[:, 0] / 60.0), np.full(count, 0.3)))
    return found


def path_m(legs: int = 5) -> np.ndarray:
    """A path (legs, 2, 2) across the middle of the ground."""
    along = np.linspace(0.0, SIDE_M, 2 * legs)
    return np.column_stack([along, 75.0 + 20.0 * np.sin(along / 30.0)]).reshape(legs, 2, 2)


@pytest.mark.parametrize("count", [0, 4])
def test_it_is_the_mean_length_of_contours_that_stay_unlocated_in_draws_of_the_posterior(count: int) -> None:
    """Draws measure the share located of the line's length, whose expectation Kac-Rice gives exactly: 3 %."""
    known = posterior(count)
    axis = np.arange(0.5 * CELL_M, SIDE_M, CELL_M)
    nodes = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    after = known.with_planned(path_m().reshape(-1, 2))
    left_m2 = after.moments(nodes)[1]  # includes planned locations
    mean, white = known.mean_m(nodes), CachedPoints(known, nodes).current().white
    covariance = known.kernel.of_scaled_numpy(*[known.kernel.scale(nodes)] * 2) - white @ white.T
    lower = np.linalg.cholesky(covariance + 1e-6 * np.eye(len(nodes)))
    located = total = 0.0
    rng = np.random.default_rng(1)
    limit = np.sqrt(left_m2).reshape(len(axis), -1) / 10.0
    for _ in range(DRAWS):
        depth = (mean + lower @ rng.standard_normal(len(nodes))).reshape(len(axis), -1)
        steep = np.hypot(*np.gradient(depth, CELL_M)) >= limit
        for line in contourpy.contour_generator(axis, axis, depth).lines(LEVEL_M):
            lengths = np.hypot(*np.diff(line, axis=0).T)
            column, row = np.rint((0.5 * (line[1:] + line[:-1]) - 0.5 * CELL_M) / CELL_M).astype(int).T
            total += lengths.sum()
            located += lengths[steep[row, column]].sum()
    cells = CachedPoints(known, nodes)
    losses = LineLoss(LEVEL_M, CELL_M).of(cells)
    unlocated = losses.sums(left_m2[None])[0]
    whole = CELL_M**2 * crossing_intensity(known.depth_and_slope(nodes), LEVEL_M).sum()
    assert 1.0 - unlocated / whole == pytest.approx(located / total, rel=0.03)


def case() -> tuple[AnytimeReward, Posterior, CachedPoints]:
    """A reward of twenty legs beside a mate, over cells of 20 m."""
    known = posterior(12)
    points = CachedPoints(known, area().grid(20.0).locations_m)
    mates = [(np.array([3.0, 9.0]), np.array([[200.0, 200.0], [180.0, 240.0]]))]
    loss = LineLoss(LEVEL_M, 20.0)
    return AnytimeReward(points, loss, mates, Weighting(20, 30, 50, 1.5)), known, points


def test_its_gradient_is_that_of_its_value() -> None:
    reward, *_ = case()
    at = np.random.default_rng(2).uniform([0.0, 0.0], [360.0, 440.0], (20, 2))
    _, gradient = reward.value_and_gradient(at)
    for row, axis in ((0, 0), (7, 1), (19, 0), (12, 1)):
        step = np.zeros_like(at)
        step[row, axis] = 0.05
        slope = (reward.coarse_value(at + step) - reward.coarse_value(at - step)) / 0.1
        assert gradient[row, axis] == pytest.approx(slope, rel=2e-3, abs=1e-3 * np.abs(gradient).max())


def test_it_telescopes() -> None:
    """The expectation before a measurement equals the mean of the expectations after it, over its outcomes."""
    reward, known, points = case()
    reward = AnytimeReward(points, LineLoss(LEVEL_M, 20.0), [], Weighting(1, 0, 1))
    at = np.array([[150.0, 150.0]])
    expected = reward.risk_before - reward.value(at[None]).expected_end
    mean, variance = known.moments(at)
    std, noise = np.sqrt(variance[0] + known.noise_var_m2), np.sqrt(known.noise_var_m2)
    nodes, weights = np.polynomial.hermite_e.hermegauss(40)
    left = []
    for z in nodes:
        more = Posterior(GpConfig())
        more.extend(known.centers)
        more.extend(Centers(at, mean + std * z, np.full(1, noise)))
        left.append(LineLoss(LEVEL_M, 20.0).of(CachedPoints(more, points.locations_m)).before.sum())
    assert weights @ left / weights.sum() == pytest.approx(expected, rel=0.01)


def test_the_estimated_isobath_is_the_mean_s_contour_where_the_ground_was_sounded() -> None:
    """A plane whose slope is known well: the cells have the contour's length, times the share of variance removed."""
    north, east = np.meshgrid([45.0, 75.0, 105.0], np.arange(0.0, SIDE_M + 1.0, 30.0))
    at = np.column_stack([north.ravel(), east.ravel()])
    known = Posterior(GpConfig())
    known.extend(Centers(at, LEVEL_M + (at - 75.0) @ [0.11, 0.04], np.full(len(at), 0.3)))
    axis = np.arange(0.5 * CELL_M, SIDE_M, CELL_M)
    nodes = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    points = CachedPoints(known, nodes)
    density, slope, slope_std = CachedSlopes(points).on_level(points.current(), LEVEL_M, CELL_M**2, estimated=True)
    mean, variance = known.moments(nodes)
    (line,) = contourpy.contour_generator(axis, axis, mean.reshape(len(axis), -1)).lines(LEVEL_M)
    near = np.abs(mean - LEVEL_M) < 0.12 * CELL_M
    removed = 1.0 - float(variance[near].mean()) / known.kernel.signal_variance_m2
    length_m = np.hypot(*np.diff(line, axis=0).T).sum() + CELL_M  # half a cell beyond each end
    assert CELL_M**2 * float(density @ slope) == pytest.approx(length_m * removed, rel=0.03)
    assert slope_std.max() < 0.2 * np.hypot(0.11, 0.04), "the mean has one slope in a cell"


def test_no_isobath_is_estimated_where_nothing_was_sounded() -> None:
    points = CachedPoints(posterior(0), area().grid(20.0).locations_m)
    assert LineLoss(LEVEL_M, 20.0).of_estimate().of(points).before.sum() == 0.0
    assert LineLoss(LEVEL_M, 20.0).of(points).before.sum() > 100.0
