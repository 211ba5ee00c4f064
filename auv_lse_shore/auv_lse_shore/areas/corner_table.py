"""A table of an area's corners: latitude and longitude of each, in the notations of all tables."""

import dataclasses
import re
from pathlib import Path

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.plurals import counted
from auv_lse_gp.tables.column_names import ANGLES, DEPTHS, Column
from auv_lse_gp.tables.dialect import columns_of, is_number
from auv_lse_gp.tables.table_error import TableError
from auv_lse_gp.tables.whole_table import WholeTable, whole_table
from auv_lse_shore.areas.features import Feature, ring_of

#: Angles with their hemispheres, such as 46°30'N.
_SIDED = {role: rf"(?i)[{side}]\s*\d.*|.*\d\W*[dms]?\W*[{side}]" for role, side in (("lat", "NS"), ("lon", "EW"))}
#: A column whose words are each in this many rows or more, on average, tells several areas apart.
_ROWS_OF_AN_AREA = 3.0


def corner_table_features(path: Path) -> list[Feature]:
    """The area of a table, and its columns that are not used; [] if it has no latitudes and longitudes.

    Raises:
        ParameterError: if it is a table of soundings or of several areas, has no header, or a corner cannot be read.
    """
    try:
        table = whole_table(path)
    except TableError:
        return []
    columns = {role: column for role, column in table.columns.items() if role in ANGLES} or _by_hemispheres(table)
    if not {"lat", "lon"} <= columns.keys():
        rows = table.dialect.sample
        if not table.dialect.header and len(rows[0]) > 1 and all(is_number(cell) for row in rows for cell in row):
            raise ParameterError(
                f"{path} has rows of numbers, such as {' '.join(rows[0])[:60]}, and no header. Write the names of its "
                "columns above them, as lat,lon or lon,lat"
            )
        return []
    if depth := next((table.columns[role].name for role in DEPTHS if role in table.columns), ""):
        raise ParameterError(
            f"{path} is a table of soundings (column {depth}). Make an area of it with auv_lse import, or leave that "
            "column out of a table of corners"
        )
    if table.count < 3:
        raise ParameterError(f"{path} has {counted(table.count, 'corner')}. Write at least three, in order")
    features, notes, used = list[Feature](), list[str](), {column.number for column in columns.values()}
    for number, name in enumerate(table.dialect.header):
        words = [cell for piece in columns_of(table.text, table.dialect, [number]) for cell in piece[0]]
        if number not in used and 1 < len({*words}) <= len(words) / _ROWS_OF_AN_AREA:
            raise ParameterError(
                f"{path}: column {name} tells {len({*words})} areas apart. Give each a file of its own"
            )
        if number not in used:
            features.append(Feature(f"column {name}"))
    try:
        table = dataclasses.replace(table, columns=columns)
        corners = table.degrees(table.read([*columns]), notes)
    except TableError as error:
        raise ParameterError(str(error)) from error
    return [
        Feature("table of corners", rings=(ring_of(corners[:, ::-1].tolist()),), assumed="; ".join(notes)),
        *features,
    ]


def _by_hemispheres(table: WholeTable) -> dict[str, Column]:
    """Latitude and longitude of two columns without a header, if every cell has its hemisphere; else {}."""
    rows = table.dialect.sample
    for order in (("lat", "lon"), ("lon", "lat")) if not table.dialect.header and len(rows) == table.count else ():
        if all(
            len(row) == 2 and all(re.fullmatch(_SIDED[r], cell) for r, cell in zip(order, row, strict=True))
            for row in rows
        ):
            return {role: Column(number, role, "", role, 0) for number, role in enumerate(order)}
    return {}
