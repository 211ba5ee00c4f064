"""Bathymetry files: what is read, and what is said about what is wrong."""

from pathlib import Path

import numpy as np
import pytest

from auv_lse_common.frames import geodetic_from_local
from auv_lse_common.params import to_mapping
from auv_lse_sim.world.config import BathymetryConfig
from auv_lse_sim.world.grid_ground import GridGround
from auv_lse_sim.world.ground import GroundError
from auv_lse_sim.world.ground_files import load_ground
from auv_lse_sim.world.soundings_ground import grid_soundings

SHARED = Path(__file__).resolve().parents[2].parent / "shared" / "data"
needs_lake = pytest.mark.skipif(
    not (SHARED / "tzibana_soundings.csv").is_file(), reason=f"the real lake's data are not at {SHARED}"
)


def bottom(north, east):
    return 20.0 + 5.0 * np.sin(np.asarray(north) / 80.0) + 4.0 * np.cos(np.asarray(east) / 100.0)


def soundings(n=3000, size=400.0):
    rng = np.random.default_rng(0)
    north, east = rng.uniform(0, size, n), rng.uniform(0, size, n)
    return north, east, bottom(north, east)


def write_csv(path, header, *columns, separator=","):
    rows = [separator.join(f"{v:.9g}" for v in row) for row in zip(*columns, strict=True)]
    path.write_text(separator.join(header) + "\n" + "\n".join(rows) + "\n")
    return path


def check_bottom(ground, offset=(0.0, 0.0), low=40.0, high=360.0, tolerance=0.3):
    rng = np.random.default_rng(1)
    n, e = rng.uniform(low, high, 300), rng.uniform(low, high, 300)
    depth = ground.depth_m(n - offset[0], e - offset[1])
    assert np.isfinite(depth).all()
    assert np.abs(depth - bottom(n, e)).max() < tolerance


def test_soundings_in_metres(tmp_path):
    north, east, depth = soundings()
    for name, separator in (("a.csv", ","), ("b.csv", ";"), ("c.txt", "\t"), ("d.xyz", " ")):
        path = write_csv(tmp_path / name, ["east_m", "north_m", "depth_m"], east, north, depth, separator=separator)
        ground = load_ground(path)
        check_bottom(ground)
        assert ground.origin is None
        assert "depth positive down" in ground.describe()


def test_soundings_with_comments_other_columns_and_repeats(tmp_path):
    north, east, depth = soundings(2000)
    path = tmp_path / "s.csv"
    lines = ["# a survey", "line,East_M,North_M,Depth_M,quality"]
    for i, row in enumerate(zip(east, north, depth, strict=True)):
        lines += [f"L{i},{row[0]},{row[1]},{row[2]},good"]
        if i % 50 == 0:  # a spike among repeats at one place: the median keeps it out
            lines += [f"L{i},{row[0]},{row[1]},{row[2]},x", "", f"L{i},{row[0]},{row[1]},{row[2] + 30},spike"]
    path.write_text("\n".join(lines))
    check_bottom(load_ground(path))


def test_soundings_in_degrees(tmp_path):
    north, east, depth = soundings()
    lat, lon = geodetic_from_local(north, east, 47.5, 9.3)
    path = tmp_path / "s.csv"
    path.write_text(
        "lat,lon,depth_m\n" + "\n".join(f"{a:.8f},{o:.8f},{d:.3f}" for a, o, d in zip(lat, lon, depth, strict=True))
    )
    ground = load_ground(path, origin=(47.5, 9.3))
    assert ground.origin == (47.5, 9.3)
    check_bottom(ground)
    middle = load_ground(path)
    assert middle.origin == pytest.approx((47.5018, 9.3027), abs=2e-4)
    check_bottom(middle, offset=(200.0, 200.0), tolerance=0.4)


