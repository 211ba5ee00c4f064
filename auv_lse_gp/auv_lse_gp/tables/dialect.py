"""The dialect of a table: its delimiter, decimal sign, comments, header and units."""

import csv
import io
import itertools
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_common.support.plurals import counted
from auv_lse_gp.tables.table_error import TableError

#: Lines from which the dialect is found.
SAMPLE = 200
#: Largest number of rows from the whole table.
_ROWS_ACROSS = 2000
_DELIMITERS = (",", ";", "\t", "|", " ")
#: Signs of comments; numbers behind a star are a row that is marked.
_COMMENT = re.compile(r"#+|//|%+|!|'|;;|\*+(?!\s*[-+.]?\d)")
#: A name with units in brackets behind it.
_BRACKETED = re.compile(r"\S[^\s(\[{]*(?:\s*[(\[{][^)\]}]*[)\]}])*")
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")
_DECIMAL_COMMA = re.compile(r"[+-]?[^,]*\d,\d+$")
#: A number whose thousands are separated.
_THOUSANDS = re.compile(r"([+-]?\d{1,3})(([.,'’\xa0\u2009\u202f])\d{3}(?:\3\d{3})*)([.,]\d*)?$")
#: Numbers that may have separated thousands or three decimals, in tables with a decimal point and a decimal comma.
_EITHER = {False: re.compile(r"[+-]?[1-9]\d{0,2},\d{3}"), True: re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}")}
_MARK = re.compile(r"[+-]?\d[\d:/.T+-]*Z?$")
#: Cells of words: a date with its time, a time with AM or a zone, an angle, its minutes, a number with its unit.
_OF_WORDS = re.compile(
    r"(\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}[-/ .]{1,2}[^\W\d]{3,9}[-/ .,]{1,2}\d{2,4})"
    r" \d{1,2}:[\d:.,]+( [A-Za-z.]{2,5}){0,2}"
    r"|\d{1,2}:\d{2}[\d:.]* [A-Za-z.]{2,5}"
    r"|(?=.*[NSEW°º'])[NSEW]? ?\d{1,3}[°º]?([- ]? ?\d[\d.]*['′]?){0,2}[\"″]? ?[NSEW]?"
    r"|[+-]?\d{1,3}( [0-5]?\d){1,2}\.\d+"
    r"|[+-]?\d[\d.]* [^\W\d]{1,9}"
)
#: Rows that are converted at once: few, because Python searches many small lists for cycles again and again.
_ROWS = 2_000
#: Letters of the longest unit in a row of units, such as degrees_north.
_LONGEST_UNIT = 16
#: The longest line of a table.
LONGEST = 20_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """The dialect of a table.

    Attributes:
        delimiter: Sign between fields; " " stands for any blanks.
        decimal_comma: Whether numbers are written 12,5.
        header: Names of the columns; () if there is no header.
        units: Units of the columns from a row of their own; () if there is none.
        above: Number of rows that are no comments up to the header and its units.
        first: Number of the first row of values among those rows.
        width: Usual number of fields.
        sample: The first rows of values.
    """

    delimiter: str
    decimal_comma: bool
    header: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    above: int = 0
    first: int = 0
    width: int = 0
    sample: list[list[str]] = field(default_factory=list)


def lines_of(text: str) -> Iterator[str]:
    """The lines that may hold values."""
    lines = io.StringIO(text, newline=None)
    while piece := list(itertools.islice(lines, _ROWS)):
        # a quoted field that continues in the next line stays one cell
        yield from [
            line.rstrip("\n") for line in piece if (line[0].isdigit() or may_hold_values(line)) and len(line) <= LONGEST
        ]


def may_hold_values(line: str) -> bool:
    """Whether a line is neither blank, as an empty row of a spreadsheet is, nor a comment."""
    bare = line.strip()
    return bool(bare.strip(",;\t|")) and not _COMMENT.match(bare) and bare[:4] != "sep="


def fields_of(lines: Iterator[str] | Sequence[str], delimiter: str) -> Iterator[list[str]]:
    """The fields of each line, without blanks around them."""
    if delimiter == " ":
        return (line.split() for line in lines)
    return csv.reader(lines, delimiter=delimiter, skipinitialspace=True)


def is_number(text: str) -> bool:
    """Whether a field is a number, with a decimal point or comma."""
    return bool(_NUMBER.match(_joined(text.strip())))


