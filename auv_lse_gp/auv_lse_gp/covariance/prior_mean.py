"""Prior mean m(p) of the depth: a constant, a plane, or a prior survey."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.plurals import counted
from auv_lse_common.support.user_error import error_text

#: Depth (P,) in metres at locations (P, 2).
PriorMean = Callable[[Array], Array]
#: The prior nearly excludes an isobath that is farther than this many standard deviations from its mean everywhere.
MAX_LEVEL_SIGMAS = 2.0
#: The survey that was read last, with its file's time of change and size.
_READ: dict[Path, tuple[tuple[int, int] | None, PriorMean]] = {}


def prior_mean(config: GpConfig) -> PriorMean:
    """The prior mean of a configuration; reads the survey's file if it names one.

    Raises:
        ParameterError: if the survey cannot be used.
    """
    if config.mean == "constant":
        return lambda locations_m: np.full(len(locations_m), config.mean_depth_m)
    if config.mean == "plane":
        slope = np.array([config.mean_slope_north, config.mean_slope_east])
        return lambda locations_m: np.asarray(config.mean_depth_m + locations_m @ slope)
    return _survey_mean(Path(config.survey_file).absolute())


def _survey_mean(path: Path) -> PriorMean:
    """The mean of a survey's file, which is read again only if it has changed: each posterior asks for it.

    A file that has disappeared, as from a broken disk in the middle of a dive, has not changed.
    """
    from auv_lse_gp.soundings import read_soundings  # few vehicles need the parser of tables

    try:
        found = path.stat()
        state = (found.st_mtime_ns, found.st_size)
    except OSError:
        state = None
    known, mean = _READ.get(path, (None, None))
    if mean is not None and state in (None, known):
        return mean
    try:
        soundings = read_soundings(path)
    except (OSError, ValueError) as error:
        raise ParameterError(f"gp.survey_file: {error_text(error)}") from error
    mean = SurveyMean(soundings[:, :2], soundings[:, 2])
    _READ.clear()
    _READ[path] = (state, mean)
    return mean


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcludedLevel:
    """A level that a prior nearly excludes.

    Attributes:
        level_m: Depth of the isobath (m).
        nearest_m: The prior mean nearest to it (m).
        signal_std_m: The prior's standard deviation (m).
    """

    level_m: float
    nearest_m: float
    signal_std_m: float

    @property
    def sigmas(self) -> float:
        """Distance of the level from the nearest prior mean in standard deviations."""
        return abs(self.level_m - self.nearest_m) / self.signal_std_m

    @property
    def wide_enough_m(self) -> float:
        """The least standard deviation (m), rounded up to 0.1 m, that does not exclude the level."""
        return math.ceil(10.0 * abs(self.level_m - self.nearest_m) / MAX_LEVEL_SIGMAS - 1e-6) / 10.0


def excluded_level(gp: GpConfig, level_m: float, locations_m: Array) -> ExcludedLevel | None:
    """The level (m), if a constant or plane prior mean at locations (P, 2) is so far from it that it is nearly
    excluded.

    Args:
        level_m: Depth of the isobath (m).
        locations_m: Corners of the area, shape (P, 2): north, east. A constant mean needs one location.
    """
    if gp.mean == "survey":
        return None
    depths = prior_mean(gp)(locations_m)
    found = ExcludedLevel(
        level_m=level_m,
        nearest_m=float(np.clip(level_m, depths.min(), depths.max())),
        signal_std_m=gp.signal_std_m,
    )
    return found if found.sigmas > MAX_LEVEL_SIGMAS else None


class SurveyMean:
    """Interpolates linearly between a survey's soundings; outside their convex hull, uses the nearest one."""

    def __init__(self, locations_m: Array, depths_m: Array) -> None:
        """Interpolates between soundings at `locations_m` (P, 2) with `depths_m` (P,).

        Raises:
            ParameterError: if there are fewer than three soundings or they lie on one line.
        """
        # Imported here because they load much of SciPy and few missions have a prior survey.
        from scipy.interpolate import LinearNDInterpolator
        from scipy.spatial import cKDTree

        if len(locations_m) < 3:
            raise ParameterError(f"gp.survey_file has {counted(len(locations_m), 'sounding')}; give at least 3")
        spread = np.linalg.svd(locations_m - locations_m.mean(axis=0), compute_uv=False)
        if spread[1] <= 1e-9 * max(spread[0], 1e-300):
            raise ParameterError("gp.survey_file has all soundings on one line; give soundings over an area")
        self._linear = LinearNDInterpolator(locations_m, depths_m)
        self._tree = cKDTree(locations_m)
        self._depths_m = depths_m

    def __call__(self, locations_m: Array) -> Array:
        """Depth (P,) in metres at locations (P, 2)."""
        depth = np.asarray(self._linear(locations_m), float)
        outside = np.isnan(depth)
        if np.any(outside):
            depth[outside] = self._depths_m[self._tree.query(locations_m[outside])[1]]
        return depth
