"""Positions and dates of tables whose parts cannot be what they seem, or say the same twice."""

from __future__ import annotations

import codecs
from datetime import date

import numpy as np
import pytest
from adjust.survey_logs import START_S
from adjust.tables import ROWS, checked, gathered, lines, utc

from auv_lse_shore.survey_import.parsing.times import dates_of_digits, days, of_gps_weeks
from auv_lse_shore.survey_import.survey_log import LogError


def test_more_than_60_minutes_are_no_position(tmp_path):
    def row(t, a, o, d):
        minutes = 60.0 * (a % 1.0)
        return f"46,{minutes + 40.0 if t > START_S + 99 else minutes:.6f},{o:.8f},{d:.3f},{utc(t)}"

    found = gathered(tmp_path, lines("lat,lat_min,lon,depth,utc", row))
    assert found.placed[0].left_out["positions that are not numeric"] == 20
    checked(found, count=100)


def test_degrees_and_minutes_in_one_number_have_less_than_60_minutes(tmp_path):
    def row(t, a, o, d):
        bad = t > START_S + 109
        return (
            f"{4600.0 + 60.0 * (a % 1.0) + (40.0 if bad else 0.0):.6f},{600.0 + 60.0 * (o % 1.0):.6f},{d:.3f},{utc(t)}"
        )

    found = gathered(tmp_path, lines("lat,lon,depth,utc", row))
    assert found.placed[0].left_out["positions that are not numeric"] == 10
    checked(found, count=110)


def test_numbers_with_more_than_60_minutes_are_no_degrees_and_minutes(tmp_path):
    data = lines(
        "lat,lon,depth,utc", lambda t, a, o, d: f"{4660.0 + 60.0 * (a % 1.0):.6f},{670.0 + o:.6f},{d:.3f},{utc(t)}"
    )
    with pytest.raises(LogError, match=r"latitudes such as 46.* are no degrees"):
        gathered(tmp_path, data)


def test_a_sign_beside_a_hemisphere_counts_once(tmp_path):
    rows = lines("lat,lat_dir,lon,lon_dir,depth,utc", lambda t, a, o, d: f"-{a:.8f},S,{o:.8f},E,{d:.3f},{utc(t)}")
    found = gathered(tmp_path, rows, "--origin", "-46.5", "6.6")
    assert found.placed[0].soundings[:, 1].mean() == pytest.approx(0.0, abs=1000.0)
    assert len(found.placed[0].soundings) == 120


def test_decimal_commas_of_one_column_are_read_beside_decimal_points_of_others(tmp_path):
    """A logger's depths, joined by a program to its positions."""

    def row(t, a, o, d):
        return f"{o:.9f};{a:.9f};{f'{d:.2f}'.replace('.', ',')};{utc(t)}"

    with pytest.raises(LogError, match=r"like: --columns lat,lon,depth,datetime, or lon,lat,depth,datetime if"):
        gathered(tmp_path, lines("", row).lstrip("\n"))
    found = gathered(tmp_path, lines("", row).lstrip("\n"), "--columns", "lon,lat,depth,utc")
    checked(found, count=120)


@pytest.mark.parametrize(
    ("text", "same"), [("14-Jun-85", "1985-06-14"), ("14-Jun-25", "2025-06-14"), ("1 Jan 80", "1980-01-01")]
)
def test_a_year_of_two_digits_is_one_of_1980_to_2079(text, same):
    assert days([text], None)[0] == pytest.approx(days([same], None)[0])


def test_a_byte_order_mark_before_a_file_of_another_program_is_none(tmp_path):
    with pytest.raises(LogError, match="is XML or a web page"):
        gathered(
            tmp_path, codecs.BOM_UTF8 + b"<?xml version='1.0'?>\n<survey lat,lon,depth>\n1,2,3\n4,5,6\n</survey>\n"
        )


@pytest.mark.parametrize("header", ["Breite [Grad];Laenge [Grad]", "Lat grad;Lon grad"])
def test_grad_is_the_german_word_for_degrees(tmp_path, header):
    data = lines(f"{header};Tiefe [m];utc", lambda t, a, o, d: f"{a:.8f};{o:.8f};{d:.3f};{utc(t)}")
    found = gathered(tmp_path, data)
    checked(found)
    assert "not understood" not in found.lines[0]


@pytest.mark.parametrize("form", ["%I:%M:%S %p", "%H:%M:%S", "%I:%M:%Sp.m."])
def test_a_column_of_am_and_pm_beside_times_that_have_them_counts_once(tmp_path, form):
    def row(t, a, o, d):
        return f"{utc(t, '%Y-%m-%d')},{utc(t + 43_200.0, form)},{utc(t + 43_200.0, '%p')},{a:.8f},{o:.8f},{d:.3f}"

    checked(gathered(tmp_path, lines("date,time,AM/PM,lat,lon,depth", row)), starts=START_S + 43_200.0)


