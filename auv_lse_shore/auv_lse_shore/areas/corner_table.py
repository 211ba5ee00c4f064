"""A table of an area's corners: latitude and longitude of each, in the notations that tables of soundings may have."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_shore.areas.features import Feature, ring_of
from auv_lse_shore.survey_import.parsing import table_values as tv
from auv_lse_shore.survey_import.parsing.angles import degrees_of
from auv_lse_shore.survey_import.parsing.column_names import Column, named_columns
from auv_lse_shore.survey_import.parsing.columns import DEPTHS
from auv_lse_shore.survey_import.parsing.dialect import Dialect, columns_of, dialect_of
from auv_lse_shore.survey_import.survey_log import LogError

#: A column whose words are each in this many rows or more, on average, tells several areas apart.
_ROWS_OF_AN_AREA = 3.0


def corner_table_features(text: str, where: str) -> list[Feature] | None:
    """The area of a table, and its columns that are not used; None if it has no columns of latitude and longitude.

    Raises:
        ParameterError: if it is a table of soundings or of several areas, or a corner cannot be read.
    """
    dialect = dialect_of(text)
    columns = {} if dialect is None else named_columns(dialect.header, dialect.units)
    if dialect is None or not {"lat", "lon"} <= columns.keys():
        return None
    if depth := next((columns[role].name for role in DEPTHS if role in columns), ""):
        raise ParameterError(
            f"{where} is a table of soundings (column {depth}). Make an area of it with auv_lse import, or leave that "
            "column out of a table of corners"
        )
    try:
        return list(_features(text, dialect, columns, where))
    except LogError as error:
        raise ParameterError(str(error)) from error


def _features(text: str, dialect: Dialect, columns: dict[str, Column], where: str) -> Iterator[Feature]:
    angles = {role: column for role, column in columns.items() if role.startswith(("lat", "lon"))}
    used = {column.number for column in angles.values()}
    cells = [list[str]() for _ in range(dialect.width)]
    for piece in columns_of(text, dialect, range(dialect.width)):
        for column, part in zip(cells, piece, strict=True):
            column += part
    for number, name in enumerate(dialect.header):
        if number in used:
            continue
        kinds = len({cell.strip() for cell in cells[number]})
        if 1 < kinds <= len(cells[number]) / _ROWS_OF_AN_AREA:
            raise ParameterError(f"{where}: column {name} tells {kinds} areas apart. Give each a file of its own")
        yield Feature(f"column {name}")
    notes: list[str] = []
    values = {
        role: np.array(cells[column.number])
        if role.startswith(tv.TEXT_ROLES)
        else tv.values_of(Path(where), role, cells[column.number], dialect.decimal_comma)
        for role, column in angles.items()
    }
    corners = degrees_of(angles, values, Path(where), notes)
    if unknown := np.flatnonzero(~np.isfinite(corners).all(axis=1)).tolist():
        shown = ", ".join(cells[angles[role].number][unknown[0]].strip() for role in ("lat", "lon"))
        raise ParameterError(f"{where}: corner {unknown[0] + 1} is {shown!r}; write degrees, such as 46.5083, 6.6")
    yield Feature("table of corners", rings=(ring_of(corners[:, ::-1].tolist()),), assumed="; ".join(notes))