def test_both_kinds_of_coordinates_give_the_origin(tmp_path):
    north, east, depth = soundings()
    lat, lon = geodetic_from_local(north, east, -33.0, 151.0)
    rows = [
        f"{n:.2f},{e:.2f},{a:.6f},{o:.6f},{d:.2f}" for n, e, a, o, d in zip(north, east, lat, lon, depth, strict=True)
    ]
    path = tmp_path / "s.csv"
    path.write_text("north_m,east_m,lat,lon,depth_m\n" + "\n".join(rows))
    assert load_ground(path).origin == pytest.approx((-33.0, 151.0), abs=2e-6)
    path.write_text(
        "north_m,east_m,lat,lon,depth_m\n"
        + "\n".join(r.replace(",151.", ",152.") if i % 2 else r for i, r in enumerate(rows))
    )
    wrong = load_ground(path)
    assert wrong.origin is None
    assert "not used" in wrong.describe()


def test_elevations_are_negated(tmp_path):
    north, east, depth = soundings()
    path = write_csv(tmp_path / "s.csv", ["north_m", "east_m", "elevation_m"], north, east, -depth)
    check_bottom(load_ground(path))
    path = write_csv(tmp_path / "t.csv", ["north_m", "east_m", "depth_m"], north, east, -depth)
    with pytest.raises(
        GroundError, match=r"t\.csv:2: depth -.* as for 3000 of 3000 soundings; expected depth_m positive down"
    ):
        load_ground(path)
    check_bottom(load_ground(path, BathymetryConfig(depth_sign="up")))


def topobathy(share_of_land=2 / 3):
    """Elevations (m) of a lake's bottom and the land around it: water surface at 0, from -30 to 60 or so."""
    axis = np.arange(0.0, 401.0, 10.0)
    north, east = np.meshgrid(axis, axis, indexing="ij")
    height = 0.2 * (east - 400.0 * (1.0 - share_of_land)) + np.sin(north / 50.0)
    return axis, height


def write_grid(path, axis, values, name="elevation_m"):
    if path.suffix == ".asc":
        path.write_text(ascii_text(values, 0.0, 0.0, 10.0, "xllcenter"))
    elif path.suffix == ".npz":
        np.savez(path, north_m=axis, east_m=axis, **{name: values})
    else:
        north, east = np.meshgrid(axis, axis, indexing="ij")
        write_csv(path, ["north_m", "east_m", name], north.ravel(), east.ravel(), values.ravel())
    return path


def test_a_raster_of_water_and_land_is_not_guessed(tmp_path):
    axis, height = topobathy()
    path = write_grid(tmp_path / "g.asc", axis, height)
    with pytest.raises(
        GroundError, match=r"g\.asc: values from -27\.\d+ to 54\.\d+ m, 3\d % negative, 6\d % positive.*water_level_m"
    ):
        load_ground(path)
    for config in (BathymetryConfig(depth_sign="up"), BathymetryConfig(water_level_m=0.0)):
        ground = load_ground(path, config)
        assert ground.depth_m(200.0, 20.0) == pytest.approx(-height[20, 2], abs=0.01)
        assert np.isnan(ground.depth_m(200.0, 300.0))
    down = load_ground(path, BathymetryConfig(depth_sign="down"))
    assert np.isnan(down.depth_m(200.0, 20.0))
    # A few nodes of land among depths are no reason to ask.
    depth = np.full((41, 41), 20.0)
    depth[:, :2] = -1.0
    assert load_ground(write_grid(tmp_path / "d.asc", axis, depth)).depth_m(200.0, 200.0) == pytest.approx(20.0)


