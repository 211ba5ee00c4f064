"""Tables of soundings as sounders, apps and spreadsheets write them."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from adjust.survey_logs import START_S, depth_m, survey
from adjust.tables import ROWS, checked, gathered, lines, utc

from auv_lse_common.vocabulary.frames import local_from_geodetic
from auv_lse_gp.tables import dialect
from auv_lse_gp.tables.angles import angle
from auv_lse_shore.survey_import.command import parser, user_facts
from auv_lse_shore.survey_import.gather import UserFacts, gather
from auv_lse_shore.survey_import.survey_log import LogError

TABLES = {
    "plain": lines("time_utc,lat,lon,depth", lambda t, a, o, d: f"{utc(t)}Z,{a:.8f},{o:.8f},{d:.3f}"),
    "feet": lines("Latitude,Longitude,Depth (ft),UTC", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d / 0.3048:.3f},{utc(t)}"),
    "unit row": lines(
        "lat;lon;depth;utc\ndeg;deg;fathom;-", lambda t, a, o, d: f"{a:.8f};{o:.8f};{d / 1.8288:.4f};{utc(t)}"
    ),
    "German": lines(
        "Breite;Länge;Tiefe;Datum;Uhrzeit",
        lambda t, a, o, d: f"{a:.8f};{o:.8f};{d:.3f};{utc(t, '%d.%m.%Y')};{utc(t, '%H:%M:%S')}".replace(".", ",", 3),
    ).encode("cp1252"),
    "decimal commas, UTF-16": lines(
        "Latitude\tLongitude\tDepth_m\tTimestamp",
        lambda t, a, o, d: f"{a:.8f}\t{o:.8f}\t{d:.3f}\t{t:.0f}".replace(".", ","),
    ).encode("utf-16"),
    "comments and mark": "\ufeff# made by an app\n// v2\nsep=,\n"
    + lines("GPSLat,GPSLon,WaterDepth[m],Epoch", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{t:.0f}"),
    "American clock": lines(
        "Date,Time,Lat,Long,DepthFt",
        lambda t, a, o, d: f"{utc(t, '%m/%d/%Y')},{utc(t, '%I:%M:%S %p')},{a:.8f},{o:.8f},{d / 0.3048:.3f}",
    ),
    "Deeper": lines("", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{1000 * t:.0f}"),
    "blanks": lines("lon lat depth_m time_s", lambda t, a, o, d: f" {o:.8f}   {a:.8f} {d:.3f} {t:.1f}"),
    "elevations x y z": lines("y,x,z,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{-d:.3f},{utc(t)}"),
    "minutes": lines(
        "Latitude,Longitude,Depth,Timestamp",
        lambda t, a, o, d: f"N 46 {60 * (a - 46):.6f},6 {60 * (o - 6):.6f} E,{d:.3f},{utc(t)}",
    ),
    "date with seconds of the day": lines(
        "line,date,utc_s,lat,lon,depth_m",
        lambda t, a, o, d: f"L1 EW,{utc(t, '%Y%m%d')},{t % 86400:.0f},{a:.8f},{o:.8f},{d:.3f}",
    ),
    "sonar software": lines(
        "record_num,beam,lat,lon,inst_dep_m,dep_m,time_s,date,time",
        lambda t, a, o, d: (
            f"{t - START_S:.0f},1,{a:.8f},{o:.8f},0,{d:.3f},{t - START_S:.2f},{utc(t, '%Y-%m-%d')},{utc(t, '%H:%M:%S')}"
        ),
    ),
}

UNITS = {
    "feet with a dot": ("Depth (ft.)", 0.3048),
    "survey feet": ("Depth (US survey feet)", 0.3048),
    "feet below a datum": ("Depth [ft MLLW]", 0.3048),
    "in feet": ("Depth (in feet)", 0.3048),
    "in inches": ("Depth (in)", 0.0254),
    "metres below the surface": ("Depth (m below surface)", 1.0),
}


@pytest.mark.parametrize("name", UNITS)
def test_a_unit_counts_whatever_stands_beside_it(tmp_path, name):
    header, unit_m = UNITS[name]
    data = lines(f"lat,lon,{header},utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d / unit_m:.3f},{utc(t)}")
    checked(gathered(tmp_path, data))


def test_a_unit_that_is_not_understood_is_named(tmp_path):
    data = lines("lat,lon,Depth (dbar),utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{utc(t)}")
    found = gathered(tmp_path, data)
    assert "column Depth (dbar), taken as metres: the unit 'dbar' is not understood" in " ".join(found.lines)
    assert "not understood" not in " ".join(gathered(tmp_path, data, "--depth-unit", "m").lines)


def test_depths_with_their_unit_in_the_cells_are_shown(tmp_path):
    data = lines("lat,lon,depth,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d / 0.3048:.1f} ft,{utc(t)}")
    with pytest.raises(LogError, match=r"such as '[\d.]+ ft'.*depth_ft, or into --depth-unit"):
        gathered(tmp_path, data)
    some = lines(
        "lat,lon,depth,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f}{' ?' if t > START_S + 119 else ''},{utc(t)}"
    )
    assert gathered(tmp_path, some).lines, "others are read"
    beside = lines(
        "lat,lon,depth,elevation,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{400.0 - d:.1f} m,{utc(t)}"
    )
    assert gathered(tmp_path, beside).lines, "only the column that is used counts"
    none = lines("lat,lon,depth,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},nan,{utc(t)}")
    with pytest.raises(LogError, match="no usable depths"):
        gathered(tmp_path, none)


def test_depths_that_are_no_numbers_in_a_part_of_a_long_table_are_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(dialect, "_ROWS", 50)
    data = lines(
        "lat,lon,depth,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f}{' ?' if t < START_S + 60 else ''},{utc(t)}"
    )
    assert "depths that are not numeric" in " ".join(gathered(tmp_path, data).lines)


@pytest.mark.parametrize(("names", "unit_m"), [("x_ft,y_ft", 0.3048), ("Easting (km),Northing (km)", 1000.0)])
def test_positions_in_other_units_than_metres_are_converted(tmp_path, names, unit_m):
    north, east = local_from_geodetic(ROWS[:, 1], ROWS[:, 2], 46.5, 6.6)
    body = "\n".join(
        f"{e / unit_m:.6f},{n / unit_m:.6f},{d:.3f},{t:.0f}"
        for n, e, (t, _, _, d) in zip(north, east, ROWS, strict=True)
    )
    path = tmp_path / "table.csv"
    path.write_text(f"{names},depth,epoch\n{body}")
    options = parser().parse_args([str(path)])
    checked(gather(options.logs, user_facts(options)))


@pytest.mark.parametrize(("crs", "unit_m"), [("EPSG:32632", 0.3048), ("EPSG:2263", 0.3048)])
def test_projected_positions_in_feet_are_those_of_any_system(tmp_path, crs, unit_m):
    from pyproj import Transformer

    start = (40.6, -73.9) if crs == "EPSG:2263" else (46.5, 6.6)
    lat, lon = ROWS[:, 1] - 46.5 + start[0], ROWS[:, 2] - 6.6 + start[1]
    x, y = Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(lon, lat)
    scale = 1.0 if crs == "EPSG:2263" else unit_m  # the coordinates of the first one are feet themselves
    body = "\n".join(
        f"{a / scale:.4f},{b / scale:.4f},{d:.3f},{t:.0f}" for a, b, (t, _, _, d) in zip(x, y, ROWS, strict=True)
    )
    found = gathered(
        tmp_path, "easting_ft,northing_ft,depth,epoch\n" + body, "--crs", crs, "--origin", *map(str, start)
    )
    north, east = local_from_geodetic(lat, lon, *start)
    assert found.placed[0].soundings[:, 1] == pytest.approx(north[: len(ROWS)], abs=0.05)
    assert found.placed[0].soundings[:, 2] == pytest.approx(east[: len(ROWS)], abs=0.05)


@pytest.mark.parametrize(
    ("text", "sign"),
    [
        ("33°51'12\"S", -1), ("33°51'12.0″ S", -1), ("33 51 12 S", -1), ("33°51'12''S", -1), ("33d51m12sS", -1),
        ("S33°51'12\"", -1), ("33°51'12\"s", -1), ("33°51.2'S", -1), ("33.853333S", -1), ("33°51'12\"W", -1),
        ("33°51'12\"", 1), ("33d51m12s", 1), ("33d51m12sN", 1), ("N 33d 51m 12s", 1), ("33°51'12\"N", 1),
        ("33°51'12\"E", 1), ("-33°51'12\"", -1), ("33:51:12S", -1),
        ("33 51 12 s", -1), ("33:51:12s", -1), ("33d51m12S", -1), ("33D51M12S", 1), ("33D51M12SS", -1),
        ("33d51m12ss", -1),
    ],
)  # fmt: skip
def test_the_s_behind_seconds_is_south_and_that_of_33d51m12s_is_a_unit(text, sign):
    assert angle(text, Path("a.csv")) == pytest.approx(sign * 33.853333, abs=1e-6)


def test_angles_in_radians_are_converted(tmp_path):
    data = lines(
        "Latitude (rad),Longitude (rad),Depth,utc",
        lambda t, a, o, d: f"{np.radians(a):.12f},{np.radians(o):.12f},{d:.3f},{utc(t)}",
    )
    checked(gathered(tmp_path, data))


def test_hemispheres_in_columns_of_their_own_count(tmp_path):
    for names in ("Latitude,N/S,Longitude,E/W", "lat,lat_dir,lon,lon_dir", "Lat,Lat Hemisphere,Lon,Lon Hemisphere"):
        data = lines(f"{names},Depth,utc", lambda t, a, o, d: f"{a:.8f},S,{o:.8f},W,{d:.3f},{utc(t)}")
        found = gathered(tmp_path, data, "--origin", "-46.5", "-6.6")
        rows = found.placed[0].soundings
        north, east = local_from_geodetic(-ROWS[:, 1], -ROWS[:, 2], -46.5, -6.6)
        assert rows[:, 1:3] == pytest.approx(np.column_stack([north, east]), abs=0.01)


@pytest.mark.parametrize("parts", [1, 2])
def test_blanks_within_angles_beside_columns_of_hemispheres_do_not_split_cells(tmp_path, parts):
    def angle(degrees):
        minutes = round(degrees * 60.0, 6)
        whole = f"{minutes // 60:.0f} "
        return whole + (f"{minutes % 60:.6f}" if parts == 1 else f"{minutes % 60 // 1:.0f} {minutes % 1 * 60:.4f}")

    data = lines("Lat,N/S,Lon,E/W,Depth", lambda t, a, o, d: f"{angle(a)},N,{angle(o)},E,{d:.3f}")
    checked(gathered(tmp_path, data), starts=None)


def test_an_o_is_east_or_west_and_refused(tmp_path):
    for data in (
        lines("lat,lon,depth,utc", lambda t, a, o, d: f"{a:.8f} N,{o:.8f} O,{d:.3f},{utc(t)}"),
        lines("lat,N/S,lon,E/W,depth,utc", lambda t, a, o, d: f"{a:.8f},N,{o:.8f},O,{d:.3f},{utc(t)}"),
    ):
        with pytest.raises(
            LogError, match=r"table.txt: the O in .* is east in German and west in French.* Write E or W"
        ):
            gathered(tmp_path, data)


@pytest.mark.parametrize("header", ["Time (UTC+2)", "Time UTC+02:00", "time (GMT+0200)", "utc+2"])
def test_a_zone_in_the_header_counts(tmp_path, header):
    found = gathered(
        tmp_path, lines(f"lat,lon,depth,{header}", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{utc(t + 7200)}")
    )
    checked(found)
    assert not any("zone" in line for line in found.lines)


@pytest.mark.parametrize("zone", [" UTC", "UTC", " GMT", " UTC+00:00"])
def test_utc_behind_a_time_is_its_zone(tmp_path, zone, recwarn):
    whole = lines("lat,lon,depth,time", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{utc(t)}{zone}")
    of_day = lines(
        "lat,lon,depth,date,time",
        lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{utc(t, '%Y-%m-%d')},{utc(t, '%H:%M:%S')}{zone}",
    )
    for data in (whole,) if "+" in zone else (whole, of_day):
        found = gathered(tmp_path, data)
        checked(found)
        assert not any("zone" in line for line in found.lines)
    assert not recwarn.list


@pytest.mark.parametrize(
    "form",
    [
        "%a %d %b %Y,%H:%M:%S",
        "%A %d %B %Y,%H:%M:%S",
        "So %d. Mai %Y,%H:%M:%S",
        "%Y-%j,%H:%M:%S",
        "%Y%j,%H:%M:%S",
    ],
)
def test_dates_with_weekdays_months_in_words_and_days_of_the_year(tmp_path, form):
    found = gathered(
        tmp_path, lines("lat,lon,depth,date,time", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{utc(t, form)}")
    )
    checked(found)
    assert "ignored" not in found.lines[0]


@pytest.mark.parametrize(
    "form",
    [
        "%a %b %d %H:%M:%S %Y",
        "%a %b %d %H:%M:%S UTC %Y",
        '"%a, %d %b %Y %H:%M:%S GMT"',
        '"%a, %d %b %Y %H:%M:%S +0000"',
        "%Y-%jT%H:%M:%SZ",
        "%Y%m%dT%H%M%SZ",
        "%Y%m%dT%H%M%S.000+00:00",
        "%Y%m%d_%H%M%SZ",
    ],
)
def test_moments_as_mail_and_unix_write_them(tmp_path, form):
    found = gathered(
        tmp_path, lines("lat,lon,depth,time", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{utc(t, form)}")
    )
    checked(found)
    assert any("zone" in line for line in found.lines) == (form == "%a %b %d %H:%M:%S %Y")


@pytest.mark.parametrize("form", ["%H:%M:%S", "%H%M%S"])
def test_a_date_that_stays_past_midnight_is_that_of_the_first_row(tmp_path, form):
    midnight_s = START_S - START_S % 86_400.0

    def row(t, a, o, d):
        return f"{a:.8f},{o:.8f},{d:.3f},03.05.2026,{utc(t - START_S + midnight_s - 60.0, form)}"

    found = gathered(tmp_path, lines("lat,lon,depth,date,time", row), "--day-first")
    checked(found, starts=None)
    stamps = found.placed[0].soundings[:, 0]
    assert np.diff(stamps).max() < 2.0
    assert "has the first day's date after midnight, too" in found.lines[0]


def test_rows_of_one_day_in_another_order_stay_in_it(tmp_path):
    header, *rows = lines(
        "lat,lon,depth,date,time",
        lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},2026-05-03,{utc(t, '%H:%M:%S')}",
    ).splitlines()
    found = gathered(tmp_path, "\n".join([header, *rows[60:], *rows[:60]]))
    assert np.ptp(found.placed[0].soundings[:, 0]) == pytest.approx(119.0)


@pytest.mark.parametrize(("header", "unit_s"), [("Time (min)", 60.0), ("time_min", 60.0), ("Time [h]", 3600.0)])
def test_elapsed_times_in_minutes_and_hours(tmp_path, header, unit_s):
    data = lines(f"lat,lon,depth,{header}", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{(t - START_S) / unit_s:.7f}")
    checked(gathered(tmp_path, data, "--date", utc(START_S) + "Z"))


@pytest.mark.parametrize("form", ["%H%M%S", "%H%M%S.00"])
def test_a_time_of_day_of_six_digits_is_no_count_of_seconds(tmp_path, form):
    def row(t, a, o, d):
        return f"{a:.8f},{o:.8f},{d:.3f},{utc(t, '%Y%m%d')},{utc(t, form)}"

    found = gathered(tmp_path, lines("lat,lon,depth,date,time_utc", row))
    checked(found)
    assert not any(line.startswith("question") for line in found.lines)
    checked(gathered(tmp_path, lines("lat,lon,depth,-,utc", row), "--date", utc(START_S)[:10]))


def test_the_least_depth_of_a_cell_is_not_a_depth_in_minutes(tmp_path):
    with pytest.raises(LogError, match="a position or a depth is not among them"):
        gathered(tmp_path, lines("lat,lon,depth_min,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{utc(t)}"))


def test_the_depth_below_the_surface_is_preferred_also_with_units(tmp_path):
    data = lines(
        "lat,lon,DepthBelowKeel(m),Water Depth (m),utc",
        lambda t, a, o, d: f"{a:.8f},{o:.8f},{d - 1.0:.3f},{d:.3f},{utc(t)}",
    )
    checked(gathered(tmp_path, data))


def test_columns_that_are_not_used_are_listed(tmp_path):
    header = "Latitude,Longitude,Easting,Northing,Depth (m),Depth 2 (m),Elevation,draft_m,tide,utc"
    data = lines(header, lambda t, a, o, d: f"{a:.8f},{o:.8f},1,2,{d:.3f},9,-9,1.0,0.5,{utc(t)}")
    said = gathered(tmp_path, data).lines[0]
    assert said.endswith(
        "columns not used: Easting, Northing, Depth 2 (m), Elevation, draft_m, tide; below the surface as the log "
        "has it"
    )
    assert "not used" not in gathered(tmp_path, TABLES["plain"]).lines[0]
    many = lines(
        "lat,lon,depth,utc," + ",".join(f"c{i}" for i in range(20)),
        lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{utc(t)}" + ",1" * 20,
    )
    assert "c11 and 8 more" in gathered(tmp_path, many).lines[0]


def test_a_header_that_is_repeated_leaves_the_order_of_dates_clear(tmp_path):
    header, *rows = TABLES["plain"].splitlines()
    found = gathered(tmp_path, "\n".join([header, *rows[:60], header, *rows[60:]]))
    checked(found)
    assert "day-first" not in " ".join(found.lines)


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_read_as_it_is(tmp_path, name):
    more = ["--day-first"] if name == "German" else []
    checked(gathered(tmp_path, TABLES[name], *more))


def test_a_table_without_a_header_proposes_its_columns(tmp_path):
    data = lines("", lambda t, a, o, d: f"{utc(t, '%m/%d/%Y')},{utc(t, '%H:%M:%S')},0.80,{a:.6f},{o:.6f},{d:.2f},12")
    with pytest.raises(LogError, match=r"no header.*--columns date,time,-,lat,lon,depth,-"):
        gathered(tmp_path, data)
    checked(gathered(tmp_path, data, "--columns", "date,time,-,lat,lon,depth,-", "--no-day-first"))
    with pytest.raises(LogError, match="fish means nothing here"):
        gathered(tmp_path, data, "--columns", "fish,time,-,lat,lon,depth,-")


def test_positions_at_zero_are_no_positions(tmp_path):
    zero = [f"0.0,0.0,{3 + i % 7},{1000 * (START_S - 500 + i):.0f}" for i in range(400)]
    found = gathered(tmp_path, "\n".join(zero) + "\n" + TABLES["Deeper"])
    checked(found)
    assert "- left out: 400 positions at 0, 0" in found.lines


def test_low_confidence_is_left_out_and_zero_is_unknown_only_if_nothing_else_is_there(tmp_path):
    def table(quality):
        return lines(
            "lat,lon,depth,time_utc,confidence (%)", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{utc(t)},{quality(t)}"
        )

    found = gathered(tmp_path, table(lambda t: 95 if t % 2 else 5))
    checked(found, len(ROWS) // 2, None)
    assert f"- left out: {len(ROWS) // 2} depths with a quality below 40 %" in found.lines
    checked(gathered(tmp_path, table(lambda t: 0)))
    checked(gathered(tmp_path, table(lambda t: 95 if t % 2 else 5), "--min-quality", "0"))
    checked(gathered(tmp_path, table(lambda t: 95 if t % 2 else 0)), len(ROWS) // 2, None)


def test_positions_that_a_logger_repeats_are_old(tmp_path):
    rows = [(t, *ROWS[i - i % 10, 1:3], d) for i, (t, _, _, d) in enumerate(ROWS)]
    text = "\n".join(["time_s,lat,lon,depth_m", *(f"{t:.1f},{a:.8f},{o:.8f},{d:.3f}" for t, a, o, d in rows)])
    (log,) = gathered(tmp_path, text).placed
    north, east = local_from_geodetic(ROWS[: len(log.soundings), 1], ROWS[: len(log.soundings), 2], 46.5, 6.6)
    off_m = np.hypot(log.soundings[:, 1] - north, log.soundings[:, 2] - east)
    assert len(log.soundings) > 100
    assert np.median(off_m) < 0.1  # 9 m, if the old positions were used


def test_positions_of_a_boat_that_stands_are_not_old(tmp_path):
    rows = [(i, 46.5 + i // 25 * 9e-6, 6.6, 5 + 0.01 * (i % 7)) for i in range(200)]  # 1 m further every 25 s
    text = "\n".join(["time_s,lat,lon,depth_m", *(f"{t:.1f},{a:.8f},{o:.8f},{d:.3f}" for t, a, o, d in rows)])
    (log,) = gathered(tmp_path, text).placed
    assert len(log.soundings) == len(rows)


def test_elevations_ask_for_the_surface(tmp_path):
    data = lines("lat,lon,elevation,time_utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{82.5 - d:.3f},{utc(t)}")
    with pytest.raises(LogError, match="give that of the water surface with --surface M"):
        gathered(tmp_path, data)
    checked(gathered(tmp_path, data, "--surface", "82.5"))


def in_utm(extra="", header="", system="EPSG:32632", metres=1.0):
    """The survey in metres of zone 32, with further cells in each row; or in other units."""
    from pyproj import Transformer

    turned = Transformer.from_crs("EPSG:4326", system, always_xy=True).transform(ROWS[:, 2], ROWS[:, 1])
    east, north = np.array(turned) / metres
    rows = zip(east, north, ROWS, strict=True)
    unit = "" if metres == 1.0 else "_ft"
    head = f"easting{unit},northing{unit},depth,epoch{header}\n"
    return head + "\n".join(f"{e:.3f},{n:.3f},{d:.3f},{t:.0f}{extra}" for e, n, (t, _, _, d) in rows)


def test_projected_metres_ask_for_their_system(tmp_path):
    with pytest.raises(LogError, match=r"projected .* such as --crs EPSG:32632"):
        gathered(tmp_path, in_utm())
    checked(gathered(tmp_path, in_utm(), "--crs", "EPSG:32632"))


@pytest.mark.parametrize(
    ("header", "cells"),
    [
        (",zone", ",32N"), (",UTM zone", ",32 T"), (",zone,hemisphere", ",32,N"), (",utm_zone,hemi", ",UTM32,north"),
        (",EPSG", ",32632"), (",crs", ",EPSG:32632"),
    ],
)  # fmt: skip
def test_projected_metres_in_the_system_that_a_column_names(tmp_path, header, cells):
    survey = gathered(tmp_path, in_utm(cells, header))
    checked(survey)
    assert "positions in EPSG:32632, by column" in survey.lines[0]
    assert "not used" not in survey.lines[0]
    checked(gathered(tmp_path, in_utm(cells, header, metres=0.3048)))


@pytest.mark.parametrize(
    ("header", "cells", "cure"),
    [
        (",zone", ",32", "Zone 32 may be north or south: --crs EPSG:32632 or --crs EPSG:32732"),
        (",zone", ",32S", "Zone 32S may be north or south"),
        (",zone", ",harbour", "such as --crs EPSG:32632"),
        (",zone", ",32C", "such as --crs EPSG:32632"),
        (",zone", ",3A", "such as --crs EPSG:32632"),
        (",zone", ",77N", "such as --crs EPSG:32632"),
        (",epsg", ",99999", "EPSG:99999 of column epsg is not a coordinate system"),
    ],
)
def test_an_unclear_system_is_asked_for(tmp_path, header, cells, cure):
    with pytest.raises(LogError, match=cure):
        gathered(tmp_path, in_utm(cells, header))


def test_rows_in_two_zones_are_refused(tmp_path):
    rows = in_utm(",32N", ",zone").splitlines()
    rows[5] = rows[5].replace(",32N", ",33N")
    with pytest.raises(LogError, match=r"several systems \(column zone\)\. Split the table by them"):
        gathered(tmp_path, "\n".join(rows))


@pytest.mark.parametrize("names", ["x_m,y_m", "x,y"])
def test_fine_metres_near_the_origin_are_no_degrees(tmp_path, names):
    rows = [(100.0 + t, 10.1234 + 0.5123 * t, 5.4321 + 0.2718 * t, 8.0 + 0.1 * t) for t in range(60)]
    path = tmp_path / "table.csv"
    path.write_text(f"elapsed,{names},depth\n" + "\n".join(f"{t:g},{x:.4f},{y:.4f},{d:.2f}" for t, x, y, d in rows))
    options = parser().parse_args([str(path)])
    log = gather(options.logs, user_facts(options))
    (soundings,) = [placed.soundings for placed in log.placed]
    assert len(soundings) == 60
    assert np.ptp(soundings[:, 2]) == pytest.approx(59 * 0.5123, rel=0.01)
    assert ("taken as metres" in " ".join(log.lines)) == (names == "x,y")


def test_local_times_are_asked_about(tmp_path):
    data = lines("lat,lon,depth,time", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{utc(t + 7200)}")
    found = gathered(tmp_path, data)
    assert "times have no zone and are taken as UTC: --utc-offset" in found.lines[-1]
    checked(gathered(tmp_path, data, "--utc-offset", "2"))
    of_day = lines("lat,lon,depth,time", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{utc(t + 7200)[11:19]}")
    checked(gathered(tmp_path, of_day, "--utc-offset", "2", "--date", "2026-05-03"))


@pytest.mark.parametrize("zone", ["+02", "+0200", "+02:00", " +02:00"])
def test_zones_in_a_table_count(tmp_path, zone):
    data = lines(
        "lat,lon,depth,time", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{utc(t + 7200).removesuffix('Z')}{zone}"
    )
    found = gathered(tmp_path, data)
    checked(found)
    assert not any("zone" in line for line in found.lines)
    assert found.placed[0].soundings[0, 0] == pytest.approx(ROWS[0, 0])


def test_absurd_values_are_left_out_and_counted(tmp_path):
    text = TABLES["plain"].replace("\n", f"\n{utc(START_S)}Z,46.5,6.6,99999\n{utc(START_S)}Z,1e308,6.6,5\n", 1)
    text += "1e300,46.5,6.6,5.0\n" + f"{utc(START_S)}Z,46.5\n"
    found = gathered(tmp_path, text)
    checked(found)
    said = "\n".join(found.lines)
    assert "1 depth with a value that marks missing data" in said
    assert "1 position that is not on earth" in said


def test_a_log_whose_receiver_counts_1024_weeks_too_many_is_read_with_its_date(tmp_path):
    """Its times are beyond what stamps of ROS hold."""
    body = "\n".join(f"{utc(t + 1024 * 604_800.0)}Z,{a:.8f},{o:.8f},{d:.3f}" for t, a, o, d in ROWS)
    text = "time,lat,lon,depth_m\n" + body
    with pytest.raises(
        LogError, match=r"240 positions and depths with an impossible time \(--date gives the first day\)"
    ):
        gathered(tmp_path, text)
    found = gathered(tmp_path, text, "--date", utc(ROWS[0, 0])[:10])
    checked(found)
    assert found.placed[0].soundings[0, 0] == pytest.approx(ROWS[0, 0])


def test_a_date_before_gps_is_no_receiver_that_lost_weeks(tmp_path):
    body = "\n".join(f"{utc(t - START_S - 1e8)}Z,{a:.8f},{o:.8f},{d:.3f}" for t, a, o, d in ROWS)
    lines = gathered(tmp_path, "time,lat,lon,depth_m\n" + body).lines
    assert "question: the log is dated 1966-10-31, before GPS; --date gives its first day" in lines


def test_huge_times_are_left_out_not_crashed_on(tmp_path):
    for huge in ("1e30", "1e300"):
        body = "\n".join(f"{huge},{a:.8f},{o:.8f},{d:.3f}" for _, a, o, d in ROWS)
        with pytest.raises(LogError, match="240 positions and depths with an impossible time"):
            gathered(tmp_path, "time_s,lat,lon,depth_m\n" + body)


@pytest.mark.parametrize(("text", "why"), [("9" * 400, "'99999999999999999999' is not a time"), ("", "it is empty")])
def test_a_time_column_without_times_is_named_as_ignored(tmp_path, text, why):
    body = "\n".join(f"{text},{a:.8f},{o:.8f},{d:.3f}" for _, a, o, d in ROWS)
    found = gathered(tmp_path, "time_s,lat,lon,depth_m\n" + body)
    assert f"column time_s is ignored: {why}" in "\n".join(found.lines)


def test_rows_of_a_clock_that_stood_still_keep_their_own_positions(tmp_path):
    stamps = np.where(np.arange(len(ROWS)) < 60, ROWS[:, 0], ROWS[60, 0])
    text = "\n".join(
        [
            "time_s,lat,lon,depth_m",
            *(f"{s:.0f},{a:.8f},{o:.8f},{d:.3f}" for s, (_, a, o, d) in zip(stamps, ROWS, strict=True)),
        ]
    )
    text += "\n" + "\n".join(f"{t + 61:.0f},{a:.8f},{o:.8f},{d:.3f}" for t, a, o, d in survey()[:20] - [0, 0, 0, 0])
    found = gathered(tmp_path, text)
    assert sum(len(log.soundings) for log in found.placed) == len(ROWS) + 20
    for log in found.placed:
        rows = log.soundings
        assert rows[:, 3] == pytest.approx(depth_m(rows[:, 1], rows[:, 2]) - 0.3, abs=0.02)


def test_a_quote_over_two_lines_stays_one_cell(tmp_path):
    found = gathered(tmp_path, 'lat,lon,depth\n46.5,6.6,"5.0\n46.50001,6.6,5.1"\n46.50002,6.6,5.2\n46.50003,6.6,5.3\n')
    assert found.placed[0].soundings[:, 3].tolist() == [5.2, 5.3]


def test_lines_that_are_too_long_for_a_row_are_counted_with_their_numbers(tmp_path):
    rows = TABLES["plain"].splitlines()
    rows.insert(5, f"{rows[5]},{'x' * 20_000}")
    rows.insert(9, f"{rows[9]},{'x' * 30_000}")
    rows.insert(20, f"# {'x' * 30_000}")  # a comment
    found = gathered(tmp_path, "\n".join(rows))
    checked(found)
    assert "- left out: 2 lines of more than 20,000 letters (the first is line 6)" in found.lines


@pytest.mark.parametrize("repeated", [1, 300])
def test_lines_that_an_open_quote_takes_in_are_counted(tmp_path, repeated):
    """Also if they are more than a cell can hold, and the rows behind them are read."""
    rows = TABLES["plain"].splitlines()
    rows[100] = f'"{rows[100]}'
    found = gathered(tmp_path, "\n".join([*rows, *rows[101:] * repeated]))
    (line,) = (line for line in found.lines if "quote" in line)
    said = re.fullmatch(r"- left out: ([\d,]+) lines inside a quoted cell \(a quote is open in line 101\)", line)
    count = int(said[1].replace(",", ""))
    read = int(re.search(r" of ([\d,]+) depths", found.lines[0])[1].replace(",", ""))
    assert count + read == len(rows) - 1 + 20 * repeated - (repeated == 1)  # where the table ends, a row has no time
    assert count == 40 if repeated == 1 else count < 3000 < read


def test_a_column_without_a_number_is_part_of_no_proposal(tmp_path):
    with pytest.raises(LogError, match="Name them with --columns"):
        gathered(tmp_path, "a,b,c\n2026-06-14,,1.0\nx,1e999,2.0\n" * 3)


def with_frequency(frequency, deeper_m=lambda i: 0.0):
    """Rows of a table with a column of frequencies, given by the row's number, as are errors of depths."""
    return [
        f"{utc(t)}Z,{a:.8f},{o:.8f},{d + deeper_m(i):.3f},{frequency(i)}" for i, (t, a, o, d) in enumerate(ROWS)
    ]  # fmt: skip


