"""The quality of a map, judged on board."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_gp.covariance.kernels import Kernel
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.level_set.lines import near, resample
from auv_lse_gp.map.certainty import FOUND, classify, found_within_m, length_of, lines_of
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.map.quality import QualityJudge, lanes_share
from auv_lse_gp.map.undiscovered import coarse_grid, undiscovered

AREA = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 200.0, 0.0, 200.0, 300.0, 0.0, 300.0)))
CONFIG = GpConfig(map_resolution_m=5.0)


def soundings(east_to_m: float) -> np.ndarray:
    """Soundings on a plane that is 15 m deep at north = 100, in the west up to `east_to_m`."""
    north, east = np.meshgrid(np.arange(10.0, 200.0, 15.0), np.arange(10.0, east_to_m, 30.0))
    depth = 15.0 + 0.1 * (north.ravel() - 100.0)
    return np.column_stack([np.arange(float(depth.size)), north.ravel(), east.ravel(), depth])


@pytest.mark.parametrize("shore", [{}, {"south": (-20.0, -50.0, -20.0, 350.0)}], ids=["open", "shore"])
def test_it_is_that_of_the_map_as_the_report_judges_it(shore: dict[str, tuple[float, ...]]) -> None:
    levels, area = LevelSetConfig(level_m=15.0), OperatingArea(dataclasses.replace(AREA.config, shore=shore))
    depth_map = DepthMap(CONFIG, levels, area)
    rows = soundings(160.0)
    depth_map.add_soundings(rows)
    banks = depth_map.gp.banks
    posterior = Posterior(CONFIG, banks=banks)
    posterior.extend(depth_map.centers)
    quality = QualityJudge(CONFIG, levels, area).judge(depth_map.centers)
    locations = np.column_stack([rows[:, 1:3], np.zeros(len(rows))])
    pieces = classify(depth_map.isobath().lines, depth_map.field(), CONFIG.signal_std_m, locations)
    located = near(lines_of(pieces, FOUND))
    missing = undiscovered(CONFIG, depth_map.centers, 15.0, coarse_grid(area, 5.0), located, banks)
    # the line goes on beyond the border, where no length is missing
    points = resample(lines_of(pieces, FOUND))
    found_m = length_of(pieces, FOUND) * float(area.contains(points).mean())
    assert 100.0 < found_m < 0.99 * length_of(pieces, FOUND)
    # the online map rounds otherwise than a posterior made in one go
    assert quality.found_share == pytest.approx(found_m / (found_m + missing.expected_m), rel=1e-6)
    assert quality.undiscovered_m == pytest.approx(missing.limit_m, rel=1e-6)
    assert quality.deviation_m == pytest.approx(found_within_m(pieces), rel=1e-6)


@pytest.mark.parametrize(("east_to_m", "share"), [(300.0, 1.0), (100.0, 0.0)])
def test_an_isobath_that_does_not_occur_is_found_once_the_ground_is_known(east_to_m: float, share: float) -> None:
    rows = soundings(east_to_m)
    rows[:, 3] += 15.0
    depth_map = DepthMap(CONFIG, LevelSetConfig(level_m=15.0), AREA)
    depth_map.add_soundings(rows)
    quality = QualityJudge(CONFIG, LevelSetConfig(level_m=15.0), AREA).judge(depth_map.centers)
    assert quality.found_share == share


def test_lanes_find_the_share_that_draws_of_the_prior_and_dense_algebra_give() -> None:
    config = dataclasses.replace(CONFIG, length_scale_m=60.0, signal_std_m=6.0)
    apart_m, kernel = 60.0, Kernel(dataclasses.replace(config, kernel="matern52"))
    at = np.array([[north, apart_m * lane] for lane in range(-3, 4) for north in np.arange(-180.0, 181.0, 12.0)])
    across = np.column_stack([np.zeros(15), np.linspace(0.0, apart_m, 15)])
    cross = kernel(across, at)
    inverse = np.linalg.inv(kernel(at, at) + config.noise_std_m**2 * np.eye(len(at)))
    std = np.sqrt(np.maximum(config.signal_std_m**2 - np.einsum("pn,nm,pm->p", cross, inverse, cross), 0.0))
    # The slope of a Matern 5/2 field has the variance 5/3 (s / l)^2 per axis; an isobath is met in proportion to it.
    slope = np.random.default_rng(1).normal(0.0, np.sqrt(5.0 / 3.0) * 6.0 / 60.0, (20_000, 2))
    steep = np.hypot(*slope.T)
    found = [np.average((s <= 10.0 * steep) & (s * s <= 0.25 * 36.0), weights=steep) for s in std]
    assert 0.3 < np.mean(found) < 0.9
    assert lanes_share(config, apart_m, 24.0) == pytest.approx(np.mean(found), abs=0.02)


def test_closer_lanes_find_a_larger_share() -> None:
    shares = [lanes_share(CONFIG, apart_m, 20.0) for apart_m in (10.0, 60.0, 90.0, 150.0, 1000.0)]
    assert shares == sorted(shares, reverse=True)
    assert shares[0] > 0.99
    assert shares[-1] < 0.1


def test_more_soundings_raise_it() -> None:
    judge = QualityJudge(CONFIG, LevelSetConfig(level_m=15.0), AREA)
    qualities = []
    for east_to_m in (100.0, 200.0, 300.0):
        depth_map = DepthMap(CONFIG, LevelSet(level_m=15.0), AREA)
        depth_map.add_soundings(soundings(east_to_m))
        posterior = Posterior(CONFIG)
        posterior.extend(depth_map.centers)
        qualities.append(judge.judge(depth_map.centers))
    assert [q.found_share for q in qualities] == sorted(q.found_share for q in qualities)
    assert [-q.undiscovered_m for q in qualities] == sorted(-q.undiscovered_m for q in qualities)
    assert qualities[-1].found_share > 0.8
