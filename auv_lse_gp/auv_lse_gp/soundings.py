"""Soundings from files: tables (CSV) and npz grids. Units m, depth positive down."""

from __future__ import annotations

import csv
import math
import zipfile
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.frames import local_from_geodetic

Array = NDArray[np.float64]

#: Names of a table's columns, in small letters; the first is the one that messages use.
_NORTH, _EAST = ("north_m", "n_m", "y_m"), ("east_m", "e_m", "x_m")
_LAT, _LON = ("lat", "latitude", "lat_deg"), ("lon", "lng", "longitude", "lon_deg")
_DEPTH, _ELEVATION = ("depth_m", "depth"), ("elevation_m", "elevation", "z_m")


def read_soundings(path: Path) -> Array:
    """Soundings (n, 3): north, east, depth (m) of a table or an npz grid in local metres.

    Raises:
        OSError: if the file cannot be read.
        ValueError: naming the file, the line and what was expected.
    """
    soundings, origin = read_soundings_anywhere(path)
    if origin is not None:
        raise ValueError(
            f"{path}: has columns lat, lon; expected north_m, east_m: metres from the mission's origin, which the file "
            "does not know"
        )
    return soundings


def read_soundings_anywhere(path: Path) -> tuple[Array, tuple[float, float] | None]:
    """Soundings (n, 3): north, east, depth (m), and the WGS84 latitude and longitude (deg) of their local origin.

    Table: a header, then rows, separated by comma, semicolon, tab or blanks; lines that begin with # are left out. Its
    columns are north_m, east_m, depth_m (others are ignored), or lat, lon in place of the first two: they become metres
    about their mean, which is then the origin (else None). elevation_m, positive up, may stand for depth_m.
    npz: north_m (ny,), east_m (nx,), depth_m (ny, nx); cells of unknown depth (NaN) are left out.

    Raises:
        OSError: if the file cannot be read.
        ValueError: naming the file, the line and what was expected.
    """
    soundings, origin = (_npz(path), None) if path.suffix == ".npz" else _table(path)
    if len(soundings) == 0:
        raise ValueError(f"{path}: holds no sounding")
    return soundings, origin


def _npz(path: Path) -> Array:
    names = ("north_m", "east_m", "depth_m")
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as grid:
            held = list(grid.files)
            arrays = [np.asarray(grid[name], float) for name in names if name in held]
    except (ValueError, EOFError, AttributeError, KeyError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(f"{path}: not a readable npz grid ({error}); expected arrays {', '.join(names)}") from error
    missing = [name for name in names if name not in held]
    if missing:
        raise ValueError(f"{path}: has {', '.join(held) or 'nothing'}; expected also {', '.join(missing)}")
    north, east, depth = arrays
    if north.ndim != 1 or east.ndim != 1 or depth.shape != (len(north), len(east)):
        expected = (north.size, east.size)
        raise ValueError(f"{path}: depth_m has shape {depth.shape}; expected (north, east) = {expected}")
    rows, columns = np.nonzero(np.isfinite(depth))
    return np.column_stack([north[rows], east[columns], depth[rows, columns]])


def _table(path: Path) -> tuple[Array, tuple[float, float] | None]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        byte = error.object[error.start]
        raise ValueError(
            f"{path}: byte {error.start} (0x{byte:02x}) is not UTF-8 text; expected a table of soundings (CSV)"
        ) from error
    lines = [(i, s) for i, s in enumerate(text.splitlines(), 1) if s.strip() and not s.lstrip().startswith("#")]
    separator = next((c for c in ",;\t" if lines and c in lines[0][1]), None)

    def fields(line: str) -> list[str]:
        return line.split() if separator is None else next(csv.reader([line], delimiter=separator))

    header = [name.strip().lower() for name in fields(lines[0][1])] if lines else []

    def column(names: tuple[str, ...]) -> int | None:
        return next((header.index(name) for name in names if name in header), None)

    geodetic = column(_NORTH) is None and column(_EAST) is None and None not in (column(_LAT), column(_LON))
    up = column(_DEPTH) is None and column(_ELEVATION) is not None
    wanted = (_LAT if geodetic else _NORTH, _LON if geodetic else _EAST, _ELEVATION if up else _DEPTH)
    missing = [names[0] for names in wanted if column(names) is None]
    if missing:
        raise ValueError(f"{path}: has columns {', '.join(header) or 'none'}; expected also {', '.join(missing)}")
    indices = [i for i in map(column, wanted) if i is not None]
    rows = []
    for number, line in lines[1:]:
        row = fields(line)
        try:
            values = [float(row[i]) for i in indices]
        except (IndexError, ValueError):
            names = ", ".join(header[i] for i in indices)
            raise ValueError(f"{path}, line {number}: got {line.strip()!r}; expected numbers in {names}") from None
        if not all(map(math.isfinite, values)):
            raise ValueError(f"{path}, line {number}: got {values}; expected finite numbers")
        if geodetic and (abs(values[0]) > 90.0 or abs(values[1]) > 360.0):
            raise ValueError(f"{path}, line {number}: got lat, lon {values[:2]}; expected degrees")
        rows.append(values)
    soundings = np.array(rows, float).reshape(-1, 3)
    if up:
        soundings[:, 2] *= -1.0
    if not geodetic or not len(soundings):
        return soundings, None
    origin = float(soundings[:, 0].mean()), float(soundings[:, 1].mean())
    soundings[:, 0], soundings[:, 1] = local_from_geodetic(soundings[:, 0], soundings[:, 1], *origin)
    return soundings, origin
