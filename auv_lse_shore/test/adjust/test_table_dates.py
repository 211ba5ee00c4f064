"""Dates and times of tables in several columns, in digits alone, around midnight, and with zones."""

from __future__ import annotations

import re

import numpy as np
import pytest
from adjust.survey_logs import START_S
from adjust.tables import ROWS, checked, gathered, lines, utc

from auv_lse_gp.tables.dialect import numbers_of
from auv_lse_shore.survey_import.parsing.times import days
from auv_lse_shore.survey_import.survey_log import LogError


def dated(header, form, ahead_s=0.0, ends=""):
    """A table whose columns of times have a form, by a clock that is ahead."""
    return lines(
        f"{header},lat,lon,depth",
        lambda t, a, o, d: f"{utc(t + ahead_s, form)}{ends},{a:.8f},{o:.8f},{d:.3f}",
    )


@pytest.mark.parametrize(
    ("header", "form"),
    [
        ("Year,Month,Day,Time", "%Y,%m,%d,%H:%M:%S"),
        ("Day,Month,Year,UTC", "%d,%m,%Y,%H%M%S"),
        ("year,month,date,time", "%Y,%m,%Y-%m-%d,%H:%M:%S"),
        ("date,time", "%Y-%m-%d,%H%M"),
        ("date,time (hhmm)", "%d.%m.%Y,%H%M"),
        ("time", "%Y-%m-%d %H%M"),
        ("YYYY,MM,DD,HH,MM,SS", "%Y,%m,%d,%H,%M,%S"),
        ("DD,MM,YYYY,HH,MM,SS", "%d,%m,%Y,%H,%M,%S"),
        ("MM,DD,YY,hh,mm,ss", "%m,%d,%y,%H,%M,%S"),
        ("yr,mo,d,h,m,s", "%y,%m,%d,%H,%M,%S"),
        ("date,hh,mm,ss", "%Y-%m-%d,%H,%M,%S"),
        ("date,h,m,s", "%Y-%m-%d,%H,%M,%S"),
        ("Year,DayOfYear,Hour,Minute,Second", "%Y,%j,%H,%M,%S"),
        ("Year,DOY,Time", "%Y,%j,%H:%M:%S"),
        ("Year,JulianDay,date,time", "%Y,2461164,%Y-%m-%d,%H:%M:%S"),
        ("year,julian day,time (UTC)", "%Y,%j,%H%M%S"),
        ("time", "%Y%m%d%H%M%S"),
        ("time", "%Y%m%d%H%M%S.00"),
        ("timestamp_utc", "%Y%m%d_%H%M%S"),
        ("timestamp_utc", "%Y%m%d-%H%M%S"),
        ("timestamp_utc", "%Y:%m:%d %H:%M:%S"),
    ],
)
def test_dates_and_times_in_several_columns_and_in_digits_alone(tmp_path, header, form):
    found = gathered(tmp_path, dated(header, form))
    checked(found)
    assert ("not used" in found.lines[0]) == header.endswith(",date,time")


def test_hours_with_a_fraction_and_seconds_of_the_day_follow_a_day_of_the_year(tmp_path):
    for header, unit_s in (("Year,DayOfYear,Hour", 3600.0), ("Year,DayOfYear,time_s", 1.0)):
        data = lines(
            f"{header},lat,lon,depth",
            lambda t, a, o, d, unit_s=unit_s: f"{utc(t, '%Y,%j')},{t % 86400 / unit_s:.7f},{a:.8f},{o:.8f},{d:.3f}",
        )
        checked(gathered(tmp_path, data))


@pytest.mark.parametrize("header", ["time,mm", "dd,time", "time,h", "time,m", "time,s,m", "time,year,mm"])
def test_letters_that_follow_no_part_of_a_date_are_other_columns(tmp_path, header):
    names = header.split(",")
    row = ",".join("%Y-%m-%dT%H:%M:%SZ" if name == "time" else "2026" if name == "year" else "7" for name in names)
    checked(gathered(tmp_path, dated(header, row)))


def test_an_underscore_is_no_part_of_a_number():
    assert np.isnan(numbers_of(["1_000", "12"], False)).tolist() == [True, False]
    assert np.isnan(numbers_of(["1_000,5", "12,5"], True)).tolist() == [True, False]


