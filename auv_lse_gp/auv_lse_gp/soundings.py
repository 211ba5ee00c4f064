"""Soundings from files: CSV and npz grids. Units m, depth positive down."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def read_soundings(path: Path) -> Array:
    """Soundings (n, 3): north, east, depth (m) of a CSV or an npz grid.

    CSV: a header with north_m, east_m and depth_m (other columns are ignored). npz: north_m (ny,), east_m (nx,),
    depth_m (ny, nx); cells of unknown depth (NaN) are left out.

    Raises:
        OSError: if the file cannot be read.
        ValueError: naming the file, the line and what was expected.
    """
    soundings = _npz(path) if path.suffix == ".npz" else _csv(path)
    if len(soundings) == 0:
        raise ValueError(f"{path}: holds no sounding")
    return soundings


def _npz(path: Path) -> Array:
    with np.load(path, allow_pickle=False) as grid:
        missing = [name for name in ("north_m", "east_m", "depth_m") if name not in grid]
        if missing:
            raise ValueError(f"{path}: has {', '.join(grid)}; expected also {', '.join(missing)}")
        north, east, depth = (np.asarray(grid[name], float) for name in ("north_m", "east_m", "depth_m"))
    if depth.shape != (len(north), len(east)):
        raise ValueError(f"{path}: depth_m has shape {depth.shape}; expected (north, east) = {(len(north), len(east))}")
    rows, columns = np.nonzero(np.isfinite(depth))
    return np.column_stack([north[rows], east[columns], depth[rows, columns]])


def _csv(path: Path) -> Array:
    with path.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file)
        names = [name.strip() for name in reader.fieldnames or []]
        missing = [name for name in ("north_m", "east_m", "depth_m") if name not in names]
        if missing:
            raise ValueError(f"{path}: has columns {', '.join(names) or 'none'}; expected also {', '.join(missing)}")
        reader.fieldnames = names
        rows = []
        for row in reader:
            try:
                values = [float(row[name]) for name in ("north_m", "east_m", "depth_m")]
            except (TypeError, ValueError):
                raise ValueError(
                    f"{path}, line {reader.line_num}: got {row!r}; expected numbers in north_m, east_m, depth_m"
                ) from None
            if not np.all(np.isfinite(values)):
                raise ValueError(f"{path}, line {reader.line_num}: got {values}; expected finite numbers")
            rows.append(values)
    return np.array(rows, float).reshape(-1, 3)
