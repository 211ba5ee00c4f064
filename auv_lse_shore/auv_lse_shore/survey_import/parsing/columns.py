"""The columns of a table that are used, by their names or by `--columns`; proposes a cure if some are missing."""

import dataclasses
import itertools
import re
from collections.abc import Container, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support.arrays import Mask
from auv_lse_gp.tables.column_names import DEPTHS, ROLES, Column, column_of, named_columns
from auv_lse_gp.tables.dialect import Dialect, fields_of, is_number, numbers_of, rows_across
from auv_lse_gp.tables.units import ANGLE_UNITS, METRES, OTHER_UNITS, TIME_UNITS, factor_of
from auv_lse_shore.survey_import.parsing.proposal import DEPTH_NAME, proposal
from auv_lse_shore.survey_import.survey_log import LogError


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """The columns of a table that are used: numbers, or text for times and names, shape (n,) each.

    `accounted` collects the roles of columns that are used for others, such as dates for times, or named in a note.
    """

    path: Path
    columns: dict[str, Column]
    values: dict[str, Any]
    decimal_comma: bool
    accounted: set[str] = field(default_factory=set)

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(next(iter(self.values.values())))


#: A line that begins with a name, also after a comment sign, and has no decimals.
_MAYBE_HEADER = re.compile(r"^(?!.*\d[.,]\d)((?:[#%!*]+|//)?)[ \t]*([\"']?[^\W\d][^\r\n\0]{,5000})", re.MULTILINE)
#: A number with at least three decimals, as degrees have.
_DECIMALS = re.compile(r"\d[.,]\d{3,}")
#: A byte of an NMEA 2000 message, and the usual number of bytes.
_BYTE, _FRAME = re.compile("[0-9A-Fa-f]{2}"), 8
#: Frames whose bytes are in one cell, as candump, an iKonvert and Garmin's plotters write them.
_IN_ONE_CELL = re.compile("[0-9A-Fa-f]{8}#(?:[0-9A-Fa-f]{2})*|[!$]PDGY|0x(?:[0-9A-Fa-f]{2}){8,}")
#: Columns of the tables of Deeper sounders, which have no header.
_DEEPER = ["lat", "lon", "depth", "time_ms"]
#: Roles that a table cannot do without.
_PAIRS = (("lat", "lon"), ("north", "east"), ("x", "y"))
#: The smallest depth of a survey is hardly ever more than this share of the largest.
_NEAR_SHARE = 0.5
#: Roles of the parts of a time in columns of their own, besides the day.
DATE_PARTS = ("year", "month", "day_of_year", "hour", "minute", "second")
GPS_TIME = ("gps_week", "of_week")
#: A column of vehicles with more names than this numbers something else.
_MOST_VEHICLES = 20
_ALL_UNITS = {**METRES, **TIME_UNITS, **ANGLE_UNITS}


def other_header(text: str, dialect: Dialect, columns: dict[str, Column]) -> tuple[int, str]:
    """Number and text of a second header with other columns, such as that of a joined table; 0 and "" if there is none.

    It begins with the header's comment sign, if that has one.
    """
    own_sign = None
    for match in _MAYBE_HEADER.finditer(text):
        sign, line = match.groups()
        cells = [cell.strip() for cell in next(fields_of([line], dialect.delimiter), [])]
        if any(map(is_number, cells)):
            continue  # a row of a table without decimals
        is_own = tuple(cells) in (dialect.header, dialect.units)
        own_sign = sign if is_own and own_sign is None else own_sign
        found = named_columns(cells) if sign == own_sign and not is_own else {}
        if is_complete(found) and any(_use(column) != _use(found.get(role)) for role, column in columns.items()):
            return text.count("\n", 0, match.start()) + 1, match[0].strip()
    return 0, ""


def _use(column: Column | None) -> tuple[int, float | str]:
    """A column's number, and its unit as a factor if it is known."""
    if column is None:
        return -1, ""
    known = not column.unit or column.unit in OTHER_UNITS
    return column.number, factor_of(column.unit, _ALL_UNITS) or (1.0 if known else column.unit)


def is_complete(columns: dict[str, Column]) -> bool:
    """Whether there are a position and a depth."""
    has_position = any(a in columns and b in columns for a, b in _PAIRS)
    return has_position and any(role in columns for role in DEPTHS)


