"""The times of a table's rows: from columns of epochs, dates, and times of day or from a start."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from auv_lse_gp.length_units import factor_of
from auv_lse_shore.survey_import.log_content import Clock, LogContent
from auv_lse_shore.survey_import.log_file import ReadOptions
from auv_lse_shore.survey_import.parsing.columns import DATE_PARTS, Column, Table, first_of, has_date_parts, vehicles_of
from auv_lse_shore.survey_import.parsing.dialect import numbers_of
from auv_lse_shore.survey_import.parsing.times import (
    UTC_FROM_S,
    are_six_digits,
    datetimes,
    days,
    full_year,
    header_zone_s,
    of_day_s,
    seconds,
    zoned_of,
)
from auv_lse_shore.survey_import.parsing.units import TIME_UNITS
from auv_lse_shore.survey_import.survey_log import LogError

Array = NDArray[np.float64]

#: A clock that goes back by more than this (s) has passed midnight, or rows are in another order; by this, midnight.
_BACK_S, _MIDNIGHT_S = 60.0, -82_800.0

#: A half of the day at the end of a time.
_HALF_DAY = re.compile(r"[ap]\.?m\.?\s*$", re.IGNORECASE)

_ORDER_NOTE = "it is unclear whether dates begin with the day or the month: see --day-first"
#: Number of times, spread over a table, by which their notation is recognized.
_SAMPLED = 1000


def times_of(table: Table, options: ReadOptions, content: LogContent) -> Array:
    """Times (s), NaN where missing; sets the content's clock."""
    best: tuple[Clock, Array] | None = None
    options.used.add("day_first")
    order = (Clock.UTC, Clock.LOCAL, Clock.DAY, Clock.ELAPSED)
    candidates = [role for role in table.columns if role.startswith("datetime")]
    if has_date_parts(table.columns):
        best = _from_parts(table, options, content)
    for role in candidates or ["date"] * ("date" in table.columns and best is None):
        found = _time(table, role, options, content)
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
    known = times[np.isfinite(times)]
    is_whole = bool(len(known)) and bool((known % 1.0 == 0.0).all())
    content.lag_std_s = 1.0 / np.sqrt(12.0) if is_whole else 0.1
    return times