def of_frequencies(rows):
    return "\n".join(["time_utc,lat,lon,depth,Frequency (MHz)", *rows]) + "\n"


def test_a_sounder_that_changes_its_frequency_now_and_then_is_one_sounder(tmp_path):
    found = gathered(tmp_path, of_frequencies(with_frequency(lambda i: "3MHz" if 30 <= i < 90 else "1MHz")))
    checked(found)
    said = " ".join(found.lines)
    assert 'one sounder that changes its frequency: "Frequency (MHz) 1MHz", "Frequency (MHz) 3MHz"' in said


def test_one_of_a_sounders_frequencies_can_be_asked_for(tmp_path):
    data = of_frequencies(with_frequency(lambda i: "3MHz" if 30 <= i < 90 else "1MHz"))
    checked(gathered(tmp_path, data, "--sounder", "frequency (mhz) 3mhz"), 60, None)


def test_rows_without_a_frequency_belong_to_the_sounder_beside_them(tmp_path):
    checked(gathered(tmp_path, of_frequencies(with_frequency(lambda i: "" if 40 <= i < 50 else "200"))))


SIDE_BY_SIDE = {
    "every other ping": with_frequency(lambda i: "200" if i % 2 else "50"),
    "both at once, one after the other in the file": with_frequency(lambda i: "50") + with_frequency(lambda i: "200"),
    "one enters the mud": with_frequency(lambda i: "50" if i > 60 else "200", lambda i: 0.8 if i > 60 else 0.0),
}


