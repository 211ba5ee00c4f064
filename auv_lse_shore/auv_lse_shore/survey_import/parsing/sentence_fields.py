"""Finds NMEA 0183 sentences in bytes, and reads their fields as columns."""

import re
from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from auv_lse_common.support.arrays import Array, Ints, Mask
from auv_lse_shore.survey_import.parsing.times import datetimes

#: Fields as bytes, shape (n,).
Cells = NDArray[np.bytes_]

#: Bytes before the first field: $, two of the talker, three of the kind, a comma.
_HEAD = 7
#: Most bytes of all fields of a sentence, and of a field that is read.
_LONGEST, _WIDTH = 160, 16
_HEX = np.full(256, 255, dtype=np.uint8)
_HEX[np.frombuffer(b"0123456789ABCDEFabcdef", dtype=np.uint8)] = [*range(16), *range(10, 16)]
_IS_NAME = np.zeros(256, dtype=bool)
_IS_NAME[np.frombuffer(b"ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789", dtype=np.uint8)] = True
_IS_END = np.zeros(256, dtype=bool)
_IS_END[np.frombuffer(b"$!*\r\n\0", dtype=np.uint8)] = True
_WHOLE_ENDS = np.frombuffer(b"*\r\n", dtype=np.uint8)
#: A date and a time before a sentence, such as "2026-06-14T10:00:00.5Z,", and most bytes of it.
_MOMENT = re.compile(
    rb"(?<!\d)(\d{4}[-/]\d\d[-/]\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?(?:Z|[+-]\d\d(?::?\d\d)?)?)[^\w\r\n]{1,4}$"
)
_WIDEST_MOMENT = 40


class Sentences:
    """Sentences of some kinds, in order.

    Attributes:
        positions: Of their first bytes, shape (n,).
        names: Talker and kind, such as b"GPRMC", shape (n,).
    """

    def __init__(self, data: bytes, kinds: Sequence[bytes]) -> None:
        """Finds them.

        Args:
            data: A piece of a log.
            kinds: Such as b"RMC".
        """
        self._data = np.frombuffer(data + b"\0" * (_HEAD + _WIDTH), dtype=np.uint8)
        starts = np.flatnonzero(self._data[: len(data)] == ord("$"))
        heads = sliding_window_view(self._data, _HEAD)[starts]
        names = np.ascontiguousarray(heads[:, 1:6])
        is_wanted = np.isin(np.ascontiguousarray(heads[:, 3:6]).view("S3")[:, 0], np.array(kinds))
        is_wanted &= (heads[:, 6] == ord(",")) & _IS_NAME[names[:, :2]].all(axis=1)
        self.positions: Ints = starts[is_wanted]
        self.names: Cells = names.view("S5")[is_wanted, 0]
        ends = np.append(np.flatnonzero(_IS_END[self._data[: len(data)]]), len(data))
        ends = ends[np.searchsorted(ends, self.positions + 1)]
        self._ends = np.minimum(ends, self.positions + _HEAD + _LONGEST)
        commas = np.flatnonzero(self._data[: len(data)] == ord(","))
        self._commas = np.append(commas, len(data))
        self._first = np.searchsorted(commas, self.positions + _HEAD - 1)
        self.counts: Ints = np.searchsorted(commas, self._ends) - self._first

    def are_intact(self) -> Mask:
        """Whether each sentence's checksum is right, shape (n,); sentences without one are intact."""
        if not len(self.positions):
            return np.ones(0, dtype=bool)
        # The checksum is the exclusive or of all bytes between $ and *; reduceat folds every other of these pieces.
        edges = np.column_stack([self.positions + 1, self._ends]).ravel()
        sums = np.bitwise_xor.reduceat(self._data, edges)[::2]
        high, low = (_HEX[self._data[self._ends + i]] for i in (1, 2))
        has_sum = (self._data[self._ends] == ord("*")) & (high < 16) & (low < 16)
        intact: Mask = ~has_sum | (sums == (high << 4) + low)
        return intact

    def are_cut(self) -> Mask:
        """Whether each sentence ends before its checksum and its line do, shape (n,): digits may be missing."""
        return ~np.isin(self._data[self._ends], _WHOLE_ENDS)

    def days_before(self, rows: Ints, of_day_s: Array) -> Array:
        """Days since 1970, shape (n,), of some sentences with times of day: NaN where a logger wrote no moment before.

        The logger's clock may be local: the day is that on which the time of day is nearest to the moment.
        """
        texts = [
            found[1].decode() if (found := _MOMENT.search(bytes(self._data[max(at - _WIDEST_MOMENT, 0) : at]))) else ""
            for at in self.positions[rows].tolist()
        ]
        if not any(texts):
            return np.full(len(rows), np.nan)
        found_days: Array = np.round((datetimes(texts, None)[0] - of_day_s) / 86_400.0)
        return found_days

    def cells(self, rows: Ints, number: int, width: int = _WIDTH) -> Cells:
        """A field (0, 1, ...) of some sentences; b"" where it is missing, b"?" where it is too long."""
        exists = self.counts[rows] > number
        comma = np.where(exists, self._first[rows] + number, 0)
        start = self._commas[comma] + 1
        sizes = np.where(exists, np.minimum(self._commas[comma + 1], self._ends[rows]) - start, 0)
        found = sliding_window_view(self._data, width)[start]
        found[np.arange(width) >= sizes[:, None]] = 0
        cells = found.view(f"S{width}")[:, 0]
        return np.where(sizes > width, np.bytes_(b"?"), cells)

    def numbers(self, rows: Ints, number: int, empty: float = np.nan) -> Array:
        """A field (0, 1, ...) of some sentences as numbers; NaN where it is not one."""
        return numbers_of(self.cells(rows, number), empty)


