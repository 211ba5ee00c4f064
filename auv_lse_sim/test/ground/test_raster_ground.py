"""Ground from ESRI ASCII grids and GeoTIFF: metres, degrees, projections."""

import numpy as np
import pytest
from ground_helpers import ascii_text, bottom, check_bottom

from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.ground_files import load_ground


@pytest.mark.parametrize(("corner", "shift"), [("xllcorner", -5.0), ("xllcenter", 0.0)])
def test_ascii_grid_in_metres(tmp_path, corner, shift):
    axis = np.arange(0.0, 401.0, 10.0)
    depth = bottom(*np.meshgrid(axis, axis, indexing="ij"))
    depth[:, 39:] = np.nan
    (tmp_path / "depth.asc").write_text(ascii_text(depth, shift, shift, 10.0, corner))
    ground = load_ground(tmp_path / "depth.asc")
    check_bottom(ground, tolerance=0.05)
    assert np.isnan(ground.depth_m(200.0, 395.0))
    (tmp_path / "e.asc").write_text(ascii_text(-depth, shift, shift, 10.0, corner))
    elevations = load_ground(tmp_path / "e.asc")
    check_bottom(elevations, tolerance=0.05)
    assert "elevations, negated" in elevations.describe()


def test_each_axis_of_an_ascii_grid_begins_at_a_corner_or_a_center(tmp_path):
    axis = np.arange(0.0, 401.0, 10.0)
    text = ascii_text(bottom(*np.meshgrid(axis, axis, indexing="ij")), -5.0, 0.0, 10.0)
    (tmp_path / "depth.asc").write_text(text.replace("yllcorner", "yllcenter"))
    check_bottom(load_ground(tmp_path / "depth.asc"), tolerance=0.05)


def test_ascii_grid_in_degrees(tmp_path):
    step = 1e-4
    lat, lon = 45.0 + step * np.arange(60), 7.0 + step * np.arange(80)
    lat0, lon0 = 45.0 + step * 29.5, 7.0 + step * 39.5
    from auv_lse_common.vocabulary.frames import local_from_geodetic

    north, east = local_from_geodetic(*np.meshgrid(lat, lon, indexing="ij"), lat0, lon0)
    (tmp_path / "depth.asc").write_text(ascii_text(bottom(north, east), 7.0, 45.0, step, "xllcenter"))
    ground = load_ground(tmp_path / "depth.asc")
    assert ground.origin == pytest.approx((lat0, lon0), abs=1e-9)
    n, e = np.random.default_rng(1).uniform(-200, 200, (2, 200))
    assert np.abs(ground.depth_m(n, e) - bottom(n, e)).max() < 0.1


def test_ascii_grid_with_a_projection(tmp_path):
    pyproj = pytest.importorskip("pyproj", reason="pyproj is not installed")
    to_utm = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True)
    x0, y0 = to_utm.transform(9.3, 47.5)
    axis = np.arange(0.0, 401.0, 10.0)
    depth = bottom(*np.meshgrid(axis, axis, indexing="ij"))
    (tmp_path / "depth.asc").write_text(ascii_text(depth, x0, y0, 10.0, "xllcenter"))
    (tmp_path / "depth.prj").write_text(pyproj.CRS("EPSG:32632").to_wkt("WKT1_ESRI"))
    ground = load_ground(tmp_path / "depth.asc", origin=(47.5, 9.3))
    # UTM's north is 0.22 deg from true north here, its scale 1.0002 off: 1.6 m at most over this grid.
    check_bottom(ground, low=20.0, high=380.0, tolerance=0.35)
    far = tmp_path / "depth2.asc"
    far.write_text(ascii_text(depth, x0, y0, 10.0, "xllcenter"))
    shifted = load_ground(far)
    assert "no projection given" in shifted.describe()
    check_bottom(shifted, offset=(200.0, 200.0), tolerance=0.05)
    with pytest.raises(
        GroundError, match=r"unknown projection, and the mission has an origin .*47\.5, 9\.3.*\.prj file"
    ):
        load_ground(far, origin=(47.5, 9.3))


