"""Positions, units and dates of tables in notations of their own."""

from __future__ import annotations

import re

import numpy as np
import pytest
from adjust.survey_logs import START_S
from adjust.tables import ROWS, checked, gathered, lines, utc

from auv_lse_common.vocabulary.frames import local_from_geodetic
from auv_lse_shore.survey_import.command import parser, user_facts
from auv_lse_shore.survey_import.gather import gather
from auv_lse_shore.survey_import.survey_log import LogError


def packed(degrees, digits=6):
    """Degrees and minutes as NMEA writes them: 4630.0000."""
    return f"{100 * int(degrees) + 60 * (degrees % 1.0):.{digits}f}"


@pytest.mark.parametrize(
    "header", ["depth,unit", "depth,depth_unit", "depth,UOM", "unit,depth", "depth,temp,depth_unit"]
)
def test_a_column_of_units_counts(tmp_path, header):
    cells = {"depth": "{}", "temp": "17.5"}
    row = ",".join(cells.get(name, "ft") for name in header.split(","))
    data = lines(f"lat,lon,{header},utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{row.format(d / 0.3048)},{utc(t)}")
    found = gathered(tmp_path, data)
    checked(found)
    assert "depths in ft, 0.3048 m" in found.lines[0]


@pytest.mark.parametrize("name", ["depth in feet", "Depth (in feet)", "water depth in ft"])
def test_a_unit_behind_in_counts(tmp_path, name):
    rows = lines(f"lat,lon,{name},utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d / 0.3048:.4f},{utc(t)}")
    checked(gathered(tmp_path, rows))


@pytest.mark.parametrize(
    "header",
    [
        "depth,temp,Units",
        "range,unit,depth",
        "elevation,unit,depth",
        "depth,altitude,unit",
        "altitude,unit,depth",
        "depth,altitude,units,quality",
    ],
)
def test_a_unit_behind_a_column_that_is_not_used_is_a_question(tmp_path, header):
    cells = {"depth": "{}", "temp": "17.5", "range": "40", "elevation": "372.1", "altitude": "4", "quality": "90"}
    row = ",".join(cells.get(name, "ft") for name in header.split(","))
    data = lines(f"lat,lon,{header},utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{row.format(d)},{utc(t)}")
    with pytest.raises(LogError, match=r"may state the unit of another column than depth.*--depth-unit"):
        gathered(tmp_path, data)
    found = gathered(tmp_path, data, "--depth-unit", "m")
    checked(found)
    assert re.search(r"columns not used: [^;]*unit", found.lines[0], re.IGNORECASE)
    checked(gathered(tmp_path, data.replace(",ft", ",m")))


def test_each_row_has_its_own_unit(tmp_path):
    units = {0: (1.0, "m"), 1: (0.3048, "ft"), 2: (1.8288, "Fathoms")}

    def row(t, a, o, d):
        unit_m, name = units[int(t) % 3]
        return f"{a:.8f},{o:.8f},{d / unit_m:.4f},{name},{utc(t)}"

    checked(gathered(tmp_path, lines("lat,lon,depth,depth_unit,utc", row)))


def test_depths_in_a_unit_that_is_not_understood_are_left_out(tmp_path):
    data = lines(
        "lat,lon,depth,depth_unit,utc",
        lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{'dbar' if t > START_S + 99 else 'm'},{utc(t)}",
    )
    found = gathered(tmp_path, data)
    assert found.placed[0].left_out["depths in a unit that is not understood (column depth_unit, such as 'dbar')"] == 20
    checked(found, count=100)


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("depth,temp,unit", "{},17.5,C"),  # of the temperature
        ("depth,unit", "{},alpha"),  # a ship's
        ("depth (m),unit", "{},ft"),  # the header is plainer
        ("depth,unit,temp,unit", "{},m,17.5,C"),
        ("depth,unit", "{},"),
        ("depth,unit", "{},in"),  # in or out
        ("state,unit,depth", "in,in,{}"),
    ],
)
def test_a_column_of_other_units_changes_no_depth(tmp_path, header, row):
    data = lines(f"lat,lon,{header},utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{row.format(round(d, 3))},{utc(t)}")
    found = gathered(tmp_path, data)
    checked(found)
    assert len(re.findall(r"(?<!not a )\bunit\b", found.lines[0])) == 1


