"""Files of soundings: the dialects that are read, and what is said about the others."""

import numpy as np
import pytest

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_gp import GpConfig, OnlineGp, read_soundings
from auv_lse_gp.soundings import local_positions, read_soundings_and_origin
from auv_lse_gp.soundings_table import read_table
from auv_lse_gp.tables.dialect import dialect_of
from auv_lse_gp.tables.table_error import TableError


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
def test_tables_with_comments_and_other_separators(tmp_path, separator):
    path = tmp_path / "survey.txt"
    rows = [["Line", "East_m", "North_m", "elevation_m"], ["1", "20", "10", "-5.5"], ["2", "21", "11", "-6"]]
    path.write_text("# a survey, of 2020\n\n" + "\n# again\n".join(separator.join(row) for row in rows) + "\n")
    assert read_soundings(path).tolist() == [[10.0, 20.0, 5.5], [11.0, 21.0, 6.0]]


@pytest.mark.parametrize("names", ["East (m),North [m],Elevation (metres)", "Easting (m),Northing (m),Elevation [m]"])
def test_units_may_be_in_brackets(tmp_path, names):
    path = tmp_path / "survey.csv"
    path.write_text(f"{names}\n20,10,-5.5\n")
    assert read_soundings(path).tolist() == [[10.0, 20.0, 5.5]]
    path.write_text("Latitude (deg),Longitude [°],Depth (m)\n46.5,6.6,1.5\n")
    table = read_table(path)
    assert (table.lat_deg, table.lon_deg, table.values) == ([46.5], [6.6], [1.5])
    path.write_text("lat,lon,Depth (ft)\n46.5,6.6,1.5\n")
    assert read_table(path).values == pytest.approx([1.5 * 0.3048])
    path.write_text("lat,lon,Depth (cubit)\n46.5,6.6,1.5\n")
    with pytest.raises(TableError, match=r"survey\.csv: column Depth \(cubit\) is in 'cubit', which is no unit"):
        read_table(path)


def test_degrees_use_their_middle_as_origin_only_if_none_is_needed(tmp_path):
    path = tmp_path / "survey.csv"
    path.write_text("lat,lon,depth_m\n45.000,7.001,10\n45.002,7.001,11\n45.001,7.000,12\n45.001,7.002,13\n")
    soundings, origin = read_soundings_and_origin(path)
    assert origin == pytest.approx((45.001, 7.001))
    # a milli-degree at 45 degrees of latitude: 111.13 m north, 78.85 m east
    wanted = [[-111.13, 0, 10], [111.13, 0, 11], [0, -78.85, 12], [0, 78.85, 13]]
    assert soundings == pytest.approx(np.array(wanted), abs=0.02)
    with pytest.raises(ParameterError, match=r"survey\.csv has columns lat, lon; give north_m, east_m"):
        OnlineGp(GpConfig(mean="survey", survey_file=str(path)))
    path.write_text("lat,lon,depth_m\n4500.1,7.001,10\n")
    with pytest.raises(ValueError, match=r"survey\.csv:2: lat is '4500\.1'\. Write degrees\."):
        read_soundings_and_origin(path)