def depth_role(columns: Container[str]) -> str:
    """The role of the column that depths are read from; there is one."""
    return next(role for role in DEPTHS if role in columns)


def has_date_parts(columns: Container[str]) -> bool:
    """Whether times are in columns of hours, minutes and so on, or dates in columns of years, months and days."""
    if "second" in columns and "hour" in columns and "minute" not in columns:  # minutes have an unknown name
        return False
    has_parts = "hour" in columns or ("year" in columns and ("month" in columns or "day_of_year" in columns))
    return "datetime" not in columns and has_date(columns) and has_parts


def has_date(columns: Container[str]) -> bool:
    """Whether there is a column of dates or days of the month, or years and days in them."""
    return "date" in columns or ("year" in columns and "day_of_year" in columns)


def unused_columns(header: Sequence[str], columns: dict[str, Column], accounted: Container[str]) -> list[str]:
    """Names of a header's columns that are not used: unknown ones, and further positions, depths, units and dates."""
    position = next(pair for pair in _PAIRS if all(role in columns for role in pair))
    further = {role for pair in _PAIRS for role in pair if role not in position} | {*DEPTHS} - {depth_role(columns)}
    further |= set() if all(role in columns for role in GPS_TIME) else {*GPS_TIME}
    further |= {"altitude", "depth_unit", "epsg", "utm_zone", "hemisphere"} | (
        set() if has_date_parts(columns) else {*DATE_PARTS}
    )
    further |= set() if "datetime" in columns or (has_date_parts(columns) and "hour" in columns) else {"half_day"}
    used = {
        column.number
        for role, column in columns.items()
        if role in accounted or (role not in further and (role in ROLES or role.startswith("datetime")))
    }
    return [name for number, name in enumerate(header) if number not in used and name]


def with_all_names(dialect: Dialect) -> Dialect:
    """The dialect with a name for each column, where the header has fewer than the rows have fields.

    One name may stand for a date and a time, also with AM or a zone, or the numbers of rows may have none, as R writes
    them. A row of names below a title is no row of units.
    """
    header, rows = dialect.header, [row for row in dialect.sample if len(row) == dialect.width]
    if is_complete(named_columns(dialect.units)) and not is_complete(named_columns(header, dialect.units)):
        return with_all_names(dataclasses.replace(dialect, header=dialect.units, units=()))
    missing = dialect.width - len(header)
    if missing not in (1, 2) or not rows:
        return dialect
    guess, numbers = proposal(dialect, rows), numbers_of([row[0].strip('"') for row in rows], dialect.decimal_comma)
    found, shifted = (named_columns(names) for names in (guess, ("", *header)))
    if missing == 1 and (np.diff(numbers) == 1.0).all() and is_complete(found) and is_complete(shifted):
        is_r = _numbers(found, with_depth=False) == _numbers(shifted, with_depth=False)
        return dataclasses.replace(dialect, header=("", *header), units=()) if is_r else dialect
    roles = [column.role if column else "" for column in map(column_of, itertools.count(), header)]
    for number, role in enumerate(roles):
        beside = {*roles[max(number - 1, 0) : number + 2]} & {"date", "datetime"}
        is_one = beside == {role} and roles.count(role) == 1
        if is_one and guess[number : number + 2] == ["date", "time"]:
            names = [header[number], "time"] if role == "date" else ["date", header[number]]
            behind = {row[number + 2].upper() for row in rows} if missing == 2 else set()
            if behind <= {"AM", "PM"}:
                names += ["ampm"] * (missing == 2)
            elif len(behind) == 1 and max(behind).isalpha():  # a zone
                names[1:] = [f"{names[1]} ({max(behind)})", ""]
            else:
                continue
            header = (*header[:number], *names, *header[number + 1 :])
            return dataclasses.replace(dialect, header=header, units=())
    return dialect