def test_a_column_in_a_unit_that_is_not_understood_names_the_cure(tmp_path):
    data = lines("lat,lon,depth,depth_unit,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},brasses,{utc(t)}")
    with pytest.raises(
        LogError, match=r"column depth_unit has 'brasses', which is not a unit of depth.*--depth-unit m"
    ):
        gathered(tmp_path, data)
    checked(gathered(tmp_path, data, "--depth-unit", "m"))


def test_a_depth_without_a_unit_among_others_in_feet_is_left_out(tmp_path):
    data = lines(
        "lat,lon,depth,unit,utc",
        lambda t, a, o, d: f"{a:.8f},{o:.8f},{d / 0.3048:.3f},{'' if t > START_S + 99 else 'ft'},{utc(t)}",
    )
    found = gathered(tmp_path, data)
    assert found.placed[0].left_out["depths without a unit in column unit, where others have one"] == 20
    checked(found, count=100)


@pytest.mark.parametrize("cell", ["n/a", "-", "NaN", "none", "metros", "metri", "mts", "mtrs"])
def test_a_depth_without_a_unit_or_in_metres_of_another_language_is_in_metres(tmp_path, cell):
    data = lines("lat,lon,depth,depth_unit,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{cell},{utc(t)}")
    checked(gathered(tmp_path, data))


@pytest.mark.parametrize("cell", ["ft/s", "boat in harbour"])
def test_words_that_contain_a_unit_are_none(tmp_path, cell):
    data = lines("lat,lon,depth,unit,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{cell},{utc(t)}")
    checked(gathered(tmp_path, data))


def test_the_unit_that_the_user_gives_counts(tmp_path):
    data = lines("lat,lon,depth,unit,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},ft,{utc(t)}")
    found = gathered(tmp_path, data, "--depth-unit", "m")
    checked(found)
    assert "columns not used: unit" in found.lines[0]


def test_a_proposal_keeps_a_column_of_units(tmp_path):
    data = lines(
        "lat,lon,altitude,unit,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{(d - 7.0) / 0.3048:.4f},ft,{utc(t)}Z"
    )
    with pytest.raises(LogError, match="--columns lat,lon,depth,depth_unit,datetime") as refused:
        gathered(tmp_path, data)
    named = re.search(r"--columns (\S+?)[;.]", str(refused.value))[1]
    found = gathered(tmp_path, data, "--columns", named)
    assert found.placed[0].soundings[:, 3] == pytest.approx(ROWS[:, 3] - 7.0, abs=1e-3)


@pytest.mark.parametrize(
    "names",
    ["Latitude (S),Longitude (W)", "lat S,lon W", "Lat_South,Lon_West", "Latitude [°S],Longitude [deg W]"],
)
def test_the_hemisphere_in_a_header_counts(tmp_path, names):
    data = lines(f"{names},Depth,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{utc(t)}")
    found = gathered(tmp_path, data, "--origin", "-46.5", "-6.6")
    north, east = local_from_geodetic(-ROWS[:, 1], -ROWS[:, 2], -46.5, -6.6)
    assert found.placed[0].soundings[:, 1:3] == pytest.approx(np.column_stack([north, east]), abs=0.01)
    assert all(f"column {name} negated" in found.lines[0] for name in names.split(","))