@pytest.mark.parametrize("form", ["%d.%m.%Y,%H:%M:%S", "%d.%m.%y,%H:%M:%S"])
def test_dates_with_dots_begin_with_the_day(tmp_path, form):
    found = gathered(tmp_path, dated("date,time", form))
    checked(found)
    assert "--day-first" in found.lines[0]
    checked(gathered(tmp_path, dated("date,time", form), "--no-day-first"), starts=None)


def of_day(order=lambda rows: rows, blank=-1, vehicles=1):
    """Times of day over midnight without a date, from 23:59."""
    rows = ROWS + np.array([86_340.0 - START_S % 86_400.0, 0.0, 0.0, 0.0])
    cells = [
        f"{utc(t, '%H:%M:%S') if i != blank else ''},{k},{a:.8f},{o + 0.01 * k:.8f},{d:.3f}"
        for k in range(vehicles)
        for i, (t, a, o, d) in enumerate(rows)
    ]
    return "\n".join(["time,vehicle,lat,lon,depth", *order(cells)]) + "\n"


def swapped(cells):
    """Every fifth row before the one above it."""
    for i in range(5, len(cells), 5):
        cells[i - 1], cells[i] = cells[i], cells[i - 1]
    return cells


@pytest.mark.parametrize("order", [lambda cells: cells, swapped])
def test_rows_out_of_order_around_a_midnight_without_a_date_are_of_one_night(tmp_path, order):
    checked(gathered(tmp_path, of_day(order), "--date", "2026-05-03"), starts=START_S - START_S % 86_400.0 + 86_340.0)


def test_an_empty_time_of_day_is_no_midnight(tmp_path):
    found = gathered(tmp_path, of_day(blank=30), "--date", "2026-05-03")
    checked(found, count=119, starts=START_S - START_S % 86_400.0 + 86_340.0)
    assert np.ptp(found.placed[0].soundings[:, 0]) == pytest.approx(119.0)


def test_midnights_of_two_vehicles_one_after_the_other_are_counted_for_each(tmp_path):
    found = gathered(tmp_path, of_day(vehicles=2), "--date", "2026-05-03")
    assert [np.ptp(log.soundings[:, 0]) for log in found.placed] == pytest.approx([119.0, 119.0])
    assert len({log.soundings[0, 0] for log in found.placed}) == 1


def test_a_time_of_day_that_turns_back_is_of_the_next_day(tmp_path):
    hours = {True: 7_200.0, False: 0.0}
    data = lines(
        "time,lat,lon,depth",
        lambda t, a, o, d: f"{utc(t + hours[t < START_S + 60], '%H:%M:%S')},{a:.8f},{o:.8f},{d:.3f}",
    )
    found = gathered(tmp_path, data, "--date", "2026-05-03")
    assert np.ptp(found.placed[0].soundings[:, 0]) == pytest.approx(86_400.0 - 7_200.0 + 119.0)


@pytest.mark.parametrize(
    ("header", "cell", "ahead_s"),
    [
        ("UTC offset", "+2", 7_200.0),
        ("tz", "+02:00", 7_200.0),
        ("timezone", "UTC+2", 7_200.0),
        ("Time Zone", "GMT-07:00", -25_200.0),
        ("utc_offset_hours", "5.5", 19_800.0),
        ("UTC offset (min)", "-210", -12_600.0),
        ("utc_offset_s", "7200", 7_200.0),
        ("gmt_offset", "+0545", 20_700.0),
        ("gmt_offset", '"+2,0"', 7_200.0),
        ("tz", "UTC", 0.0),
        ("tz", "Z", 0.0),
    ],
)
def test_a_column_of_offsets_turns_local_times_into_utc(tmp_path, header, cell, ahead_s):
    for columns, form in ((f"time,{header}", "%Y-%m-%d %H:%M:%S"), (f"date,time,{header}", "%Y-%m-%d,%H:%M:%S")):
        found = gathered(tmp_path, dated(columns, form, ahead_s, f",{cell}"))
        checked(found)
        assert not any("question" in line for line in found.lines)
        assert f"UTC by column {header}" in found.lines[0]


@pytest.mark.parametrize("cell", ["CEST", "Europe/Zurich", "120", "", "+99"])
def test_a_zone_that_is_no_offset_is_named(tmp_path, cell):
    found = gathered(tmp_path, dated("time,tz", "%Y-%m-%d %H:%M:%S", 7_200.0, f",{cell}"))
    checked(found, starts=START_S + 7_200.0)
    assert any("--utc-offset" in line for line in found.lines)
    assert "column tz is not used" in found.lines[0]