@pytest.mark.parametrize(
    ("header", "form", "ahead_h"),
    [
        ("Date,Hour,Min,Sec", "%Y-%m-%d,%H,%M,%S", 0.0),
        ("date,hh,min,ss", "%Y-%m-%d,%H,%M,%S", 0.0),
        ("Year,Month,Day,Hour,Minute,Second", "%y,%m,%d,%H,%M,%S", 0.0),
        ("Date,Hour,Minute,Second,AM/PM", "%Y-%m-%d,%I,%M,%S,%p", 0.0),
        ("Date,Hour (UTC+2),Minute,Second", "%Y-%m-%d,%H,%M,%S", 2.0),
    ],
)
def test_parts_of_times_have_two_digits_halves_of_days_and_zones(tmp_path, header, form, ahead_h):
    def row(t, a, o, d):
        return f"{utc(t + 43_200.0 + 3600.0 * ahead_h, form)},{a:.8f},{o:.8f},{d:.3f}"

    found = gathered(tmp_path, lines(f"{header},lat,lon,depth", row))
    checked(found, starts=START_S + 43_200.0)
    assert "not used" not in found.lines[0]
    assert ("have no zone" in "\n".join(found.lines)) == (not ahead_h)


def test_hours_and_seconds_without_a_column_of_minutes_are_no_times(tmp_path):
    def row(t, a, o, d):
        return f"{utc(t, '%Y-%m-%d,%H,%M,%S')},{a:.8f},{o:.8f},{d:.3f}"

    found = gathered(tmp_path, lines("date,hour,foo,second,lat,lon,depth", row))
    checked(found, starts=None)
    assert "columns not used: hour, foo, second;" in found.lines[0]


def test_midnights_under_one_date_are_counted_for_each_vehicle(tmp_path):
    def rows(vehicle, first_s, north_deg):
        times = [first_s + (t - START_S) * 700.0 for t, *_ in ROWS[:120]]
        return [
            f"2026-06-14,{utc(s, '%H:%M:%S')},{vehicle},{a + north_deg:.8f},{o:.8f},{d:.3f}"
            for s, (_, a, o, d) in zip(times, ROWS[:120], strict=True)
        ]

    day_s = START_S // 86_400.0 * 86_400.0
    both = [*rows("A", day_s + 600.0, 0.0), *rows("B", day_s + 600.0, 0.01)]
    found = gathered(tmp_path, "\n".join(["date,time,vehicle,lat,lon,depth", *both]))
    first, second = (log.soundings[:, 0] for log in found.placed)
    assert first[0] == second[0]


def test_a_height_above_the_bottom_that_follows_the_depth_is_that_of_a_boat(tmp_path):
    data = lines(
        "lat,lon,depth,distance to bottom,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{d - 0.4:.2f},{utc(t)}"
    )
    found = gathered(tmp_path, data)
    checked(found)
    assert "column distance to bottom is not added: it follows the depth" in found.lines[0]


def test_one_negative_number_among_depths_marks_missing_echoes(tmp_path):
    data = lines("lat,lon,depth,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{'-1' if t % 20 else f'{d:.3f}'},{utc(t)}")
    found = gathered(tmp_path, data)
    checked(found, count=6, starts=None)


def test_negative_depths_may_have_missing_echoes_of_0(tmp_path):
    data = lines("lat,lon,depth,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{-d if t % 4 else 0.0:.3f},{utc(t)}")
    checked(gathered(tmp_path, data), count=90, starts=None)


def test_seven_digits_are_a_day_of_a_year_only_in_a_year_of_surveys():
    assert days(["2025165"], None)[0] == pytest.approx(days(["2025-06-14"], None)[0])
    assert days(["1062025"], None)[0] != pytest.approx(days(["1062-01-25"], None)[0])


def test_positions_with_standard_deviations_may_all_be_missing(tmp_path):
    data = lines("lat,lon,depth,utc,north_std_m,east_std_m", lambda t, a, o, d: f"0,0,{d:.3f},{utc(t)},1,1")
    with pytest.raises(LogError, match=r"has no usable positions \(120 positions at 0, 0"):
        gathered(tmp_path, data)


def test_rows_out_of_order_around_midnight_under_one_date_are_of_one_night(tmp_path):
    def row(t, a, o, d):
        late_s = 3.0 if int(t) % 3 == 1 else 0.0
        return f"2026-06-14,{utc(t - START_S - 60.0 - late_s, '%H:%M:%S')},{a:.8f},{o:.8f},{d:.3f}"

    found = gathered(tmp_path, lines("date,time,lat,lon,depth", row))
    assert np.ptp(found.placed[0].soundings[:, 0]) < 130.0