@pytest.mark.parametrize(
    ("names", "sign"),
    [
        ("Latitude (N),Longitude (E)", 1.0),
        ("lat N,lon E", 1.0),
        ("Latitude (N/S),Longitude (E/W)", 1.0),
        ("Latitude (-S),Longitude (-W)", 1.0),
        ("Latitude (S),Longitude (W)", -1.0),  # signed, too
        ("Latitudes,Longitudes", 1.0),
    ],
)
def test_degrees_that_have_their_sign_keep_it(tmp_path, names, sign):
    first = ["--columns", "lat,lon,depth,utc"] if names.startswith("Latitudes") else []
    data = lines(f"{names},Depth,utc", lambda t, a, o, d: f"{sign * a:.8f},{sign * o:.8f},{d:.3f},{utc(t)}")
    found = gathered(tmp_path, data, *first, "--origin", str(sign * 46.5), str(sign * 6.6))
    north, east = local_from_geodetic(sign * ROWS[:, 1], sign * ROWS[:, 2], sign * 46.5, sign * 6.6)
    assert found.placed[0].soundings[:, 1:3] == pytest.approx(np.column_stack([north, east]), abs=0.01)


@pytest.mark.parametrize(
    "names",
    ["Lat (deg),Lat (min),Lon (deg),Lon (min)", "lat_deg,lat_min,lon_deg,lon_min", "Lat,LatMinutes,Lon,LonMinutes"],
)
def test_minutes_in_columns_of_their_own_count(tmp_path, names):
    data = lines(
        f"{names},depth,utc",
        lambda t, a, o, d: f"{int(a)},{60 * (a % 1):.6f},{int(o)},{60 * (o % 1):.6f},{d:.3f},{utc(t)}",
    )
    checked(gathered(tmp_path, data))


@pytest.mark.parametrize("names", ["{}_deg,{}_min,{}_sec", "{} (deg),{} (min),{} (sec)", "{},{} minutes,{} seconds"])
@pytest.mark.parametrize("sign", [1, -1])
def test_seconds_in_columns_of_their_own_count(tmp_path, names, sign):
    def cells(degrees):
        minutes, seconds = divmod(round(3600.0 * degrees, 5), 60.0)
        return f"{sign * (minutes // 60):.0f},{minutes % 60:.0f},{seconds:.5f}"

    header = f"{names.replace('{}', 'lat')},{names.replace('{}', 'lon')},depth,utc"
    data = lines(header, lambda t, a, o, d: f"{cells(a)},{cells(o)},{d:.3f},{utc(t)}")
    found = gathered(tmp_path, data, "--origin", str(sign * 46.5), str(sign * 6.6))
    north, east = local_from_geodetic(sign * ROWS[:, 1], sign * ROWS[:, 2], sign * 46.5, sign * 6.6)
    assert found.placed[0].soundings[:, 1:3] == pytest.approx(np.column_stack([north, east]), abs=0.01)


def test_minutes_beside_whole_positions_do_not_count_twice(tmp_path):
    data = lines("lat,lat_min,lon,lon_min,depth,utc", lambda t, a, o, d: f"{a:.8f},30.1,{o:.8f},36.1,{d:.3f},{utc(t)}")
    checked(gathered(tmp_path, data))


@pytest.mark.parametrize("names", ["lat,lon", "Latitude (ddmm.mmmm),Longitude (dddmm.mmmm)", "lat_ddmm,lon_ddmm"])
def test_degrees_and_minutes_in_one_number(tmp_path, names):
    found = gathered(
        tmp_path, lines(f"{names},depth,utc", lambda t, a, o, d: f"{packed(a)},{packed(o)},{d:.3f},{utc(t)}")
    )
    checked(found)
    assert "positions as degrees and minutes (4630.0000)" in found.lines[0]


@pytest.mark.parametrize("unit", ["DDM", "dm", "ddmm.mmm"])
@pytest.mark.parametrize("cell", ["{0:.0f} {1:.6f}", "{0:.0f}°{1:.6f}'", "{2:.8f}"])
def test_degrees_under_a_header_of_degrees_and_minutes_stay_degrees(tmp_path, unit, cell):
    """DDM is what GPS devices call 46° 30.5'."""

    def text(degrees):
        return cell.format(int(degrees), 60.0 * (degrees % 1.0), degrees)

    names = f"Latitude ({unit}),Longitude ({unit}),depth,utc"
    checked(gathered(tmp_path, lines(names, lambda t, a, o, d: f"{text(a)},{text(o)},{d:.3f},{utc(t)}")))