def _time(table: Table, role: str, options: ReadOptions, content: LogContent) -> tuple[Clock, Array] | None:
    """A column of times with its clock; None if it holds none."""
    column, texts = table.columns[role], table.values[role].tolist()
    if "half_day" in table.columns:
        halves = table.values["half_day"].tolist()
        lacks = [":" in text and not _HALF_DAY.search(text) for text in texts]
        texts = [f"{text} {half}" if lack else text for text, half, lack in zip(texts, halves, lacks, strict=True)]
    first = next((text for text in texts if text.strip()), "")
    if not first:
        return None
    is_utc = any(word in column.name.lower() for word in ("utc", "gmt", "gps", "epoch", "unix"))
    is_utc = is_utc or first.strip().endswith(("Z", "UTC", "GMT"))
    sample = texts[:: len(texts) // _SAMPLED + 1]
    date_of = table.columns.get("date")
    is_of_day = are_six_digits(sample) and column.unit not in TIME_UNITS
    if not is_of_day and np.isfinite(numbers_of(sample, table.decimal_comma)).mean() > 0.5:
        return _from_numbers(numbers_of(texts, table.decimal_comma), column, table, options, content)
    if np.isfinite(of_day_s(sample)).mean() > 0.5:
        clock = of_day_s(texts)
        _check_zones(texts, clock, zoned_of(texts), column, date_of or column, table.path)
        day, assumed = days(table.values["date"].tolist() if date_of else [], options.day_first)
        if date_of is None or not np.isfinite(day).any():
            if date_of is not None:
                content.notes.append(
                    f"column {date_of.name} is ignored: {first_of(table.values['date'])!r} is not a date"
                )
            clock -= header_zone_s(column.name)
            return Clock.DAY, clock + 86_400.0 * np.append(0.0, np.cumsum(np.diff(np.nan_to_num(clock)) < -60.0))
        day = _past_midnight(clock, day, table, content)
        is_utc = is_utc or "utc" in date_of.name.lower()
        has_zone, stamps = False, day + clock - header_zone_s(f"{column.name} {date_of.name}")
    else:
        stamps, zoned, assumed = datetimes(texts, options.day_first)
        _check_zones(texts, stamps, zoned, column, column, table.path)
        has_zone = bool(zoned)
        if not np.isfinite(stamps).mean() > 0.5:
            return None
        stamps = stamps if has_zone else stamps - header_zone_s(column.name)
    if assumed:
        content.notes.append(_ORDER_NOTE)
    return (Clock.UTC if has_zone or is_utc else Clock.LOCAL), stamps


def _from_parts(table: Table, options: ReadOptions, content: LogContent) -> tuple[Clock, Array] | None:
    """Times from columns of dates or years, months and days, and of hours, minutes, seconds; None if they hold none."""
    dates = table.values["date"].tolist()
    if "year" in table.columns and "month" in table.columns:
        parts = (table.values["year"], table.values["month"], numbers_of(dates, table.decimal_comma))
        ymd = [np.nan_to_num(part, nan=-1.0) for part in parts]
        dates = [
            f"{full_year(int(year))}-{month:.0f}-{of_month:.0f}" if year >= 0.0 else ""
            for year, month, of_month in zip(*ymd, strict=True)
        ]
    stamps, assumed = days(dates, options.day_first)
    content.notes += [_ORDER_NOTE] * assumed
    for role, unit_s in (("hour", 3600.0), ("minute", 60.0), ("second", 1.0)):
        stamps = stamps + unit_s * table.values.get(role, 0.0)
    if "half_day" in table.columns and "hour" in table.columns:
        halves, hours = np.char.lower(np.char.strip(table.values["half_day"])), table.values["hour"]
        stamps = stamps + 3600.0 * (12.0 * (np.char.startswith(halves, "p") & (hours < 12.0)))
        stamps = stamps - 3600.0 * (12.0 * (np.char.startswith(halves, "a") & (hours >= 12.0)))
    name = " ".join(table.columns[role].name.lower() for role in ("date", *DATE_PARTS) if role in table.columns)
    stamps, is_utc = stamps - header_zone_s(name), "utc" in name
    return ((Clock.UTC if is_utc else Clock.LOCAL), stamps) if np.isfinite(stamps).any() else None


def _past_midnight(clock: Array, day: Array, table: Table, content: LogContent) -> Array:
    """Dates (n,), s since 1970, of rows with one date in all of them, which may be that of the first row.

    Args:
        clock: Seconds of the day, (n,). If only midnights turn a vehicle's back, days begin there.
        day: Seconds since 1970 of the dates, (n,).
        table: Its vehicles have rows of their own.
        content: Takes a note.
    """
    is_known, dates, turned = np.isfinite(clock + day), day.copy(), False
    for _, mask in vehicles_of(table):
        rows = np.flatnonzero(mask & is_known)
        steps = np.diff(clock[rows])
        turns = steps < -_BACK_S
        if not turns.any() or np.ptp(day[rows]) > 0.0 or (steps[turns] > _MIDNIGHT_S).any():
            continue
        # a row of before midnight between others of after it
        begun = np.cumsum(turns.astype(int) - (steps > 86_400.0 - _BACK_S))
        dates[rows[1:]] += 86_400.0 * (begun - np.minimum.accumulate(begun.clip(max=0)))
        turned = True
    if turned:
        name = table.columns["date"].name
        content.notes.append(f"column {name} has the first day's date after midnight, too; later days are counted")
    return dates


def _check_zones(
    texts: Sequence[str], times: Array, zoned: Sequence[str], column: Column, date_of: Column, path: Path
) -> None:
    """Checks that all texts (n,) that are times (n,) state a zone, or none, unless the header does.

    Raises:
        LogError: if only some do.
    """
    names = f"{column.name} {date_of.name}".lower()
    if not zoned or len(zoned) == len(texts) or "utc" in names or "gmt" in names:
        return
    count = sum(1 for text, time in zip(texts, times.tolist(), strict=True) if ":" in text and time == time)
    if len(zoned) < count:
        raise LogError(
            f"{path}: {len(zoned)} of {count} times in column {column.name} state a zone, such as {zoned[0][:40]!r}, "
            "the others none. Write the same zone behind all of them"
        )


def _from_numbers(
    numbers: Array, column: Column, table: Table, options: ReadOptions, content: LogContent
) -> tuple[Clock, Array]:
    """Epochs, seconds of a day with a date, or seconds from a start."""
    low, unit_s = float(np.nanmin(numbers)), factor_of(column.unit, TIME_UNITS)
    if (
        low > 25_569.0 and float(np.nanmax(numbers)) < 80_000.0 and not unit_s and (numbers % 1.0 != 0.0).any()
    ):  # days of a spreadsheet since 1899-12-30
        days_s = (numbers - 25_569.0) * 86_400.0 - header_zone_s(column.name)
        return Clock.UTC if "utc" in column.name.lower() else Clock.LOCAL, days_s
    times = seconds(numbers)
    if unit_s and low * unit_s < UTC_FROM_S:
        times = numbers * unit_s
    if float(np.nanmin(times)) > 0.3 * UTC_FROM_S:
        return Clock.UTC, times
    if "date" in table.columns and float(np.nanmax(times)) <= 86_401.0:
        day, _ = days(table.values["date"].tolist(), options.day_first)
        if np.isfinite(day).mean() > 0.5:
            name = f"{column.name} {table.columns['date'].name}".lower()
            day = _past_midnight(times, day, table, content)
            return (Clock.UTC if "utc" in name or "gps" in name else Clock.LOCAL), day + times - header_zone_s(name)
    return Clock.ELAPSED, times
