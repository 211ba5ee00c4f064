"""The quality of a vehicle's map, in the terms of `mission.until`: share found, length undiscovered, deviation."""

import dataclasses
import importlib
import math
from collections.abc import Sequence

import numpy as np
from scipy.special import erfc

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.vocabulary.map_quality import Quality
from auv_lse_gp.inference.banks import Banks
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.posterior_in_parts import extend_in_parts, moments_in_parts
from auv_lse_gp.inference.roughness import variance_scales_in_parts
from auv_lse_gp.inference.tiled_posterior import TiledMoments, TiledPosterior
from auv_lse_gp.inference.work import FUNCTION, Work, finish
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.level_set.lines import contours, near, resample
from auv_lse_gp.map.certainty import (
    FOUND,
    MAX_STD_M,
    MIN_INFORMED,
    MIN_LENGTH_M,
    Piece,
    classify,
    found_within_m,
    length_of,
    lines_of,
)
from auv_lse_gp.map.depth_map import MANY_CELLS, Moments, field_of
from auv_lse_gp.map.online import MAX_DENSE
from auv_lse_gp.map.undiscovered import KERNEL, Undiscovered, coarse_grid, undiscovered_in_parts


def share_found(found_m: float, missing: Undiscovered) -> float:
    """Share of the isobath that is found: length found, of that and the length expected elsewhere.

    It is 1 if none is found and, with 95 % probability, less than the shortest stretch that counts is missing: the
    level does not occur.
    """
    if found_m <= 0.0:
        return float(missing.limit_m < MIN_LENGTH_M)
    return found_m / (found_m + missing.expected_m)


class QualityJudge:
    """Judges the maps of one mission.

    A judgement takes one to four seconds. So it is done in parts (`auv_lse_gp.inference.work`).
    """

    def __init__(self, config: GpConfig, level_set: LevelSetConfig, area: OperatingArea) -> None:
        importlib.import_module("scipy.optimize")  # takes 50 ms, which no slice of a judgement has
        self._config, self._levels, self._area = config, LevelSet.of(level_set), area
        grid = area.grid(config.map_resolution_m, "gp.map_resolution_m")
        cells = int(np.count_nonzero(grid.inside))
        if cells > MANY_CELLS:
            grid = area.grid(config.map_resolution_m * math.sqrt(cells / MANY_CELLS))
        self._grid, self._locations_m = grid, grid.locations_m
        self._coarse = coarse_grid(area, config.map_resolution_m)
        self._prior = Posterior(config, banks=Banks.of(area.config, self._levels.level_m))
        self._tiles: TiledMoments | None = None  # of a large map, so that tiles without changes are kept

    def judge(self, centers: Centers) -> Quality:
        """The quality of the map of these centers.

        Where positions are corrected, its position variance (`Posterior.position_variance`) counts as the vehicles'
        error.

        Raises:
            IllConditionedError: if the centers cannot be factorized.
        """
        return finish(self.judge_in_parts(centers))

    def judge_in_parts(self, centers: Centers, revision: int = 0) -> Work[Quality]:
        """As `judge`; the quality has the map's `revision`."""
        banks, level_m = self._prior.banks, self._levels.level_m
        moments = yield from self._moments(centers)
        field = field_of(self._grid, moments, self._levels, banks, self._config.signal_std_m, revision)
        yield FUNCTION * len(self._locations_m)
        informed = field.informed(self._config.signal_std_m)
        lines = contours(self._grid.north_m, self._grid.east_m, field.mean_m, level_m, informed)
        soundings = np.column_stack([centers.locations_m, np.zeros(len(centers))])
        yield FUNCTION * len(self._locations_m)
        pieces = classify(lines, field, self._config.signal_std_m, soundings, shore_known=banks is not None)
        yield FUNCTION * len(self._locations_m)
        located = near(lines_of(pieces, FOUND))
        missing = yield from undiscovered_in_parts(
            self._config, centers, level_m, self._coarse, located, self._prior.banks
        )
        return Quality(
            found_share=share_found(self._found_inside_m(pieces), missing),
            undiscovered_m=missing.limit_m,
            deviation_m=found_within_m(pieces),
            revision=revision,
        )

    def _found_inside_m(self, pieces: Sequence[Piece]) -> float:
        """Length (m) found within the area; beyond its border nothing is counted as missing."""
        points = resample(lines_of(pieces, FOUND))
        return length_of(pieces, FOUND) * float(self._area.contains(points).mean()) if len(points) else 0.0

    def _moments(self, centers: Centers) -> Work[Moments]:
        """The posterior at the grid's cells: of a small map as a whole, else tile by tile."""
        if len(centers) > MAX_DENSE:
            if self._tiles is None:
                length_m = self._config.length_scale_m
                self._tiles = TiledMoments(TiledPosterior(self._prior), self._locations_m, length_m)
            found = yield from self._tiles.follow(centers)
            scales = yield from self._tiles.scales_in_parts(self._config.std_soundings)
            return Moments(*found, scales)
        posterior = self._prior.blank()
        yield from extend_in_parts(posterior, centers)
        mean, variance, position_variance = yield from moments_in_parts(posterior, self._locations_m)
        scales = yield from variance_scales_in_parts(posterior, self._config, self._locations_m, variance)
        return Moments(mean, variance, position_variance, scales)


#: Half the number of lanes of `lanes_share`, and half their length in length scales.
LANES, LENGTH_SCALES = 4, 3.0


def lanes_share(config: GpConfig, apart_m: float, leg_m: float) -> float:
    """Share of the isobath that is found by parallel lanes, expected by the prior alone.

    A location is found if the deviation s that the lanes leave there, divided by the slope g, is at most
    `MAX_STD_M[FOUND]`. On the isobath, g is distributed as the length of a normal vector in the plane, weighted by
    itself: P(g > t) = erfc(t / sqrt(2) b) + sqrt(2 / pi) t / b exp(-t^2 / 2 b^2), b the standard deviation per axis.

    Args:
        apart_m: Distance between the lanes.
        leg_m: Length of a leg; soundings half a leg apart on a lane suffice for length scales of a leg or more.
    """
    prior = dataclasses.replace(config, kernel=KERNEL)
    lanes = Posterior(prior)
    reach_m = LENGTH_SCALES * max(config.length_scale_m, config.length_scale_2_m)
    at = np.meshgrid(np.arange(-reach_m, reach_m, 0.5 * leg_m), (np.arange(2 * LANES) - LANES + 0.5) * apart_m)
    count = at[0].size
    slope = lanes.depth_and_slope(np.zeros((1, 2))).slope_covariance[0]
    lanes.extend(Centers(np.column_stack([a.ravel() for a in at]), np.zeros(count), np.full(count, config.noise_std_m)))
    across = np.linspace(0.0, 0.5 * apart_m, 21)
    _, variance = lanes.moments(np.column_stack([np.zeros(len(across)), across]))
    limit = np.sqrt(variance / np.trace(slope) * 2.0) / MAX_STD_M[FOUND]
    share = erfc(limit / math.sqrt(2.0)) + math.sqrt(2.0 / math.pi) * limit * np.exp(-0.5 * limit * limit)
    informed = 1.0 - variance / config.signal_std_m**2 >= MIN_INFORMED[FOUND]
    return float(np.mean(np.where(informed, share, 0.0)))