def test_degrees_and_minutes_in_one_number_with_hemispheres(tmp_path):
    sides = lines("lat,ns,lon,ew,depth,utc", lambda t, a, o, d: f"{packed(a)},N,{packed(o)},E,{d:.3f},{utc(t)}")
    checked(gathered(tmp_path, sides))
    checked(gathered(tmp_path, sides.replace(",N,", "N,").replace(",E,", "E,").replace("ns,", "").replace("ew,", "")))


def test_positions_as_whole_numbers_need_their_unit(tmp_path):
    def data(names):
        return lines(f"{names},depth,utc", lambda t, a, o, d: f"{1e7 * a:.0f},{1e7 * o:.0f},{d:.3f},{utc(t)}")

    checked(gathered(tmp_path, data("lat_e7,lon_e7")))
    checked(gathered(tmp_path, data("latitude (degE7),longitude (degE7)")))
    with pytest.raises(LogError, match=r"latitudes such as 46\d+ are no degrees.*--columns.*lat_e7,lon_e7"):
        gathered(tmp_path, data("lat,lon"))


@pytest.mark.parametrize("form", ["%d-%b-%Y", "%d %b %Y", "%d %B %Y", "%b %d, %Y", "%d-%b-%y", "%d%b%Y"])
def test_months_may_have_names(tmp_path, form):
    day = utc(START_S, form)
    apart = lines("date;time;lat;lon;depth", lambda t, a, o, d: f"{day};{utc(t, '%H:%M:%S')};{a:.8f};{o:.8f};{d:.3f}")
    checked(gathered(tmp_path, apart))
    both = lines("utc;lat;lon;depth", lambda t, a, o, d: f"{day} {utc(t, '%H:%M:%S')};{a:.8f};{o:.8f};{d:.3f}")
    checked(gathered(tmp_path, both))


def test_a_date_that_is_not_understood_is_named_as_ignored(tmp_path):
    data = lines("date,time,lat,lon,depth", lambda t, a, o, d: f"day 3,{utc(t, '%H:%M:%S')},{a:.8f},{o:.8f},{d:.3f}")
    found = gathered(tmp_path, data)
    checked(found, starts=None)
    assert "column date is ignored: 'day 3' is not a date" in found.lines[0]


def joined(second, row, first="utc,lat,lon,depth_m"):
    """Two tables in one file, as `cat` makes them."""
    rows = [f"{utc(t)},{a:.8f},{o:.8f},{d:.3f}" for t, a, o, d in ROWS[:60]]
    return "\n".join([first, *rows, second, *(row(*values) for values in ROWS[60:])]) + "\n"


@pytest.mark.parametrize("second", ["utc,lat,lon,depth_ft", "utc,lon,lat,depth_m", "UTC,lat,lon,temp,depth_m"])
def test_a_second_header_with_other_columns_is_refused(tmp_path, second):
    data = joined(second, lambda t, a, o, d: f"{utc(t)},{a:.8f},{o:.8f},{d / 0.3048:.3f}")
    with pytest.raises(LogError, match=rf"two headers, utc,lat,lon,depth_m and {second} in line 62. Split it there"):
        gathered(tmp_path, data)


@pytest.mark.parametrize(
    "second", ["utc,lat,lon,depth_m", "UTC,Lat,Lon,Depth (m)", "utc,lat,lon,depth_m,temp", "utc: lost"]
)
def test_a_second_header_with_the_same_columns_is_none(tmp_path, second):
    checked(gathered(tmp_path, joined(second, lambda t, a, o, d: f"{utc(t)},{a:.8f},{o:.8f},{d:.3f}")))


def test_words_before_the_header_are_none(tmp_path):
    data = joined("utc,lat,lon,depth_m", lambda t, a, o, d: f"{utc(t)},{a:.8f},{o:.8f},{d:.3f}")
    checked(gathered(tmp_path, "Format: utc,lat,lon,depth,quality\n" + data))