@pytest.mark.parametrize("ending", ["prj", "PRJ"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_a_projection_of_other_programs_is_read(tmp_path, ending, encoding):
    pyproj = pytest.importorskip("pyproj", reason="pyproj is not installed")
    to_utm = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True)
    axis = np.arange(0.0, 401.0, 10.0)
    depth = bottom(*np.meshgrid(axis, axis, indexing="ij"))
    (tmp_path / "LAKE_DEPTH.ASC").write_text(ascii_text(depth, *to_utm.transform(9.3, 47.5), 10.0, "xllcenter"))
    wkt = pyproj.CRS("EPSG:32632").to_wkt("WKT1_ESRI").replace("WGS_1984_UTM_Zone_32N", "Zürichsee")
    (tmp_path / f"LAKE_DEPTH.{ending}").write_bytes(wkt.encode(encoding))
    check_bottom(load_ground(tmp_path / "LAKE_DEPTH.ASC", origin=(47.5, 9.3)), low=20.0, high=380.0, tolerance=0.35)


def test_a_projection_that_is_not_understood_names_its_cure(tmp_path):
    pytest.importorskip("pyproj", reason="pyproj is not installed")
    (tmp_path / "depth.asc").write_text(ascii_text(np.full((3, 3), 12.0), 315_000.0, 5_152_000.0, 10.0))
    (tmp_path / "depth.prj").write_text("Projection UTM\nZone 32\nDatum WGS84\nParameters\n")
    with pytest.raises(GroundError, match=r"depth\.asc: its projection is not understood: .*such as EPSG:32632"):
        load_ground(tmp_path / "depth.asc")


def test_a_unit_at_the_end_of_the_name_of_an_ascii_grid_counts(tmp_path):
    axis = np.arange(0.0, 401.0, 10.0)
    depth = bottom(*np.meshgrid(axis, axis, indexing="ij"))
    (tmp_path / "lake_depth_ft.asc").write_text(ascii_text(depth / 0.3048, -5.0, -5.0, 10.0))
    ground = load_ground(tmp_path / "lake_depth_ft.asc")
    check_bottom(ground, tolerance=0.05)
    assert "converted from units of 0.3048 m" in ground.describe()


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
    with rasterio.open(tmp_path / "depth.tif", "w", crs="EPSG:32632", nodata=-1.0, **options) as file:
        file.write(depth[::-1], 1)
    ground = load_ground(tmp_path / "depth.tif")
    assert ground.origin is not None
    check_bottom(ground, offset=(200.0, 200.0), tolerance=0.3)
    (tmp_path / "bad.tif").write_bytes(b"nothing")
    with pytest.raises(GroundError, match="not a readable raster"):
        load_ground(tmp_path / "bad.tif")


@pytest.mark.parametrize("west", [179.998, -180.002, 288.3])
def test_a_raster_on_both_sides_of_the_antimeridian_is_read_whole(tmp_path, west):
    step = 5e-5
    lat, lon = -16.8 + step * np.arange(60), west + step * np.arange(80)
    from auv_lse_common.vocabulary.frames import local_from_geodetic

    north, east = local_from_geodetic(*np.meshgrid(lat, lon, indexing="ij"), -16.8 + step * 29.5, west + step * 39.5)
    (tmp_path / "depth.asc").write_text(ascii_text(bottom(north, east), west, -16.8, step, "xllcenter"))
    ground = load_ground(tmp_path / "depth.asc")
    assert abs(ground.origin[1]) <= 180.0
    assert (ground.origin[1] - (west + step * 39.5) + 180.0) % 360.0 == pytest.approx(180.0, abs=1e-9)
    n, e = np.random.default_rng(1).uniform(-120, 120, (2, 200))
    assert np.abs(ground.depth_m(n, e) - bottom(n, e)).max() < 0.1


def test_an_ascii_grid_with_a_byte_order_mark(tmp_path):
    axis = np.arange(0.0, 401.0, 10.0)
    text = ascii_text(bottom(*np.meshgrid(axis, axis, indexing="ij")), 0.0, 0.0, 10.0, "xllcenter")
    (tmp_path / "depth.asc").write_text("\ufeff" + text, encoding="utf-8")
    check_bottom(load_ground(tmp_path / "depth.asc"), tolerance=0.05)


@pytest.mark.parametrize("begin", [b"DSAA\n2 2\n", b"DSBB\x02\0", b"DSRB\x04\0"])
def test_a_grid_of_surfer_names_its_cure(tmp_path, begin):
    (tmp_path / "g.grd").write_bytes(begin + bytes(60))
    with pytest.raises(GroundError, match=r"g\.grd is a Surfer grid\. Convert it: gdal_translate g\.grd g\.tif"):
        load_ground(tmp_path / "g.grd")