@pytest.mark.parametrize("fill", [np.nan, 0.0])
def test_a_raster_above_sea_level_is_not_taken_as_deep(tmp_path, fill):
    axis, height = topobathy(0.5)
    height = 1200.0 + 0.75 * height  # 1170 to 1230 m
    height[:3] = fill
    path = write_grid(tmp_path / "g.asc", axis, height)
    with pytest.raises(GroundError, match=r"to 1230.* m: elevations above sea level, or depths\?.*water_level_m"):
        load_ground(path)
    height[:3] = np.nan
    path = write_grid(path, axis, height)
    with pytest.raises(GroundError, match=r"none below the water surface at 1100 m"):
        load_ground(path, BathymetryConfig(water_level_m=1100.0))
    ground = load_ground(path, BathymetryConfig(water_level_m=1200.0))
    assert ground.depth_m(200.0, 20.0) == pytest.approx(1200.0 - height[20, 2], abs=0.01)
    assert "elevations, water surface at 1200 m" in ground.describe()
    assert load_ground(path, BathymetryConfig(depth_sign="down")).depth_m(200.0, 200.0) > 1100.0


@pytest.mark.parametrize("ending", ["npz", "csv"])
def test_named_elevations_above_sea_level_need_the_water_level(tmp_path, ending):
    axis, height = topobathy(0.5)
    path = write_grid(tmp_path / f"g.{ending}", axis, 1200.0 + 0.75 * height)
    with pytest.raises(
        GroundError,
        match=rf"g\.{ending}: elevation_m from 11\d\d.* to 1230.*none below .* at 0 m;.*set .*water_level_m",
    ):
        load_ground(path)
    config = BathymetryConfig(water_level_m=1200.0, smoothing_m=0.0)
    assert load_ground(path, config).depth_m(200.0, 20.0) == pytest.approx(-0.75 * height[20, 2], abs=0.01)
    # Two thirds of land is no error where the name says what is up.
    land = write_grid(tmp_path / f"l.{ending}", *topobathy(2 / 3))
    assert "nodes are land" in load_ground(land).describe()
    depths = write_grid(tmp_path / f"d.{ending}", axis, -height, "depth_m")
    with pytest.raises(GroundError, match=r"depth_m from .* with sim\.bathymetry\.water_level_m = 1200 m; expected"):
        load_ground(depths, config)
    shallow = write_grid(tmp_path / f"n.{ending}", *topobathy(0.1), "depth_m")
    with pytest.raises(GroundError, match=r"positive down: set sim\.bathymetry\.depth_sign: up for elevations"):
        load_ground(shallow)
    load_ground(shallow, BathymetryConfig(depth_sign="down"))


@pytest.mark.parametrize("mark", [-9999.0, 9999.0, -99999.0, -32768.0, 32767.0])
@pytest.mark.parametrize("ending", ["npz", "asc"])
def test_marks_for_no_data_are_unknown(tmp_path, ending, mark):
    axis = np.arange(0.0, 401.0, 10.0)
    depth = bottom(*np.meshgrid(axis, axis, indexing="ij"))
    depth[:, 20:] = mark
    path = write_grid(tmp_path / f"g.{ending}", axis, depth, "depth_m")
    if ending == "asc":  # the header names another value
        path.write_text(path.read_text().replace("NODATA_value -9999", "NODATA_value -1"))
    ground = load_ground(path)
    assert np.isnan(ground.depth_m(200.0, 300.0))
    assert ground.depth_m(200.0, 100.0) == pytest.approx(bottom(200.0, 100.0), abs=0.01)
    assert f"; {41 * 21} nodes of {mark:g} taken as unknown" in ground.describe()


def test_marks_for_no_data_among_soundings_are_refused(tmp_path):
    north, east, depth = soundings(100)
    depth[[40, 60]] = -9999.0
    path = write_csv(tmp_path / "s.csv", ["north_m", "east_m", "depth_m"], north, east, depth)
    with pytest.raises(
        GroundError, match=r"s\.csv:42: depth_m is -9999, as on 2 of 100 lines: a usual mark for no data"
    ):
        load_ground(path)


def test_the_water_level_left_out_is_not_in_a_mission_file():
    """Campaigns name their missions by their parameters: those of a default mission are what they were."""
    assert set(to_mapping(BathymetryConfig())) == {"file", "resolution_m", "max_gap_m", "smoothing_m", "depth_sign"}


