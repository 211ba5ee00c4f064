"""Loads the ground of a mission."""

from __future__ import annotations

import functools
from pathlib import Path

from auv_lse_common.mission_file.sections.world import BathymetryConfig, LakeConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_sim.ground.ground import Ground
from auv_lse_sim.ground.ground_files import load_ground
from auv_lse_sim.ground.lake import SyntheticLake


def ground_of(settings: Settings) -> Ground:
    """The file of `sim.bathymetry`, or the synthetic lake of `sim.lake`; built once in a process for one mission.

    Raises:
        GroundError: if the file cannot be used.
        ValueError: if the lake's parameters are inconsistent.
    """
    config = settings.sim.bathymetry
    if not config.file:
        return _lake(settings.sim.lake, settings.mission.seed)
    lat, lon = settings.area.origin_lat_deg, settings.area.origin_lon_deg
    origin = (lat, lon) if lat is not None and lon is not None else None
    path = Path(config.file)
    about = path.stat() if path.is_file() else None
    return _of_file(config, origin, None if about is None else (about.st_size, about.st_mtime_ns))


@functools.lru_cache(maxsize=1)
def _lake(config: LakeConfig, seed: int) -> Ground:
    return SyntheticLake(config, seed)


@functools.lru_cache(maxsize=1)
def _of_file(config: BathymetryConfig, origin: tuple[float, float] | None, version: tuple[int, int] | None) -> Ground:
    """The ground of a file; `version` (size, time of change) tells a changed file from the one built last."""
    return load_ground(config.file, config, origin)