def test_an_offset_beside_times_in_utc_is_not_used(tmp_path):
    found = gathered(tmp_path, dated("time_utc,utc_offset", "%Y-%m-%d %H:%M:%S", 0.0, ",+2"))
    checked(found)
    assert "column utc_offset is not used" in found.lines[0]


@pytest.mark.parametrize("zone", ["+02:00", "+0200", "+02", " +02:00"])
def test_times_of_day_may_state_their_zone(tmp_path, zone):
    found = gathered(tmp_path, dated("date,time", "%Y-%m-%d,%H:%M:%S", 7_200.0, zone))
    checked(found)
    assert not any("question" in line for line in found.lines)


def test_only_some_times_of_day_with_a_zone_are_refused(tmp_path):
    data = dated("date,time", "%Y-%m-%d,%H:%M:%S", 7_200.0).replace("12:01:00", "12:01:00+02:00")
    with pytest.raises(LogError, match="1 of 120 times in column time state a zone"):
        gathered(tmp_path, data)


@pytest.mark.parametrize(
    ("header", "cells"),
    [
        ("Date,Time", lambda t: f"{t // 86_400.0 + 25_569:.0f},{t % 86_400.0 / 86_400.0:.9f}"),
        ("Date,Time", lambda t: f"{t // 86_400.0 + 25_569:.0f},{utc(t, '%H:%M:%S')}"),
        ("Date,Time", lambda t: f"{utc(t, '%Y-%m-%d')},{t % 86_400.0 / 86_400.0:.9f}"),
        ("Year,Month,Day,Time", lambda t: utc(t, "%Y,%b,%d,%H:%M:%S")),
        ("Year,Month,Day,Hour,Minute,Second", lambda t: utc(t, "%Y,%B,%d,%H,%M,%S")),
    ],
)
def test_dates_and_times_of_spreadsheets(tmp_path, header, cells):
    data = lines(f"{header},lat,lon,depth", lambda t, a, o, d: f"{cells(t)},{a:.8f},{o:.8f},{d:.3f}")
    checked(gathered(tmp_path, data))


@pytest.mark.parametrize("date", ["30526", "50326", "40125", "12345"])
def test_five_digits_that_may_be_a_date_without_signs_are_none(date):
    assert np.isnan(days([date], None)[0]).all()


def test_times_whose_leading_zero_a_spreadsheet_removed(tmp_path):
    def row(t, a, o, d):
        return f"{utc(t, '%Y%m%d')},{int(utc(t - 3_570.0, '%H%M%S'))},{a:.8f},{o:.8f},{d:.3f}"

    checked(gathered(tmp_path, lines("date,time,lat,lon,depth", row)), starts=START_S - 3_570.0)


@pytest.mark.parametrize(("start_s", "unit"), [(9_950.0, 1.0), (35_970.0, 1.0), (1_000.0, 1.0), (20_000.0, 1_000.0)])
def test_digits_that_count_up_are_seconds(tmp_path, start_s, unit):
    data = lines(
        "date,time,lat,lon,depth" if unit == 1.0 else "time_ms,lat,lon,depth",
        lambda t, a, o, d: (
            f"{'2026-05-03,' if unit == 1.0 else ''}{(t - START_S) * unit + start_s:.0f},{a:.8f},{o:.8f},{d:.3f}"
        ),
    )
    found = gathered(tmp_path, data, *([] if unit == 1.0 else ["--date", "2026-05-03"]))
    checked(found, starts=None)
    assert np.ptp(found.placed[0].soundings[:, 0]) == pytest.approx(119.0)


def test_a_local_time_beside_a_date_in_utc_is_local(tmp_path):
    data = lines(
        "utc_date,local_time,lat,lon,depth",
        lambda t, a, o, d: f"{utc(t, '%Y-%m-%d')},{utc(t + 7_200.0, '%H:%M:%S')},{a:.8f},{o:.8f},{d:.3f}",
    )
    assert any("--utc-offset" in line for line in gathered(tmp_path, data).lines)
    checked(gathered(tmp_path, data, "--utc-offset", "2"))