def test_a_header_in_cyrillic_letters_of_utf_16_is_text(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(
        ("# \u0441\u044a\u0451\u043c\u043a\u0430\n" * 9 + "north_m,east_m,depth_m\n1,2,3\n").encode("utf-16")
    )
    assert read_soundings(path).tolist() == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize("begin", [b"\xa3\x95\x80\x80Y", b"PK\x03\x04\x14", b"\x00\x06\x1b\xfd\n1,2,3\n"])
def test_a_file_that_is_no_text_is_not_shown_to_the_terminal(tmp_path, begin):
    """A log or a spreadsheet: its bytes stood in the error as columns."""
    path = tmp_path / "a.tlog"
    path.write_bytes(begin + bytes(range(256)) * 40)
    with pytest.raises(TableError, match=r"a\.tlog is not text\. Save the table as CSV; auv_lse import reads logs$"):
        read_soundings_and_origin(path)


@pytest.mark.parametrize(
    ("header", "row", "wrong"),
    [("north_m,east_m,depth_m", "{0},{0},5", "1e308,1,5"), ("lat,lon,depth_m", "46.50{0},6.6,5", "4.65,6.6,5")],
)
def test_one_position_far_from_all_others_is_refused(tmp_path, header, row, wrong):
    path = tmp_path / "survey.csv"
    path.write_text("\n".join([header, *(row.format(10 + n) for n in range(20)), wrong]))
    with pytest.raises(TableError, match=r"survey\.csv:22: .* lies more than 1000 km from the others, as on 1 line\."):
        read_soundings_and_origin(path)


@pytest.mark.parametrize("separator", [";", "\t", " "])
def test_decimal_commas_between_other_separators(tmp_path, separator):
    path = tmp_path / "survey.txt"
    rows = [["east_m", "north_m", "depth_m"], ["20,5", "10,25", "5,5"]]
    path.write_text("\n".join(separator.join(row) for row in rows))
    assert read_soundings(path).tolist() == [[10.25, 20.5, 5.5]]


def test_the_middle_of_longitudes_of_0_to_360_degrees_on_both_sides_of_greenwich_is_between_them(tmp_path):
    path = tmp_path / "survey.csv"
    path.write_text("lat,lon,depth_m\n51.48,359.999,10\n51.48,0.001,11\n")
    soundings, origin = read_soundings_and_origin(path)
    assert origin == pytest.approx((51.48, 0.0), abs=1e-9)
    assert np.abs(soundings[:, :2]).max() < 100.0


def test_the_middle_of_soundings_on_both_sides_of_the_antimeridian_is_between_them(tmp_path):
    path = tmp_path / "survey.csv"
    path.write_text("lat,lon,depth_m\n-16.8,179.999,10\n-16.802,-179.997,11\n")
    soundings, origin = read_soundings_and_origin(path)
    assert origin == pytest.approx((-16.801, -179.999))
    assert np.abs(soundings[:, :2]).max() < 250.0


@pytest.mark.parametrize("names", ["lat,N/S,lon,E/W", "lat,lat_dir,lon,lon_dir"])
def test_hemispheres_may_be_in_columns_of_their_own(tmp_path, names):
    path = tmp_path / "survey.csv"
    path.write_text(f"{names},depth_m\n16.8,S,6.6,W,10\n16.8,s,6.6,w,10\n")
    table = read_table(path)
    assert (table.lat_deg.tolist(), table.lon_deg.tolist()) == ([-16.8, -16.8], [-6.6, -6.6])
    assert table.notes == ()
    path.write_text(f"{names},depth_m\n16.8,S,6.6,W,10\n16.8,,6.6,W,10\n")
    with pytest.raises(TableError, match=r"survey\.csv:3: (N/S|lat_dir) is ''. Write N, S, E or W"):
        read_table(path)


@pytest.mark.parametrize("name", ["Bottom Depth", "water_depth_m", "TotalDepth (m)"])
def test_of_two_depths_the_one_of_the_water_counts_because_the_other_may_be_a_vehicle_s(tmp_path, name):
    path = tmp_path / "survey.csv"
    path.write_text(f"lat,lon,Depth,{name}\n46.5,6.6,1.5,12.5\n46.501,6.6,1.5,13.5\n")
    table = read_table(path)
    assert (table.depth_name, table.values.tolist(), table.notes) == (name, [12.5, 13.5], ("columns not used: Depth",))


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04 cut off", b"north_m,east_m,depth_m\n1,2,3\n"])
def test_files_other_than_npz_are_named(tmp_path, data):
    path = tmp_path / "bad.npz"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=r"bad\.npz is damaged or not npz.*needs the arrays east_m"):
        read_soundings(path)


def test_letters_of_windows_are_read_and_shown(tmp_path):
    path = tmp_path / "bad.csv"
    path.write_bytes("north_m,east_m,depth_m\n1,2,3 # Tiefe gemäß Lot\n".encode("latin-1"))
    with pytest.raises(TableError, match=r"bad\.csv:2: depth_m is '3 # Tiefe gemäß Lot'"):
        read_soundings(path)
    path.write_bytes("# gemäß Lot\nnorth_m,east_m,depth_m\n1,2,3\n".encode("latin-1"))
    assert read_soundings(path).tolist() == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
def test_tables_are_read_in_the_encodings_of_spreadsheets(tmp_path, encoding):
    path = tmp_path / "soundings.csv"
    path.write_bytes("# gemäß Lot\nnorth_m,east_m,depth_m\n1,2,3\n4,5,6\n".encode(encoding))
    assert read_soundings(path).tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


