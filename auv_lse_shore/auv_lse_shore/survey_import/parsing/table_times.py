"""The times of a table's rows: from columns of epochs, dates, and times of day or from a start."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_gp.tables.column_names import HEADER_ZONE_NAME, Column
from auv_lse_gp.tables.dialect import numbers_of
from auv_lse_gp.tables.units import TIME_UNITS, factor_of
from auv_lse_shore.survey_import.log_content import Clock, LogContent
from auv_lse_shore.survey_import.log_file import ReadOptions
from auv_lse_shore.survey_import.parsing.columns import (
    DATE_PARTS,
    GPS_TIME,
    Table,
    first_of,
    has_date,
    has_date_parts,
    vehicles_of,
)
from auv_lse_shore.survey_import.parsing.times import (
    UTC_FROM_S,
    are_compact,
    are_four_digits,
    are_six_digits,
    dates_of_digits,
    datetimes,
    days,
    full_year,
    header_zone_s,
    months,
    of_counts,
    of_day_s,
    of_gps_weeks,
    of_hour_s,
    offsets_s,
    seconds,
    with_colons,
    zoned_of,
)
from auv_lse_shore.survey_import.survey_log import JUMP_M, MAX_SPEED_MPS, LogError

#: After a larger step back (s), a clock has passed midnight or rows are out of order; below the second (s): midnight.
_BACK_S, _MIDNIGHT_S = 60.0, -82_800.0
_DAY_S, _HOUR_S = 86_400.0, 3_600.0

#: AM or PM at the end of a time.
_HALF_DAY = re.compile(r"[ap]\.?m\.?\s*$", re.IGNORECASE)

#: The name of a zone, whose offset is not known, after a time.
_ZONE_NAME = re.compile(r"(?<=[\d.MAPmp])\s+(?!UTC|GMT|AM|PM)[A-Z]{3,4}(?=\s+\d{4}\s*$|\s*$)")

#: A name that states minutes and seconds.
_NOTATION = re.compile(r"(?<!h:)\bmm?:ss?\b|\bmin:sec\b", re.IGNORECASE)
#: A boat that logs a position each minute or more often, and is slower than this (m/s), is at a mooring.
_DRIFT_MPS = 0.1

_ORDER_NOTE = "it is unclear whether dates begin with the day or the month: see --day-first"
#: Number of times, spread over a table, by which their notation is recognized.
_SAMPLED = 1000


def times_of(table: Table, steps_m: Array, options: ReadOptions, content: LogContent) -> Array:
    """Times (s), NaN where missing; sets the content's clock.

    Args:
        table: Its `n` rows.
        steps_m: Distances (m) between their positions (n - 1).
        options: What the user knows about them.
        content: The clock and notes are added to it.
    """
    best: tuple[Clock, Array] | None = None
    options.used.add("day_first")
    order = (Clock.UTC, Clock.LOCAL, Clock.DAY, Clock.ELAPSED)
    candidates = [role for role in table.columns if role.startswith("datetime")]
    if has_date_parts(table.columns):
        best = _from_parts(table, options, content)
    if {*GPS_TIME} <= table.columns.keys():
        best = Clock.UTC, of_gps_weeks(*(table.values[role] for role in GPS_TIME))
    for role in candidates or ["date"] * ("date" in table.columns and best is None):
        found = _time(table, role, steps_m, options, content)
        if found and (best is None or order.index(found[0]) < order.index(best[0])):
            best = found
    if best is None:
        for role in candidates:
            text = first_of(table.values[role])
            why = f"{text!r} is not a time" if text else "it is empty"
            content.notes.append(f"column {table.columns[role].name} is ignored: {why}")
        content.clock = Clock.NONE
        return np.arange(table.count, dtype=float)
    content.clock, times = best
    times = _without_offsets(times, table, content)
    known = times[np.isfinite(times)]
    is_whole = bool(len(known)) and bool((known % 1.0 == 0.0).all())
    content.lag_std_s = 1.0 / np.sqrt(12.0) if is_whole else 0.1
    return times


def _time(
    table: Table, role: str, steps_m: Array, options: ReadOptions, content: LogContent
) -> tuple[Clock, Array] | None:
    """A column of times with its clock; None if it holds none."""
    column, texts = table.columns[role], table.values[role].tolist()
    if "half_day" in table.columns:
        halves = table.values["half_day"].tolist()
        lacks = [":" in text and not _HALF_DAY.search(text) for text in texts]
        texts = [f"{text} {half}" if lack else text for text, half, lack in zip(texts, halves, lacks, strict=True)]
    if role != "date" and has_date(table.columns):
        texts = [with_colons(text.strip()) for text in texts]
    first = next((text for text in texts if text.strip()), "")
    if not first:
        return None
    if role == "date" and dates_of_digits(texts, options.today):
        day, _ = _days(table, options, content)
        return (Clock.LOCAL, day) if np.isfinite(day).any() else None
    if ":" in first and (zone := _ZONE_NAME.search(first)):
        content.notes.append(f"column {column.name}: the zone{zone[0]} is not read")
        texts = [_ZONE_NAME.sub("", text) for text in texts]
    elif zone := HEADER_ZONE_NAME.search(column.name):
        content.notes.append(f"column {column.name}: the zone {zone[0]} is not read")
    is_utc = any(word in column.name.lower() for word in ("utc", "gmt", "gps", "epoch", "unix"))
    is_utc = is_utc or first.strip().endswith(("Z", "UTC", "GMT"))
    sample = texts[:: len(texts) // _SAMPLED + 1]
    are_of_day = are_six_digits(sample) or (
        has_date(table.columns)
        and are_four_digits(sample, _are_too_fast(numbers_of(texts, table.decimal_comma), steps_m))
    )
    are_digits = are_compact(sample) or (are_of_day and column.unit not in TIME_UNITS)
    if not are_digits and np.isfinite(numbers_of(sample, table.decimal_comma)).mean() > 0.5:
        return _from_numbers(numbers_of(texts, table.decimal_comma), column, table, options, content)
    is_of_hour = of_hour_s(sample, True) is not None and _are_minutes_and_seconds(texts, column, table, steps_m)
    if of_hour_s(sample, is_of_hour) is not None and (of_hour := of_hour_s(texts, is_of_hour)) is not None:
        content.notes.append(f"column {column.name} has minutes and seconds, and no hours")
        return Clock.ELAPSED, _counted(of_hour, _HOUR_S, table)
    if np.isfinite(of_day_s(sample)).mean() > 0.5:
        clock, zoned, (day, date_name) = of_day_s(texts), zoned_of(texts), _days(table, options, content)
        _check_zones(texts, clock, zoned, column, date_name, table.path)
        if not np.isfinite(day).any():
            return Clock.DAY, _counted(clock - (0.0 if zoned else header_zone_s(column.name)), _DAY_S, table)
        day = _past_midnight(clock, day, date_name, table, content)
        is_utc = is_utc or ("utc" in date_name.lower() and "local" not in column.name.lower())
        has_zone = bool(zoned)
        stamps = day + clock - (0.0 if has_zone else header_zone_s(f"{column.name} {date_name}"))
    else:
        stamps, stated, assumed = datetimes(texts, options.day_first)
        _check_zones(texts, stamps, stated, column, column.name, table.path)
        has_zone = bool(stated)
        if not np.isfinite(stamps).mean() > 0.5:
            return None
        stamps = stamps if has_zone else stamps - header_zone_s(column.name)
        content.notes += [_ORDER_NOTE] * assumed
    return (Clock.UTC if has_zone or is_utc else Clock.LOCAL), stamps


def _are_too_fast(time_s: Array, steps_m: Array) -> bool:
    """Whether moving by `steps_m` (n - 1) between rows at these times (n,) (s) would take an impossibly fast boat."""
    known = time_s[np.isfinite(time_s)]
    way_m = float(np.nansum(steps_m[np.isfinite(steps_m)]))
    return bool(len(known)) and way_m > MAX_SPEED_MPS * float(np.ptp(known))


def _are_minutes_and_seconds(texts: Sequence[str], column: Column, table: Table, steps_m: Array) -> bool:
    """Whether times such as "12:34" are minutes and seconds: by their name, or because the boat would else only drift.

    With a date they are hours and minutes, as are those of single soundings minutes apart.
    """
    if _NOTATION.search(column.name):
        return True
    clock = of_day_s(texts)
    apart_s = np.diff(clock[np.isfinite(clock)])
    if has_date(table.columns) or not len(apart_s) or np.median(np.abs(apart_s)) > 60.0:
        return False
    way_m = float(np.nansum(np.where(steps_m < JUMP_M, steps_m, 0.0)))
    return way_m < _DRIFT_MPS * float(apart_s[(apart_s > 0.0) & (apart_s < 3600.0)].sum())


def _from_parts(table: Table, options: ReadOptions, content: LogContent) -> tuple[Clock, Array] | None:
    """Times from columns of dates or years, months and days, and of hours, minutes, seconds; None if they hold none."""
    stamps, date_name = _days(table, options, content)
    if "day_of_year" in table.accounted:
        stamps = stamps + _DAY_S * (table.values["day_of_year"] % 1.0)
    for role, unit_s in (("hour", 3600.0), ("minute", 60.0), ("second", 1.0)):
        stamps = stamps + unit_s * table.values.get(role, 0.0)
    if "half_day" in table.columns and "hour" in table.columns:
        halves, hours = np.char.lower(np.char.strip(table.values["half_day"])), table.values["hour"]
        stamps = stamps + 3600.0 * (12.0 * (np.char.startswith(halves, "p") & (hours < 12.0)))
        stamps = stamps - 3600.0 * (12.0 * (np.char.startswith(halves, "a") & (hours >= 12.0)))
    name = " ".join([date_name, *(table.columns[role].name for role in DATE_PARTS if role in table.columns)]).lower()
    stamps, is_utc = stamps - header_zone_s(name), "utc" in name
    return ((Clock.UTC if is_utc else Clock.LOCAL), stamps) if np.isfinite(stamps).any() else None


class _Dates(NamedTuple):
    """The dates of a table's rows, () without any, and the names of their columns."""

    texts: Sequence[str]
    name: str