def numbers_of(cells: Cells, empty: float = np.nan) -> Array:
    """Numbers of fields; `empty` for blank ones, and NaN where one is not a number."""
    try:
        return np.where(cells == b"", b"nan", cells).astype(float) if np.isnan(empty) else _filled(cells, empty)
    except ValueError:
        return np.array([_number(cell.strip(), empty) for cell in cells.tolist()])


def _filled(cells: Cells, empty: float) -> Array:
    is_empty = cells == b""
    numbers: Array = np.where(is_empty, empty, np.where(is_empty, b"0", cells).astype(float))
    return numbers


def _number(text: bytes, empty: float) -> float:
    if not text:
        return empty
    try:
        return float(text)
    except ValueError:
        return float("nan")


def degrees(texts: Cells, sides: Cells, positive: bytes, negative: bytes) -> Array:
    """Degrees from dddmm.mmmm and the hemisphere; NaN where one of them is wrong."""
    numbers = np.nan_to_num(numbers_of(texts), nan=-1.0, posinf=-1.0)
    whole = np.floor(numbers / 100.0)
    minutes = numbers - 100.0 * whole
    has_minutes = np.char.find(texts, b".")
    has_minutes = np.where(has_minutes < 0, np.char.str_len(texts), has_minutes)
    is_right = (has_minutes >= 3) & (minutes < 60.0) & (numbers >= 0.0)
    sign = np.where(sides == positive, 1.0, np.where(sides == negative, -1.0, np.nan))
    found: Array = np.where(is_right, sign * (whole + minutes / 60.0), np.nan)
    return found


def of_day_s(clocks: Cells) -> Array:
    """Seconds of the day of times such as 140305.20; NaN where one is not a time."""
    numbers = np.nan_to_num(numbers_of(clocks), nan=-1.0, posinf=-1.0)
    digits = np.char.find(clocks, b".")
    digits = np.where(digits < 0, np.char.str_len(clocks), digits)
    hours, rest = np.divmod(numbers, 10_000.0)
    minutes, seconds = np.divmod(rest, 100.0)
    is_right = (digits == 6) & (hours < 25.0) & (minutes < 60.0) & (seconds < 61.0) & (numbers >= 0.0)
    found: Array = np.where(is_right, 3600.0 * hours + 60.0 * minutes + seconds, np.nan)
    return found


def days(dates: Cells) -> Array:
    """Days since 1970 of dates ddmmyy; NaN where one is not a date."""
    numbers = np.where(np.char.str_len(dates) == 6, numbers_of(dates), np.nan)
    unique, where = np.unique(numbers, return_inverse=True)
    found: Array = np.array([_day(number) for number in unique.tolist()])[where] if len(unique) else np.empty(0)
    return found


def _day(number: float) -> float:
    if not 0.0 <= number < 1e6:
        return float("nan")
    day, month, year = int(number // 10_000), int(number // 100) % 100, int(number % 100)
    return day_of(year + (1900 if year >= 80 else 2000), month, day)


def day_of(year: float, month: float, day: float) -> float:
    """Days since 1970 of a date; NaN if there is no such day."""
    if not (year % 1.0 == month % 1.0 == day % 1.0 == 0.0 and 1.0 <= year <= 9999.0 and 1.0 <= month <= 12.0):
        return float("nan")
    try:
        return float(np.datetime64(f"{int(year):04d}-{int(month):02d}-{int(day):02d}", "D").astype(np.int64))
    except ValueError:
        return float("nan")
