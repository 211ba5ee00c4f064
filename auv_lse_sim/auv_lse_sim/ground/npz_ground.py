"""Ground from an npz grid in metres (see `auv_lse_gp.soundings.read_npz_grid`)."""

from pathlib import Path

import numpy as np

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_common.vocabulary.frames import FAR_M
from auv_lse_gp.soundings import is_far, read_npz_grid
from auv_lse_sim.ground.depth_sign import SIGN_ADVICE, grid_depths, upside_down
from auv_lse_sim.ground.grid_ground import GridGround, checked_origin
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.local_frame import ranges


def read_npz_ground(path: Path, config: BathymetryConfig, origin: tuple[float, float] | None) -> GridGround:
    """Reads ground from an npz grid.

    Besides the grid it may have dist_to_sounding_m (ny, nx), the distance of each node to the nearest sounding, and
    lat0, lon0, the WGS84 latitude and longitude (deg) of the local origin.

    Raises:
        GroundError: naming the array and what was expected.
        TableError: if it is not an npz grid.
    """
    grid = read_npz_grid(path)
    depth, notes = grid_depths(grid.values, path, grid.depth_name, grid.upward, config)
    if upside_down(depth, notes[0], config):
        raise GroundError(
            f"{path}: {grid.depth_name} is mostly negative (median {np.nanmedian(depth):g} m), but depths are "
            f"positive down: {SIGN_ADVICE}"
        )
    distance = grid.others.get("dist_to_sounding_m")
    if distance is not None:
        if distance.dtype.kind not in "fiu":
            raise GroundError(f"{path}: dist_to_sounding_m holds {distance.dtype}, not numbers")
        if distance.shape != depth.shape:
            raise GroundError(f"{path}: dist_to_sounding_m has the shape {distance.shape}, not {depth.shape}")
        depth = np.where(distance <= config.max_gap_m, depth, np.nan)
        notes.append(f"unknown beyond {config.max_gap_m:g} m of a sounding")
    if ("lat0" in grid.others) != ("lon0" in grid.others):
        raise GroundError(f"{path} has only one of lat0, lon0; give both or neither")
    if "lat0" in grid.others:
        origin = checked_origin(grid.others["lat0"], grid.others["lon0"], f"{path}: lat0, lon0")
    north, east = grid.north_m, grid.east_m
    if north.size and east.size and is_far(north, east):
        raise GroundError(
            f"{path}: {ranges(north, east)} are farther than {FAR_M / 1000:g} km from a local origin, so they "
            "may be projected (UTM). Subtract an origin, and give its latitude and longitude as lat0, lon0"
        )
    return GridGround(
        north,
        east,
        depth,
        name=path.name,
        origin=origin,
        notes=tuple(notes),
    )