def dialect_of(text: str) -> Dialect | None:
    """The dialect of a table; None if no delimiter makes columns."""
    sample = list(itertools.islice(lines_of(text), SAMPLE))
    best, most = None, 0.0
    for delimiter in _DELIMITERS:
        try:
            rows = [[cell.strip() for cell in row] for row in fields_of(sample, delimiter)]
        except csv.Error:
            continue
        score = _score(rows)
        # a cell of words is one without a number, and several of them between blanks: only commas are parts of numbers
        other = best[0] if best and delimiter == " " else ""
        if score > most * {"": 1.0, ",": 1.25}.get(other, 1.7):
            best, most = (delimiter, rows), score
    if best is None:
        return None
    comments = itertools.takewhile(lambda line: not may_hold_values(line), io.StringIO(text, newline=None))
    found = [_COMMENT.match(line.strip()) for line in itertools.islice(comments, SAMPLE)]
    behind = [match.string[match.end() :].strip() for match in found if match]
    return _with_header(*best, [[cell.strip() for cell in row] for row in fields_of(behind, best[0])])


def _values_in(cells: list[str]) -> int:
    """Number of cells that are numbers, angles, dates or times."""
    return sum(1 for cell in cells if _MARK.match(cell) or is_number(cell) or _OF_WORDS.fullmatch(cell))


def _score(rows: list[list[str]]) -> float:
    """Score of a table's rows as columns of numbers, dates and times; the highest is the best."""
    widths = Counter(len(row) for row in rows)
    width = max((w for w in widths if w > 1), key=lambda w: widths[w], default=0)
    if width < 2:
        return 0.0
    usual = [row for row in rows if len(row) == width]
    cells = [cell for row in usual for cell in row]
    good = _values_in(cells) + 0.5 * sum(1 for cell in cells if not cell)
    return (0.05 + good / len(cells)) * len(usual) / len(rows)


def _with_header(delimiter: str, rows: list[list[str]], comments: list[list[str]]) -> Dialect:
    """The dialect with the header and the row of units, which come before the first row of values.

    Without a header, the last comment above the rows that has as many names as they have fields is one.
    """
    widths = Counter(len(row) for row in rows)
    width = max((w for w in widths if w > 1), key=lambda w: widths[w])

    usual = float(np.median([_values_in(row) for row in rows if len(row) == width]))
    first = next(
        (i for i, row in enumerate(rows) if len(row) == width and _values_in(row) >= 0.5 * max(usual, 1.0)), None
    )
    values = rows[first:] if first is not None else []

    def without_blanks(row: list[str]) -> list[str]:
        below = zip(row, *values[:1], strict=False)
        has_units = any(
            name.startswith(("(", "[", "{")) and any(map(str.isdigit, *cell)) for name, *cell in below if cell
        )
        return _BRACKETED.findall(" ".join(row)) if delimiter == " " and (len(row) > width or has_units) else row

    before = rows[: len(rows) if first is None else first]
    named = [i for i, row in enumerate(before) if len([cell for cell in row if cell and not is_number(cell)]) >= 2]
    names = [before[i] for i in named]
    header: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    if len(names) > 1 and len(names[-2]) == len(names[-1]) and max(map(len, names[-1])) <= _LONGEST_UNIT:
        header, units = tuple(names[-2]), tuple(names[-1])
    elif names:
        header = tuple(names[-1])
    elif names := [row for row in map(without_blanks, comments) if len(row) == width and not any(map(is_number, row))]:
        has_units = len(names) > 1 and len(set(names[-1])) < width  # such as deg, deg, m
        header, units = tuple(names[-1 - has_units]), tuple(names[-1]) if has_units else ()
    header = tuple(_with_whole_brackets(without_blanks([*header]), delimiter, width))
    cells = [cell for row in values for cell in row]
    commas = sum(1 for cell in cells if _DECIMAL_COMMA.match(cell) and is_number(cell))
    points = sum(1 for cell in cells if cell.count(".") == 1 and cell.rfind(",") < cell.find(".") and is_number(cell))
    return Dialect(
        delimiter=delimiter,
        decimal_comma=commas > points,
        header=header,
        units=units,
        above=named[-1] + 1 if named else 0,
        first=len(rows) if first is None else first,
        width=width,
        sample=values,
    )


def _with_whole_brackets(names: list[str], delimiter: str, width: int) -> list[str]:
    """The names of more columns than rows have, with those put together between which a bracket is open."""
    joined = list[str]()
    for number, name in enumerate(names):
        left = len(joined) + len(names) - number  # names if no more are put together
        if left > width and joined and sum(map(joined[-1].count, "([{")) > sum(map(joined[-1].count, ")]}")):
            joined[-1] += f"{delimiter} {name}"
        else:
            joined.append(name)
    return joined


