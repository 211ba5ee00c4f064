"""Times in other people's notations: epochs in any unit, dates, times of day, and wrong dates."""

import re
import warnings
from collections.abc import Sequence
from datetime import UTC, date, datetime

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_gp.tables.column_names import HEADER_ZONE
from auv_lse_gp.tables.dialect import numbers_of

#: Times from here on (s since 1970: 2000) are UTC; smaller ones count from a start.
UTC_FROM_S = 946_684_800.0
#: After 1,024 weeks, a GPS receiver may begin its count of weeks again.
_WEEK_S = 7 * 86_400.0
ROLLOVER_S = 1024 * _WEEK_S
#: The latest time that a message's stamp can hold (s since 1970: January 2038).
UTC_TO_S = 2_147_483_000.0
#: Start of GPS time, 1980-01-06: no receiver gives an earlier time.
GPS_FROM_S = 315_964_800.0
#: Days from which GPS is one more leap second ahead of UTC.
_LEAP_DAYS = np.array(
    [
        "1981-07", "1982-07", "1983-07", "1985-07", "1988-01", "1990-01", "1991-01", "1992-07", "1993-07", "1994-07",
        "1996-01", "1997-07", "1999-01", "2006-01", "2009-01", "2012-07", "2015-07", "2017-01",
    ],
    dtype="datetime64[s]",
).astype(float)  # fmt: skip
#: Factors of epochs to seconds, by the magnitude of the numbers.
_UNITS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3), (0.0, 1.0))
_OF_DAY = re.compile(
    r"(\d{1,2})[:h](\d{2})(?:[:m](\d{2}(?:[.,]\d*)?)s?)?\s*([AaPp]\.?[Mm])?\.?\s*(Z|(?:UTC|GMT)?(?:[+-]\d{2}(?::?\d{2})?)?)$"
)
#: Minutes and seconds.
_OF_HOUR = re.compile(r"([0-5]?\d):([0-5]\d(?:[.,]\d*)?)")
_WITH_POINTS = re.compile(r"([01]?\d|2[0-4])\.([0-5]\d)\.(?=[0-5]\d(?:[.,]\d*)?(?:$|[ Z+-]))")
_FOUR_DIGITS = re.compile(r"(\d{2})(\d{2}(?:\.\d*)?)")
#: Spreadsheets remove a leading zero.
_SIX_DIGITS = re.compile(r"(\d{1,2})(\d{2})(\d{2}(?:\.\d*)?)")
_YEAR_FIRST = re.compile(r"(\d{4})[-/.:](\d{1,2})[-/.:](\d{1,2})$|(\d{4})(\d{2})(\d{2})$")
_YEAR_LAST = re.compile(r"(\d{1,2})[-/.](\d{1,2})[-/.](\d{4}|\d{2})$")
#: Orders of dates of six digits, such as 140625, and where their years, months and days begin.
_DIGIT_ORDERS = {"ddmmyy": (4, 2, 0), "mmddyy": (4, 0, 2), "yymmdd": (0, 2, 4)}
#: ISO 8601 without signs: 20250614T100000Z.
_COMPACT = re.compile(r"\s*((?:19|20)\d{6})T?[ _-]?(\d{2})(\d{2})(\d{2}(?:\.\d*)?)(\s*(?:Z|[+-]\d{2}(?::?\d{2})?)?)$")
#: A spreadsheet's day number that cannot be a date such as 40325, and day 0 (s since 1970: 1899-12-30).
_SERIAL = re.compile(r"[2-7](?:3[2-9]|[4-9]\d)\d\d(\.0*)?")
SERIAL_FROM_S = -25_569.0 * 86_400.0
#: Counts at 1970 and at the latest time, their unit (s), and whether they are of UTC: days of spreadsheets, modified
#: Julian days (below 51,544 they look like those), Matlab's, Julian ones; LabVIEW's seconds, and ticks of Windows and
#: of .NET.
_COUNTS = (
    (25_569.0, 51_544.0, 86_400.0, False),
    (40_587.0, 65_500.0, 86_400.0, True),
    (719_529.0, 745_000.0, 86_400.0, False),
    (2_440_587.5, 2_465_500.0, 86_400.0, True),
    (2_082_844_800.0, 4.23e9, 1.0, True),
    (1.16444736e17, 1.38e17, 1e-7, True),
    (6.21355968e17, 6.43e17, 1e-7, False),
)
#: Largest time (s) between two counts of a table: a ping every 14 minutes; otherwise "days" are really seconds.
_COUNTS_APART_S = 864.0
#: A year and the day in it, as in 2025-165.
_YEAR_DAY = re.compile(r"((?:19|20)\d{2})-?(\d{3})$")
#: Months by the first letters of their English, German, French, Spanish and Italian names.
_MONTHS = {
    "jan": 1, "gen": 1, "ene": 1, "feb": 2, "fev": 2, "fév": 2, "mar": 3, "mär": 3, "mrz": 3, "apr": 4, "avr": 4,
    "abr": 4, "may": 5, "mai": 5, "mag": 5, "jun": 6, "juin": 6, "giu": 6, "jul": 7, "juil": 7, "lug": 7, "aug": 8,
    "aou": 8, "aoû": 8, "ago": 8, "sep": 9, "set": 9, "oct": 10, "okt": 10, "ott": 10, "nov": 11, "dec": 12, "dez": 12,
    "déc": 12, "dic": 12,
}  # fmt: skip
_NAME = f"({'|'.join(sorted(_MONTHS, key=len, reverse=True))})[^\\W\\d_]*"
#: Dates whose month has its name, also behind a weekday: 14-Jun-2025, Sat 14 June 2025, 14Jun2025; Jun 14, 2025; and
#: with the time before the year: Sat Jun 14 10:00:00 UTC 2025.
_WEEKDAY = r"^\s*(?:[^\W\d_]{2,10}[.,]{0,2}\s+)?"
_DAY_NAME_YEAR = re.compile(rf"{_WEEKDAY}(\d{{1,2}})[-/. ]*{_NAME}[-/., ]*(\d{{4}}|\d{{2}})(?!\d)", re.IGNORECASE)
_NAME_DAY_YEAR = re.compile(rf"{_WEEKDAY}{_NAME}[-/. ]*(\d{{1,2}})[-/., ]+(\d{{4}})(?!\d)", re.IGNORECASE)
_MONTH_NAME = re.compile(rf"{_NAME}\.?$", re.IGNORECASE)
_YEAR_AT_END = re.compile(
    rf"{_WEEKDAY}{_NAME}\s+(\d{{1,2}})\s+(\d{{1,2}}:[\d:.]+(?:\s*[AaPp][Mm])?(?:\s+[A-Z]{{3,4}})?)\s+(\d{{4}})\s*$",
    re.IGNORECASE,
)
_ZONE = re.compile(r"(?<=[\d:. ]{3})\s*(Z|UTC|GMT|(?:UTC|GMT)?[+-]\d{2}(?::?\d{2})?)$")
#: Offsets from UTC in a column of their own; no clock is farther ahead or behind (s).
_OFFSET = re.compile(r"(?:UTC|GMT)?[+-]\d{2}:?\d{2}")
_PLAIN_OFFSET = re.compile(r"(?:UTC|GMT)? *([+-]?\d+(?:\.\d*)?)")
_MOST_AHEAD_S = 14.0 * 3600.0
#: Letters of times that NumPy reads.
_ISO_LETTERS = frozenset("0123456789-:.TZ \n")


