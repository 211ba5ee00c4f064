"""Fields of a Micromodem sentence: text to integers, numbers, bytes and times, and times back to text.

Each `take_...` reads the field at `index`. If it is missing or invalid, `SentenceError` names the field, its text and
what was expected.
"""

import math
import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_INT = re.compile(r"[+-]?[0-9]{1,15}\Z")
_FLOAT = re.compile(r"[+-]?([0-9]{1,15}(\.[0-9]{0,12})?|\.[0-9]{1,12})\Z")


class SentenceError(ValueError):
    """A sentence whose fields do not fit its type; names the field, its text and what was expected."""


def take_text(fields: Sequence[str], index: int, name: str) -> str:
    """The field's text."""
    if index >= len(fields):
        raise SentenceError(f"{name} (field {index + 1}) is missing; the sentence has {len(fields)} fields")
    return fields[index]


def is_int(text: str) -> bool:
    """Whether `take_int` would read the text as an integer."""
    return _INT.match(text) is not None


def take_int(fields: Sequence[str], index: int, name: str, low: int | None = None, high: int | None = None) -> int:
    """An integer, `low` to `high` where they are given."""
    text = take_text(fields, index, name)
    if not is_int(text):
        raise SentenceError(f"{name} (field {index + 1}) is {text[:40]!r}, not an integer")
    value = int(text)
    if (low is not None and value < low) or (high is not None and value > high):
        raise SentenceError(f"{name} (field {index + 1}) is {value}, outside {low} to {high}")
    return value


def take_float(fields: Sequence[str], index: int, name: str) -> float:
    """A decimal number without exponent."""
    text = take_text(fields, index, name)
    if not _FLOAT.match(text):
        raise SentenceError(f"{name} (field {index + 1}) is {text[:40]!r}, not a number")
    return float(text)


def number_or(fields: Sequence[str], index: int, name: str, other: float = math.nan) -> float:
    """A decimal number; `other` where the field is empty or missing, because the firmware did not measure it."""
    if index >= len(fields) or not fields[index]:
        return other
    return take_float(fields, index, name)


def whole_or(fields: Sequence[str], index: int, name: str, other: int = 0) -> int:
    """The nearest integer to a decimal number; `other` where the field is empty or missing."""
    return round(number_or(fields, index, name, other))


def take_flag(fields: Sequence[str], index: int, name: str) -> bool:
    """True for 1, False for 0."""
    return take_int(fields, index, name, 0, 1) == 1


def take_hex(fields: Sequence[str], index: int, name: str) -> bytes:
    """The bytes of hexadecimal digits."""
    text = take_text(fields, index, name)
    try:
        return bytes.fromhex(text)
    except ValueError as error:
        raise SentenceError(f"{name} is {text[:20]!r}..., not hexadecimal digits ({error})") from None


def iso_time(utc_s: float) -> str:
    """`2019-12-02T03:02:59Z`, the second that `utc_s` (s since 1970, UTC) falls in."""
    return (_EPOCH + timedelta(seconds=math.floor(utc_s))).strftime("%Y-%m-%dT%H:%M:%SZ")


def clock_time(utc_s: float) -> str:
    """`030259`: hours, minutes and seconds of `utc_s` (s since 1970, UTC)."""
    return (_EPOCH + timedelta(seconds=math.floor(utc_s))).strftime("%H%M%S")


def arrival_time(utc_s: float) -> str:
    """`20191202030259.1234`: date and time of `utc_s` (s since 1970, UTC), to 0.1 ms."""
    ticks = round(utc_s * 10000.0)
    return (_EPOCH + timedelta(seconds=ticks // 10000)).strftime("%Y%m%d%H%M%S") + f".{ticks % 10000:04d}"


def read_iso_time(text: str, name: str) -> tuple[float, float]:
    """Time and resolution (s since 1970 UTC, s) of an ISO 8601 time, with or without a fraction, ending in Z or not."""
    match = re.match(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)(\.\d{1,9})?Z?\Z", text)
    try:
        if match is None:
            raise ValueError("shape")
        whole = datetime.strptime(match[1], "%Y-%m-%dT%H:%M:%S").replace(tzinfo=UTC)
    except ValueError:
        raise SentenceError(f"{name} is {text[:40]!r}, not a time such as 2019-12-02T03:02:59Z") from None
    fraction = match[2] or ""
    resolution = 10.0 ** -(len(fraction) - 1) if fraction else 1.0
    return (whole - _EPOCH).total_seconds() + (float(fraction) if fraction else 0.0), resolution


def read_arrival_time(text: str) -> float:
    """Seconds since 1970 (UTC) of `20191202030259.1234`; NaN if it is not a date (firmware does send such values)."""
    match = re.match(r"(\d{14})(\.\d{1,9})?\Z", text)
    if match is None:
        return math.nan
    try:
        whole = datetime.strptime(match[1], "%Y%m%d%H%M%S").replace(tzinfo=UTC)
    except ValueError:
        return math.nan
    return (whole - _EPOCH).total_seconds() + float(match[2] or 0.0)