def _dates(table: Table) -> _Dates:
    """The dates of a table, from a column of their own, or from years and months or days of the year."""
    columns, values = table.columns, table.values
    texts: list[str] = values["date"].tolist() if "date" in columns else []
    of_month = numbers_of(texts, table.decimal_comma)
    roles: Sequence[str] = ("date",) if texts else ()
    form, parts = "", list[Array]()
    if "year" in columns and "day_of_year" in columns and (values["day_of_year"] <= 366.0).any():
        roles, form, parts = ("year", "day_of_year"), "{:.0f}-{:03.0f}", [np.floor(values["day_of_year"])]
    elif "year" in columns and "month" in columns and (of_month <= 31.0).any():
        of_year = months(values["month"].tolist(), table.decimal_comma)
        roles, form, parts = ("year", "month", "date"), "{:.0f}-{:.0f}-{:.0f}", [of_year, of_month]
    if form:
        rows = zip(*(np.nan_to_num(part, nan=-1.0).tolist() for part in (values["year"], *parts)), strict=True)
        texts = [form.format(full_year(int(year)), *rest) if year >= 0.0 else "" for year, *rest in rows]
    table.accounted.update(roles)
    return _Dates(texts, ", ".join(columns[role].name for role in roles))


def _days(table: Table, options: ReadOptions, content: LogContent) -> tuple[Array, str]:
    """Days (n,), s since 1970, of a table's dates, NaN for others, and the names of their columns.

    Notes an order of day and month that is only assumed, and dates that cannot be read.
    """
    texts, name = _dates(table)
    orders = dates_of_digits(texts, options.today)
    meant = [order for order in orders if options.day_first in (None, order == "ddmmyy")]
    meant = [order for order in orders if order in name.lower()] or meant
    if len(meant) == 1:
        texts = [orders[meant[0]].get(text, "") for text in texts]
    day, assumed = days(texts, options.day_first)
    content.notes += [_ORDER_NOTE] * assumed
    if not np.isfinite(day).any() and (text := first_of(texts)):
        may_be = " or ".join(f"{orders[order][text]} ({order})" for order in meant)
        why = f"may be {may_be}; write it in that form" if meant else "is not a date"
        note = f"column {name} is ignored: {text!r} {why}"
        content.notes += [note] * (note not in content.notes)  # several columns may need the dates
    return day, name


