"""The sign of a file's depths.

A column or array called `depth_m` is positive down; one called `elevation_m` (or `z_m`) is positive up:
depth = water_level_m - elevation. Rasters have no names: with `depth_sign` "auto", mostly negative values are
elevations, and ambiguous values are an error.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_gp.soundings import is_no_data
from auv_lse_sim.ground.ground import GroundError

Array = NDArray[np.float64]

#: Positive values above this are taken for elevations above sea level unless the user sets the sign.
_ELEVATED_M = 200.0
#: A raster with more than this fraction of its values on both sides of 0 is ambiguous.
_BOTH_SIGNS = 0.05

_DOWN = "depth positive down"
SIGN_ADVICE = "set sim.bathymetry.depth_sign: up for elevations, down for depths with land above them"


def depths_of(values: Array, path: Path, what: str, up: bool | None, config: BathymetryConfig) -> tuple[Array, str]:
    """Converts a file's values to depths (m, positive down); returns them and a note on how.

    Args:
        values: The file's values, any shape, NaN for unknown.
        path: The file, for messages.
        what: Their name in the file.
        up: Whether the name means elevations; None for a raster, which has no names.
        config: How to read them.

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
        up = level is not None or _looks_up(known, f"{path}: {span}")
    if not up:
        if level is not None:
            raise GroundError(
                f"{path}: {span}, taken as depths (positive down), with sim.bathymetry.water_level_m = {level:g} m; "
                "expected water_level_m for elevations only: leave it out, or set sim.bathymetry.depth_sign: up"
            )
        return values, _DOWN
    surface = 0.0 if level is None else level
    if known.min() >= surface:
        raise GroundError(
            f"{path}: {span}, taken as elevations, none below the water surface at {surface:g} m; expected the "
            "bottom's elevations: set sim.bathymetry.water_level_m to the elevation of the water surface in the file's "
            "datum, or sim.bathymetry.depth_sign: down if these are depths"
        )
    return surface - values, "elevations, " + ("negated" if surface == 0.0 else f"water surface at {surface:g} m")


def grid_depths(
    values: Array, path: Path, what: str, up: bool | None, config: BathymetryConfig
) -> tuple[Array, list[str]]:
    """As `depths_of` for a grid: no-data values become NaN, which a note reports."""
    marks = is_no_data(values)
    notes = []
    if marks.any():
        found = ", ".join(f"{v:g}" for v in np.unique(values[marks]))
        notes = [f"{int(marks.sum())} nodes of {found} taken as unknown"]
        values = np.where(marks, np.nan, values)
    depth, note = depths_of(values, path, what, up, config)
    return depth, [note, *notes]


def _looks_up(known: Array, span: str) -> bool:
    """Whether a raster's values are elevations according to their signs.

    Raises:
        GroundError: if the signs are ambiguous.
    """
    negative, positive = float((known < 0.0).mean()), float((known > 0.0).mean())
    if min(negative, positive) > _BOTH_SIGNS:
        raise GroundError(
            f"{span}, {100.0 * negative:.0f} % negative, {100.0 * positive:.0f} % positive: water and land, but which "
            "is which? Expected sim.bathymetry.water_level_m, the elevation of the water surface in the file's datum "
            "(these are elevations), or sim.bathymetry.depth_sign: down (these are depths, positive down)"
        )
    # Zeros often fill the outside of a survey, and outliers occur, so most values decide.
    if positive > 0.5 and float(np.quantile(known[known != 0.0], _BOTH_SIGNS)) > _ELEVATED_M:
        raise GroundError(
            f"{span}: elevations above sea level, or depths? Expected sim.bathymetry.water_level_m, the elevation of "
            "the water surface in the file's datum (these are elevations), or sim.bathymetry.depth_sign: down (these "
            "are depths, positive down)"
        )
    return negative > 0.5


def upside_down(depth: Array, note: str, config: BathymetryConfig) -> bool:
    """Whether named depths must be wrong: mostly negative, or, with a sign set by the user, never positive."""
    known = depth[np.isfinite(depth)]
    if note != _DOWN:
        return False
    return bool((known < 0.0).mean() > 0.5 if config.depth_sign == "auto" else (known < 0.0).all())