@pytest.mark.parametrize("name", SIDE_BY_SIDE)
def test_two_frequencies_side_by_side_are_two_sounders(tmp_path, name):
    found = gathered(tmp_path, of_frequencies(SIDE_BY_SIDE[name]))
    assert "takes them instead" in " ".join(found.lines)
    assert sum(len(log.soundings) for log in found.placed) < len(SIDE_BY_SIDE[name])


@pytest.mark.parametrize(
    ("header", "form", "zone"),
    [
        ("time", "%Y-%m-%dT%H:%M:%S", "Z"),
        ("time", "%d.%m.%Y %H:%M:%S", "+02:00"),
        ("date,time", "%Y-%m-%d,%H:%M:%S", " UTC"),
        ("time", "%H:%M:%S", "Z"),
    ],
)
def test_times_of_which_only_some_state_a_zone_are_refused(tmp_path, header, form, zone):
    lines = [f"{header},lat,lon,depth_m"]
    for i, (stamp, lat, lon, depth) in enumerate(survey()[:40]):
        when = datetime.fromtimestamp(stamp, UTC).strftime(form) + (zone if i in (3, 7) else "")
        lines.append(f"{when},{lat:.8f},{lon:.8f},{depth:.3f}")
    path = tmp_path / "a.csv"
    path.write_text("\n".join(lines))
    with pytest.raises(LogError, match=r"a\.csv: 2 of 40 times in column time state a zone, .* the others none\."):
        gather([path], UserFacts())
    path.write_text("\n".join(line.replace(zone, "") for line in lines))
    assert len(gather([path], UserFacts()).placed[0].soundings) == 40