def seconds(values: Array) -> Array:
    """Seconds of epochs in s, ms, us or ns, by their magnitude."""
    known = np.abs(values[np.isfinite(values)])
    largest = float(np.median(known)) if len(known) else 0.0
    factor = next(factor for least, factor in _UNITS if largest >= least)
    with np.errstate(over="ignore"):
        return values * factor


def of_counts(numbers: Array) -> tuple[Array, bool] | None:
    """Seconds since 1970 of days or ticks (n,) since another beginning, and whether of UTC; None for others."""
    known = np.unique(numbers[np.isfinite(numbers)])
    if len(known) < 2:
        return None
    for first, last, unit_s, is_utc in _COUNTS:
        if first < known[0] and known[-1] < last and np.median(np.diff(known)) * unit_s <= _COUNTS_APART_S:
            return (numbers - first) * unit_s, is_utc
    return None


def with_colons(text: str) -> str:
    """A time of day with points, such as "10.15.00", with colons; other text as it is. Alone it could be a date."""
    match = _WITH_POINTS.match(text)
    return f"{match[1]}:{match[2]}:{text[match.end() :]}" if match else text


def of_day_s(texts: Sequence[str]) -> Array:
    """Seconds of the day of times such as "14:03:05.2", "2:03 PM", "140305", "1403" or "1403.25"; NaN for others.

    Those of a time with a zone, such as "16:03+02:00", are of UTC, and may be negative.
    """
    cache: dict[str, float] = {}
    return np.array([cache[t] if t in cache else cache.setdefault(t, _of_day(t)) for t in texts])