@pytest.mark.parametrize(
    ("header", "arguments"),
    [
        ("depth,height above bottom", ()),
        ("Depth (m),Altitude above bottom [m]", ()),
        ("vehicle_depth,altitude", ()),
        ("ROV depth,DVL altitude", ()),
        ("depth,altitude", ("--columns", "lat,lon,depth,altitude,utc")),
        ("foo,bar", ("--columns", "lat,lon,depth,altitude,utc")),
    ],
)
def test_water_depth_is_the_depth_of_a_vehicle_plus_its_altitude(tmp_path, header, arguments):
    data = lines(f"lat,lon,{header},utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d - 2.0:.3f},2.000,{utc(t)}")
    found = gathered(tmp_path, data, *arguments)
    checked(found)
    assert "the height above the bottom" in found.lines[0]


@pytest.mark.parametrize("header", ["water_depth,altitude", "Water Depth,height above bottom", "depth_m,alt_gps"])
def test_a_depth_of_water_stays_one_beside_an_altitude(tmp_path, header):
    data = lines(f"lat,lon,{header},utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},2.0,{utc(t)}")
    found = gathered(tmp_path, data)
    checked(found)
    assert f"columns not used: {header.split(',')[1]}" in found.lines[0]


@pytest.mark.parametrize(("altitude_m", "asks"), [(2.0, True), (372.4, False), (-3.0, False)])
def test_an_altitude_beside_a_depth_is_a_question_if_it_can_be_above_the_bottom(tmp_path, altitude_m, asks):
    data = lines("lat,lon,depth,altitude,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{altitude_m},{utc(t)}")
    found = gathered(tmp_path, data)
    checked(found)
    assert asks == ("question: column altitude is not used" in "\n".join(found.lines))
    assert "columns not used: altitude" in found.lines[0]


def test_a_row_without_an_altitude_is_left_out_and_the_water_depth_is_preferred(tmp_path):
    data = lines(
        "lat,lon,depth,distance to bottom,utc",
        lambda t, a, o, d: f"{a:.8f},{o:.8f},{d - 2.0:.3f},{'' if t > START_S + 99 else '2.0'},{utc(t)}",
    )
    found = gathered(tmp_path, data)
    checked(found, count=100)
    assert "20 depths without a height above the bottom (column distance to bottom)" in "\n".join(found.lines)
    both = lines(
        "lat,lon,depth,altitude,water depth,utc",
        lambda t, a, o, d: f"{a:.8f},{o:.8f},{d - 2.0:.3f},2.0,{d:.3f},{utc(t)}",
    )
    checked(gathered(tmp_path, both))


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("Latitude (min),Longitude (min)", r"column Latitude \(min\) holds minutes, and no column the degrees.*lat"),
        ("lat,Longitude (min)", r"column Longitude \(min\) holds minutes, and no column the degrees.*column lon,"),
        ("lat_sec,lon", r"column lat_sec holds seconds, and no column the degrees"),
        ("lat,lon,lat_min", r"column lon has whole degrees, and there is no column of its minutes. Add it as lon_min"),
    ],
)
def test_minutes_without_degrees_and_degrees_without_minutes_are_refused(tmp_path, header, message):
    def row(t, a, o, d):
        cells = {"lat": f"{a // 1:.0f}", "lon": f"{o // 1:.0f}"}
        return ",".join([cells.get(name, f"{60 * (a % 1):.6f}") for name in header.split(",")]) + f",{d:.3f},{utc(t)}"

    with pytest.raises(LogError, match=message):
        gathered(tmp_path, lines(f"{header},depth,utc", row))


