"""Bathymetry files of every kind: errors, origins, and a survey both as soundings and as a grid."""

import re

import numpy as np
import pytest
from ground_helpers import SURVEY_FILES, SURVEY_ORIGIN, ascii_text, soundings, survey, write_survey

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_sim.ground.grid_ground import GridGround
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.ground_files import load_ground
from auv_lse_sim.ground.ground_source import ground_of

GOOD = "east_m,north_m,depth_m\n" + "".join(f"{i % 7 * 10},{i // 7 * 10},12.5\n" for i in range(40))


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("a.csv", "", r"a\.csv has 0 lines; write a header"),
        (
            "a.csv",
            "x,y\n1,2\n",
            r"a\.csv:1: the columns x, y are not enough; needed are east_m,north_m,depth_m .* or lat,lon,depth_m",
        ),
        ("a.csv", GOOD + "10,20\n", r"a\.csv:42: 2 fields '10,20', but the header has 3"),
        ("a.csv", GOOD + "10,abc,3\n", r"a\.csv:42: north_m is 'abc'. Write a finite number"),
        ("a.csv", GOOD + "10,20,nan\n", r"a\.csv:42: depth_m is 'nan'. Write a finite number"),
        ("a.csv", GOOD + "10,20,12500\n", r"a\.csv:42: depth 12500 m is deeper than 12000 m; depths must be in metres"),
        (
            "a.csv",
            "lat,lon,depth_m\n95,10,3\n",
            r"a\.csv: latitudes such as 95 are no degrees.*lon,lat",
        ),
        (
            "a.csv",
            "east_m,north_m,depth_m\n1,2,3\n4,5,6\n",
            r"a\.csv: soundings at 2 different locations are too few; give at least 10",
        ),
        ("a.csv", "east_m,north_m,depth_m\n" + "".join(f"{i},{2 * i},3\n" for i in range(60)), r"lie on one line"),
        (
            "a.csv",
            "east_m,north_m,depth_m\n" + "".join(f"{i * 9e3},{i % 7 * 9e3},3\n" for i in range(60)),
            r"2 x 2 to 5000 x 5000",
        ),
        ("a.npz", "no zip", r"a\.npz is damaged or not npz"),
        ("a.pdf", "x", r"files ending in '\.pdf' cannot be read; use one of \.csv"),
        ("a.asc", "ncols 2\nnrows x\n", r"a\.asc:2: 'nrows x' is not a header line"),
        ("a.asc", "ncols 2\nnrows 2\ncellsize 15 10\n", r"a\.asc:3: 'cellsize 15 10' is not a header line"),
        (
            "a.asc",
            "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\ndy 15\n1 2\n3 4\n",
            r"a\.asc: its header has cellsize 10 and dy 15\. Leave the right one",
        ),
        ("a.asc", "ncols 2\nnrows 2\nncols 3\n", r"a\.asc:3: 'ncols 3': ncols was 2 above\. Leave the right one"),
        ("a.asc", "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\n1 2\n3 4\n", r"but no cellsize, or dx and dy"),
        (
            "a.asc",
            "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2\n3 4 5\n",
            r"a\.asc:7: the row has 3 values, and ncols is 2",
        ),
        (
            "a.asc",
            "ncols 2\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2\n3 4\n",
            r"it has 2 rows of values, and nrows is 3",
        ),
        (
            "a.asc",
            "ncols 2\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2\n3\n4 5 6\n",
            r"a\.asc:7: the row has 1 value, and ncols is 2\. Correct the row, or ncols",
        ),
        (
            "a.asc",
            "ncols 4\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2\n3 4\n5 6\n7 8\n9 10\n",
            r"it has 10 values, and nrows x ncols is 3 x 4 = 12\. Correct nrows and ncols, or copy",
        ),
        (
            "a.asc",
            "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2\n3 z4\n",
            r"a\.asc:7: 'z4' is not a number",
        ),
        ("a.asc", "ncols inf\n", r"a\.asc:1: 'ncols inf': write a whole number of at least 2"),
        ("a.asc", "ncols 2\nnrows nan\n", r"a\.asc:2: 'nrows nan': write a whole number of at least 2"),
        ("a.asc", "ncols 2.5\n", r"a\.asc:1: 'ncols 2.5': write a whole number"),
        ("a.asc", "ncols 2\ncellsize inf\n", r"a\.asc:2: 'cellsize inf': write a finite number"),
    ],
)
def test_errors_name_file_line_and_what_was_expected(tmp_path, name, text, match):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(GroundError, match=match):
        load_ground(path)


def test_missing_file(tmp_path):
    with pytest.raises(GroundError, match=r" is not a file; give bathymetry as"):
        load_ground(tmp_path)
    with pytest.raises(GroundError, match=r"^9+: cannot be read: File name too long$"):
        load_ground("9" * 400)
    with pytest.raises(GroundError, match=r"^9+: cannot be read: File name too long$"):
        ground_of(Settings.load(None, {"sim.bathymetry.file": "9" * 400}))
    with pytest.raises(GroundError, match=r"nowhere\.csv does not exist"):
        load_ground("nowhere.csv")