def _of_day(text: str) -> float:
    text = text.strip()
    if match := _OF_DAY.match(text):
        hours, minutes, rest, half, zone = match.groups()
        hour = int(hours)
        if half:
            hour = hour % 12 + (12 if half[0] in "Pp" else 0)
        return hour * 3600.0 + int(minutes) * 60.0 + float((rest or "0").replace(",", ".")) - _zone_s(zone)
    if (match := _SIX_DIGITS.fullmatch(text)) and int(match[1]) < 25 and int(match[2]) < 60 and float(match[3]) < 61.0:
        return int(match[1]) * 3600.0 + int(match[2]) * 60.0 + float(match[3])
    if (match := _FOUR_DIGITS.fullmatch(text)) and int(match[1]) < 24 and float(match[2]) < 60.0:
        return int(match[1]) * 3600.0 + float(match[2]) * 60.0
    return float("nan")


def of_hour_s(texts: Sequence[str], are_certain: bool) -> Array | None:
    """Seconds (n,) of the hour of times such as "34:05.2", NaN for others; None if hours and minutes may be meant.

    Spreadsheets leave out the hours of times with fractions of a second.

    Args:
        are_certain: Whether hours and minutes are not meant.
    """
    found = [_OF_HOUR.fullmatch(text.strip()) for text in texts]
    values = [(float(match[1]), float(match[2].replace(",", "."))) if match else (np.nan, np.nan) for match in found]
    minutes, seconds_ = np.array(values).reshape(-1, 2).T
    is_of_hour = are_certain or (minutes >= 24.0).any() or (seconds_ % 1.0 > 0.0).any()
    return 60.0 * minutes + seconds_ if is_of_hour and np.isfinite(minutes).mean() > 0.5 else None


def of_gps_weeks(weeks: Array, of_week: Array) -> Array:
    """Seconds since 1970 (n,) of GPS weeks and their seconds or milliseconds, without the leap seconds until then."""
    of_week_s = of_week * (1e-3 if np.nanmax(of_week, initial=0.0) > _WEEK_S else 1.0)
    gps_s = GPS_FROM_S + weeks * _WEEK_S + of_week_s
    return gps_s - np.searchsorted(_LEAP_DAYS + np.arange(len(_LEAP_DAYS)), gps_s, side="right")


def are_six_digits(texts: Sequence[str]) -> bool:
    """Whether all texts that are not blank are times such as "140305" or "90305"; counts of seconds soon fail."""
    known = [text.strip() for text in texts if text.strip()]
    return bool(known) and all(map(_SIX_DIGITS.fullmatch, known)) and bool(np.isfinite(of_day_s(known)).all())