@pytest.mark.parametrize(
    ("header", "form"),
    [
        ("year,month,day,hour,minute,second", "%Y,%m,%d,%H,%M,%S"),
        ("Year,Month,Day,Hours,Minutes,Seconds", "%Y,%m,%d,%H,%M,%S.0"),
        ("Date,Hour,Minute,Second", "%d.%m.%Y,%H,%M,%S"),
        ("date,time,AM/PM", "%Y-%m-%d,%I:%M:%S,%p"),
        ("time,ampm", "%m/%d/%Y %I:%M:%S,%p"),
    ],
)
def test_times_in_several_columns_are_put_together(tmp_path, header, form):
    def row(t, a, o, d):
        return f"{utc(t + 43_200.0, form)},{a:.8f},{o:.8f},{d:.3f}"

    found = gathered(tmp_path, lines(f"{header},lat,lon,depth", row), *(["--day-first"] if "." in form[:6] else []))
    checked(found, starts=START_S + 43_200.0)
    assert "not used" not in found.lines[0]


def test_parts_of_a_date_beside_a_whole_one_are_not_used(tmp_path):
    data = lines(
        "utc,year,month,day,seconds,lat,lon,depth",
        lambda t, a, o, d: f"{utc(t)},1999,{utc(t, '%m,%d')},{t % 60:.0f},{a:.8f},{o:.8f},{d:.3f}",
    )
    found = gathered(tmp_path, data)
    checked(found)
    assert "columns not used: year, month, seconds;" in found.lines[0]