@pytest.mark.parametrize(("header", "is_read"), [("depth", True), ("vehicle_depth", False)])
def test_an_empty_column_of_heights_above_the_bottom_is_ignored_beside_a_depth(tmp_path, header, is_read):
    data = lines(f"lat,lon,{header},altimeter,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},,{utc(t)}")
    if is_read:
        found = gathered(tmp_path, data)
        checked(found)
        assert "column altimeter is not added: it has no height" in found.lines[0]
    else:
        with pytest.raises(LogError, match="120 depths without a height above the bottom"):
            gathered(tmp_path, data)


@pytest.mark.parametrize(("unit", "factor"), [("", 0.3048), (" (m)", 1.0)])
def test_the_depth_unit_is_that_of_heights_above_the_bottom_without_their_own(tmp_path, unit, factor):
    def row(t, a, o, d):
        return f"{a:.8f},{o:.8f},{(d - 2.0) / 0.3048:.4f},{2.0 / factor:.4f},{utc(t)}"

    data = lines(f"lat,lon,depth,distance to bottom{unit},utc", row)
    checked(gathered(tmp_path, data, "--depth-unit", "ft"))


@pytest.mark.parametrize(
    ("texts", "today", "found"),
    [
        (["261129"], date(2026, 11, 29), {"yymmdd": "2026-11-29"}),  # else a day to come, or the month 26
        (["061425"], date(2026, 11, 29), {"mmddyy": "2025-06-14"}),
        (["271125"], date(2026, 11, 29), {"ddmmyy": "2025-11-27"}),
        (["271125", "000000", ""], date(2026, 11, 29), {"ddmmyy": "2025-11-27"}),
        (["140625", "150625"], date(2026, 11, 29), {"ddmmyy": "2025-06-14"}),  # a day apart, or a year
        (["140625"], date(2026, 11, 29), {"ddmmyy": "2025-06-14", "yymmdd": "2014-06-25"}),
        (["140625", "2025-06-14"], date(2026, 11, 29), {}),
        (["999999"], date(2026, 11, 29), {}),
    ],
)
def test_six_digits_are_dates_in_the_orders_that_may_be_meant(texts, today, found):
    assert {order: dates[texts[0]] for order, dates in dates_of_digits(texts, today).items()} == found


@pytest.mark.parametrize(
    ("header", "form", "options"),
    [
        ("date,time", "%d%m%y,%H:%M:%S", []),
        ("date,hour,minute,second", "%m%d%y,%H,%M,%S", []),
        ("date (yymmdd),time", "%y%m%d,%H%M%S", []),
        ("date,time", "%d%m%y,%H:%M:%S", ["--day-first"]),
    ],
)
def test_dates_of_six_digits_beside_times(tmp_path, header, form, options):
    first_s = 0.0 if options or "(" in header else 50_380.0  # the others pass midnight

    def row(t, a, o, d):
        return f"{utc(t + first_s, form)},{a:.8f},{o:.8f},{d:.3f}"

    checked(gathered(tmp_path, lines(f"{header},lat,lon,depth", row), *options), starts=START_S + first_s)


@pytest.mark.parametrize(
    "form", ["date,time|%d%m%y,%H:%M:%S", "date,hour,minute,second|%d%m%y,%H,%M,%S", "date|%d%m%y"]
)
def test_a_date_of_six_digits_that_may_be_two_is_ignored_and_both_are_named(tmp_path, form):
    header, form = form.split("|")
    data = lines(f"{header},lat,lon,depth", lambda t, a, o, d: f"{utc(t, form)},{a:.8f},{o:.8f},{d:.3f}")
    text = gathered(tmp_path, data).lines[0]
    assert text.count("column date is ignored: '030526' may be 2026-05-03 (ddmmyy) or 2026-03-05 (mmddyy)") == 1
    assert "2003-05-26 (yymmdd); write it in that form" in text


def test_minutes_and_seconds_before_24_minutes_are_those_of_a_boat_that_moves(tmp_path):
    def row(t, a, o, d):
        return f"{utc(t, '%M:%S')},{a:.8f},{o:.8f},{d:.3f}"

    for header in ("time", "elapsed (mm:ss)"):
        found = gathered(tmp_path, lines(f"{header},lat,lon,depth", row), "--date", "2026-05-03T10:00:00Z")
        checked(found)
        assert "minutes and seconds, and no hours" in found.lines[0]


def test_hours_and_minutes_of_single_soundings_stay_such(tmp_path):
    def row(t, a, o, d):
        return f"{utc(START_S + 300.0 * (t - START_S), '%H:%M')},{a:.8f},{o:.8f},{d:.3f}"

    assert "no hours" not in gathered(tmp_path, lines("time,lat,lon,depth", row)).lines[0]


