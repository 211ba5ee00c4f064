"""Soundings in metres from tables and npz grids, and the origin of their positions."""

import math
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.input_bounds import MAX_GRID_NODES
from auv_lse_common.support.plurals import counted
from auv_lse_common.vocabulary.frames import FAR_M, geodetic_from_local, local_from_geodetic, unwrapped_deg
from auv_lse_gp.no_data import fill_values, is_no_data
from auv_lse_gp.soundings_table import SoundingsTable, read_table
from auv_lse_gp.tables.table_error import TableError

#: Origins computed from a table's lat and lon are no more accurate than this (m).
SAME_ORIGIN_M = 2.0

#: Distance (m) from the middle of a survey beyond which a position is wrong.
_APART_M = 1_000_000.0

#: Exceptions of numpy and zipfile for a file that is damaged or not an npz file.
_BROKEN_NPZ = (
    ValueError, EOFError, OSError, KeyError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError,
    MemoryError, OverflowError, SyntaxError, TypeError, tokenize.TokenError,
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocalPositions:
    """Positions in metres from a local origin.

    Attributes:
        north_m, east_m: Positions (m), shape (n,).
        origin: WGS84 latitude and longitude (deg) of the local origin; None if unknown.
        from_degrees: Whether the positions come from lat, lon rather than from metres.
        notes: Remarks for the user on how the positions were computed.
    """

    north_m: Array
    east_m: Array
    origin: tuple[float, float] | None
    from_degrees: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NpzGrid:
    """A regular grid of depths or elevations from an npz file.

    Attributes:
        north_m: North of the rows (m), shape (ny,).
        east_m: East of the columns (m), shape (nx,).
        depth_name: Name of the array of depths or elevations.
        upward: Whether the values are elevations, positive up.
        values: Depths or elevations (m), shape (ny, nx), NaN where unknown.
        others: The file's other arrays by name.
    """

    north_m: Array
    east_m: Array
    depth_name: str
    upward: bool
    values: Array
    others: Mapping[str, NDArray[Any]] = field(default_factory=dict)


def read_soundings(path: Path) -> Array:
    """Soundings (n, 3): north, east, depth (m) of a table or an npz grid in metres.

    Raises:
        OSError: if the file cannot be read.
        TableError: naming the file, the line and what was expected.
    """
    soundings, origin = read_soundings_and_origin(path)
    if origin is not None:
        raise TableError(
            f"{path} has columns lat, lon; give north_m, east_m instead, in metres from the mission's origin"
        )
    return soundings


def read_soundings_and_origin(path: Path, notes: list[str] | None = None) -> tuple[Array, tuple[float, float] | None]:
    """Soundings (n, 3): north, east, depth (m), and their local origin (WGS84, deg).

    The origin is the middle of the soundings; None for a file in metres. Elevations count from the water surface.

    Args:
        notes: Takes remarks for the user on what was not read.

    Raises:
        OSError: if the file cannot be read.
        TableError: naming the file, the line and what was expected.
    """
    if path.suffix == ".npz":
        grid = read_npz_grid(path)
        known = np.isfinite(grid.values) & ~is_no_data(grid.values)
        known &= ~np.isin(grid.values, fill_values(grid.values[known]))
        rows, columns = np.nonzero(known)
        if len(rows) == 0:
            raise TableError(f"{path} holds no sounding")
        depth = -grid.values[known] if grid.upward else grid.values[known]
        return np.column_stack([grid.north_m[rows], grid.east_m[columns], depth]), None
    table = read_table(path)
    if notes is not None:
        notes += table.notes
    positions = local_positions(table)
    check_together(table.file.where, positions.north_m, positions.east_m)
    depth = -table.values if table.upward else table.values
    return np.column_stack(
        [positions.north_m, positions.east_m, depth]
    ), positions.origin if positions.from_degrees else None


def origin_of_metres(path: Path) -> tuple[float, float] | None:
    """WGS84 latitude and longitude (deg) from which the metres of a table with lat, lon count; None if unknown.

    Raises:
        OSError: if the file cannot be read.
        TableError: if it is not a table of soundings.
    """
    if path.suffix == ".npz":
        return None
    positions = local_positions(read_table(path))
    return None if positions.from_degrees else positions.origin


def origin_problem(path: Path, area: AreaConfig) -> str:
    """Why a survey's metres do not fit a mission's area: another origin; "" if they do, or one origin is unknown.

    Raises:
        OSError, TableError: as `origin_of_metres`.
    """
    origin, lat_deg, lon_deg = origin_of_metres(path), area.origin_lat_deg, area.origin_lon_deg
    if origin is None or lat_deg is None or lon_deg is None:
        return ""
    apart_m = math.hypot(*local_from_geodetic(*origin, lat_deg, lon_deg))
    if apart_m <= SAME_ORIGIN_M:
        return ""
    return (
        f"the metres of {str(path)!r} are relative to {origin[0]:.6f}, {origin[1]:.6f} deg, {apart_m:.0f} m from the "
        f"mission's origin {lat_deg:.6f}, {lon_deg:.6f}. Set area.origin_lat_deg and area.origin_lon_deg to the first"
    )


def check_together(where: Callable[[int], str], north: Array, east: Array) -> None:
    """Checks that no sounding lies absurdly far from the others.

    Args:
        where: Gives the file and the line of a sounding, by its number.
        north, east: Positions (m), shape (n,).

    Raises:
        TableError: naming the line of the first that does.
    """
    away = np.maximum(np.abs(north - np.median(north)), np.abs(east - np.median(east)))
    far = np.flatnonzero(~(away <= _APART_M))
    if len(far):
        raise TableError(
            f"{where(far[0])}: the position {north[far[0]]:g} m north, {east[far[0]]:g} m east lies more than "
            f"{_APART_M / 1000:g} km from the others, as on {counted(len(far), 'line')}. Correct or remove them"
        )


def is_far(north_m: Array, east_m: Array) -> bool:
    """Whether all positions (m) are farther from the local origin than `FAR_M`."""
    nearest = [max(float(v.min()), -float(v.max())) for v in (north_m, east_m)]
    return not max(nearest) <= FAR_M


def local_positions(table: SoundingsTable, origin: tuple[float, float] | None = None) -> LocalPositions:
    """A table's positions in metres from a local origin.

    Metres are used unchanged; degrees, if also given, determine the origin. If degrees are given, metres far from any
    local origin (projected coordinates) are ignored.

    Args:
        origin: WGS84 latitude and longitude (deg) of the local origin for a table with degrees only; by default the
            middle of the soundings.
    """
    notes: tuple[str, ...] = ()
    north, east, lat, lon = table.north_m, table.east_m, table.lat_deg, table.lon_deg
    if north is not None and east is not None:
        if lat is None or lon is None:
            return LocalPositions(north_m=north, east_m=east, origin=origin)
        if not is_far(north, east):
            fitted = _origin_of(north, east, lat, lon)
            notes = () if fitted is not None else ("lat, lon ignored: they do not match east_m, north_m",)
            return LocalPositions(north_m=north, east_m=east, origin=fitted, notes=notes)
        notes = ("metres ignored: far from any local origin (projected?); using lat, lon",)
    assert lat is not None
    assert lon is not None
    if origin is None:
        unwrapped = unwrapped_deg(lon)
        middle = longitude_180(float((unwrapped.min() + unwrapped.max()) / 2.0))
        origin = float((lat.min() + lat.max()) / 2.0), middle
        notes = (*notes, "origin set to the middle of the soundings")
    north, east = local_from_geodetic(lat, lon, *origin)
    return LocalPositions(north_m=north, east_m=east, origin=origin, from_degrees=True, notes=notes)


def longitude_180(lon_deg: float) -> float:
    """A longitude of -180 to 360 deg, wrapped to -180 to 180 deg."""
    return lon_deg if abs(lon_deg) <= 180.0 else (lon_deg + 180.0) % 360.0 - 180.0


def _origin_of(north: Array, east: Array, lat: Array, lon: Array) -> tuple[float, float] | None:
    """The origin whose azimuthal equidistant projection maps lat, lon (deg) to north, east (m); None if none does."""
    design = np.stack([np.ones_like(north), north, east], axis=1)
    lat0 = float(np.linalg.lstsq(design, lat, rcond=None)[0][0])
    lon0 = float(np.linalg.lstsq(design, lon, rcond=None)[0][0])
    for _ in range(2):
        if not (abs(lat0) <= 90.0 and abs(lon0) <= 360.0):
            return None
        n, e = local_from_geodetic(lat, lon, lat0, lon0)
        new_lat, new_lon = geodetic_from_local(np.median(n - north), np.median(e - east), lat0, lon0)
        lat0, lon0 = float(new_lat), float(new_lon)
    if not math.isfinite(lat0 + lon0):
        return None
    n, e = local_from_geodetic(lat, lon, lat0, lon0)
    # 2 m: the rounding of lat and lon to 5 decimals.
    return (lat0, lon0) if float(np.median(np.hypot(n - north, e - east))) < 2.0 else None


# npz grids ------------------------------------------------------------------------------------------------------------


def _check_npz_size(path: Path) -> None:
    """Compares the sizes that the arrays' headers state with the bound."""
    if not zipfile.is_zipfile(path):
        return  # np.load reports the error
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            with archive.open(name) as member:
                if member.read(len(np.lib.format.MAGIC_PREFIX)) != np.lib.format.MAGIC_PREFIX:
                    continue
                version = tuple(member.read(2))
                header = (
                    np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                )
                shape, _, kind = header(member)
            if math.prod(shape) * kind.itemsize > 8 * MAX_GRID_NODES:
                raise TableError(
                    f"{path}: {name.removesuffix('.npy')} has the shape {shape}, more than {MAX_GRID_NODES:,} "
                    "values. Cut the grid, or make it coarser"
                )


def read_npz_grid(path: Path) -> NpzGrid:
    """Reads an npz grid: north_m (ny,), east_m (nx,), and depth_m or elevation_m (ny, nx).

    Raises:
        OSError: if the file cannot be opened.
        TableError: naming the file, the array and what was expected.
    """
    with path.open("rb") as file:
        try:
            _check_npz_size(path)
            data = np.load(file, allow_pickle=False)
            arrays = {key: np.asarray(data[key]) for key in data.files} if hasattr(data, "files") else None
        except TableError:
            raise
        except _BROKEN_NPZ as error:
            raise TableError(
                f"{path} is damaged or not npz ({str(error)[:80]}). It needs the arrays east_m, north_m, depth_m."
            ) from error
    if arrays is None:
        raise TableError(
            f"{path} is a single array of shape {data.shape} (npy); save east_m, north_m, depth_m as an npz file "
            "(np.savez)"
        )
    depth_name = "depth_m" if "depth_m" in arrays else "elevation_m"
    for key in ("north_m", "east_m", depth_name):
        if key not in arrays:
            raise TableError(
                f"{path} has the arrays {', '.join(sorted(arrays)) or 'none'}; needed are east_m (nx,), north_m "
                "(ny,), depth_m (ny, nx), optionally lat0, lon0, dist_to_sounding_m"
            )
        if arrays[key].dtype.kind not in "fiu":
            raise TableError(f"{path}: {key} holds {arrays[key].dtype}, not numbers")
    north, east, values = (arrays.pop(key).astype(float) for key in ("north_m", "east_m", depth_name))
    if north.ndim != 1 or east.ndim != 1 or values.shape != (len(north), len(east)):
        raise TableError(
            f"{path}: {depth_name} has the shape {values.shape}, north_m {north.shape}, east_m {east.shape}; "
            "they must be (ny, nx), (ny,) and (nx,)"
        )
    return NpzGrid(
        north_m=north,
        east_m=east,
        depth_name=depth_name,
        upward=depth_name == "elevation_m",
        values=values,
        others=arrays,
    )