def columns_for(path: Path, dialect: Dialect, names: Sequence[str], text: str) -> dict[str, Column]:
    """The columns of a table, by `names` if the user gives them, else by its header.

    Raises:
        LogError: if they do not show positions and depths; with a proposal from their values.
    """
    if len(names) > dialect.width:
        raise LogError(f"--columns names {len(names)} columns, and {path} has {dialect.width}.")
    columns = named_columns(names) if names else named_columns(dialect.header, dialect.units)
    if names and "altitude" in columns:
        columns["above_bottom"] = columns.pop("altitude")
    known = {column.number for column in columns.values()}
    if unknown := [name for i, name in enumerate(names) if name != "-" and i not in known]:
        raise LogError(f"--columns: {unknown[0]} means nothing here; write lat, lon, depth, time, or - to skip one.")
    columns = _vehicle_columns(columns)
    if is_complete(columns):
        if not names:
            _check_names(path, dialect, columns, text)
        return columns
    for angle in ("lat", "lon"):
        part = columns.get(f"{angle}_min") or columns.get(f"{angle}_sec")
        if part is not None and angle not in columns:
            raise LogError(
                f"{path}: column {part.name} holds {'minutes' if part.role.endswith('min') else 'seconds'}, and no "
                f"column the degrees before them. Add them as a column {angle}, or write degrees into this one and "
                f"name it {angle}."
            )
    guess = proposal(dialect, rows_across(text, dialect))
    if not dialect.header and not names and guess == _DEEPER:
        return named_columns(guess)
    if _are_frames(dialect.sample or [dialect.header]):  # a dump of a CAN bus has no cells of numbers
        cure = "These are frames of NMEA 2000: convert them to NMEA 0183, as n2kd of canboat does"
    elif is_complete(named_columns(guess)):
        others = f"{_or_swapped(dialect, guess, text)}{_or_elevations(dialect, guess, text)}{_or_other(dialect, guess)}"
        cure = f"By their values they look like: --columns {','.join(guess)}{others}"
    elif any({*pair} <= {*guess} for pair in _PAIRS):
        cure = (
            f"By their values they look like: --columns {','.join(guess)}; write depth, or elevation with --surface M, "
            "for the column that holds it"
        )
    elif _has_positions(dialect.sample):
        cure = "Latitude and longitude are in one cell: write them into columns lat and lon"
    else:
        cure = "Name them with --columns, such as --columns lat,lon,depth,time, and - for one to skip"
    if dialect.header:
        what = f"has the columns {', '.join(dialect.header)[:200]}; a position or a depth is not among them"
    else:
        what = f"has no header; its first row is {', '.join(dialect.sample[0] if dialect.sample else [])[:120]}"
    raise LogError(f"{path} {what}. {cure}.")


def _are_frames(rows: Sequence[Sequence[str]]) -> bool:
    """Whether most rows hold the bytes of a message, some of them not decimal, as their last cells or in one."""
    of_bytes = [len(row) > _FRAME and all(map(_BYTE.fullmatch, row[-_FRAME:])) for row in rows]
    if all("".join(row[-_FRAME:]).isdecimal() for row in rows):  # such as parts of a date
        of_bytes = []
    in_one = [any(map(_IN_ONE_CELL.fullmatch, row)) for row in rows]
    return 2 * max(sum(of_bytes), sum(in_one)) > len(rows)


def _check_names(path: Path, dialect: Dialect, columns: dict[str, Column], text: str) -> None:
    """Refuses a table separated by blanks in which a name of several words shifts the columns."""
    count = len(dialect.header)
    if dialect.delimiter != " " or count == dialect.width:
        return
    rows = rows_across(text, dialect)
    unit = columns[depth_role(columns)].unit
    guess = [f"{name}_{unit}" if name == "depth" and unit in METRES else name for name in proposal(dialect, rows)]
    widest = max(map(len, rows), default=0)
    found, pairs = named_columns(guess), itertools.pairwise(dialect.header)
    if count < dialect.width:
        is_shifted = "date" not in columns and ("date", "time") in itertools.pairwise(guess)
        whole = [row for row in rows if len(row) == dialect.width]
        words = [i for i, name in enumerate(guess) if name == "-" and all(row[i].isalpha() for row in whole)]
        is_shifted |= any(i < columns[depth_role(columns)].number for i in words)  # as of "run 1"
    else:
        is_joined = any(not column_of(0, a) and column_of(0, a + b) for a, b in pairs)
        is_shifted = count > widest and (is_joined or any(column.number >= widest for column in columns.values()))
    if is_shifted and is_complete(found) and _numbers(found) != _numbers(columns):
        raise LogError(
            f"{path} has {count} names in its header and {dialect.width} fields in its rows. By their values they look "
            f"like: --columns {','.join(guess)}."
        )