def test_typographic_minus_signs_mean_depths_and_boots(tmp_path):
    data = lines(
        "time_boot_ms,lat,lon,depth_mean,depth_min",
        lambda t, a, o, d: f"{1000 * (t - START_S):.0f},\u2212{a:.8f},\u2212{o:.8f},{d:.3f},{d - 1.0:.3f}",
    )
    found = gathered(tmp_path, data, "--origin", "-46.5", "-6.6", "--date", utc(START_S) + "Z")
    assert len(found.placed[0].soundings) == 120
    assert found.placed[0].soundings[0, 0] == pytest.approx(START_S)


def test_positions_that_are_no_angles_are_shown(tmp_path):
    data = lines("lat,lon,depth,utc", lambda t, a, o, d: f"S{a:.0f}/{t % 60:.3f},W{o:.0f}/1.5,{d:.3f},{utc(t)}")
    with pytest.raises(LogError, match=r"its positions are neither numbers nor angles, such as 'S46/.*46 30\.5 S"):
        gathered(tmp_path, data)


@pytest.mark.parametrize("header", ["year,month,day", "date"])
def test_rows_that_all_have_one_date_and_no_time_are_read_in_their_order(tmp_path, header):
    form = "%Y,%m,%d" if "," in header else "%Y-%m-%d"
    data = lines(f"{header},lat,lon,depth", lambda t, a, o, d: f"{utc(t, form)},{a:.8f},{o:.8f},{d:.3f}")
    found = gathered(tmp_path, data)
    checked(found, starts=None)
    assert "rows while the clock stood still" in found.lines[0]
