"""Reads tables of soundings (CSV).

A table has a header and rows, in any notation that `auv_lse import` understands: comma, semicolon, tab or blanks
between fields, decimal commas, degrees with minutes and seconds, hemispheres, units in the header or in a column of
units. Lines that begin with # are comments. Positions are in metres (north_m, east_m, or northing, easting), in degrees
(lat, lon), or both. Depths are positive down, elevations and z_m positive up. Each row counts; columns that are not
read are listed.
"""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_common.support.plurals import counted
from auv_lse_gp.no_data import fill_values, is_no_data
from auv_lse_gp.tables.column_names import ANGLES, DEPTHS, Column, named_columns
from auv_lse_gp.tables.dialect import Dialect
from auv_lse_gp.tables.table_error import TableError
from auv_lse_gp.tables.units import stated_units, unit_column
from auv_lse_gp.tables.whole_table import WholeTable, whole_table

#: Names of x and y in a comment above XYZ text, and the roles of its columns, whose numbers are never angles.
_PAIRS = (("lon", "lat"), ("east", "north"), ("x", "y"))
_XYZ = ("east", "north", "z")
_NEEDED_COLUMNS = (
    "east_m,north_m,depth_m (or easting, northing) or lat,lon,depth_m (elevation_m instead of depth_m for values that "
    "are positive up)"
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SoundingsTable:
    """The columns of a table of soundings; depths are converted to metres. All arrays have shape (n,).

    Attributes:
        file: The table, which names the line of a row.
        depth_name: Name of the column of depths or elevations.
        upward: Whether the values are elevations, positive up; None: unknown.
        values: Depths or elevations (m).
        north_m, east_m: Positions (m), if the table has them; of XYZ text perhaps latitudes and longitudes.
        lat_deg, lon_deg: Positions (WGS84), if the table has them.
        is_xyz: Whether it is XYZ text, in which missing values are NaN.
        notes: What was not read, and in which notation the rest is.
    """

    file: WholeTable
    depth_name: str
    upward: bool | None
    values: Array
    north_m: Array | None = None
    east_m: Array | None = None
    lat_deg: Array | None = None
    lon_deg: Array | None = None
    is_xyz: bool = False
    notes: tuple[str, ...] = ()


def read_table(path: Path, may_be_xyz: bool = False) -> SoundingsTable:
    """Reads a table of soundings, or XYZ text: x, y and a value on each line, mostly without a header.

    Raises:
        OSError: if the file cannot be read.
        TableError: naming the file, the line, what was found and what was expected.
    """
    table = whole_table(path)
    if may_be_xyz and (xyz := _xyz_columns(table.dialect)):
        table, column = dataclasses.replace(table, columns=xyz), xyz["z"]
        values = table.read(_XYZ, may_be_nan="z")
        values["z"][is_no_data(values["z"])] = np.nan
        return SoundingsTable(
            file=table,
            depth_name=column.name,
            upward={"depth": False, "elevation": True}.get(column.role),
            values=table.metres("z", values),
            north_m=values["north"],
            east_m=values["east"],
            is_xyz=True,
            notes=tuple(table.unused(values)),
        )
    return _soundings(table)


def _xyz_columns(dialect: Dialect) -> dict[str, Column]:
    """The columns east, north and z of XYZ text, {} of another table; a comment may name them in another order."""
    names = named_columns(dialect.header, dialect.units)
    x, y = next((pair for pair in _PAIRS if {*pair} <= names.keys()), ("", ""))
    if dialect.above:
        depth = next((role for role in DEPTHS if role in names), "")
        is_plain = x == "x" and depth and not names[x].unit
        return {"east": names[x], "north": names[y], "z": names[depth]} if is_plain else {}
    if dialect.width != 3:
        return {}
    numbers = [names[x].number, names[y].number] if x else [0, 1]
    numbers += {0, 1, 2}.difference(numbers)
    by_number = {column.number: column for column in names.values()} if x else {}
    unnamed = Column(-1, "z", "", "the third column", 0)
    return {r: by_number.get(i, unnamed._replace(number=i)) for r, i in zip(_XYZ, numbers, strict=True)}


def _soundings(table: WholeTable) -> SoundingsTable:
    columns = table.columns
    degrees = [role for role in ANGLES if role in columns and {"lat", "lon"} <= columns.keys()]
    metres = next((pair for pair in (("north", "east"), ("y", "x")) if _has_metres(table, pair)), ())
    depth = next((role for role in DEPTHS if role in columns and (role != "z" or columns[role].unit)), "")
    if not depth or not (metres or degrees):
        shown = ", ".join(name[:40] for name in table.dialect.header[:30])
        what = f"the columns {shown} are not enough" if shown else "there is no header"
        raise TableError(
            f"{table.where(-1) if table.dialect.above else table.path}: {what}; needed are {_NEEDED_COLUMNS}. auv_lse "
            "import makes such a table of many others"
        )
    units = [] if columns[depth].unit.strip("- ") else [role for role in columns if role.startswith("depth_unit")]
    read = [*degrees, *metres, depth, *units]
    values, notes = table.read(read), list[str]()
    is_marked = is_no_data(values[depth])
    is_marked |= np.isin(values[depth], fill_values(values[depth][~is_marked]))
    marks = f"This is a common mark for missing data, as on {is_marked.sum():,} of {counted(table.count, 'line')}"
    table.check(~is_marked, depth, f"{marks}. Remove these lines")
    depth_m, by = _depths(table, depth, units, values)
    positions: dict[str, Any] = {}
    if degrees:
        positions["lat_deg"], positions["lon_deg"] = table.degrees(values, notes).T
    if metres:
        positions["north_m"], positions["east_m"] = (table.metres(role, values) for role in metres)
    return SoundingsTable(
        file=table,
        depth_name=columns[depth].name,
        upward=depth != "depth",
        values=depth_m,
        notes=(*notes, *table.unused((*degrees, *metres, depth, *by))),
        **positions,
    )


def _has_metres(table: WholeTable, pair: tuple[str, str]) -> bool:
    """Whether there are columns of lengths; x and y without a unit may be degrees."""
    found = [table.columns[role] for role in pair if role in table.columns]
    return len(found) == 2 and (pair[0] == "north" or all(column.unit for column in found))


def _depths(table: WholeTable, role: str, units: list[str], values: dict[str, Any]) -> tuple[Array, list[str]]:
    """Depths (m), and the role of the column of units that counts, if any."""
    depth, by_number = table.columns[role], {table.columns[unit].number: unit for unit in units}
    names = {number: table.columns[unit].name for number, unit in by_number.items()}
    plain = {table.columns[other].number for other in values if other not in (role, *units)}
    column = unit_column(names, depth.number, plain)
    stated = None if column is None else stated_units(values[by_number[column.number]], column)
    if column is None or stated is None:
        return table.metres(role, values), []
    unit = by_number[column.number]
    table.check(~np.isnan(stated), unit, "Write a unit of length, or convert the depths to metres (depth_m)")
    if not column.is_clear and (stated != 1.0).any():
        raise TableError(
            f"{table.path}: the column {names[column.number]}, with {values[unit][stated != 1.0][0][:20]!r}, may state "
            f"the unit of another column than {depth.name}. Convert the depths to metres, and name their column depth_m"
        )
    return values[role] * stated, [unit]