def _numbers(columns: dict[str, Column], with_depth: bool = True) -> set[int]:
    """The indices of the columns of positions and depths, or of positions alone."""
    position = next(pair for pair in _PAIRS if all(role in columns for role in pair))
    return {columns[role].number for role in (*position, *[depth_role(columns)] * with_depth)}


def _or_swapped(dialect: Dialect, guess: list[str], text: str) -> str:
    """The other order of latitude and longitude, if there is no header and the values allow both."""
    if dialect.header or not {"lat", "lon"} <= {*guess}:
        return ""
    rows = [row for row in rows_across(text, dialect) if len(row) == dialect.width]
    angles = [numbers_of([row[guess.index(name)] for row in rows], dialect.decimal_comma) for name in ("lat", "lon")]
    if max(np.nanmax(np.abs(angle)) for angle in angles) > 90.0:
        return ""
    swap = {"lat": "lon", "lon": "lat"}
    return f", or {','.join(swap.get(name, name) for name in guess)} if longitude comes first"


def _or_other(dialect: Dialect, guess: list[str]) -> str:
    """The other columns whose names are those of depths."""
    titles = zip(dialect.header, guess, strict=False)
    others = [title for title, name in titles if name == "-" and DEPTH_NAME.search(title)]
    return f"; depths are perhaps those of {' or '.join(others)} instead" if others else ""


def _or_elevations(dialect: Dialect, guess: list[str], text: str) -> str:
    """How to name elevations, if values that can be depths do not come near 0."""
    number = next((i for i, name in enumerate(guess) if column_of(i, name) and name.startswith("depth")), None)
    if number is None:
        return ""
    rows = [row for row in rows_across(text, dialect) if len(row) == dialect.width]
    known = numbers_of([row[number] for row in rows], dialect.decimal_comma)
    known = known[np.isfinite(known)]
    least, most = np.quantile(known, (0.01, 0.99)) if len(known) else (0.0, 0.0)
    if least <= _NEAR_SHARE * most:
        return ""
    return (
        f"; if {least:.1f} to {most:.1f} are elevations, write {guess[number].replace('depth', 'elevation')}, and give "
        "that of the water surface with --surface M"
    )


def _has_positions(rows: Sequence[Sequence[str]]) -> bool:
    """Whether a column has latitude and longitude in one cell."""
    cells = [[cell for cell in row if len(_DECIMALS.findall(cell)) == 2] for row in rows]
    return 2 * sum(1 for row in cells if len(row) == 1) > len(rows)


def _vehicle_columns(columns: dict[str, Column]) -> dict[str, Column]:
    """Renames the columns of a vehicle's own depth and its height above the bottom to `depth` and `above_bottom`.

    A height above the bottom counts only with a column of the vehicle's own depth, whose name may be just depth. Then
    an altitude may be such a height, too.
    """
    own, depth = columns.pop("own_depth", None), columns.get("depth")
    if own is not None and not {*DEPTHS} & columns.keys():
        above = columns.get("above_bottom") or columns.pop("altitude", None)
        return columns if above is None else {**columns, "depth": own, "above_bottom": above}
    if depth is None or ROLES["depth"][depth.rank] != "depth":
        columns.pop("above_bottom", None)
        columns.pop("altitude", None)
    return columns


def first_of(texts: Sequence[str] | NDArray[np.str_]) -> str:
    """The first text that is not blank, shortened for a message; "" without one."""
    return next((str(text)[:20] for text in texts if text.strip()), "")


def vehicles_of(table: Table) -> list[tuple[str, Mask]]:
    """Each vehicle of a table: the suffix of its log's name, and the mask of its rows."""
    vehicles = table.values.get("vehicle")
    names = [] if vehicles is None else np.unique(vehicles).tolist()
    if not 1 < len(names) <= _MOST_VEHICLES:
        return [("", np.ones(table.count, dtype=bool))]
    return [(f", vehicle {name}", vehicles == name) for name in names]