def _without_offsets(times: Array, table: Table, content: LogContent) -> Array:
    """Times (n,) in UTC, by a column of the hours that a local clock is ahead; sets the content's clock."""
    column = table.columns.get("utc_offset")
    if column is None:
        return times
    cells = table.values["utc_offset"]
    ahead_s = offsets_s(cells.tolist(), factor_of(column.unit, TIME_UNITS) or 3600.0)
    unclear = cells[~np.isfinite(ahead_s) & np.isfinite(times)]
    if content.clock not in (Clock.LOCAL, Clock.DAY) or len(unclear):
        text = first_of(unclear)
        why = (
            f"{text!r} is not an offset such as +02:00"
            if text
            else "some rows have none"
            if len(unclear)
            else "the times need none"
        )
        content.notes.append(f"column {column.name} is not used: {why}")
        return times
    content.notes.append(f"UTC by column {column.name}")
    content.clock = Clock.UTC if content.clock is Clock.LOCAL else content.clock
    return times - ahead_s


def _counted(clock: Array, period_s: float, table: Table) -> Array:
    """Times (n,) of a clock that restarts after each day or hour, plus the days or hours begun, vehicle by vehicle."""
    times = clock.copy()
    for _, mask in vehicles_of(table):
        rows = np.flatnonzero(mask & np.isfinite(clock))
        times[rows[1:]] += period_s * _periods_begun(np.diff(clock[rows]), period_s)
    return times