def test_zeros_of_a_damaged_disk_are_no_digits_left_out(tmp_path):
    path = tmp_path / "soundings.csv"
    path.write_bytes(b"north_m,east_m,depth_m\n1,2,1\0\0\n")
    with pytest.raises(TableError, match=r"soundings\.csv:2: depth_m is"):
        read_soundings(path)


def test_grid_survey(tmp_path):
    path = tmp_path / "grid.npz"
    depth = np.array([[1.0, 2.0, np.nan], [3.0, 4.0, 5.0]])
    np.savez(path, north_m=[0.0, 10.0], east_m=[0.0, 10.0, 20.0], depth_m=depth)
    assert read_soundings(path).tolist() == [[0, 0, 1], [0, 10, 2], [10, 0, 3], [10, 10, 4], [10, 20, 5]]
    np.savez(path, north_m=[0.0, 10.0], east_m=[0.0, 10.0], depth_m=depth)
    with pytest.raises(
        ValueError, match=r"depth_m has the shape \(2, 3\), north_m \(2,\), east_m \(2,\); they must be \(ny, nx\)"
    ):
        read_soundings(path)
    np.savez(path, north_m=[0.0, 10.0])
    with pytest.raises(ValueError, match="has the arrays north_m; needed are east_m"):
        read_soundings(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("north_m,east_m\n1,2\n", r":1: the columns north_m, east_m are not enough; needed are east_m,north_m,depth_m"),
        (
            "north_m," + "[" * 3000 + "\n1,2\n",
            r":1: the columns north_m, \[{40} are not enough; needed are east_m,north_m,depth_m",
        ),
        ("north_m,east_m,depth_m\n1,2,x\n", r":2: depth_m is 'x'. Write a finite number"),
        ("north_m,east_m,depth_m\n1,2,3\n1,2\n", r":3: 2 fields '1,2', but the header has 3"),
        ("north_m,east_m,depth_m\n1,2,nan\n", r":2: depth_m is 'nan'. Write a finite number"),
        ("north_m,east_m,depth_m\n", "has 1 line; write a header"),
        ("north_m,east_m,depth_m\n1\n", r":2: 1 field '1', but the header has 3"),
        ("", "has 0 lines; write a header"),
    ],
)
def test_invalid_files_are_named(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_soundings(path)
    with pytest.raises(ParameterError, match=r"gp\.survey_file: .*bad\.csv"):
        OnlineGp(GpConfig(mean="survey", survey_file=str(path)))


@pytest.mark.parametrize("names", [("northing", "easting"), ("Northing_m", "Easting_m"), ("y_m", "x_m")])
def test_projected_metres_are_used_unchanged(tmp_path, names):
    path = tmp_path / "utm.csv"
    path.write_text(f"{names[0]},{names[1]},depth\n5262000,523000,7.5\n5262010,523020,8\n")
    assert read_soundings(path).tolist() == [[5262000.0, 523000.0, 7.5], [5262010.0, 523020.0, 8.0]]


def test_degrees_replace_projected_metres(tmp_path):
    lat, lon = geodetic_from_local(np.array([-10.0, 10.0]), np.array([0.0, 30.0]), 47.5, 9.3)
    path = tmp_path / "utm.csv"
    rows = "".join(
        f"{5262000 + i},523000,{a:.9f},{o:.9f},{i + 3}\n" for i, (a, o) in enumerate(zip(lat, lon, strict=True))
    )
    path.write_text("northing,easting,lat,lon,depth\n" + rows)
    soundings, origin = read_soundings_and_origin(path)
    assert origin == pytest.approx((47.5, (lon[0] + lon[1]) / 2.0), abs=1e-9)
    assert soundings == pytest.approx(np.array([[-10.0, -15.0, 3.0], [10.0, 15.0, 4.0]]), abs=1e-3)
    positions = local_positions(read_table(path), origin=(47.5, 9.3))
    assert positions.from_degrees
    assert np.column_stack([positions.north_m, positions.east_m]) == pytest.approx(
        np.array([[-10.0, 0.0], [10.0, 30.0]]), abs=1e-3
    )


def test_metres_are_preferred_and_degrees_give_their_origin(tmp_path):
    north, east = np.array([0.0, 50.0, 20.0, 80.0]), np.array([0.0, 10.0, 60.0, 90.0])
    lat, lon = geodetic_from_local(north, east, -33.0, 151.0)
    path = tmp_path / "both.csv"
    rows = "".join(f"{n},{e},{a:.9f},{o:.9f},3\n" for n, e, a, o in zip(north, east, lat, lon, strict=True))
    path.write_text("north_m,east_m,lat,lon,depth_m\n" + rows)
    assert read_soundings(path)[:, :2].tolist() == np.column_stack([north, east]).tolist()
    assert local_positions(read_table(path)).origin == pytest.approx((-33.0, 151.0), abs=1e-7)


def test_marks_for_missing_data_are_rejected_in_tables_and_ignored_in_grids(tmp_path):
    path = tmp_path / "s.csv"
    path.write_text("north_m,east_m,depth_m\n1,2,3\n1,2,-9999\n")
    with pytest.raises(
        TableError, match=r"s\.csv:3: depth_m is '-9999'\. This is a common mark for missing data, as on 1 of 2 lines"
    ):
        read_soundings(path)
    np.savez(tmp_path / "g.npz", north_m=[0.0, 10.0], east_m=[0.0], elevation_m=[[-9999.0], [-4.0]])
    assert read_soundings(tmp_path / "g.npz").tolist() == [[10.0, 0.0, 4.0]]


HEADER = "north_m,east_m"


@pytest.mark.parametrize(
    "names", ["depth,unit", "depth,depth_unit", "depth,UOM", "unit,depth", "depth,temp,Depth Unit"]
)
def test_a_column_of_units_counts(tmp_path, names):
    path = tmp_path / "s.csv"
    columns = names.split(",")
    row = ",".join({"depth": "30", "temp": "17.5"}.get(name, "ft") for name in columns)
    path.write_text(f"{HEADER},{names}\n1,2,{row}\n2,3,{row}\n")
    assert read_soundings(path)[:, 2] == pytest.approx([9.144, 9.144])


def test_each_row_has_its_own_unit(tmp_path):
    path = tmp_path / "s.csv"
    path.write_text(f"{HEADER},elevation,units\n1,2,-30,ft\n2,3,-5,Fathoms\n2,3,-5,m\n")
    assert read_soundings(path)[:, 2] == pytest.approx([9.144, 9.144, 5.0])


@pytest.mark.parametrize(
    ("names", "row"),
    [
        ("depth,temp,unit", "3,17.5,C"),  # of the temperature
        ("depth,unit", "3,alpha"),  # a ship's
        ("depth,unit", "3,in"),  # in or out
        ("depth_m,unit", "3,ft"),  # the header is plainer
        ("depth,unit,temp,unit", "3,m,17.5,C"),
        ("depth,unit", "3,"),
        ("depth,depth_unit", "3,n/a"),
        ("depth,depth_unit", "3,metri"),
    ],
)
def test_a_column_of_other_units_changes_no_depth(tmp_path, names, row):
    path = tmp_path / "s.csv"
    path.write_text(f"{HEADER},{names}\n1,2,{row}\n2,3,{row}\n")
    assert read_soundings(path)[:, 2].tolist() == [3.0, 3.0]
    assert ("unit" in "".join(read_table(path).notes)) is not row.endswith("metri")


@pytest.mark.parametrize("number", ["1_2.5", "1_000", "_1"])
def test_a_number_has_no_underscore(tmp_path, number):
    path = tmp_path / "s.csv"
    path.write_text(f"{HEADER},depth\n1,2,{number}\n")
    with pytest.raises(TableError, match=rf"s\.csv:2: depth is '{number}'"):
        read_soundings(path)


@pytest.mark.parametrize(
    ("names", "rows", "message"),
    [
        ("depth,depth_unit", ["3,m", "3,cubit"], r"s\.csv:3: depth_unit is 'cubit'\. Write a unit of length"),
        ("depth,depth_unit", ["3,ft", "3,"], r"s\.csv:3: depth_unit is ''\. Write a unit of length"),
        (
            "depth,temp,unit",
            ["3,17,ft", "3,17,ft"],
            r"s\.csv: the column unit, with 'ft', may state the unit of another",
        ),
    ],
)
def test_units_that_are_not_clear_are_refused(tmp_path, names, rows, message):
    path = tmp_path / "s.csv"
    path.write_text(f"{HEADER},{names}\n" + "".join(f"1,2,{row}\n" for row in rows))
    with pytest.raises(TableError, match=message + ".*metres"):
        read_soundings(path)


def test_columns_that_are_not_read_are_listed(tmp_path):
    path = tmp_path / "s.csv"
    path.write_text("east_m,north_m,depth_m,s44_order,altitude,depth_unit\n1,2,3,special,2.0,m\n")
    notes: list[str] = []
    read_soundings_and_origin(path, notes)
    assert notes == ["columns not used: altitude, depth_unit"]
    path.write_text("east_m,north_m,depth_m\n1,2,3\n")
    assert read_table(path).notes == ()


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("Breite;Länge;Tiefe [m]", "46,5;-6,25;12,5"),
        ("Latitude,Longitude,Depth (ft)", "46°30.0'N,6°15'00\"W,41.0105"),
        ("lat\tN/S\tlon\tE/W\tdepth", "46°30'\tN\t6°15'\tW\t12.5 m"),
        ("lon_e7 lat_e7 bed_elevation_cm", "-62500000 465000000 -1250"),
        ("lat_ddmm,lon_ddmm,depth_fathoms", "4630.0,-615.0,6.835083"),
        ("lat,lat_min,lon,lon_min,depth", "46,30.0,-6,15.0,12.5"),
        ("lat,lon,depth,depth_m", "46.5,-6.25,41,12.5"),
        ("# lat lon depth", "46.5 -6.25 12.5"),
    ],
)
def test_notations_that_import_reads_are_read_everywhere(tmp_path, header, row):
    path = tmp_path / "s.csv"
    path.write_text("\n".join([header, row, row, ""]), encoding="utf-8")
    table = read_table(path)
    depth = -table.values if table.upward else table.values
    rows = np.column_stack([table.lat_deg, table.lon_deg, depth])
    assert rows == pytest.approx(np.array([[46.5, -6.25, 12.5]] * 2), abs=1e-4)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["lat,lon,depth_m", "46°30'N,6°15'W,3", "46°30'N,6°75'W,3"], r"s\.csv:3: lon is .6°75'W.\. Write a finite"),
        (["lat;lon;depth", "46,5;6,6;980,5", "46,5;6,6;1.234"], r"thousands or decimals in '1\.234'"),
        (["lat,lon,depth_m", "46,5,6,6,12,5"], r"s\.csv:2: 6 fields .* but the header has 3"),
        (["north_m,east_m,depth_m", "1,2", "1,2,3", "1,2,3"], r"s\.csv:2: 2 fields '1,2', but the header has 3"),
        (["north_m,east_m,depth_m", '1,2,"3', "1,2,3"], r"s\.csv:2: a quoted cell continues in the next line"),
        (["north_m,east_m,depth_m", "1,2,3", '1,2,"3', "1,2,3", '1,2,"'], r"s\.csv:3: a quoted cell continues in"),
        (["north_m,east_m,depth_m", "1,2,3", "north_m,east_m,depth_m", "1,2,3"], r"s\.csv:3: north_m is 'north_m'"),
        (["north_m\teast_m\tdepth_m", "1\t2\t3", "1\t2\t"], r"s\.csv:3: depth_m is ''"),
        (["x,y,depth_m", "1,2,3"], r"s\.csv:1: the columns x, y, depth_m are not enough"),
        (["1,2,3", "1,2,3"], r"s\.csv: there is no header; needed are east_m"),
    ],
)
def test_a_row_that_is_not_understood_is_refused_by_its_line(tmp_path, rows, message):
    path = tmp_path / "s.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    with pytest.raises(TableError, match=message):
        read_table(path)


def test_lines_with_an_unusual_sign_of_comments_are_reported(tmp_path):
    path = tmp_path / "s.csv"
    path.write_text("# survey\nnorth_m,east_m,depth_m\n1,2,3\n! 1,2,4\n1,2,5\n'1,2,6\n")
    table = read_table(path)
    assert table.values.tolist() == [3.0, 5.0]
    assert table.notes == ("2 lines taken as comments, such as line 4",)


def test_text_with_brackets_and_without_numbers_is_no_table():
    assert dialect_of("a (b c\nd e f\n").sample == []
