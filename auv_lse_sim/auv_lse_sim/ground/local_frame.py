"""Checks that the coordinates of a file lie near the mission's local origin."""

import math
from pathlib import Path

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.frames import FAR_M, local_from_geodetic
from auv_lse_gp.soundings import SAME_ORIGIN_M, is_far, origin_of_metres
from auv_lse_gp.tables.table_error import TableError
from auv_lse_sim.ground.ground import GroundError


def ranges(north: Array, east: Array) -> str:
    """Text with the ranges of locations (m)."""
    return f"north from {north.min():.0f} to {north.max():.0f} m, east from {east.min():.0f} to {east.max():.0f} m"


def check_near(path: Path, north: Array, east: Array, lat: Array, lon: Array, origin: tuple[float, float]) -> None:
    """Checks that geodetic data lie near the mission's origin.

    Raises:
        GroundError: if they do not; names both.
    """
    if is_far(north, east):
        raise GroundError(
            f"{path}: latitude {lat.min():.5f} to {lat.max():.5f}, longitude {lon.min():.5f} to {lon.max():.5f} "
            f"deg are all farther than {FAR_M / 1000:g} km from the mission's area.origin_lat_deg, "
            f"origin_lon_deg = {origin[0]:g}, {origin[1]:g}. Change the origin, or leave both out"
        )


def check_placed(path: Path, east: float, north: float, origin: tuple[float, float] | None, advice: str) -> None:
    """Checks that a mission with an origin on Earth takes no data in an unknown projection.

    Args:
        east: The middle of the data (m) in that projection.
        north: Its northing (m).
        origin: WGS84 latitude and longitude (deg) of the mission's local origin; None if it has none.
        advice: The cure.

    Raises:
        GroundError: if it does.
    """
    if origin is not None:
        raise GroundError(
            f"{path}: its coordinates, about {east:.0f} east, {north:.0f} north, are in an unknown projection, and the "
            f"mission has an origin on Earth, {origin[0]:g}, {origin[1]:g} deg. {advice}"
        )


def prior_fits(gp: GpConfig, origin: tuple[float | None, float | None]) -> bool:
    """Whether the prior mean's metres are relative to an origin, latitude and longitude (deg), or it has none."""
    if gp.mean == "constant":
        return True
    try:
        found = origin_of_metres(Path(gp.survey_file)) if gp.mean == "survey" else None
    except (OSError, TableError):
        return False
    lat_deg, lon_deg = origin
    if found is None or lat_deg is None or lon_deg is None:
        return False
    return math.hypot(*local_from_geodetic(*found, lat_deg, lon_deg)) <= SAME_ORIGIN_M