def rows_across(text: str, dialect: Dialect) -> list[list[str]]:
    """Rows of values from the whole table: its beginning may be without positions."""
    step = max(len(text) // _ROWS_ACROSS, 1)
    starts = sorted({text.find("\n", at) + 1 for at in range(0, len(text), step)} - {0})
    lines = [text[start : start + LONGEST].split("\n", 1)[0] for start in starts]
    lines = [line for line in lines if may_hold_values(line)]
    try:
        return [[cell.strip() for cell in row] for row in fields_of(lines, dialect.delimiter)]
    except csv.Error:
        return dialect.sample


def columns_of(
    text: str, dialect: Dialect, wanted: Sequence[int], whole: Path | None = None, joined: list[int] | None = None
) -> Iterator[list[list[str]]]:
    """The texts of the wanted columns, some thousand rows at once; missing fields are empty.

    Args:
        whole: The path of a table in which each row has as many fields as the header.
        joined: Takes the number of lines that quoted cells took in.

    Raises:
        TableError: naming the first line of a whole table that has other fields.
    """
    rows = fields_of(lines_of(text), dialect.delimiter)
    for _ in itertools.islice(rows, dialect.first):  # an islice of all would end at the first error
        pass
    before = getattr(rows, "line_num", 0)
    width, all_fields, read = max(wanted) + 1, len(dialect.header) or dialect.width, 0
    while True:
        piece: list[list[str]] = []
        try:
            piece.extend(itertools.islice(rows, _ROWS))
        except csv.Error as error:  # a quote that is not closed: the lines within it are lost
            if whole:
                raise TableError(f"{whole}: {error}. Check its quotes") from error
            if not piece:
                continue
        if not piece:
            if joined is not None and dialect.delimiter != " ":
                joined.append(getattr(rows, "line_num", 0) - before - read)
            return
        if whole and {*map(len, piece)} != {all_fields}:
            for row, found in enumerate(piece):
                if len(found) < all_fields or any(found[all_fields:]):
                    number, line = line_of(text, dialect, read + row)
                    raise TableError(
                        f"{whole}:{number}: {counted(len(found), 'field')} {line.strip()[:60]!r}, but "
                        f"{'the header' if dialect.header else 'the first row'} has {all_fields}"
                    )
        read += len(piece)
        if min(map(len, piece)) < width:
            piece = [row + [""] * (width - len(row)) for row in piece]
        columns = list(zip(*piece, strict=False))
        yield [list(columns[i]) for i in wanted]


def long_lines(text: str) -> list[int]:
    """Numbers of the lines that are longer than any of a table, and are left out of its rows."""
    at = 0
    while at + LONGEST < len(text):  # most texts have none, and need not be divided into lines
        end = max(text.rfind(sign, at, at + LONGEST) for sign in "\r\n")
        if end < 0:
            lines = enumerate(io.StringIO(text, newline=None), 1)
            return [number for number, line in lines if len(line) > LONGEST and may_hold_values(line)]
        at = end + 1
    return []


def open_quote(text: str) -> int:
    """Number of the first line with a quote that continues in the next line; 1 without one."""
    return next((number for number, line in enumerate(io.StringIO(text, newline=None), 1) if line.count('"') % 2), 1)


def line_of(text: str, dialect: Dialect, row: int) -> tuple[int, str]:
    """Number and text of the line with a row of values."""
    lines = ((i, line) for i, line in enumerate(io.StringIO(text, newline=None), 1) if may_hold_values(line))
    return next(itertools.islice(lines, dialect.first + row, None))


def numbers_of(texts: Sequence[str], decimal_comma: bool) -> Array:
    """Numbers of texts, shape (n,); NaN where a text is not a number."""
    joined = "\n".join(texts)
    cells = joined.replace(",", ".").split("\n") if decimal_comma else texts
    try:
        if "_" in joined:  # Python reads 1_000
            raise ValueError
        return np.fromiter(map(float, cells), float, len(cells))
    except ValueError:
        return np.fromiter((_number(text, decimal_comma) for text in texts), float, len(texts))


def _number(text: str, decimal_comma: bool) -> float:
    plain = _joined(text.strip())
    if decimal_comma or not _EITHER[False].fullmatch(plain):  # 2,5 is no thousand, also beside 38.286
        plain = plain.replace(",", ".")
    try:
        return float(plain) if "_" not in text else float("nan")
    except ValueError:
        return float("nan")


def _joined(text: str) -> str:
    """A number with its thousands joined; as it is if it has none, or a sign that may be that of decimals."""
    match = _THOUSANDS.match(text)
    if not match:
        return text
    first, more, sign, decimals = match.groups("")
    is_either = sign in ".," and more.count(sign) == 1 and not decimals
    is_joined = not is_either and not decimals.startswith(sign)
    return first + more.replace(sign, "") + decimals.replace(",", ".") if is_joined else text


def first_unclear(texts: Sequence[str], decimal_comma: bool) -> str:
    """The first number whose sign may separate thousands or decimals, such as 1.234 beside 980,5; "" without one."""
    sign, pattern = "." if decimal_comma else ",", _EITHER[decimal_comma]
    if sign not in "".join(texts):
        return ""
    return next((text.strip() for text in texts if sign in text and pattern.fullmatch(text.strip())), "")