def test_gon_are_converted_and_an_unknown_unit_of_an_angle_is_named(tmp_path):
    gon = lines("lat (gon),lon (gon),depth,utc", lambda t, a, o, d: f"{a / 0.9:.9f},{o / 0.9:.9f},{d:.3f},{utc(t)}")
    checked(gathered(tmp_path, gon))
    other = lines("lat (mils),lon (deg E),depth,utc", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{utc(t)}")
    found = gathered(tmp_path, other)
    assert "column lat (mils) taken as degrees: the unit 'mils' is not understood" in found.lines[0]
    assert "lon (deg E) taken" not in found.lines[0]


def test_longitudes_of_0_to_360_degrees_give_an_origin_that_a_mission_takes(tmp_path):
    data = lines("lat,lon,depth,utc", lambda t, a, o, d: f"{a:.8f},{o + 260.0:.8f},{d:.3f},{utc(t)}")
    path = tmp_path / "west.csv"
    path.write_text(data)
    options = parser().parse_args([str(path)])
    assert gather(options.logs, user_facts(options)).origin == pytest.approx((46.5, -93.4), abs=0.01)


@pytest.mark.parametrize(("every", "asks"), [(2, True), (40, False)])
def test_depths_of_both_signs_are_a_question(tmp_path, every, asks):
    data = lines(
        "lat,lon,depth,utc",
        lambda t, a, o, d: f"{a:.8f},{o:.8f},{d if (t - START_S) % every else -d:.3f},{utc(t)}",
    )
    found = gathered(tmp_path, data)
    assert asks == ("of 120 depths are negative, and left out" in "\n".join(found.lines))


@pytest.mark.parametrize(
    "cell", ['"{a:.7f}, {o:.7f}"', '"POINT ({o:.6f} {a:.6f})"', "N{a:.6f} E{o:.6f}", '"{a:.6f}N {o:.6f}E"']
)
def test_latitude_and_longitude_in_one_cell_are_named(tmp_path, cell):
    data = lines("position,depth,time", lambda t, a, o, d: f"{cell.format(a=a, o=o)},{d:.2f},{utc(t)}")
    with pytest.raises(LogError, match="Latitude and longitude are in one cell: write them into columns lat and lon"):
        gathered(tmp_path, data)


def test_what_stands_between_blocks_is_no_time_without_a_zone(tmp_path):
    header, *rows = lines("time,lat,lon,depth", lambda t, a, o, d: f"{utc(t)}Z,{a:.8f},{o:.8f},{d:.3f}").splitlines()
    found = gathered(tmp_path, "\n".join([header, *rows[:60], "* begin: again", "begin: again", header, *rows[60:]]))
    checked(found)


def test_degrees_minutes_and_seconds_may_have_hyphens_between_them(tmp_path):
    def row(t, a, o, d):
        parts = [(v // 1, v * 60.0 % 60.0 // 1, v * 3_600.0 % 60.0) for v in (a, o)]
        return (
            ",".join(f"{p[0]:.0f}-{p[1]:02.0f}-{p[2]:07.4f}{side}" for p, side in zip(parts, "NE", strict=True))
            + f",{d:.3f}"
        )

    checked(gathered(tmp_path, lines("lat,lon,depth", row)), starts=None)
    checked(
        gathered(
            tmp_path, lines("lat;lon;depth", lambda t, a, o, d: f"46-{a % 1 * 60:.6f}N;6-{o % 1 * 60:.6f}E;{d:.3f}")
        ),
        starts=None,
    )


@pytest.mark.parametrize("cell", ["1150199.34.5", "1150199.34mN"])
def test_metres_that_are_no_numbers_are_shown(tmp_path, cell):
    with pytest.raises(LogError, match=r"positions are neither numbers .*150.*Write metres, such as"):
        gathered(tmp_path, lines("east,north,depth", lambda t, a, o, d: f"{cell},{cell},{d:.3f}"), "--crs", "EPSG:2056")


def test_positions_in_one_cell_are_named(tmp_path):
    def row(t, a, o, d):
        return f"N46 {a % 1 * 60:.5f} E6 {o % 1 * 60:.5f},{d:.2f} m,{int(t)}"

    with pytest.raises(LogError, match="Latitude and longitude are in one cell"):
        gathered(tmp_path, lines("Position,Depth,Time", row))
