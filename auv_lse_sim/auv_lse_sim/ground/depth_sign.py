"""The sign of a file's depths.

A column or array called `depth_m` is positive down; one called `elevation_m` (or `z_m`) is positive up:
depth = water_level_m - elevation. For a raster whose names, unit and CRS say neither, `depth_sign` "auto" takes mostly
negative values for elevations and positive ones that come near 0 for depths; anything else is an error.
"""

from pathlib import Path

import numpy as np

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.plurals import counted
from auv_lse_common.vocabulary.sounding import DEEPEST_M
from auv_lse_gp.no_data import OFTEN_NO_DATA, fill_values, is_no_data
from auv_lse_sim.ground.ground import GroundError

#: Positive values come near 0 if their 1st percentile is below this (m), or below this share of the 99th.
_NEAR_M, _NEAR_SHARE = 2.0, 0.1
#: Positive values cross 0 if more than this share is below 0: the rest is land.
_ACROSS = 0.01
#: A raster with more than this fraction of its values on both sides of 0 is ambiguous.
_BOTH_SIGNS = 0.05

_DOWN = "depth positive down"
SIGN_FLAGS = (
    "--depths, or --elevations --water-level M with the elevation of the water surface in the file's datum "
    "(sim.bathymetry.depth_sign, water_level_m)"
)
SIGN_ADVICE = "choose --elevations, or --depths for depths with land above them (sim.bathymetry.depth_sign: up or down)"


def depths_of(values: Array, path: Path, what: str, up: bool | None, config: BathymetryConfig) -> tuple[Array, str]:
    """Converts a file's values to depths (m, positive down); returns them and a note on how.

    Args:
        values: The file's values, any shape, NaN for unknown.
        what: Their name in the file.
        up: Whether the name means elevations; None for a raster, which has no names.

    Raises:
        GroundError: if the sign is ambiguous, or no elevation lies under water.
    """
    known = values[np.isfinite(values)]
    if not known.size:
        return values, "nothing known"
    span = f"{what} from {known.min():g} to {known.max():g} m"
    level = config.water_level_m
    if config.depth_sign != "auto":
        up = config.depth_sign == "up"
    elif up is None:
        up = level is not None or _are_elevations(known, f"{path}: {span}")
    if not up:
        if level is not None:
            raise GroundError(
                f"{path}: {span}, taken as depths (positive down), but sim.bathymetry.water_level_m = {level:g} "
                "m needs elevations. Leave it out, or set sim.bathymetry.depth_sign: up"
            )
        return values, _DOWN
    surface = 0.0 if level is None else level
    if known.min() >= surface:
        raise GroundError(
            f"{path}: {span}, taken as elevations, none below the water surface at {surface:g} m. Give the elevation "
            "of the water surface in the file's datum with --water-level M (sim.bathymetry.water_level_m), or --depths "
            "if these are depths (sim.bathymetry.depth_sign: down)"
        )
    return surface - values, "elevations, " + ("negated" if surface == 0.0 else f"water surface at {surface:g} m")


def grid_depths(
    values: Array, path: Path, what: str, up: bool | None, config: BathymetryConfig
) -> tuple[Array, list[str]]:
    """As `depths_of` for a grid: no-data values become NaN, which a note reports."""
    marks = is_no_data(values)
    is_above_0 = config.water_level_m is not None and config.water_level_m > 0.0  # 0 may then mean "no data"
    often = (*OFTEN_NO_DATA, 0.0) if is_above_0 else OFTEN_NO_DATA
    marks |= np.isin(values, fill_values(values[~marks], often))
    notes = []
    if marks.any():
        found = ", ".join(f"{v:g}" for v in np.unique(values[marks]))
        notes = [f"{counted(int(marks.sum()), 'node')} of {found} taken as unknown"]
        values = np.where(marks, np.nan, values)
    depth, note = depths_of(values, path, what, up, config)
    with np.errstate(invalid="ignore"):
        absurd = np.isinf(values) | (np.abs(depth) > DEEPEST_M)
    if absurd.any() and 2 * absurd.sum() < np.isfinite(depth).sum():
        extremes = np.unique(values[absurd])
        shown = f"{extremes[0]:g}" if len(extremes) == 1 else f"{extremes[0]:g} to {extremes[-1]:g}"
        notes.append(f"{counted(int(absurd.sum()), 'node')} of {shown} left out: deeper or higher than {DEEPEST_M:g} m")
        depth = np.where(absurd, np.nan, depth)
    return depth, [note, *notes]


def _are_elevations(known: Array, span: str) -> bool:
    """Whether a raster's values are elevations according to their signs."""
    negative, positive = float((known < 0.0).mean()), float((known > 0.0).mean())
    if min(negative, positive) > _BOTH_SIGNS:
        raise GroundError(
            f"{span}, {100.0 * negative:.0f} % negative, {100.0 * positive:.0f} % positive: water and land, but which "
            f"is which? Say {SIGN_FLAGS}"
        )
    # Zeros often fill the outside of a survey, and outliers occur, so most values decide.
    is_one_sided = positive > 0.5 and negative < _ACROSS
    least, largest = np.quantile(known[known > 0.0], (0.01, 0.99)) if is_one_sided else (0.0, 0.0)
    if least > max(_NEAR_M, _NEAR_SHARE * largest):
        raise GroundError(f"{span}, none near 0: depths, or elevations of the bottom? Say which: {SIGN_FLAGS}")
    return negative > 0.5


def upside_down(depth: Array, note: str, config: BathymetryConfig) -> bool:
    """Whether named depths must be wrong: mostly negative, or, with a sign set by the user, never positive."""
    known = depth[np.isfinite(depth)]
    if note != _DOWN:
        return False
    return bool((known < 0.0).mean() > 0.5 if config.depth_sign == "auto" else (known < 0.0).all())
