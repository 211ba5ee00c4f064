"""Ground from an ESRI ASCII grid: a header of `name value` lines, then rows from north to south."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_common.support.input_bounds import MAX_TEXT_BYTES, over_size
from auv_lse_common.support.plurals import counted
from auv_lse_common.support.text import decoded
from auv_lse_sim.ground.grid_ground import GridGround, check_nodes
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.raster_ground import raster_ground


def read_ascii_ground(path: Path, config: BathymetryConfig, origin: tuple[float, float] | None) -> GridGround:
    """Reads ground from an ESRI ASCII grid; a .prj file beside it gives its projection.

    Rows may be wrapped: ncols says where one ends. Either axis may begin at the corner or the center of a cell.

    Raises:
        GroundError: naming the line and what was expected.
    """
    header: dict[str, float] = {}
    values: list[float] = []
    counts: list[int] = []
    lines: list[int] = []
    if too_large := over_size(path, MAX_TEXT_BYTES):
        raise GroundError(f"{too_large}. Cut the grid, or make it coarser")
    for number, line in enumerate(decoded(path.read_bytes()).splitlines(), 1):
        fields = line.split()
        if not fields:
            continue
        if fields[0][0].isalpha() and fields[0].lower() != "nan" and not lines:
            _read_header_line(fields, header, f"{path}:{number}: {line.strip()[:80]!r}")
            check_nodes(str(path), int(header.get("nrows", 1)), int(header.get("ncols", 1)))
            continue
        try:
            row = [float(f.replace(",", ".")) for f in fields]
        except ValueError:
            bad = next(f for f in fields if not _is_number(f.replace(",", ".")))
            raise GroundError(
                f"{path}:{number}: {bad[:40]!r} is not a number. Separate numbers by blanks, and write them as 12.4"
            ) from None
        values.extend(row)
        counts.append(len(row))
        lines.append(number)
    x_name, y_name = (
        f"{axis}ll{'center' if f'{axis}llcenter' in header and f'{axis}llcorner' not in header else 'corner'}"
        for axis in "xy"
    )
    cell = header.get("cellsize", math.nan)
    for key in ("dx", "dy"):
        if header.setdefault(key, cell) != cell and "cellsize" in header:
            raise GroundError(
                f"{path}: its header has cellsize {cell:g} and {key} {header[key]:g}. Leave the right one"
            )
    for key in ("ncols", "nrows", x_name, y_name, "dx", "dy"):
        if math.isnan(header.get(key, math.nan)):
            missing = "cellsize, or dx and dy" if key in ("dx", "dy") else key
            given = ", ".join(name for name, value in header.items() if not math.isnan(value))
            raise GroundError(f"{path}: its header has {given or 'nothing'}, but no {missing}. Add it")
    rows, columns = int(header["nrows"]), int(header["ncols"])
    _check_count(path, counts, lines, rows, columns)
    grid = np.array(values).reshape(rows, columns)[::-1]  # rows run from north to south
    grid = np.where(grid == header.get("nodata_value", math.nan), np.nan, grid)
    dx, dy = header["dx"], header["dy"]
    if min(dx, dy) <= 0.0:
        raise GroundError(f"{path}: its cells are {dx:g} x {dy:g}; write sizes above 0")
    x = header[x_name] + dx * (0.5 * (x_name == "xllcorner") + np.arange(columns, dtype=np.float64))
    y = header[y_name] + dy * (0.5 * (y_name == "yllcorner") + np.arange(rows, dtype=np.float64))
    return raster_ground(path, x, y, grid, _projection(path), config, origin)


def _projection(path: Path) -> str | None:
    """The text of the .prj file beside a grid, whose ending may be in capitals; None if there is none."""
    files = (path.with_suffix(ending) for ending in (".prj", ".PRJ"))
    return next((decoded(file.read_bytes()).strip() for file in files if file.is_file()), None) or None


def _check_count(path: Path, counts: Sequence[int], lines: Sequence[int], rows: int, columns: int) -> None:
    """Compares the numbers of values in lines with those of a grid's rows and columns."""
    odd = next((i for i, count in enumerate(counts) if count != columns), None)
    if odd is not None and (len(counts) == rows or 2 * counts.count(columns) > len(counts)):
        raise GroundError(
            f"{path}:{lines[odd]}: the row has {counted(counts[odd], 'value')}, and ncols is {columns}. Correct the "
            "row, or ncols"
        )
    if odd is None and len(counts) != rows:
        raise GroundError(
            f"{path}: it has {counted(len(counts), 'row')} of values, and nrows is {rows}. Correct nrows, or copy the "
            "file again"
        )
    if sum(counts) != rows * columns:
        raise GroundError(
            f"{path}: it has {counted(sum(counts), 'value')}, and nrows x ncols is {rows} x {columns} = "
            f"{rows * columns}. Correct nrows and ncols, or copy the file again"
        )


def _read_header_line(fields: list[str], header: dict[str, float], where: str) -> None:
    """Adds a line 'name number' to the header."""
    key = fields[0].lower()
    try:
        (value,) = fields[1:]
        number = float(value.replace(",", "."))
    except ValueError:
        raise GroundError(f"{where} is not a header line. Write a name and a number") from None
    if key in header and header[key] != number:
        raise GroundError(f"{where}: {key} was {header[key]:g} above. Leave the right one")
    header[key] = number
    if key in ("ncols", "nrows") and not (header[key].is_integer() and header[key] >= 2):
        raise GroundError(f"{where}: write a whole number of at least 2")
    if not (math.isfinite(header[key]) or key == "nodata_value"):
        raise GroundError(f"{where}: write a finite number")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
