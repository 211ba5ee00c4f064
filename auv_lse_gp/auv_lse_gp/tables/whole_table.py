"""Tables in which every row counts: it is read, or the error names its line."""

import dataclasses
import io
from collections.abc import Container, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.support.input_bounds import MAX_SOUNDINGS, MAX_TEXT_BYTES, over_size
from auv_lse_common.support.plurals import counted, listed
from auv_lse_common.support.text import decoded, encoding_of, is_text
from auv_lse_gp.tables.angles import PACKED, degrees_of
from auv_lse_gp.tables.column_names import Column, named_columns
from auv_lse_gp.tables.dialect import (
    LONGEST,
    Dialect,
    columns_of,
    dialect_of,
    fields_of,
    line_of,
    may_hold_values,
    open_quote,
)
from auv_lse_gp.tables.table_error import TableError
from auv_lse_gp.tables.units import factor_of
from auv_lse_gp.tables.values import SAMPLE_LETTERS, TEXT_ROLES, read_values

#: Columns of this project's own tables for other programs.
_OF_EXPORT = (
    "", "time_s", "vehicle", "east_std_m", "north_std_m", "thu_m", "tvu_m", "s44_order", "latitude_deg",
    "longitude_deg", "vertical_datum",
)  # fmt: skip
#: The most columns that are listed as not used.
_MOST_LISTED = 8
#: Letters of hemispheres in the columns of these roles.
_SIDES = {"lat_side": ("N", "S"), "lon_side": ("E", "W", "O")}


@dataclass(frozen=True, slots=True)
class WholeTable:
    """A table, of which every row has to be understood.

    Attributes:
        columns: The columns whose names are understood, by role.
        count: Number of its rows.
        comments: Numbers of the lines that begin with another sign of comments than #.
    """

    path: Path
    text: str
    dialect: Dialect
    columns: dict[str, Column]
    count: int
    comments: list[int]

    def read(self, roles: Sequence[str], may_be_nan: str = "") -> dict[str, Any]:
        """The values of columns by role, (n,) each, texts of `TEXT_ROLES`.

        Raises:
            TableError: naming the first line with other fields, or with a cell that is not a finite number.
        """
        columns = {role: self.columns[role] for role in roles}
        has_unit = any(role.startswith("depth_unit") for role in roles)
        values = read_values(self.path, self.text, self.dialect, columns, has_unit, is_whole=True)
        if len(values[roles[0]]) != self.count:
            number = open_quote(self.text)
            raise TableError(f"{self.path}:{number}: a quoted cell continues in the next line. Remove the quotes")
        for role in roles:
            if role in _SIDES:
                sides = np.char.upper(np.char.strip(values[role]).astype("U1"))
                self.check(np.isin(sides, _SIDES[role]), role, "Write N, S, E or W")
            elif not role.startswith(TEXT_ROLES):
                is_good = np.isfinite(values[role])
                if role == may_be_nan and not is_good.all():
                    pieces = columns_of(self.text, self.dialect, [self.columns[role].number])
                    cells = np.concatenate([np.char.lower(np.char.strip(cells)) for (cells,) in pieces])
                    is_good |= np.isin(cells, ("nan", "-nan", "+nan"))
                more = int((~is_good).sum()) - 1
                others = f" and the {counted(more, 'other')} without one" if more > 0 else ""
                self.check(is_good, role, f"Write a finite number, or remove this line{others}")
        return values

    def unused(self, read: Container[str]) -> list[str]:
        """Notes on columns that were not read, apart from those of this project's exports, and on unusual comments."""
        used = {column.number for role, column in self.columns.items() if role in read}
        names = [n for i, n in enumerate(self.dialect.header) if i not in used and n.lower() not in _OF_EXPORT]
        notes = [f"columns not used: {listed([name[:40] for name in names], _MOST_LISTED)}"] * bool(names)
        if self.comments:
            notes.append(f"{counted(len(self.comments), 'line')} taken as comments, such as line {self.comments[0]}")
        return notes

    def degrees(self, values: dict[str, Any], notes: list[str]) -> Array:
        """Latitude and longitude (deg), shape (n, 2), of values that were read; their notation goes into `notes`.

        Raises:
            TableError: naming the first line that has none.
        """
        positions = degrees_of(self.columns, values, self.path, notes)
        raw = np.abs(np.column_stack([values["lat"], values["lon"]]))
        is_packed = any(PACKED.fullmatch(self.columns[role].unit) for role in ("lat", "lon"))
        # one of them may be degrees and minutes in one number, the other plain degrees
        doubtful = (raw > (90.0, 360.0)).any(axis=1) & (raw < 100.0).any(axis=1) & (not is_packed)
        for number, (role, most) in enumerate((("lat", 90.0), ("lon", 360.0))):
            is_good = (np.abs(positions[:, number]) <= most) & ~(doubtful & (raw[:, number] > most))
            self.check(is_good, role, "Write degrees")
        return positions

    def metres(self, role: str, values: dict[str, Any]) -> Array:
        """Lengths (m), shape (n,), of a column that was read.

        Raises:
            TableError: if its unit is not understood.
        """
        column = self.columns[role]
        factor = factor_of(column.unit) if column.unit.strip("- ") else 1.0
        if not factor:
            raise TableError(
                f"{self.path}: column {column.name} is in {column.unit!r}, which is no unit of length. Convert it to "
                "metres, and write (m) behind its name"
            )
        return np.asarray(values[role] * factor)

    def check(self, is_good: Mask, role: str, cure: str) -> None:
        """Raises TableError for the first row (n,) that is not good, showing its line and its cell."""
        for row in np.flatnonzero(~is_good)[:1].tolist():
            number, line = line_of(self.text, self.dialect, row)
            column, cells = self.columns[role], next(fields_of([line.rstrip("\r\n")], self.dialect.delimiter))
            raise TableError(f"{self.path}:{number}: {column.name} is {cells[column.number].strip()[:40]!r}. {cure}.")

    def where(self, row: int) -> str:
        """The file and the line of a row."""
        return f"{self.path}:{line_of(self.text, self.dialect, row)[0]}"