def test_origins_are_on_earth(tmp_path):
    north, east, depth = soundings(300)
    lat, lon = geodetic_from_local(north, east, 47.5, -91.5)
    rows = "\n".join(f"{a:.8f},{o + 360.0:.8f},{d:.3f}" for a, o, d in zip(lat, lon, depth, strict=True))
    (tmp_path / "s.csv").write_text("lat,lon,depth_m\n" + rows)
    # Longitudes of 0 to 360 are read, and the origin is what area.origin_lon_deg may be.
    assert load_ground(tmp_path / "s.csv").origin == pytest.approx((47.5018, -91.4973), abs=2e-4)
    with pytest.raises(
        GroundError, match=r"s\.csv: area\.origin_lat_deg, origin_lon_deg: 500, 8 is not a position in degrees"
    ):
        load_ground(tmp_path / "s.csv", origin=(500.0, 8.0))
    (tmp_path / "depth.asc").write_text(ascii_text(np.full((30, 30), 20.0), 1e12, 1e12, 10.0))
    (tmp_path / "depth.prj").write_text("EPSG:32632")
    with pytest.raises(GroundError, match=r"depth\.asc: .*(not a position in degrees|outside of its projection)"):
        load_ground(tmp_path / "depth.asc")
    with pytest.raises(GroundError, match=r"grid: origin: 47, 361 is not a position"):
        GridGround([0, 1], [0, 1], np.ones((2, 2)), origin=(47.0, 361.0))


def test_data_far_from_the_origin_are_refused_by_name(tmp_path):
    north, east, depth = soundings(300)
    lat, lon = geodetic_from_local(north, east, 47.5, 9.3)
    rows = "\n".join(f"{a:.8f},{o:.8f},{d:.3f}" for a, o, d in zip(lat, lon, depth, strict=True))
    (tmp_path / "s.csv").write_text("lat,lon,depth_m\n" + rows)
    (tmp_path / "depth.asc").write_text(ascii_text(np.full((30, 30), 20.0), 9.3, 47.5, 1e-4, "xllcenter"))
    for name in ("s.csv", "depth.asc"):
        for origin in ((47.5, 11.0), (-40.0, -170.0)):
            with pytest.raises(GroundError, match=rf"{re.escape(name)}: latitude 47\.50.*farther than 100 km from .*"):
                load_ground(tmp_path / name, origin=origin)
    axis = np.arange(0.0, 101.0, 10.0)
    np.savez(tmp_path / "u.npz", north_m=axis + 5.2e6, east_m=axis + 5e5, depth_m=np.full((11, 11), 20.0))
    with pytest.raises(GroundError, match=r"u\.npz: north from 5200000 to 5200100 m.*lat0, lon0"):
        load_ground(tmp_path / "u.npz")


def test_a_survey_both_ways(tmp_path):
    write_survey(tmp_path)
    lake, rows = survey()
    fine, grid = (load_ground(tmp_path / name) for name in SURVEY_FILES)
    # The file's positions have 9 digits after the point: 0.1 mm.
    assert fine.origin == pytest.approx(SURVEY_ORIGIN, abs=1e-8)
    assert grid.origin == pytest.approx(SURVEY_ORIGIN)
    n, e = np.meshgrid(*grid.extent.axes(20.0), indexing="ij")
    truth = lake.depth_m(n, e)
    distance = np.hypot(n - 250.0, e + 200.0)  # from the middle of the part left out, 150 m in radius
    for ground in (fine, grid):
        depth = ground.depth_m(n, e)
        known = np.isfinite(depth)
        assert known.mean() > 0.9
        assert not known[distance < 80.0].any()  # farther than 60 m from every sounding
        error = np.abs(depth - truth)[known & np.isfinite(truth) & (distance > 160.0)]
        # Noise of 0.05 m, and lines 35 m apart over relief with waves of some 60 m.
        assert np.median(error) < 0.1
        assert np.percentile(error, 99) < 0.5
    assert len(rows) > 6000


@pytest.mark.parametrize(
    ("name", "begin", "match"),
    [
        ("a.laz", b"LASF", r"a\.laz is a point cloud \(LAS\)\..* pdal translate a\.laz a\.xyz "),
        ("a.txt", b"LASF", r"a\.txt is a point cloud"),
        ("a.geojson", b"{}", r"a\.geojson holds points or lines, not a grid\..* ogr2ogr .* a\.csv a\.geojson; then"),
        ("a.gpkg", b"SQLite", r"a\.gpkg holds points or lines"),
        ("a.csv.gz", b"\x1f\x8b", r"a\.csv\.gz is packed\. Unpack it"),
        ("a.zip", b"PK\3\4", r"a\.zip is packed\. Unpack it"),
        ("a.XLSX", b"PK\3\4", r"a\.XLSX is a spreadsheet\. Save it as \.csv"),
        ("a.ods", b"PK\3\4", r"a\.ods is a spreadsheet\. Save it as \.csv"),
    ],
)
def test_files_that_another_program_converts_name_the_way(tmp_path, name, begin, match):
    (tmp_path / name).write_bytes(begin + bytes(20))
    with pytest.raises(GroundError, match=match):
        load_ground(tmp_path / name)


@pytest.mark.parametrize("name", ["g.csv", "g.xyz", "g.asc"])
def test_text_is_read_in_the_encodings_of_other_programs(tmp_path, name):
    text = {
        "g.csv": GOOD,
        "g.xyz": "\n".join(GOOD.replace(",", " ").splitlines()[1:]),
        "g.asc": ascii_text(np.full((4, 5), 12.5), 0.0, 0.0, 10.0),
    }[name]
    grounds = []
    for encoding in ("utf-8", "utf-16", "utf-16-le"):
        (tmp_path / name).write_bytes(text.encode(encoding))
        grounds.append(load_ground(tmp_path / name, BathymetryConfig(depth_sign="down")).describe())
    assert grounds == grounds[:1] * 3
