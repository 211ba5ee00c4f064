"""Headers of tables: behind a sign of comments, and with units in words; and columns that hold nothing."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest
from adjust.survey_logs import START_S
from adjust.tables import ROWS, checked, gathered, lines, utc

from auv_lse_common.vocabulary.frames import local_from_geodetic
from auv_lse_shore.survey_import.command import parser, user_facts
from auv_lse_shore.survey_import.gather import gather
from auv_lse_shore.survey_import.survey_log import LogError


def row(t, a, o, d):
    return f"{a:.8f},{o:.8f},{d / 0.3048:.4f},{utc(t)}Z"


@pytest.mark.parametrize("sign", ["*", "# ", "% ", "#", "// ", "! ", "*  "])
@pytest.mark.parametrize("title", ["", "# Survey of the lake\n", "* lake, north\n\n"])
def test_a_header_behind_a_sign_of_comments_counts(tmp_path, sign, title):
    checked(gathered(tmp_path, title + lines(f"{sign}lat,lon,depth_ft,time", row)))
    data = title + lines(f"{sign}lat lon depth_ft time", lambda *r: row(*r).replace(",", " "))
    checked(gathered(tmp_path, data))


def test_a_row_of_units_behind_a_sign_of_comments_counts(tmp_path):
    checked(gathered(tmp_path, lines("# lat lon depth time\n# deg deg ft utc", lambda *r: row(*r).replace(",", " "))))


def test_a_comment_above_a_header_stays_one(tmp_path):
    checked(gathered(tmp_path, lines("# east, north, z, clock\nlat,lon,depth_ft,time\n# 1,2,3,4", row)))
    deeper = lines("# bathymetry of the north bay", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{1000 * t:.0f}")
    checked(gathered(tmp_path, deeper))


def test_rows_behind_a_star_are_counted(tmp_path):
    rows = [row(*r) for r in ROWS]
    data = "\n".join(["lat,lon,depth_ft,time", *rows[:100], *(f"*{text}" for text in rows[100:])])
    found = gathered(tmp_path, data)
    checked(found, count=100)
    assert found.placed[0].left_out["positions that are not numeric"] == 20
    with pytest.raises(LogError, match=r"its positions are neither numbers .* '\*46.5"):
        gathered(tmp_path, lines("lat,lon,depth_ft,time", lambda *r: f"*{row(*r)}"))


def of_a_vehicle(header, depth_m, height_m, cells=""):
    """A table of a vehicle at a depth that changes, with its height above the bottom, each in a unit (m)."""

    def written(t, a, o, d):
        own = 2.0 + 0.5 * np.sin(t)
        return f"{a:.8f},{o:.8f},{own / depth_m:.4f},{(d - own) / height_m:.4f},{utc(t)}Z{cells}"

    return lines(f"lat,lon,{header}", written)


@pytest.mark.parametrize(
    ("header", "depth_m", "height_m", "cells"),
    [
        ("depth_ft,altimeter,time", 0.3048, 0.3048, ""),
        ("depth (ft),height above bottom,time", 0.3048, 0.3048, ""),
        ("vehicle_depth_ft,altitude,time", 0.3048, 0.3048, ""),
        ("depth_ft,altimeter_m,time", 0.3048, 1.0, ""),
        ("depth,altimeter_ft,time", 1.0, 0.3048, ""),
        ("depth,altimeter,time", 1.0, 1.0, ""),
        ("depth,altimeter,time,depth_unit", 0.3048, 0.3048, ",ft"),
        ("depth,altimeter_m,time,depth_unit", 0.3048, 1.0, ",ft"),
    ],
)
def test_a_height_above_the_bottom_without_a_unit_is_in_that_of_the_depth(tmp_path, header, depth_m, height_m, cells):
    found = gathered(tmp_path, of_a_vehicle(header, depth_m, height_m, cells))
    checked(found)
    assert "the height above the bottom" in found.lines[0]
    assert "--depth-unit" not in found.lines[0]


def test_the_depth_unit_is_that_of_heights_in_a_unit_that_is_not_understood(tmp_path):
    data = of_a_vehicle("depth,altimeter (pieds),time", 0.3048, 0.3048)
    checked(gathered(tmp_path, data, "--depth-unit", "ft"))


@pytest.mark.parametrize("cell", ["0", "-1", "-9999", "0.0", "9999"])
def test_heights_above_the_bottom_without_any_echo_are_not_added(tmp_path, cell):
    data = lines("lat,lon,depth,altimeter,time", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f},{cell},{utc(t)}Z")
    found = gathered(tmp_path, data)
    checked(found)
    assert "column altimeter is not added: it has no height" in found.lines[0]
    with pytest.raises(LogError, match="120 depths without a height above the bottom"):
        gathered(tmp_path, data, "--columns", "lat,lon,depth,altitude,time")


@pytest.mark.parametrize(
    ("header", "unit_m"),
    [
        ("depth_in_ft", 0.3048),
        ("depth_in_meters", 1.0),
        ("Depth (inches)", 0.0254),
        ("depth_inches", 0.0254),
        ("depth_in", 0.0254),
        ("Tiefe in Metern", 1.0),
        ("Tiefe in Zentimetern", 0.01),
    ],
)
def test_units_in_words_of_a_header(tmp_path, header, unit_m):
    data = lines(f"lat,lon,{header},time", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d / unit_m:.4f},{utc(t)}Z")
    found = gathered(tmp_path, data)
    checked(found)
    assert "not understood" not in found.lines[0]


@pytest.mark.parametrize(
    ("header", "unit_m", "name"),
    [
        ("Lat,Lon,Depth in ft below surface,When", 0.3048, "depth_ft"),
        ("Lat,Lon,Lake floor [ft],When", 0.3048, "depth_ft"),
        ("Lat,Lon,Lake floor,When\n-,-,feet,-", 0.3048, "depth_feet"),
        ("Lat,Lon,Lake floor (m),When", 1.0, "depth_m"),
        ("Lat,Lon,Lake floor in front,When", 1.0, "depth"),
        ("Lat,Lon,Lake floor,When", 1.0, "depth"),
    ],
)
def test_proposed_columns_keep_the_unit_of_the_header(tmp_path, header, unit_m, name):
    data = lines(header, lambda t, a, o, d: f"{a:.8f},{o:.8f},{d / unit_m:.4f},{utc(t)}Z")
    with pytest.raises(LogError, match=rf"--columns lat,lon,{name},datetime\."):
        gathered(tmp_path, data)
    checked(gathered(tmp_path, data, "--columns", f"lat,lon,{name},datetime"))


@pytest.mark.parametrize("sign", ["#", "% ", "* "])
def test_joined_tables_whose_headers_are_behind_signs_of_comments(tmp_path, sign):
    rows = [row(*r) for r in ROWS]
    header, other = f"{sign}lat,lon,depth_ft,time", f"{sign}lat,lon,depth_m,time"
    with pytest.raises(LogError, match=r"has two headers, lat,lon,depth_ft,time and .*depth_m,time in line 62"):
        gathered(tmp_path, "\n".join([header, *rows[:60], other, *rows[60:]]))
    checked(gathered(tmp_path, "\n".join([header, *rows[:60], header, *rows[60:]])))
    notes = f"{sign}lat,lon,depth of the north bay", f"{sign}begin"
    checked(gathered(tmp_path, "\n".join([header, *rows[:60], *notes, *rows[60:]])))
    checked(gathered(tmp_path, "\n".join(["lat,lon,depth_ft,time", *rows[:60], other, *rows[60:]])))


def blanks(header, *more):
    """A table with blanks between fields; some columns hold 1, 2 and so on."""
    ends = "".join(f" {k}" for k in more)
    return lines(header, lambda t, a, o, d: f"{a:.8f} {o:.8f} {d:.3f} {t:.0f}{ends}")


@pytest.mark.parametrize(
    "header",
    [
        "Latitude (N) Longitude (E) Depth (m) time (s)",
        "lat [deg] lon [deg] depth [m] time",
        "lat lon depth time note",
        "lat lon depth time",
    ],
)
def test_units_in_brackets_are_no_columns_of_a_table_with_blanks(tmp_path, header):
    checked(gathered(tmp_path, blanks(header)))


@pytest.mark.parametrize(
    "header", ["lat lon water depth time", "Position lat lon depth time", "lat lon sea depth time (s)"]
)
def test_names_of_several_words_in_a_table_with_blanks_are_refused(tmp_path, header):
    with pytest.raises(
        LogError, match=r"has 5 names in its header and 4 fields in its rows.*--columns lat,lon,depth,time"
    ):
        gathered(tmp_path, blanks(header))
    checked(gathered(tmp_path, blanks(header), "--columns", "lat,lon,depth,time"))
    checked(
        gathered(tmp_path, blanks(header.replace("water depth", "depth").replace("sea ", "").replace("Position ", "")))
    )


def test_a_last_column_that_few_rows_of_a_table_with_blanks_have_is_one(tmp_path):
    text = blanks("lat lon depth time note").replace(f"{ROWS[7][0]:.0f}\n", f"{ROWS[7][0]:.0f} here\n")
    checked(gathered(tmp_path, text))


@pytest.mark.parametrize(
    "header", ["# lat (deg) lon (deg) depth (ft) time", "# lat [deg] lon [deg] depth [ft] time (utc)"]
)
def test_units_in_brackets_of_a_header_behind_a_sign_of_comments(tmp_path, header):
    checked(gathered(tmp_path, lines(header, lambda *r: row(*r).replace(",", " "))))


@pytest.mark.parametrize("sign", [" ", ",", ";"])
@pytest.mark.parametrize(
    "header", ["datetime lat lon depth", "lat lon depth time_utc", "lat lon Date depth", "date lat lon depth note"]
)
@pytest.mark.parametrize("form", ["%Y-%m-%d", "%d.%m.%Y", "%Y-%j"])
def test_one_name_for_a_date_and_a_time_in_two_columns(tmp_path, sign, header, form):
    def row(t, a, o, d):
        cells = {"lat": f"{a:.8f}", "lon": f"{o:.8f}", "depth": f"{d:.3f}", "note": "7"}
        return sign.join(cells.get(name, utc(t, f"{form}{sign}%H:%M:%S")) for name in header.split())

    checked(gathered(tmp_path, lines(header.replace(" ", sign), row), "--day-first"))


@pytest.mark.parametrize(
    ("header", "cells"),
    [
        ("date time lat lon depth", "{date} {time} {a:.8f} {o:.8f} {d:.3f} 7"),
        ("time date lat lon depth", "{time} {date} {a:.8f} {o:.8f} {d:.3f} 7"),
        ("time lat lon depth", "{t:.0f} {a:.8f} {o:.8f} {d:.3f} 7"),
        ("date time lat lon depth", "{date} {time} {a:.8f} {o:.8f} {d:.3f} {date} {time}"),
        ("lat lon depth datetime", "{a:.8f} {o:.8f} {d:.3f} {date}T{time} 12:00"),
    ],
)
def test_further_columns_behind_times_leave_them_as_they_are(tmp_path, header, cells):
    def row(t, a, o, d):
        return cells.format(t=t, a=a, o=o, d=d, date=utc(t, "%Y-%m-%d"), time=utc(t, "%H:%M:%S"))

    checked(gathered(tmp_path, lines(header, row)))


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("Lat\tLon\tDepth (ft)\tTemp (F)\tTime", "{a:.8f}\t{o:.8f}\t{f:.3f}\t66.2\t{time:%m/%d/%Y %I:%M:%S %p}"),
        ("Lat,Lon,Depth (ft),Time", "{n:.0f} {m:.6f} N,{e:.0f} {u:.6f} E,{f:.3f},{time:%Y-%m-%d %H:%M:%S}"),
        ("Lat,Lon,Depth (ft),Time", "N{n:.0f} {m:.6f},E{e:.0f} {u:.6f},{f:.3f},{time:%d %b %Y %H:%M:%S}"),
        ("Lat Lon Depth (ft) Time", "{a:.8f} {o:.8f} {f:.3f} {time:%Y-%m-%d %H:%M:%S}"),
        ("Time Lat Lon Depth (ft)", "{time:%Y-%m-%d %H:%M:%S} {a:.8f} {o:.8f} {f:.3f}"),
        (",Lat,Lon,Depth (ft),Time", "7,{a:.8f},{o:.8f},{f:.3f},{time:%Y-%m-%d %H:%M:%S}"),
        ("Lat (N) Lon (E) Depth (ft)", "{a:.8f} N {o:.8f} E {f:.3f} ft"),
        ("Zeit;Lat;Lon;Tiefe (ft)", "{time:%d.%m.%Y %H:%M:%S};{ac};{oc};{fc}"),
        ("Zeit Lat Lon Tiefe (ft)", "{time:%d.%m.%Y} {time:%H:%M:%S} {ac} {oc} {fc}"),
    ],
)
def test_units_of_a_header_count_where_cells_have_blanks(tmp_path, header, row):
    def written(t, a, o, d):
        numbers = {"a": a, "o": o, "f": d / 0.3048, "n": a // 1, "m": a % 1 * 60, "e": o // 1, "u": o % 1 * 60}
        commas = {f"{key}c": f"{numbers[key]:.8f}".replace(".", ",") for key in "aof"}
        return row.format(time=datetime.fromtimestamp(t, UTC), **numbers, **commas)

    checked(
        gathered(tmp_path, lines(header, written), "--no-day-first" if "%m/" in row else "--day-first"), starts=None
    )


@pytest.mark.parametrize("header", ["E,N,depth", "n,e,depth", "point,N,E,depth", "X_UTM,Y_UTM,depth"])
def test_metres_may_be_under_single_letters(tmp_path, header):
    def row(t, a, o, d):
        north, east = local_from_geodetic(a, o, 46.5, 6.6)
        cells = {"N": north, "E": east, "X_UTM": east, "Y_UTM": north, "depth": d, "point": 7}
        return ",".join(f"{cells.get(name, cells.get(name.upper())):.3f}" for name in header.split(","))

    path = tmp_path / "table.txt"
    path.write_text(lines(header, row))
    checked(gather([path], user_facts(parser().parse_args([str(path)]))), starts=None)


def test_fields_behind_the_last_name_of_a_table_with_blanks_are_not_used(tmp_path):
    checked(gathered(tmp_path, blanks("lat lon depth time", 5, 6)))
    checked(gathered(tmp_path, blanks("lat lon depth", 5)), starts=None)


@pytest.mark.parametrize(
    ("header", "cells"),
    [
        ("time lat lon speed depth note", "{t:.0f} {a:.8f} {o:.8f} 1.{u:.0f} {d:.3f}"),
        ("time lat lon speed depth", "{t:.0f} {a:.8f} {o:.8f} 1.{u:.0f} {d:.3f} 7"),
        ("time pitch roll lat lon depth", "{t:.0f} 0.12{u:.0f}3 0.34{u:.0f}5 {a:.8f} {o:.8f} {d:.3f} 7"),
        ("date time lat lon speed depth", "2026-05-03 {c} {a:.8f} {o:.8f} 1.{u:.0f} {d:.3f} 7"),
    ],
)
def test_values_that_look_like_others_are_no_reason_to_refuse_a_table_with_blanks(tmp_path, header, cells):
    data = lines(header, lambda t, a, o, d: cells.format(t=t, a=a, o=o, d=d, u=t % 10, c=utc(t, "%H:%M:%S")))
    checked(gathered(tmp_path, data), starts=None)


@pytest.mark.parametrize(("shift_deg", "other"), [(0.0, True), (100.0, False)])
def test_a_proposal_has_both_orders_of_latitude_and_longitude_that_the_values_allow(tmp_path, shift_deg, other):
    data = lines("", lambda t, a, o, d: f"{a:.8f} {o + shift_deg:.8f} {-d:.3f}").lstrip("\n")
    with pytest.raises(LogError, match=r"look like: --columns lat,lon,elevation") as raised:
        gathered(tmp_path, data)
    assert (", or lon,lat,elevation if longitude comes first" in str(raised.value)) == other


@pytest.mark.parametrize(
    ("above", "unit_m"),
    [
        ("time,latitude,longitude,depth\nUTC,degrees_north,degrees_east,m", 1.0),
        ("time,latitude,longitude,depth\nUTC,degrees_north,degrees_east,ft", 0.3048),
        ("Survey,Lake,north,2026\ntime,lat,lon,depth_ft", 0.3048),
        ("Boat,Sensor,Sensor,Sensor\nutctime,gps latitude,gps longitude,water depth (ft)", 0.3048),
    ],
)
def test_a_row_of_units_and_a_title_above_the_names(tmp_path, above, unit_m):
    data = lines(above, lambda t, a, o, d: f"{utc(t)}Z,{a:.8f},{o:.8f},{d / unit_m:.3f}")
    checked(gathered(tmp_path, data))


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("form", ["{i}", '"{i}"'])
@pytest.mark.parametrize("sign", [",", " ", ";"])
def test_numbers_of_rows_may_have_no_name(tmp_path, first, form, sign):
    def row(t, a, o, d):
        number = form.format(i=first + round(t - START_S))
        return sign.join([number, f"{a:.8f}", f"{o:.8f}", "1.5", f"{d:.3f}", f"{utc(t)}Z"])

    checked(gathered(tmp_path, lines(sign.join(["lat", "lon", "speed", "depth", "time"]), row)))


@pytest.mark.parametrize("end", ["", "7", "a"])
def test_seconds_that_count_up_are_no_numbers_of_rows(tmp_path, end):
    data = lines("time,lat,lon,depth", lambda t, a, o, d: f"{t - START_S:.0f},{a:.8f},{o:.8f},{d:.3f},{end}")
    checked(gathered(tmp_path, data, "--date", "2026-05-03T10:00:00Z"))


@pytest.mark.parametrize(("header", "side"), [("LatN,LonE", 1.0), ("Lat,LonW", -1.0), ("Lat,Lon W", -1.0)])
def test_a_side_at_the_end_of_a_name(tmp_path, header, side):
    data = lines(f"{header},depth", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f}")
    path = tmp_path / "table.txt"
    path.write_text(data)
    found = gather([path], user_facts(parser().parse_args([str(path)])))
    assert found.origin[1] == pytest.approx(side * 6.6, abs=1e-4)


@pytest.mark.parametrize(
    "names",
    [
        "HF Depth (ft),LF Depth (ft)",
        "Depth 200kHz (ft),Depth 30 kHz (ft)",
        "depth_hf_ft,depth_lf_ft",
        "200kHz_depth_ft,x",
        "Depth (200 kHz) [ft],Depth (30 kHz) [ft]",
    ],
)
def test_depths_of_several_frequencies(tmp_path, names):
    found = gathered(
        tmp_path, lines(f"lat,lon,{names},time", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d / 0.3048:.3f},99,{utc(t)}Z")
    )
    checked(found)
    assert f"columns not used: {names.partition(',')[2]}" in found.lines[0]


@pytest.mark.parametrize("name", ["half", "shelf", "depth_std_lf", "hfx"])
def test_what_only_ends_like_a_frequency_is_no_depth(tmp_path, name):
    with pytest.raises(LogError, match="a position or a depth is not among them"):
        gathered(tmp_path, lines(f"lat,lon,{name}", lambda t, a, o, d: f"{a:.8f},{o:.8f},{d:.3f}"))


@pytest.mark.parametrize("zone", ["UTC", "AM", "CEST"])
@pytest.mark.parametrize("header", ["lat lon depth_ft time", "Date lat lon depth_ft", "lat lon datetime depth_ft"])
def test_a_zone_or_half_of_the_day_behind_a_date_and_a_time_below_one_name(tmp_path, header, zone):
    def row(t, a, o, d):
        cells = {"lat": f"{a:.8f}", "lon": f"{o:.8f}", "depth_ft": f"{d / 0.3048:.3f}"}
        return " ".join(cells.get(name, f"{utc(t, '%Y-%m-%d %I:%M:%S')} {zone}") for name in header.split())

    found = gathered(tmp_path, lines(header, row))
    checked(found)
    assert any("--utc-offset" in line for line in found.lines) is (zone != "UTC")


@pytest.mark.parametrize("sign", ["\t", ";", ",", "|"])
def test_words_in_cells_make_no_table_with_blanks(tmp_path, sign):
    def row(t, a, o, d):
        cells = [
            utc(t, "%Y-%m-%d %H:%M:%S"),
            f"{a:.8f}",
            "N",
            f"{o:.8f}",
            "E",
            f"{d / 0.3048:.3f}",
            "run 1",
            "mud or sand",
        ]
        return sign.join(cells)

    names = ["Date Time", "Lat", "N/S", "Lon", "E/W", "Depth (ft)", "Line Name", "Bottom Type"]
    checked(gathered(tmp_path, lines(sign.join(names), row)))


def test_a_table_with_blanks_may_have_one_tab_in_its_rows(tmp_path):
    data = lines("lat lon\tdepth_ft time", lambda t, a, o, d: f"{a:.8f} {o:.8f}\t{d / 0.3048:.3f} {utc(t)}Z")
    checked(gathered(tmp_path, data))
    data = lines("lat lon depth_ft", lambda t, a, o, d: f"{a:.6f} {o:.6f} {d / 0.3048:.3f}".replace(".", ","))
    checked(gathered(tmp_path, data), starts=None)


@pytest.mark.parametrize("cell", ["run 1", "mud", "mud and sand"])
def test_words_between_blanks_before_the_depth_shift_no_columns(tmp_path, cell):
    data = lines("lat lon name depth_ft volt", lambda t, a, o, d: f"{a:.8f} {o:.8f} {cell} {d / 0.3048:.3f} 12.1")
    shifted = lines(
        "name date time depth lat lon", lambda t, a, o, d: f"{cell} {utc(t, '%Y-%m-%d %H:%M:%S')} {d} {a} {o}"
    )
    if " " in cell:
        with pytest.raises(LogError):
            gathered(tmp_path, shifted)
    else:
        checked(gathered(tmp_path, shifted))
        checked(gathered(tmp_path, data), starts=None)
        checked(gathered(tmp_path, data.replace(" 12.1", " 12.1 13 ok")), starts=None)
        return
    columns = f"lat,lon,{'-,' * len(cell.split())}depth_ft,-"
    with pytest.raises(LogError, match=f"names in its header.*--columns {columns}"):
        gathered(tmp_path, data)
    checked(gathered(tmp_path, data, "--columns", columns), starts=None)


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("Lat N/S Lon E/W Depth_ft Time", "{a:.8f} N {o:.8f} E {f:.3f} {time:%Y-%m-%dT%H:%M:%SZ}"),
        ("Date Time Lat N/S Lon E/W Depth_ft", "{time:%Y-%m-%d %H:%M:%S} {a:.8f} N {o:.8f} E {f:.3f}"),
        (
            "time\tTemp (C)\tLat\tLon\tDepth (ft)",
            "{time:%Y-%m-%d %H:%M:%S} UTC\t12.3\tN 46 {m:.6f}\tE 6 {u:.6f}\t{f:.3f}",
        ),
        (
            "Date\tTime\tSats\tLat\tN/S\tLon\tE/W\tDepth_ft",
            "{time:%Y-%m-%d\t%H:%M:%S}\t12\t{a:.8f}\tN\t{o:.8f}\tE\t{f:.3f}",
        ),
        ("Speed;Time;Lat;Lon;Name;Depth_ft", "3.9;{time:%d %b %Y %H:%M:%S};{a:.8f};{o:.8f};run 1;{f:.3f}"),
        ("Lat_deg Lon_deg Depth_ft Time", "{a:.8f} {o:.8f} {f:.3f} {time:%Y-%m-%dT%H:%M:%SZ}"),
    ],
)
@pytest.mark.parametrize("comma", [False, True])
def test_commas_in_numbers_do_not_split_cells_of_words(tmp_path, header, row, comma):
    def written(t, a, o, d):
        numbers = {"a": a, "o": o, "f": d / 0.3048, "m": a % 1 * 60, "u": o % 1 * 60}
        text = row.format(time=datetime.fromtimestamp(t, UTC), **numbers)
        return text.replace(".", ",") if comma else text

    checked(gathered(tmp_path, lines(header, written)))


def test_a_proposal_has_no_position_around_a_time(tmp_path):
    data = lines("volt a b c d", lambda t, a, o, d: f"12.1 {1000 * t:.0f} {a:.8f} {o:.8f} {d:.3f}")
    with pytest.raises(LogError, match="--columns -,time_ms,lat,lon,depth"):
        gathered(tmp_path, data)


@pytest.mark.parametrize("name", ["Depth_MLLW_ft", "CORR_DEPTH (ft)", "Bathy depth [ft]", "Depth NAVD88 (ft)"])
def test_names_of_depths_in_archives_and_datums_behind_them(tmp_path, name):
    header = f"utc\tlat\tlon\tTWT\t{name}"

    def row(t, a, o, d):
        return f"{utc(t)}\t{a:.8f}\t{o:.8f}\t{d / 750.0:.5f}\t{d / 0.3048:.3f}"

    checked(gathered(tmp_path, lines(header, row)))


@pytest.mark.parametrize("name", ["ELEV_NAVD88_FT", "Elevation NGVD29 (ft)", "Z_LN02_ft"])
def test_elevations_above_a_datum_need_the_water_surface(tmp_path, name):
    data = lines(f"utc,lat,lon,{name}", lambda t, a, o, d: f"{utc(t)},{a:.8f},{o:.8f},{(372.0 - d) / 0.3048:.3f}")
    with pytest.raises(LogError, match="--surface"):
        gathered(tmp_path, data)
    checked(gathered(tmp_path, data, "--surface", "372"))


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("Long;Lat;Min;Avg", "lon,lat,elevation,-"),
        ("Long;Lat;TWT;Min depth", "lon,lat,-,depth"),
        ("Long;Lat;TWT;ellipsoidal_height_m", "lon,lat,-,elevation_m"),
    ],
)
def test_a_proposal_keeps_the_names_that_are_known(tmp_path, header, columns):
    sign, base = (-1.0, 0.0) if "Avg" in header else (1.0, 0.0) if "depth" in header else (-1.0, 420.0)
    data = lines(header, lambda t, a, o, d: f"{o:.8f};{a:.8f};{base + sign * d:.3f};{base + sign * d + 0.001:.3f}")
    with pytest.raises(LogError, match=f"--columns {columns}[.]$"):
        gathered(tmp_path, data)


def test_a_proposal_keeps_names_of_columns_that_are_apart(tmp_path):
    """As the viewer of a Ping echo sounder writes them."""
    header = "timestamp,distance_mm,confidence,latitude,longitude"
    data = lines(header, lambda t, a, o, d: f"{utc(t)},{1000.0 * d:.0f},95,{a:.8f},{o:.8f}")
    with pytest.raises(LogError, match="--columns datetime,depth_mm,quality,lat,lon"):
        gathered(tmp_path, data)
    checked(gathered(tmp_path, data, "--columns", "datetime,depth_mm,quality,lat,lon"))


@pytest.mark.parametrize("header", ["", "lon,lat,bottom"])
def test_a_proposal_asks_for_the_water_surface_if_values_may_be_elevations(tmp_path, header):
    data = lines(header, lambda t, a, o, d: f"{o:.8f},{a:.8f},{372.0 - d:.3f}")
    with pytest.raises(LogError, match=r"if 3\d\d.\d to 3\d\d.\d are elevations, write elevation, .* with --surface M"):
        gathered(tmp_path, data)
    checked(gathered(tmp_path, data, "--columns", "lon,lat,elevation", "--surface", "372"), starts=None)
    with pytest.raises(LogError, match="depth") as shallow:
        gathered(tmp_path, lines(header, lambda t, a, o, d: f"{o:.8f},{a:.8f},{2.0 * (d - 6.0):.3f}"))
    assert "elevations" not in str(shallow.value)


def test_what_is_known_of_a_table_without_depths_is_proposed(tmp_path):
    """Heights on both sides of the surface can be depths or elevations."""
    data = lines(
        "", lambda t, a, o, d: f"{2_302_000 + 1e5 * (o - 6.6):.2f},{5_026_000 + 1e5 * (a - 46.5):.2f},{d - 12:.2f}"
    )
    with pytest.raises(
        LogError, match=r"look like: --columns east,north,-; write depth, or elevation with --surface M"
    ):
        gathered(tmp_path, data.lstrip("\n"))


def test_a_second_column_of_depths_is_named(tmp_path):
    data = lines("X,Y,Depth.sample,Depth.water", lambda t, a, o, d: f"{o:.8f},{a:.8f},{0.5 * d:.1f},{d:.2f}")
    with pytest.raises(LogError, match=r"--columns .*,depth,-; depths are perhaps those of Depth\.water instead\.$"):
        gathered(tmp_path, data)


@pytest.mark.parametrize(
    "line",
    [
        "2026-06-14T10:00:0{}.1Z,3,128267,35,255,8,ff,5c,02,{}0,00,00,00,ff",
        "<0x0df50b23> [8] ff 5c 02 {}{} 00 00 00 ff",
        "(17456009{}1.338397) can0 11FB1063#0B{}E61FFFFFFFFFF",
        "$PDGY,{}00000,4,,5,48{},1,0",
        "{}8,48702{},127245,Rudder,Garmin,1,255,2,1,8,0x00F8FF7F5FB8FFFF",
    ],
)
def test_frames_of_nmea_2000_are_no_table(tmp_path, line):
    with pytest.raises(LogError, match="frames of NMEA 2000: convert them to NMEA 0183"):
        gathered(tmp_path, "\n".join(line.format(n % 10, n % 10) for n in range(50)))


def test_numbers_of_two_digits_are_no_frames_of_nmea_2000(tmp_path):
    data = lines("a,b,c,yy,mo,dd,hh,mi,ss,sats,hdop", lambda t, a, o, d: f"{a},{o},{d},26,06,14,10,00,10,12,10")
    with pytest.raises(LogError, match="By their values they look like: --columns lat,lon,depth"):
        gathered(tmp_path, data)


@pytest.mark.parametrize("depth", ["depth (m, corrected)", "depth [m, corrected]"])
def test_a_comma_between_brackets_of_a_header_is_part_of_a_name(tmp_path, depth):
    """The depth was read from the column behind it."""
    data = lines(f"lat,lon,speed (m, s),{depth},temp,utc", lambda t, a, o, d: f"{a},{o},1,{d},14,{utc(t)}")
    found = gathered(tmp_path, data)
    checked(found)
    assert f"column {depth}" in found.lines[0]