def are_four_digits(texts: Sequence[str], are_no_seconds: bool = False) -> bool:
    """Whether all texts that are not blank are times such as "1403" or "1403.25".

    Seconds of the day have no 0 before them, and are hardly the same for long, or all below 60 in each hundred.

    Args:
        are_no_seconds: Whether they cannot be seconds of the day.
    """
    known = [text.strip() for text in texts if text.strip()]
    if not known or not all(map(_FOUR_DIGITS.fullmatch, known)) or np.isnan(of_day_s(known)).any():
        return False
    least = min(known)
    return (
        are_no_seconds
        or 2 * len(set(known)) <= len(known)
        or float(max(known)) - float(least) >= 100.0
        or least.startswith("0")
    )


def are_compact(texts: Sequence[str]) -> bool:
    """Whether all texts that are not blank are dates and times in digits alone, such as "20250614100000"."""
    known = [text.strip() for text in texts if text.strip()]
    return bool(known) and all(map(_COMPACT.match, known)) and bool(np.isfinite(datetimes(known, None)[0]).all())


def offsets_s(texts: Sequence[str], unit_s: float) -> Array:
    """Seconds (n,) by which clocks are ahead of UTC, of offsets such as "+02:00", "UTC+2" or "-7"; NaN for others.

    Args:
        unit_s: Seconds per unit of a plain number.
    """
    found = {text: _offset_s(text.strip().upper().replace(",", "."), unit_s) for text in set(texts)}
    return np.array([found[text] for text in texts])


def _offset_s(text: str, unit_s: float) -> float:
    if text in ("Z", "UTC", "GMT"):
        return 0.0
    found = [_zone_s(match[0]) for match in [_OFFSET.fullmatch(text)] if match]
    found += [float(match[1]) * unit_s for match in [_PLAIN_OFFSET.fullmatch(text)] if match]
    return next((ahead_s for ahead_s in found if abs(ahead_s) <= _MOST_AHEAD_S), float("nan"))


def days(texts: Sequence[str], day_first: bool | None) -> tuple[Array, bool]:
    """Seconds since 1970 of dates, NaN for others; and whether the order of day and month is only assumed.

    Args:
        day_first: Whether 3/4/2026 is in April; None: as the dates show, else as they follow each other most closely,
            else if they have dots.
    """
    plain = {text: _with_numbers(text) for text in set(texts)}
    unique, texts = sorted(set(plain.values())), [plain[text] for text in texts]
    assumed = False
    if day_first is None:
        options = {order: _days(unique, order) for order in (False, True)}
        bad = {order: sum(value != value for value in found.values()) for order, found in options.items()}
        spans = {order: _span(found) for order, found in options.items()}
        is_dotted = all("." in text for text in unique if _YEAR_LAST.match(text.strip()))  # as in German
        day_first = (bad[True], spans[True], not is_dotted) < (bad[False], spans[False], is_dotted)
        differ = any(options[True][text] != value for text, value in options[False].items() if value == value)
        assumed = bad[True] == bad[False] and differ
    known = _days(unique, day_first)
    return np.array([known[text] for text in texts]), assumed