def whole_table(path: Path) -> WholeTable:
    """The table in a text file.

    Raises:
        TableError: if it is not text, has no columns or no rows, too many of them, or a line that is longer than any of
            a table.
        OSError: if it cannot be read.
    """
    if too_large := over_size(path, MAX_TEXT_BYTES):
        raise TableError(f"{too_large}. Thin it out, or make a grid of it (.npz, .asc, .tif)")
    data = path.read_bytes()
    head = data[:SAMPLE_LETTERS]
    if encoding_of(head) == "utf-8":
        head = head.replace(b"\0", b"")  # of a damaged disk
    if head.strip() and not is_text(head):
        raise TableError(f"{path} is not text. Save the table as CSV; auv_lse import reads logs")
    text = decoded(data).replace("\u2212", "-")  # a typographic minus
    lines, comments = 0, list[int]()
    for number, line in enumerate(io.StringIO(text, newline=None), 1):
        if len(line) > LONGEST:
            raise TableError(
                f"{path}:{number}: {line[:60]!r}... cannot be read as a row: it has more than {LONGEST:,} characters. "
                "Check the line"
            )
        if line[0].isdigit() or may_hold_values(line):
            lines += 1
        elif line.strip(",;|\t \r\n") and not line.lstrip().startswith(("#", "sep=")):
            comments.append(number)
    if lines > MAX_SOUNDINGS + 1:
        raise TableError(
            f"{path} has {lines:,} lines, more than {MAX_SOUNDINGS:,}. Thin it out, or make a grid of it (.npz, .asc, "
            ".tif)"
        )
    dialect = dialect_of(text[:SAMPLE_LETTERS])
    if dialect is None or lines == dialect.above:
        raise TableError(
            f"{path} has {counted(lines, 'line')}{' without columns' if lines > 1 else ''}; write a header, then "
            "rows of numbers"
        )
    dialect = dataclasses.replace(dialect, first=dialect.above)
    columns = named_columns(dialect.header, dialect.units)
    return WholeTable(path, text, dialect, columns, lines - dialect.above, comments)