def test_unknown_far_from_soundings():
    north, east, depth = soundings()
    keep = ~((np.abs(north - 200) < 80) & (np.abs(east - 200) < 80))
    ground = grid_soundings(north[keep], east[keep], depth[keep], BathymetryConfig(max_gap_m=30.0))
    assert np.isnan(ground.depth_m(200.0, 200.0))
    assert np.isfinite(ground.depth_m(200.0, 135.0))
    assert np.isnan(ground.depth_m(-50.0, 200.0))
    whole = grid_soundings(north[keep], east[keep], depth[keep], BathymetryConfig(max_gap_m=200.0))
    assert np.isfinite(whole.depth_m(200.0, 200.0))


def test_grid_is_smooth():
    """No kink at the nodes: the slope's jump across a node line falls with the step, as in a C1 surface."""
    axis = np.arange(0.0, 401.0, 10.0)
    depth = bottom(*np.meshgrid(axis, axis, indexing="ij")) + np.random.default_rng(0).normal(0, 0.2, (41, 41))
    ground = GridGround(axis, axis, depth)
    east = np.linspace(60, 340, 200)

    def jump(h):
        left = (ground.depth_m(200.0, east) - ground.depth_m(200.0 - h, east)) / h
        right = (ground.depth_m(200.0 + h, east) - ground.depth_m(200.0, east)) / h
        return np.abs(right - left).max()

    assert jump(0.1) < 0.02
    assert jump(0.01) < 0.15 * jump(0.1) + 1e-6
    assert (
        np.abs(ground.depth_m(axis[3:38, None], axis[None, 3:38]) - depth[3:38, 3:38]).max() < 1e-9
    )  # through the nodes


def test_land_and_unknown_are_nan():
    axis = np.arange(0.0, 101.0, 10.0)
    depth = np.full((11, 11), 12.0)
    depth[:, :3] = -2.0
    depth[8:, 8:] = np.nan
    ground = GridGround(axis, axis, depth)
    assert np.isnan(ground.depth_m([50.0, 95.0, 50.0], [15.0, 95.0, 101.0])).all()
    assert ground.depth_m(50.0, 60.0) == pytest.approx(12.0)
    assert "33 nodes are land" in ground.describe()


def test_npz(tmp_path):
    axis = np.arange(-50.0, 451.0, 10.0)
    depth = bottom(*np.meshgrid(axis, axis, indexing="ij"))
    distance = np.zeros_like(depth)
    distance[:, -5:] = 100.0
    np.savez(
        tmp_path / "g.npz", north_m=axis, east_m=axis, depth_m=depth, lat0=10.0, lon0=20.0, dist_to_sounding_m=distance
    )
    ground = load_ground(tmp_path / "g.npz")
    assert ground.origin == (10.0, 20.0)
    check_bottom(ground, tolerance=0.05)
    assert np.isnan(ground.depth_m(100.0, 430.0))
    np.savez(tmp_path / "e.npz", north_m=axis, east_m=axis, elevation_m=-depth)
    check_bottom(load_ground(tmp_path / "e.npz"), tolerance=0.05)


def ascii_text(depth, x, y, step, corner="xllcorner", nodata=-9999):
    head = f"ncols {depth.shape[1]}\nnrows {depth.shape[0]}\n{corner} {x}\n{corner.replace('x', 'y', 1)} {y}\n"
    rows = "\n".join(" ".join(f"{nodata if np.isnan(v) else v:.4f}" for v in row) for row in depth[::-1])
    return head + f"cellsize {step}\nNODATA_value {nodata}\n" + rows + "\n"


@pytest.mark.parametrize(("corner", "shift"), [("xllcorner", -5.0), ("xllcenter", 0.0)])
def test_ascii_grid_in_metres(tmp_path, corner, shift):
    axis = np.arange(0.0, 401.0, 10.0)
    depth = bottom(*np.meshgrid(axis, axis, indexing="ij"))
    depth[:, 39:] = np.nan
    (tmp_path / "g.asc").write_text(ascii_text(depth, shift, shift, 10.0, corner))
    ground = load_ground(tmp_path / "g.asc")
    check_bottom(ground, tolerance=0.05)
    assert np.isnan(ground.depth_m(200.0, 395.0))
    (tmp_path / "e.asc").write_text(ascii_text(-depth, shift, shift, 10.0, corner))
    elevations = load_ground(tmp_path / "e.asc")
    check_bottom(elevations, tolerance=0.05)
    assert "elevations, negated" in elevations.describe()