def dates_of_digits(texts: Sequence[str], today: date) -> dict[str, dict[str, str]]:
    """Dates of six digits, such as 140625, as 2025-06-14, by each order of their digits that may be meant.

    It gives no day after `today`, and of several days those that follow each other most closely.

    Returns:
        Dates by texts, by "ddmmyy", "mmddyy" or "yymmdd"; {} for other texts.
    """
    known = sorted({text for text in texts if text.strip().strip("0")})  # receivers without a date write 000000
    digits = [text.strip().zfill(6) for text in known]  # spreadsheets remove a leading zero
    if not known or max(map(len, known)) < 6 or not all(re.fullmatch(r"\d{6}", text) for text in digits):
        return {}
    last_s = datetime(today.year, today.month, today.day, tzinfo=UTC).timestamp() + 86_400.0  # also east of here
    found, spans = dict[str, dict[str, str]](), dict[str, float]()
    for order, begins in _DIGIT_ORDERS.items():
        parts = ([int(text[begin : begin + 2]) for begin in begins] for text in digits)
        written = [f"{full_year(year)}-{month:02d}-{day:02d}" for year, month, day in parts]
        stamps = [_date(text, day_first=False) for text in written]
        if all(stamp <= last_s for stamp in stamps):
            found[order], spans[order] = dict(zip(known, written, strict=True)), max(stamps) - min(stamps)
    return {order: written for order, written in found.items() if spans[order] == min(spans.values())}


def _with_numbers(text: str) -> str:
    """A text whose date has a month's name, or no signs, with numbers and signs instead; others as they are."""
    if match := _COMPACT.match(text):
        return f"{match[1]} {match[2]}:{match[3]}:{match[4]}{match[5]}"
    if match := _YEAR_AT_END.match(text):
        name, day, rest, year = match.groups()
        rest = f" {rest}"
    elif match := _DAY_NAME_YEAR.match(text):
        day, name, year = match.groups()
        rest = text[match.end() :]
    elif match := _NAME_DAY_YEAR.match(text):
        name, day, year = match.groups()
        rest = text[match.end() :]
    else:
        return text
    return f"{full_year(int(year))}-{_MONTHS[name.lower()]}-{day}{rest}"


def months(texts: Sequence[str], decimal_comma: bool) -> Array:
    """Numbers (n,) of months, which may have names; NaN for other texts."""
    found = {text: _MONTH_NAME.match(text.strip()) for text in set(texts)}
    numbers = {text: _MONTHS[match[1].lower()] if match else float("nan") for text, match in found.items()}
    stated = numbers_of(texts, decimal_comma)
    return np.where(np.isnan(stated), [numbers[text] for text in texts], stated)


def full_year(number: int) -> int:
    """A year of two digits in full: 1980 to 2079."""
    return number + (0 if number > 99 else 1900 if number >= 80 else 2000)


def _span(found: dict[str, float]) -> float:
    values = [value for value in found.values() if value == value]
    return max(values, default=0.0) - min(values, default=0.0)


def _days(texts: Sequence[str], day_first: bool) -> dict[str, float]:
    return {text: _date(text.strip(), day_first) for text in texts}


def _date(text: str, day_first: bool) -> float:
    if (match := _YEAR_DAY.match(text)) and 1 <= int(match[2]) <= 366:
        return datetime(int(match[1]), 1, 1, tzinfo=UTC).timestamp() + 86_400.0 * (int(match[2]) - 1)
    if _SERIAL.fullmatch(text):
        return SERIAL_FROM_S + 86_400.0 * float(text)
    if match := _YEAR_FIRST.match(text):
        parts = [int(part) for part in match.groups() if part]
    elif match := _YEAR_LAST.match(text):
        first, second, year = (int(part) for part in match.groups())
        parts = [full_year(year), second, first] if day_first else [full_year(year), first, second]
    else:
        return float("nan")
    try:
        year, month, day = parts
        return datetime(year, month, day, tzinfo=UTC).timestamp()
    except ValueError:
        return float("nan")