def _periods_begun(steps: Array, period_s: float = _DAY_S) -> Array:
    """Number (n,) of days or hours that have begun after each step (s) of a clock.

    Rows from before and after midnight may be mixed.
    """
    begun = np.cumsum((steps < -_BACK_S).astype(float) - (steps > period_s - _BACK_S))
    count: Array = begun - np.minimum.accumulate(begun.clip(max=0.0))
    return count


def _past_midnight(clock: Array, day: Array, name: str, table: Table, content: LogContent) -> Array:
    """Dates (n,), s since 1970, of rows that all have one date, perhaps just that of the first row.

    Args:
        clock: Seconds of the day, (n,). If a vehicle's clock goes back only at midnight, days begin there.
        day: Seconds since 1970 of the dates, (n,).
        table: Its vehicles have rows of their own.
    """
    is_known, dates, turned = np.isfinite(clock + day), day.copy(), False
    for _, mask in vehicles_of(table):
        rows = np.flatnonzero(mask & is_known)
        steps = np.diff(clock[rows])
        turns = steps < -_BACK_S
        if not turns.any() or np.ptp(day[rows]) > 0.0 or (steps[turns] > _MIDNIGHT_S).any():
            continue
        dates[rows[1:]] += 86_400.0 * _periods_begun(steps)
        turned = True
    if turned:
        content.notes.append(f"column {name} has the first day's date after midnight, too; later days are counted")
    return dates


def _check_zones(
    texts: Sequence[str], times: Array, zoned: Sequence[str], column: Column, date_name: str, path: Path
) -> None:
    """Checks that all texts (n,) that are times (n,) state a zone, or none, unless the header does."""
    names = f"{column.name} {date_name}".lower()
    if not zoned or len(zoned) == len(texts) or "utc" in names or "gmt" in names:
        return
    count = sum(1 for text, time in zip(texts, times.tolist(), strict=True) if ":" in text and time == time)
    if len(zoned) < count:
        raise LogError(
            f"{path}: {len(zoned)} of {count} times in column {column.name} state a zone, such as {zoned[0][:40]!r}, "
            "the others none. Write the same zone after all of them"
        )


def _from_numbers(
    numbers: Array, column: Column, table: Table, options: ReadOptions, content: LogContent
) -> tuple[Clock, Array]:
    """Epochs, seconds of a day with a date, or seconds from a start."""
    low, unit_s = float(np.nanmin(numbers)), factor_of(column.unit, TIME_UNITS)
    if not unit_s and (counted := of_counts(numbers)):
        times, is_utc = counted
        is_utc = is_utc or "utc" in column.name.lower()
        return Clock.UTC if is_utc else Clock.LOCAL, times - header_zone_s(column.name)
    times = seconds(numbers)
    if unit_s and low * unit_s < UTC_FROM_S:
        times = numbers * unit_s
    if float(np.nanmin(times)) > 0.3 * UTC_FROM_S:
        if "gps" in column.name.lower():
            content.notes.append(
                f"column {column.name} is taken as seconds since 1970 (--date gives the first day, if it counts from "
                "1980 as GPS does)"
            )
        return Clock.UTC, times
    if has_date(table.columns) and float(np.nanmax(times)) <= 86_401.0:
        day, date_name = _days(table, options, content)
        if np.isfinite(day).mean() > 0.5:
            if not unit_s and float(np.nanmax(times)) <= 1.0:  # a share of the day, as spreadsheets have it
                times = times * 86_400.0
            name = f"{column.name} {date_name}".lower()
            day = _past_midnight(times, day, date_name, table, content)
            return (Clock.UTC if "utc" in name or "gps" in name else Clock.LOCAL), day + times - header_zone_s(name)
    return Clock.ELAPSED, times
