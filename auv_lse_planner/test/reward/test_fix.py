"""What a fix brings to a map whose soundings are in doubtful locations."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.reward.fix import gain_of_fix

LEVEL = LevelSet(level_m=15.0, cost_false_safe=10.0, cost_false_unsafe=10.0)
SLOPE = 0.05


def slope(displaced_m: float, by_fix: bool, std_soundings: float = 100.0) -> CachedPoints:
    """A plane that slopes north, 15 m deep at 0, densely sounded; all soundings may be north of their locations."""
    grid = np.arange(-200.0, 201.0, 20.0)
    locations = np.stack(np.meshgrid(grid, grid), axis=2).reshape(-1, 2)
    effect = np.zeros((len(locations), 3))
    effect[:, 0 if by_fix else 2] = SLOPE * displaced_m
    posterior = Posterior(GpConfig(mean="plane", mean_slope_north=SLOPE, std_soundings=std_soundings))
    posterior.follow(Centers(locations, 15.0 + SLOPE * locations[:, 0], np.full(len(locations), 0.1), effect))
    cells = np.arange(-99.0, 100.0, 2.0)  # none of them on the isobath
    return CachedPoints(posterior, np.stack(np.meshgrid(cells, [0.0]), axis=2).reshape(-1, 2))


def test_gain_without_variance_is_the_area_of_displacement() -> None:
    """With hardly anything else in doubt: cost times the mean distance, sqrt(2 / pi) sigma, by cells of 2 m."""
    kept = slope(8.0, True, std_soundings=1e-9)  # the soundings are just what was expected
    assert gain_of_fix(kept, LEVEL) == pytest.approx(10.0 * math.sqrt(2.0 / math.pi) * 8.0 / 2.0, rel=0.05)


def test_rough_ground_reduces_the_gain() -> None:
    by_prior, by_soundings = (slope(8.0, True, std_soundings=worth) for worth in (0.0, 100.0))
    assert by_soundings.posterior.variance_scale < 0.5
    assert gain_of_fix(by_prior, LEVEL) < 0.9 * gain_of_fix(by_soundings, LEVEL)


def test_gain_grows_with_the_removed_position_effect() -> None:
    assert gain_of_fix(slope(8.0, False), LEVEL) == 0.0
    assert 0.0 < gain_of_fix(slope(2.0, True), LEVEL) < 0.5 * gain_of_fix(slope(8.0, True), LEVEL)


def test_gain_is_0_for_exact_locations() -> None:
    kept = slope(8.0, True)
    kept.posterior.follow(dataclasses.replace(kept.posterior.centers, position_effect_m=None))
    assert gain_of_fix(kept, LEVEL) == 0.0
