"""Loads the ground of a mission."""

from __future__ import annotations

from auv_lse_common.mission_file.settings import Settings
from auv_lse_sim.ground.ground import Ground
from auv_lse_sim.ground.ground_files import load_ground
from auv_lse_sim.ground.lake import SyntheticLake


def ground_of(settings: Settings) -> Ground:
    """The file of `sim.bathymetry`, or the synthetic lake of `sim.lake`.

    Raises:
        GroundError: if the file cannot be used.
        ValueError: if the lake's parameters are inconsistent.
    """
    if settings.sim.bathymetry.file:
        lat, lon = settings.area.origin_lat_deg, settings.area.origin_lon_deg
        origin = (lat, lon) if lat is not None and lon is not None else None
        return load_ground(settings.sim.bathymetry.file, settings.sim.bathymetry, origin)
    return SyntheticLake(settings.sim.lake, settings.mission.seed)