@pytest.mark.parametrize("step_s", [0.5, 0.1])
@pytest.mark.parametrize("header", ["time", "elapsed"])
def test_seconds_with_fractions_are_no_days_of_a_spreadsheet(tmp_path, header, step_s):
    def row(t, a, o, d):
        return f"{36_000.5 + (t - START_S) * step_s:.1f},{a:.8f},{o:.8f},{d:.3f}"

    found = gathered(tmp_path, lines(f"{header},lat,lon,depth", row), "--date", "2026-05-03T10:00:00Z")
    assert np.ptp(found.placed[0].soundings[:, 0]) == pytest.approx(119.0 * step_s, abs=1.0)
    dated_rows = lines(f"date,{header},lat,lon,depth", lambda *r: f"2026-05-03,{row(*r)}")
    assert gathered(tmp_path, dated_rows).placed[0].soundings[0, 0] == pytest.approx(START_S + 0.5, abs=0.5)


@pytest.mark.parametrize(
    ("header", "first_day"),
    [("time", 719_529.0), ("datenum", 719_529.0), ("jd", 2_440_587.5), ("time", 40_587.0), ("mjd", 40_587.0),
     ("time", 25_569.0), ("time_utc", 25_569.0)],
)  # fmt: skip
def test_days_count_from_the_beginnings_that_programs_have(tmp_path, header, first_day):
    def row(t, a, o, d):
        return f"{t / 86_400.0 + first_day:.9f},{a:.8f},{o:.8f},{d:.3f}"

    checked(gathered(tmp_path, lines(f"{header},lat,lon,depth", row)))


@pytest.mark.parametrize("form", ["%Hh%M", "%Hh%Mm%Ss", "%d/%m/%Y %Hh%M", "%d/%m/%Y %Hh%M:%S"])
def test_hours_may_end_with_h(tmp_path, form):
    data = lines("heure;lat;lon;depth", lambda t, a, o, d: f"{utc(t, form)};{a:.8f};{o:.8f};{d:.3f}")
    facts = ["--day-first"] if "%Y" in form else ["--date", "2026-05-03"]
    assert gathered(tmp_path, data, *facts).placed[0].soundings[0, 0] == pytest.approx(START_S, abs=1.0)


@pytest.mark.parametrize("zone", ["CEST", "PDT", "CST"])
@pytest.mark.parametrize(
    "form", ["%Y-%m-%d %H:%M:%S", "%m/%d/%Y %I:%M:%S %p", "%H:%M:%S", "%a %b %d %H:%M:%S {zone} %Y"]
)
def test_a_time_behind_which_a_zone_is_named_is_local(tmp_path, form, zone):
    form = form.replace("{zone}", zone) if "{" in form else f"{form} {zone}"
    data = lines("time,lat,lon,depth", lambda t, a, o, d: f"{utc(t + 7_200, form)},{a:.8f},{o:.8f},{d:.3f}")
    date = [] if "%Y" in form else ["--date", "2026-05-03"]
    found = gathered(tmp_path, data, "--utc-offset", "2", "--no-day-first", *date)
    checked(found)
    assert f"the zone {zone} is not read" in found.lines[0]
    if not date:
        assert any("--utc-offset" in line for line in gathered(tmp_path, data, "--no-day-first").lines)


def test_the_name_of_a_month_is_no_zone(tmp_path):
    data = lines("time,lat,lon,depth", lambda t, a, o, d: f"{utc(t, '%d-%b-%Y %H:%M:%S GMT')},{a:.8f},{o:.8f},{d:.3f}")
    assert "zone" not in "".join(gathered(tmp_path, data).lines)


@pytest.mark.parametrize(("first_s", "decimals"), [(0.0, 1), (1_400.0, 0), (3_550.0, 1), (3_550.0, 0)])
def test_minutes_and_seconds_without_hours(tmp_path, first_s, decimals):
    def row(t, a, o, d):
        minutes, seconds = divmod((first_s + 0.25 + t - START_S) % 3_600.0, 60.0)
        return f"{minutes:02.0f}:{seconds // 1:02.0f}{'.2' * decimals},{a:.8f},{o:.8f},{d:.3f}"

    data = lines("time,lat,lon,depth", row)
    assert any("--date" in line for line in gathered(tmp_path, data).lines)
    found = gathered(tmp_path, data, "--date", "2026-05-03T10:00:00Z")
    checked(found)
    assert np.ptp(found.placed[0].soundings[:, 0]) == pytest.approx(119.0)


def test_hours_and_minutes_stay_such(tmp_path):
    data = lines("time,lat,lon,depth", lambda t, a, o, d: f"{utc(t, '%H:%M')},{a:.8f},{o:.8f},{d:.3f}")
    checked(gathered(tmp_path, data, "--date", "2026-05-03"), starts=None)
    assert "no hours" not in gathered(tmp_path, data).lines[0]


