"""The values of a table's columns: numbers, angles in any notation, and texts."""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support.arrays import Array
from auv_lse_gp.tables.angles import angle
from auv_lse_gp.tables.column_names import DEPTHS, Column
from auv_lse_gp.tables.dialect import Dialect, columns_of, first_unclear, numbers_of
from auv_lse_gp.tables.table_error import TableError

#: Letters from which a table's dialect is found.
SAMPLE_LETTERS = 100_000
#: Beginnings of the roles whose cells stay text.
TEXT_ROLES = (
    "date", "vehicle", "sounder", "order", "lat_side", "lon_side", "depth_unit", "half_day", "utc_offset", "month",
    "vertical_datum", "epsg", "utm_zone", "hemisphere",
)  # fmt: skip
#: Beginnings of the roles of lengths and of coordinates in metres.
_LENGTHS = ("depth", "elevation", "z", "own_depth", "above_bottom", "altitude", "north", "east")
#: The unit behind a depth.
_METRES = re.compile(r"(?<=\d)\s*(?:m|met(?:er|re)s?)\.?\s*$", re.IGNORECASE)


def read_values(
    path: Path,
    text: str,
    dialect: Dialect,
    columns: Mapping[str, Column],
    has_unit: bool = False,
    progress: Callable[[float], None] = lambda share: None,
    is_whole: bool = False,
    joined: list[int] | None = None,
) -> dict[str, Any]:
    """The values of a table's columns by role, (n,) each: texts of `TEXT_ROLES`, else numbers, NaN for other cells.

    Args:
        has_unit: Whether the unit of depths is stated elsewhere: then one behind a depth may contradict it.
        progress: Takes the share of the rows that has been read.
        is_whole: Whether each row must have as many fields as the header.
        joined: Takes the number of lines that quoted cells took in.

    Raises:
        TableError: if a hemisphere is not clear, or what separates the digits of a length, or a row lacks fields.
    """
    parts: dict[str, list[NDArray[np.str_] | Array]] = {role: [] for role in columns}
    read, lines = 0, text.count("\n") + 1
    for piece in columns_of(text, dialect, [c.number for c in columns.values()], path if is_whole else None, joined):
        for (role, column), cells in zip(columns.items(), piece, strict=True):
            unit_is_stated = has_unit or bool(column.unit.strip("- "))
            is_text = role.startswith(TEXT_ROLES)
            parts[role].append(
                np.array(cells) if is_text else _values_of(path, role, cells, dialect.decimal_comma, unit_is_stated)
            )
        read += len(piece[0])
        progress(min(read / lines, 1.0))
    return {role: np.concatenate(arrays) if arrays else np.empty(0) for role, arrays in parts.items()}


def _values_of(path: Path, role: str, cells: Sequence[str], decimal_comma: bool, has_unit: bool) -> Array:
    """Numbers of cells; angles may have hemispheres, minutes and seconds, depths "m" behind them."""
    numbers = numbers_of(cells, decimal_comma)
    if role in DEPTHS and not has_unit and np.isnan(numbers).any():
        cells = [_METRES.sub("", cell) for cell in cells]
        numbers = numbers_of(cells, decimal_comma)
    if role.startswith(_LENGTHS) and (unclear := first_unclear(cells, decimal_comma)):
        raise TableError(
            f"{path}: it is unclear what separates thousands or decimals in {unclear!r}, because other numbers have a "
            f"decimal {'comma' if decimal_comma else 'point'}. Write numbers without separated thousands."
        )
    if role in ("lat", "lon", "x", "y"):
        for i in np.flatnonzero(~np.isfinite(numbers)).tolist():
            numbers[i] = angle(cells[i].replace(",", ".") if decimal_comma else cells[i], path)
    return numbers