def test_ascii_grid_in_degrees(tmp_path):
    step = 1e-4
    lat, lon = 45.0 + step * np.arange(60), 7.0 + step * np.arange(80)
    lat0, lon0 = 45.0 + step * 29.5, 7.0 + step * 39.5
    from auv_lse_common.frames import local_from_geodetic

    north, east = local_from_geodetic(*np.meshgrid(lat, lon, indexing="ij"), lat0, lon0)
    (tmp_path / "g.asc").write_text(ascii_text(bottom(north, east), 7.0, 45.0, step, "xllcenter"))
    ground = load_ground(tmp_path / "g.asc")
    assert ground.origin == pytest.approx((lat0, lon0), abs=1e-9)
    n, e = np.random.default_rng(1).uniform(-200, 200, (2, 200))
    assert np.abs(ground.depth_m(n, e) - bottom(n, e)).max() < 0.1


def test_ascii_grid_with_a_projection(tmp_path):
    pyproj = pytest.importorskip("pyproj")
    to_utm = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True)
    x0, y0 = to_utm.transform(9.3, 47.5)
    axis = np.arange(0.0, 401.0, 10.0)
    depth = bottom(*np.meshgrid(axis, axis, indexing="ij"))
    (tmp_path / "g.asc").write_text(ascii_text(depth, x0, y0, 10.0, "xllcenter"))
    (tmp_path / "g.prj").write_text(pyproj.CRS("EPSG:32632").to_wkt("WKT1_ESRI"))
    ground = load_ground(tmp_path / "g.asc", origin=(47.5, 9.3))
    # UTM's north is 0.22 deg from true north here, its scale 1.0002 off: 1.6 m at most over this grid.
    check_bottom(ground, low=20.0, high=380.0, tolerance=0.35)
    far = tmp_path / "f.asc"
    far.write_text(ascii_text(depth, x0, y0, 10.0, "xllcenter"))
    shifted = load_ground(far)
    assert "no projection given" in shifted.describe()
    check_bottom(shifted, offset=(200.0, 200.0), tolerance=0.05)