@pytest.mark.parametrize(("header", "scale"), [("GPS_Week,TOW", 1.0), ("gps_week,gps_sec", 1.0), ("GWk,GMS", 1e3)])
def test_gps_weeks_and_their_seconds(tmp_path, header, scale):
    def row(t, a, o, d):
        week, of_week = divmod(t + 18.0 - 315_964_800.0, 604_800.0)
        return f"{week:.0f},{of_week * scale:.0f},{a:.8f},{o:.8f},{d:.3f}"

    found = gathered(tmp_path, lines(f"{header},lat,lon,depth", row))
    checked(found)
    assert not any("columns not used" in line or "question" in line for line in found.lines)
    alone = lines("week,lat,lon,depth,time", lambda t, a, o, d: f"19,{a:.8f},{o:.8f},{d:.3f},{utc(t)}Z")
    found = gathered(tmp_path, alone)
    checked(found)
    assert "columns not used: week" in found.lines[0]


def test_days_of_the_year_may_have_the_time_as_their_fraction(tmp_path):
    def row(t, a, o, d):
        return f"2026,{(t - 1_767_225_600.0) / 86_400.0 + 1.0:.8f},{a:.8f},{o:.8f},{d:.3f}"

    checked(gathered(tmp_path, lines("year,doy,lat,lon,depth", row)))


@pytest.mark.parametrize(
    "count", [lambda t: t + 2_082_844_800, lambda t: (t + 11_644_473_600) * 1e7, lambda t: (t + 62_135_596_800) * 1e7]
)
def test_counts_of_labview_and_windows(tmp_path, count):
    data = lines("time,lat,lon,depth", lambda t, a, o, d: f"{count(t):.0f},{a:.8f},{o:.8f},{d:.3f}")
    checked(gathered(tmp_path, data))


@pytest.mark.parametrize(("header", "asks"), [("gps_time", True), ("GPSTime", True), ("time", False)])
def test_seconds_of_gps_may_count_from_1980(tmp_path, header, asks):
    def row(t, a, o, d):
        return f"{t - 315_964_800.0 * asks:.0f},{a:.8f},{o:.8f},{d:.3f}"

    data = lines(f"{header},lat,lon,depth", row)
    assert any("1980 as GPS does" in line for line in gathered(tmp_path, data).lines) is asks
    if asks:
        checked(gathered(tmp_path, data, "--date", "2026-05-03"))


def test_stamps_of_ros_messages(tmp_path):
    header = "header.stamp.sec,header.stamp.nanosec,latitude,longitude,depth"
    checked(gathered(tmp_path, lines(header, lambda t, a, o, d: f"{t:.0f},5,{a:.8f},{o:.8f},{d:.3f}")))


@pytest.mark.parametrize(("hour", "step_min"), [(8, 1.0 / 60.0), (14, 1.0 / 60.0), (14, 1.01)])
def test_hours_and_minutes_in_one_number_have_fractions_of_a_minute(tmp_path, hour, step_min):
    def row(t, a, o, d):
        minutes = (t - START_S) * step_min + 60.0 * hour + 15.0
        return f"20260614,{minutes // 60.0:02.0f}{minutes % 60.0:06.3f},{a:.8f},{o:.8f},{d:.3f}"

    found = gathered(tmp_path, lines("DATE,TIME,LAT,LON,DEPTH", row))
    checked(found, starts=None)
    assert utc(found.placed[0].soundings[0, 0]) == f"2026-06-14T{hour:02d}:15:00"


@pytest.mark.parametrize("name", ["Uhrzeit (MESZ)", "Time PDT", "time [CEST]"])
def test_the_name_of_a_zone_in_a_header_is_reported_as_not_read(tmp_path, name):
    def row(t, a, o, d):
        return f"{utc(t, '%Y-%m-%d')},{utc(t, '%H:%M:%S')},{a:.8f},{o:.8f},{d:.3f}"

    found = gathered(tmp_path, lines(f"Date,{name},lat,lon,depth", row))
    checked(found)
    assert re.search(r"the zone (MESZ|PDT|CEST) is not read", found.lines[0])
    assert any("--utc-offset" in line for line in found.lines)
    assert "is not read" not in gathered(tmp_path, lines("Date,START TIME UT,lat,lon,depth", row)).lines[0]