@pytest.mark.parametrize(("stamp_s", "ahead_s"), [(1.42e9, 16.0), (1.451e9, 17.0), (1.9e9, 18.0), (3.3e8, 0.0)])
def test_gps_is_ahead_by_the_leap_seconds_until_then(stamp_s, ahead_s):
    week, of_week = np.divmod(np.array([stamp_s - 315_964_800.0 + ahead_s]), 604_800.0)
    assert of_gps_weeks(week, of_week) == pytest.approx([stamp_s])


def test_a_raw_file_of_hypack_names_what_to_export(tmp_path):
    raw = (
        "FTP NEW 2\nVER 13.0.9.17\nTND 10:00:00 05/03/2026\nDEV 0 16 GPS\nDEV 1 16 Sounder\nEOH\n"
        "POS 0 36000.100 500000.12 5150000.34\nEC1 1 36000.150 8.12\nPOS 0 36001.100 500001.12 5150000.34\n"
    )
    with pytest.raises(LogError, match=r"a raw file of Hypack. Export"):
        gathered(tmp_path, raw)


@pytest.mark.parametrize("mark", ["'", "’", ",", "\u00a0"])
def test_thousands_are_separated(tmp_path, mark):
    def row(t, a, o, d):
        return f'"{d * 1000.0:,.1f}",{a:.8f},{o:.8f},{utc(t)}'.replace(",", mark, 1 if d >= 1.0 else 0)

    checked(gathered(tmp_path, lines("depth_mm,lat,lon,utc", row)))


def test_thousands_are_separated_by_points_beside_decimal_commas(tmp_path):
    def row(t, a, o, d):
        depth = f"{d * 1000.0:,.1f}".translate(str.maketrans(",.", ".,"))
        return f"{utc(t)};{depth};{a:.8f};{o:.8f}".replace(f";{a:.8f};{o:.8f}", f";{a:.8f};{o:.8f}".replace(".", ","))

    checked(gathered(tmp_path, lines("utc;Tiefe (mm);lat;lon", row)))


@pytest.mark.parametrize(("sign", "mark"), [(",", "."), (".", ",")])
def test_one_separator_that_may_be_a_decimal_sign_is_refused(tmp_path, sign, mark):
    def row(t, a, o, d):
        return f"{utc(t)};{d * 1000.0:,.0f}".replace(",", mark) + f";{a:.8f};{o:.8f}".replace(".", sign)

    with pytest.raises(LogError, match=r"separates thousands or decimals in '\d+[.,]\d{3}'"):
        gathered(tmp_path, lines("utc;depth_mm;lat;lon", row))


@pytest.mark.parametrize("wrong", ["46-75-12N", "46 30 75 N", "46°60.5'N"])
def test_an_angle_with_more_than_60_minutes_or_seconds_is_no_position(tmp_path, wrong):
    def row(t, a, o, d):
        lat = wrong if t > START_S + 99 else f"46 {60.0 * (a % 1.0):.6f} N"
        return f"{lat};6 {60.0 * (o % 1.0):.6f} E;{d:.3f};{utc(t)}"

    found = gathered(tmp_path, lines("lat;lon;depth;utc", row))
    assert found.placed[0].left_out["positions that are not numeric"] == 20
    checked(found, count=100)


@pytest.mark.parametrize("header", ["time,lat,lon,depth", "date,time,lat,lon,depth"])
@pytest.mark.filterwarnings("error")
def test_times_of_day_may_have_points(tmp_path, header):
    """As Excel and Danish and Finnish writers have them; beside a date they cannot be one."""

    def row(t, a, o, d):
        day, clock = utc(t).rstrip("Z").split("T")
        return f"{day}{',' if header.startswith('date') else ' '}{clock.replace(':', '.')},{a:.8f},{o:.8f},{d:.3f}"

    checked(gathered(tmp_path, lines(header, row)), count=120)


def test_a_quality_in_words_is_listed_as_ignored(tmp_path):
    rows = lines("time,lat,lon,depth,quality", lambda t, a, o, d: f"{utc(t)},{a:.8f},{o:.8f},{d:.3f},good")
    assert "column quality is ignored: 'good' is not a number" in gathered(tmp_path, rows).lines[0]


def test_metres_behind_depths_are_read_unless_another_unit_is_stated(tmp_path):
    def table(header, unit):
        return lines(header, lambda t, a, o, d: f"{utc(t)},{a:.8f},{o:.8f},{d:.3f}{unit}")

    for unit in (" m", "m", " metres"):
        checked(gathered(tmp_path, table("time,lat,lon,depth", unit)), count=120)
    for header, unit, facts in (
        ("time,lat,lon,depth", " ft", ()),
        ("time,lat,lon,depth_ft", " m", ()),
        ("time,lat,lon,depth", " m", ("--depth-unit", "ft")),
    ):
        with pytest.raises(LogError, match="its depths are not numbers"):
            gathered(tmp_path, table(header, unit), *facts)