def test_geotiff_without_rasterio_says_so(tmp_path, monkeypatch):
    import builtins

    real = builtins.__import__

    def missing(name, *args, **kwargs):
        if name.startswith("rasterio"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", missing)
    (tmp_path / "g.tif").write_bytes(b"II*\0")
    with pytest.raises(GroundError, match=r"needs rasterio, which is not installed; pip install rasterio"):
        load_ground(tmp_path / "g.tif")


def test_geotiff(tmp_path):
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
    axis = np.arange(0.0, 401.0, 10.0)
    depth = bottom(*np.meshgrid(axis, axis, indexing="ij")).astype("float32")
    transform = rasterio.transform.from_origin(500_000.0, 5_200_000.0, 10.0, 10.0)
    options = {"driver": "GTiff", "width": 41, "height": 41, "count": 1, "dtype": "float32", "transform": transform}
    with rasterio.open(tmp_path / "g.tif", "w", crs="EPSG:32632", nodata=-1.0, **options) as file:
        file.write(depth[::-1], 1)
    ground = load_ground(tmp_path / "g.tif")
    assert ground.origin is not None
    check_bottom(ground, offset=(200.0, 200.0), tolerance=0.3)
    (tmp_path / "bad.tif").write_bytes(b"nothing")
    with pytest.raises(GroundError, match="not a readable GeoTIFF"):
        load_ground(tmp_path / "bad.tif")


GOOD = "east_m,north_m,depth_m\n" + "".join(f"{i % 7 * 10},{i // 7 * 10},12.5\n" for i in range(40))


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("a.csv", "", r"a\.csv: 0 lines; expected a header"),
        (
            "a.csv",
            "x,y\n1,2\n",
            r"a\.csv:1: columns are x, y; expected east_m,north_m,depth_m \(or easting, northing\) or lat,lon,depth_m",
        ),
        ("a.csv", GOOD + "10,20\n", r"a\.csv:42: 2 fields '10,20'; expected 3"),
        ("a.csv", GOOD + "10,abc,3\n", r"a\.csv:42: north_m is 'abc'; expected a finite number"),
        ("a.csv", GOOD + "10,20,nan\n", r"a\.csv:42: depth_m is 'nan'; expected a finite number"),
        ("a.csv", GOOD + "10,20,12500\n", r"a\.csv:42: depth 12500 m; expected metres, below 11000"),
        ("a.csv", "lat,lon,depth_m\n95,10,3\n", r"a\.csv:2: lat is 95; expected degrees"),
        (
            "a.csv",
            "east_m,north_m,depth_m\n1,2,3\n4,5,6\n",
            r"a\.csv: 2 soundings at different places; expected at least 10",
        ),
        ("a.csv", "east_m,north_m,depth_m\n" + "".join(f"{i},{2 * i},3\n" for i in range(60)), r"lie on one line"),
        (
            "a.csv",
            "east_m,north_m,depth_m\n" + "".join(f"{i * 9e4},{i % 7 * 9e4},3\n" for i in range(60)),
            r"2 x 2 to 5000 x 5000",
        ),
        ("a.npz", "no zip", r"a\.npz: not a readable npz file"),
        ("a.pdf", "x", r"ending '\.pdf'; expected one of \.csv"),
        ("a.asc", "ncols 2\nnrows x\n", r"a\.asc:2: 'nrows x'; expected a header line 'name number'"),
        ("a.asc", "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\n1 2\n3 4\n", r"expected also cellsize"),
        (
            "a.asc",
            "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2\n3 4 5\n",
            r"a\.asc:7: 3 values; expected ncols = 2",
        ),
        (
            "a.asc",
            "ncols 2\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2\n3 4\n",
            r"2 rows of values; expected nrows = 3",
        ),
        (
            "a.asc",
            "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2\n3 z4\n",
            r"a\.asc:7: 'z4'; expected a number",
        ),
        ("a.asc", "ncols inf\n", r"a\.asc:1: 'ncols inf'; expected a whole number of at least 2"),
        ("a.asc", "ncols 2\nnrows nan\n", r"a\.asc:2: 'nrows nan'; expected a whole number of at least 2"),
        ("a.asc", "ncols 2.5\n", r"a\.asc:1: 'ncols 2.5'; expected a whole number"),
        ("a.asc", "ncols 2\ncellsize inf\n", r"a\.asc:2: 'cellsize inf'; expected a finite number"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, name, text, match):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(GroundError, match=match):
        load_ground(path)


def test_missing_file():
    with pytest.raises(GroundError, match=r"nowhere\.csv: no such file"):
        load_ground("nowhere.csv")


@pytest.mark.parametrize(
    ("arrays", "match"),
    [
        ({"depth_m": np.ones((3, 3))}, "arrays are depth_m; expected east_m"),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1], "depth_m": np.ones((3, 3))},
            r"shape \(3, 3\), north_m \(3,\), east_m \(2,\); expected",
        ),
        (
            {"north_m": [0, 1, 5], "east_m": [0, 1, 2], "depth_m": np.ones((3, 3))},
            "north_m runs from 0 to 5; expected growing",
        ),
        ({"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": -np.ones((3, 3))}, "mostly negative"),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.full((3, 3), 2e4)},
            "depth 20000 m; expected metres",
        ),
        ({"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.full((3, 3), np.nan)}, "0 grid nodes hold water"),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.full((3, 3), "x")},
            "depth_m holds <U1; expected numbers",
        ),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.ones((3, 3)), "lat0": 3.0},
            "only one of lat0, lon0",
        ),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.ones((3, 3)), "lat0": [3.0, 4.0], "lon0": 5.0},
            r"lat0, lon0: of shapes \(2,\), \(\); expected one latitude",
        ),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.ones((3, 3)), "lat0": "north", "lon0": 5.0},
            r"lat0, lon0: .*expected one latitude",
        ),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.ones((3, 3)), "lat0": 500.0, "lon0": 5.0},
            r"lat0, lon0: 500, 5; expected degrees, a latitude of -90 to 90",
        ),
        (
            {"north_m": [0, 1, 2], "east_m": [0, 1, 2], "depth_m": np.ones((3, 3)), "lat0": 5.0, "lon0": np.nan},
            r"lat0, lon0: 5, nan; expected degrees",
        ),
    ],
)
def test_what_is_wrong_in_an_npz(tmp_path, arrays, match):
    np.savez(tmp_path / "g.npz", **arrays)
    with pytest.raises(GroundError, match=match):
        load_ground(tmp_path / "g.npz")


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_damaged_npz(tmp_path, save):
    axis = np.arange(0.0, 101.0, 10.0)
    path = tmp_path / "g.npz"
    save(path, north_m=axis, east_m=axis, depth_m=np.full((11, 11), 9.5), lat0=1.0, lon0=2.0)
    good = path.read_bytes()
    rng = np.random.default_rng(0)
    said = []
    for i in range(400):
        if i < 100:
            bad = good[: len(good) * i // 100]
        else:
            damaged = np.frombuffer(good, np.uint8).copy()
            damaged[rng.integers(len(good), size=3)] ^= np.uint8(rng.integers(1, 256))
            bad = damaged.tobytes()
        path.write_bytes(bad)
        try:
            load_ground(path)
        except GroundError as error:
            said.append(str(error))
    assert len(said) > 300
    assert all("g.npz" in text for text in said)
    with path.open("wb") as file:
        np.save(file, np.ones((3, 3)))
    with pytest.raises(
        GroundError, match=r"^[^:]*g\.npz: a single array of shape \(3, 3\) \(npy\); expected an npz file"
    ):
        load_ground(path)


def test_origins_are_on_earth(tmp_path):
    north, east, depth = soundings(300)
    lat, lon = geodetic_from_local(north, east, 47.5, -91.5)
    rows = "\n".join(f"{a:.8f},{o + 360.0:.8f},{d:.3f}" for a, o, d in zip(lat, lon, depth, strict=True))
    (tmp_path / "s.csv").write_text("lat,lon,depth_m\n" + rows)
    # Longitudes of 0 to 360 are read, and the origin is what area.origin_lon_deg may be.
    assert load_ground(tmp_path / "s.csv").origin == pytest.approx((47.5018, -91.4973), abs=2e-4)
    with pytest.raises(GroundError, match=r"s\.csv: area\.origin_lat_deg, origin_lon_deg: 500, 8; expected degrees"):
        load_ground(tmp_path / "s.csv", origin=(500.0, 8.0))
    (tmp_path / "g.asc").write_text(ascii_text(np.full((30, 30), 20.0), 1e12, 1e12, 10.0))
    (tmp_path / "g.prj").write_text("EPSG:32632")
    with pytest.raises(GroundError, match=r"g\.asc: the middle of the raster: .*; expected degrees"):
        load_ground(tmp_path / "g.asc")
    with pytest.raises(GroundError, match=r"grid: origin: 47, 361; expected"):
        GridGround([0, 1], [0, 1], np.ones((2, 2)), origin=(47.0, 361.0))


@pytest.mark.parametrize("names", [("easting", "northing"), ("Easting_m", "Northing_m"), ("east_m", "north_m")])
def test_projected_soundings_are_refused_by_name(tmp_path, names):
    north, east, depth = soundings(300)
    path = write_csv(tmp_path / "u.csv", [*names, "depth_m"], east + 523_000.0, north + 5_262_000.0, depth)
    with pytest.raises(
        GroundError,
        match=r"u\.csv: north from 526200\d to 526[23]\d\d\d m, east from 52300\d to 523[34]\d\d m; "
        r"expected metres about a local origin.*lat, lon.*subtract an origin, here perhaps 5262200 and 523200",
    ):
        load_ground(path)
    near = write_csv(tmp_path / "n.csv", [*names, "depth_m"], east, north, depth)
    assert np.isfinite(load_ground(near).depth_m(200.0, 200.0))


@pytest.mark.parametrize("names", [("lat", "lon"), ("Latitude", "Longitude"), ("latitude", "lng")])
def test_projected_soundings_with_degrees_are_placed_by_these(tmp_path, names):
    north, east, depth = soundings()
    lat, lon = geodetic_from_local(north, east, 47.5, 9.3)
    columns = [east + 523_000.0, north + 5_262_000.0, lat, lon, depth]
    rows = "\n".join(",".join(f"{v:.8f}" for v in row) for row in zip(*columns, strict=True))
    (tmp_path / "s.csv").write_text(f"easting,northing,{names[0]},{names[1]},depth_m\n{rows}")
    ground = load_ground(tmp_path / "s.csv", origin=(47.5, 9.3))
    assert ground.origin == (47.5, 9.3)
    assert "metres far from any local origin (projected?) are not used" in ground.describe()
    check_bottom(ground)


def test_data_far_from_the_origin_are_refused_by_name(tmp_path):
    north, east, depth = soundings(300)
    lat, lon = geodetic_from_local(north, east, 47.5, 9.3)
    rows = "\n".join(f"{a:.8f},{o:.8f},{d:.3f}" for a, o, d in zip(lat, lon, depth, strict=True))
    (tmp_path / "s.csv").write_text("lat,lon,depth_m\n" + rows)
    (tmp_path / "g.asc").write_text(ascii_text(np.full((30, 30), 20.0), 9.3, 47.5, 1e-4, "xllcenter"))
    for name in ("s.csv", "g.asc"):
        for origin in ((47.5, 11.0), (-40.0, -170.0)):
            with pytest.raises(
                GroundError, match=rf"{name[0]}\.{name[2:]}: latitude 47\.50.*farther than 100 km from .*"
            ):
                load_ground(tmp_path / name, origin=origin)
    axis = np.arange(0.0, 101.0, 10.0)
    np.savez(tmp_path / "u.npz", north_m=axis + 5.2e6, east_m=axis + 5e5, depth_m=np.full((11, 11), 20.0))
    with pytest.raises(GroundError, match=r"u\.npz: north from 5200000 to 5200100 m.*lat0, lon0"):
        load_ground(tmp_path / "u.npz")


@needs_lake
def test_the_real_lake_both_ways():
    fine, grid = (load_ground(SHARED / name) for name in ("tzibana_soundings.csv", "tzibana_grid10m.npz"))
    assert fine.origin == pytest.approx((17.1221, -91.6281), abs=2e-5)
    assert grid.origin == pytest.approx((17.1221, -91.6281))
    n, e = np.meshgrid(*grid.extent.axes(20.0), indexing="ij")
    a, b = fine.depth_m(n, e), grid.depth_m(n, e)
    both = np.isfinite(a) & np.isfinite(b)
    # Area known in the survey's own grid: 1.43 km2.
    assert np.isfinite(b).mean() * grid.extent.height_m * grid.extent.width_m == pytest.approx(1.43e6, rel=0.05)
    assert both.sum() > 0.95 * np.isfinite(b).sum()
    # Two griddings of the same soundings, smoothed differently, on slopes of up to 45 degrees.
    assert np.median(np.abs(a - b)[both]) < 0.15
    assert np.percentile(np.abs(a - b)[both], 99) < 2.5
    assert (b[both] > 15.0).mean() == pytest.approx(0.67, abs=0.04)