def datetimes(texts: Sequence[str], day_first: bool | None) -> tuple[Array, Sequence[str], bool]:
    """Seconds since 1970 of dates with times, NaN for others; those that state a zone; whether the order is assumed.

    Args:
        texts: Such as "2026-06-14T10:00:00Z", "14.06.2026 10:00:00", "6/14/2026 2:03 PM" or "Sun, 14 Jun 2026 10:00:00
            GMT".
        day_first: See `days`.
    """
    if (quick := _iso(texts)) is not None:
        return quick, texts if texts[0].endswith("Z") else (), False
    plain = [_with_numbers(text.strip()) for text in texts]
    zones = [_ZONE.search(text) if ":" in text else None for text in plain]
    zoned = [text for text, zone in zip(texts, zones, strict=True) if zone]
    bare = [text[: zone.start()] if zone else text for text, zone in zip(plain, zones, strict=True)]
    parts = [re.split(r"[T ,]+", text, maxsplit=1) for text in bare]
    day, assumed = days([part[0] for part in parts], day_first)
    clock = of_day_s([with_colons(part[1]) if len(part) > 1 else "0:00" for part in parts])
    shift = np.array([_zone_s(zone[1]) if zone else 0.0 for zone in zones])
    return day + clock - shift, zoned, assumed


def _iso(texts: Sequence[str]) -> Array | None:
    """Seconds since 1970 if all texts are ISO 8601, all in UTC or all without a zone; else None."""
    if not texts or len(texts[0]) < 19 or texts[0][4:5] != "-" or texts[0][10] not in "T ":
        return None
    is_utc, joined = texts[0].endswith("Z"), "\n".join([*texts, ""])
    if not _ISO_LETTERS.issuperset(joined):
        return None
    zones = (joined.count("Z\n"), joined.count("Z"), joined.count("+"), joined.count("-") - 2 * len(texts))
    if zones != (len(texts) * is_utc, len(texts) * is_utc, 0, 0) or min(map(len, texts)) < 19:
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # text that looks like a zone is not one here
            stamps = np.array([text[:-1] for text in texts] if is_utc else texts, dtype="datetime64[us]")
    except (ValueError, UserWarning, DeprecationWarning):
        return None
    seconds_: Array = np.where(np.isnat(stamps), np.nan, stamps.astype(np.int64) * 1e-6)
    return seconds_


def zoned_of(texts: Sequence[str]) -> list[str]:
    """The times of day that state their zone."""
    zoned = {text for text in set(texts) if ":" in text and _ZONE.search(text.strip())}
    return [text for text in texts if text in zoned] if zoned else []


def header_zone_s(name: str) -> float:
    """Seconds by which the times of a column are ahead of UTC, by its name; 0 if it has no zone."""
    match = HEADER_ZONE.search(name)
    if not match:
        return 0.0
    sign, hours, minutes = match.groups()
    return (-1.0 if sign == "-" else 1.0) * (int(hours) * 3600.0 + int(minutes or 0) * 60.0)


def _zone_s(zone: str) -> float:
    zone = zone.removeprefix("UTC").removeprefix("GMT")
    if zone in ("", "Z"):
        return 0.0
    digits = zone[1:].replace(":", "").ljust(4, "0")
    return (-1.0 if zone[0] == "-" else 1.0) * (int(digits[:2]) * 3600.0 + int(digits[2:]) * 60.0)


def date_question(first_s: float, last_s: float, today: date) -> str:
    """A question about implausible dates: a GPS receiver that lost its count of weeks, or a future date; else ""."""
    now_s = datetime(today.year, today.month, today.day, tzinfo=UTC).timestamp() + 2 * 86_400.0
    first = datetime.fromtimestamp(first_s, UTC)
    if last_s > now_s:
        return f"the log is dated {first:%Y-%m-%d}, which is in the future; --date gives its first day"
    if last_s < GPS_FROM_S:
        return f"the log is dated {first:%Y-%m-%d}, before GPS; --date gives its first day"
    if last_s + ROLLOVER_S <= now_s:
        then = datetime.fromtimestamp(first_s + ROLLOVER_S, UTC)
        return (
            f"the log is dated {first:%Y-%m-%d}. If it is really from {then:%Y-%m-%d}, its GPS receiver lost 1,024 "
            f"weeks: --date {then:%Y-%m-%d} corrects that, --date {first:%Y-%m-%d} confirms the old date"
        )
    return ""
