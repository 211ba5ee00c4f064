"""Resamples rasters in projected or geodetic coordinates to local metres."""

from pathlib import Path

import numpy as np
from scipy import ndimage

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.user_error import brief
from auv_lse_common.vocabulary.frames import geodetic_from_local, local_from_geodetic, unwrapped_deg
from auv_lse_gp.soundings import longitude_180
from auv_lse_sim.ground.band_meaning import Meaning, meaning
from auv_lse_sim.ground.depth_sign import SIGN_ADVICE, grid_depths, upside_down
from auv_lse_sim.ground.grid_ground import GridGround, check_nodes, checked_origin
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.local_frame import check_near, check_placed

_PROJECTION_ADVICE = (
    "Write its code, such as EPSG:32632, into the .prj file beside a grid; for other rasters use gdal_edit.py -a_srs"
)


def raster_ground(
    path: Path,
    x: Array,
    y: Array,
    grid: Array,
    crs: str | None,
    config: BathymetryConfig,
    origin: tuple[float, float] | None,
    said: Meaning | None = None,
) -> GridGround:
    """Converts a raster in any coordinates to local ground.

    Args:
        x: Coordinates of the columns (nx,), growing.
        y: Coordinates of the rows (ny,), growing.
        grid: Values (ny, nx), NaN where unknown.
        crs: Their coordinate reference system in a form that pyproj reads, None if the file has none.
        origin: WGS84 latitude and longitude (deg) of the local origin; None: the middle of the raster.
        said: What the file states about the values; None: its name decides.

    Raises:
        GroundError: if the values or the projection are not understood, or the raster lies far from the origin or is
            too large.
    """
    grid, notes = _depths(path, x, y, grid, said or meaning({}, "", None, path.stem, str(path)), config)
    degrees = x[0] >= -360 and x[-1] <= 360 and y[0] >= -90 and y[-1] <= 90 and x[1] - x[0] < 0.1
    if crs is None and not degrees:
        return _local_raster(path, x, y, grid, notes, origin)
    from pyproj import CRS, Transformer
    from pyproj.exceptions import CRSError

    try:
        to_raster = Transformer.from_crs("EPSG:4326", CRS.from_user_input(crs or "EPSG:4326"), always_xy=True)
    except CRSError as error:
        raise GroundError(f"{path}: its projection is not understood: {brief(error)}. {_PROJECTION_ADVICE}") from error
    corners_x, corners_y = np.meshgrid([x[0], x[-1]], [y[0], y[-1]])
    lon, lat = to_raster.transform(corners_x, corners_y, direction="INVERSE")
    if not (np.isfinite(lat).all() and np.isfinite(lon).all()):
        raise GroundError(f"{path}: the corner {x[0]:g}, {y[0]:g} or {x[-1]:g}, {y[-1]:g} is outside of its projection")
    if origin is None:
        middle = longitude_180(float(np.mean(unwrapped_deg(lon))))
        origin = checked_origin(np.mean(lat), middle, f"{path}: the middle of the raster")
    north, east = local_from_geodetic(lat, lon, *origin)
    if not np.isfinite([north, east]).all():
        raise GroundError(f"{path}: its corners are too far from its middle, or outside of its projection")
    check_near(path, north, east, lat, lon, origin)
    north_m, east_m = _local_axes(path, north, east, grid.shape)
    lat, lon = geodetic_from_local(*np.meshgrid(north_m, east_m, indexing="ij"), *origin)
    rx, ry = to_raster.transform(lon, lat)
    if to_raster.target_crs is not None and to_raster.target_crs.is_geographic:
        half_turn = 180.0 - (x[0] + x[-1]) / 2.0  # the raster may have longitudes from 0 to 360
        rx = (np.asarray(rx) + half_turn) % 360.0 - half_turn
    rows = (np.asarray(ry) - y[0]) / (y[1] - y[0])
    columns = (np.asarray(rx) - x[0]) / (x[1] - x[0])
    # Bilinear with NaN outside: a node that mixes in an unknown one is unknown.
    local = ndimage.map_coordinates(grid, [rows, columns], order=1, mode="constant", cval=np.nan)
    notes = (*notes, "reprojected to local metres")
    return GridGround(north_m, east_m, local, name=path.name, origin=origin, notes=notes)


def _depths(
    path: Path, x: Array, y: Array, grid: Array, said: Meaning, config: BathymetryConfig
) -> tuple[Array, tuple[str, ...]]:
    """The depths of a raster, and notes on how it was read."""
    if min(len(x), len(y)) < 2:
        raise GroundError(f"{path}: has {len(y)} x {len(x)} nodes; a grid needs at least 2 x 2")
    if not (np.isfinite([x[0], x[-1], y[0], y[-1]]).all() and x[1] > x[0] and y[1] > y[0]):
        raise GroundError(f"{path}: coordinates from {x[0]:g}, {y[0]:g} to {x[-1]:g}, {y[-1]:g} make no grid")
    depth, notes = grid_depths(grid * said.unit_m, path, said.name, said.up, config)
    if said.unit_m != 1.0:
        notes.append(f"converted from units of {said.unit_m:g} m")
    if upside_down(depth, notes[0], config):
        raise GroundError(
            f"{path}: {said.name} are depths, but mostly negative (median {np.nanmedian(depth):g} m): {SIGN_ADVICE}"
        )
    return depth, (*notes, *said.notes)


def _local_raster(
    path: Path, x: Array, y: Array, grid: Array, notes: tuple[str, ...], origin: tuple[float, float] | None
) -> GridGround:
    """A raster without a projection: in local metres, or, with large coordinates, in metres about its middle."""
    note = "coordinates taken as local metres"
    if max(abs(x[0]), abs(x[-1]), abs(y[0]), abs(y[-1])) > 50_000.0:
        x0, y0 = float(x[0] + x[-1]) / 2.0, float(y[0] + y[-1]) / 2.0
        check_placed(path, x0, y0, origin, _PROJECTION_ADVICE)
        x, y = x - x0, y - y0
        note = f"no projection given: local origin put at its {x0:.1f}, {y0:.1f}"
    return GridGround(y, x, grid, name=path.name, origin=None, notes=(*notes, note))


def _local_axes(path: Path, north: Array, east: Array, shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Axes (m) of a local grid that covers a raster's corners as finely as the raster of `shape`."""
    ny, nx = shape
    step = min(float(np.ptp(north)) / (ny - 1), float(np.ptp(east)) / (nx - 1))
    if not step > 0.0:
        raise GroundError(f"{path}: its cells are {step:g} m wide. Check its georeference, or make it coarser")
    north_m = north.min() + step * np.arange(int(np.ptp(north) / step) + 1)
    east_m = east.min() + step * np.arange(int(np.ptp(east) / step) + 1)
    check_nodes(str(path), len(north_m), len(east_m))
    return north_m, east_m
