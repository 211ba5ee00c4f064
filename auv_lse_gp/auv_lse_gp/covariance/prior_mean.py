"""Prior mean m(p) of the depth: a constant, a plane, or a prior survey."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_gp.soundings import read_soundings

Array = NDArray[np.float64]

#: Depth (P,) in metres at places (P, 2).
PriorMean = Callable[[Array], Array]


def prior_mean(config: GpConfig) -> PriorMean:
    """The prior mean of a configuration; reads the survey's file if it names one.

    Raises:
        ParameterError: if the survey cannot be used.
    """
    if config.mean == "constant":
        return lambda places_m: np.full(len(places_m), config.mean_depth_m)
    if config.mean == "plane":
        slope = np.array([config.mean_slope_north, config.mean_slope_east])
        return lambda places_m: np.asarray(config.mean_depth_m + places_m @ slope)
    try:
        soundings = read_soundings(Path(config.survey_file))
    except (OSError, ValueError) as error:
        raise ParameterError(f"gp.survey_file: {error}") from error
    return SurveyMean(soundings[:, :2], soundings[:, 2])


class SurveyMean:
    """Interpolates linearly between a survey's soundings; outside their convex hull, uses the nearest one."""

    def __init__(self, places_m: Array, depths_m: Array) -> None:
        """Takes soundings at `places_m` (P, 2) with `depths_m` (P,).

        Raises:
            ParameterError: if there are fewer than three soundings or they lie on one line.
        """
        # Imported here because they load much of SciPy and few missions have a prior survey.
        from scipy.interpolate import LinearNDInterpolator
        from scipy.spatial import cKDTree

        if len(places_m) < 3:
            raise ParameterError(f"gp.survey_file: got {len(places_m)} soundings; expected at least 3")
        spread = np.linalg.svd(places_m - places_m.mean(axis=0), compute_uv=False)
        if spread[1] <= 1e-9 * max(spread[0], 1e-300):
            raise ParameterError("gp.survey_file: got soundings on one line; expected soundings over an area")
        self._linear = LinearNDInterpolator(places_m, depths_m)
        self._tree = cKDTree(places_m)
        self._depths_m = depths_m

    def __call__(self, places_m: Array) -> Array:
        """Depth (P,) in metres at places (P, 2)."""
        depth = np.asarray(self._linear(places_m), float)
        outside = np.isnan(depth)
        if np.any(outside):
            depth[outside] = self._depths_m[self._tree.query(places_m[outside])[1]]
        return depth
