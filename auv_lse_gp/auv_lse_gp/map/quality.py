"""The quality of a vehicle's map, as `mission.until` asks for it: share found, length undiscovered, deviation."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.mission_file.sections.mission import UntilConfig
from auv_lse_gp.inference.banks import depths, width_factor
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.roughness import variance_scales
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.level_set.lines import near
from auv_lse_gp.map.certainty import FOUND, MAX_STD_M, MIN_INFORMED, classify, found_within_m, length_of, lines_of
from auv_lse_gp.map.depth_map import MANY_CELLS, DepthField, contours
from auv_lse_gp.map.undiscovered import KERNEL, coarse_grid, undiscovered

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """The quality of a map.

    Attributes:
        found_share: Length of isobath found / (that length + expected length undiscovered); 0 without any.
        undiscovered_m: 95 % upper limit of the length undiscovered (m).
        deviation_m: Distance (m) within which 95 % of the line found is expected; NaN if none is found.
    """

    found_share: float
    undiscovered_m: float
    deviation_m: float

    def meets(self, asked: UntilConfig) -> bool:
        """Whether it is at least the quality that is asked for."""
        return (
            (asked.found is None or self.found_share >= asked.found)
            and (asked.undiscovered_m is None or self.undiscovered_m <= asked.undiscovered_m)
            and (asked.deviation_m is None or self.deviation_m <= asked.deviation_m)
        )


#: Nothing is known yet.
UNKNOWN = Quality(found_share=math.nan, undiscovered_m=math.nan, deviation_m=math.nan)


class QualityJudge:
    """Judges the maps of one mission; takes one to two seconds for each."""

    def __init__(self, config: GpConfig, level_set: LevelSetConfig, area: OperatingArea) -> None:
        self._config, self._levels = config, LevelSet.of(level_set)
        grid = area.grid(config.map_resolution_m, "gp.map_resolution_m")
        cells = int(np.count_nonzero(grid.inside))
        if cells > MANY_CELLS:
            grid = area.grid(config.map_resolution_m * math.sqrt(cells / MANY_CELLS))
        self._grid, self._locations_m = grid, grid.locations_m
        self._coarse = coarse_grid(area, config.map_resolution_m)

    def judge(self, posterior: Posterior) -> Quality:
        """The quality of the map of a posterior.

        Where positions are corrected, its location variance (`Posterior.position_variance`) counts as the vehicles'
        error.
        """
        field, level_m = self._field(posterior), self._levels.level_m
        lines = contours(self._grid, field.mean_m, level_m)
        soundings = np.column_stack([posterior.centers.locations_m, np.zeros(posterior.data_rows)])
        shore_known = posterior.banks is not None
        pieces = classify(lines, field, self._config.signal_std_m, soundings, shore_known=shore_known)
        located = near(lines_of(pieces, FOUND))
        missing = undiscovered(self._config, posterior.centers, level_m, self._coarse, located, posterior.banks)
        found_m = length_of(pieces, FOUND)
        both_m = found_m + missing.expected_m
        return Quality(
            found_share=found_m / both_m if both_m > 0.0 else 0.0,
            undiscovered_m=missing.limit_m,
            deviation_m=found_within_m(pieces),
        )

    def _field(self, posterior: Posterior) -> DepthField:
        """The posterior on the grid, as `DepthMap.field`."""
        grid, config = self._grid, self._config
        relative, variance = posterior.moments(self._locations_m)
        position_variance = posterior.position_variance(posterior.kernel.scale(self._locations_m))
        exact = np.maximum(variance - position_variance, 0.0)  # of exact positions
        scales = variance_scales(posterior, config, self._locations_m, exact)
        scales = scales + width_factor(posterior.banks, self._locations_m, relative, config.signal_std_m)
        mean, std = depths(posterior.banks, self._locations_m, relative, scales * exact + position_variance)
        _, prior_std = depths(posterior.banks, self._locations_m, relative, variance)
        return DepthField(
            grid=grid,
            mean_m=grid.fill(mean),
            std_m=grid.fill(std),
            prior_std_m=grid.fill(prior_std),
            risk=grid.fill(self._levels.risk(mean, std)),
            p_safe=grid.fill(self._levels.p_safe(mean, std)),
            variance_scale=float(scales.mean()),
            revision=0,
        )


#: Half the number of lanes of `lanes_share`, and half their length in length scales.
LANES, LENGTH_SCALES = 4, 3.0


def lanes_share(config: GpConfig, apart_m: float, leg_m: float) -> float:
    """Share of the isobath that is found by parallel lanes, expected by the prior alone.

    A location is found if the deviation s that the lanes leave there, divided by the slope g, is at most
    `MAX_STD_M[FOUND]`. On the isobath, g is distributed as the length of a normal vector in the plane, weighted by
    itself: P(g > t) = erfc(t / sqrt(2) b) + sqrt(2 / pi) t / b exp(-t^2 / 2 b^2), b the standard deviation per axis.

    Args:
        apart_m: Distance between the lanes.
        leg_m: Distance between two soundings on a lane; half of it is enough for any kernel as long as it.
    """
    prior = dataclasses.replace(config, kernel=KERNEL, support_m=0.0, local=False)
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
