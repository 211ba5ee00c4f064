"""A coarse chart of the ground that the team has before its mission: the smoothed truth with random errors.

The mission then starts from the chart instead of a constant depth: `gp.mean` becomes `survey`, and `gp.survey_file` the
chart's file.
"""

import math
from pathlib import Path

import numpy as np
from scipy import ndimage

from auv_lse_common.mission_file.sections.area import corners
from auv_lse_common.mission_file.sections.world import ChartConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.extent import Extent
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_sim.ground.ground import Ground, GroundError
from auv_lse_sim.ground.ground_source import ground_of

#: Distance (m) by which the chart extends beyond the bounding box of the operating area.
BEYOND_M = 50.0
#: Name of the chart's file.
FILE = "chart.npz"


def with_chart(settings: Settings, folder: Path) -> Settings:
    """Writes the chart that the settings request into `folder`, and returns settings that use it.

    Raises:
        GroundError: if the ground is unknown in the whole area.
    """
    config = settings.sim.chart
    if config.smoothing_m == 0.0:
        return settings
    locations = corners("area.polygon_m", settings.area.polygon_m)
    (north_min, east_min), (north_max, east_max) = locations.min(axis=0), locations.max(axis=0)
    area = Extent(north_min_m=north_min, north_max_m=north_max, east_min_m=east_min, east_max_m=east_max)
    north, east, depth = coarse_chart(
        ground_of(settings), area.grown(BEYOND_M), config, stream(settings.mission.seed, "chart")
    )
    path = folder / FILE
    np.savez_compressed(path, north_m=north, east_m=east, depth_m=depth)
    return settings.with_overrides({"gp.mean": "survey", "gp.survey_file": str(path)})


def coarse_chart(
    ground: Ground, extent: Extent, config: ChartConfig, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Nodes of the chart: north (R,), east (C,), depth (R, C) in metres, NaN where no ground is known nearby.

    The ground is sampled every `smoothing_m` / 8 and smoothed with Gaussian weights of standard deviation
    `smoothing_m`; land counts as unknown. The errors are white noise smoothed over `error_length_m`, with standard
    deviation `error_m`. Every fourth node is kept.

    Raises:
        GroundError: if no ground is known.
    """
    spacing_m = config.smoothing_m / 8.0
    north, east = extent.axes(spacing_m)
    truth = np.asarray(ground.depth_m(*np.meshgrid(north, east, indexing="ij")))
    known = np.isfinite(truth)
    if not known.any():
        raise GroundError(
            "sim.chart: no ground is known in the operating area. Choose another area, or set sim.chart.smoothing_m: 0"
        )
    sigma = config.smoothing_m / spacing_m
    weight = ndimage.gaussian_filter(known.astype(float), sigma, mode="nearest")
    depth = ndimage.gaussian_filter(np.where(known, truth, 0.0), sigma, mode="nearest")
    near = weight > 1e-3
    depth = np.where(near, depth / np.where(near, weight, 1.0), np.nan)
    depth += config.error_m * _correlated(depth.shape, config.error_length_m / spacing_m, rng)
    return north[::4], east[::4], np.maximum(depth, 0.0)[::4, ::4]


def _correlated(shape: tuple[int, ...], sigma: float, rng: np.random.Generator) -> Array:
    """Noise (R, C) of unit variance: white, averaged with Gaussian weights of `sigma` nodes."""
    margin = math.ceil(4.0 * sigma)
    white = rng.standard_normal([n + 2 * margin for n in shape])
    smooth = ndimage.gaussian_filter(white, sigma, mode="wrap")
    # Gaussian weights of standard deviation s, squared and summed over the plane: 1 / (4 pi s^2)
    inner: Array = smooth[margin : margin + shape[0], margin : margin + shape[1]]
    return inner * (2.0 * math.sqrt(math.pi) * sigma)
