"""What rasters say about their values: scale, unit, sign, masks, bands; and what they are not."""

import contextlib
import os
import resource
from pathlib import Path

import numpy as np
import pytest
from ground_helpers import bottom, check_bottom

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_sim.ground import gdal_ground, grid_ground, ground_source
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.ground_files import load_ground

rasterio = pytest.importorskip("rasterio")
AXIS = np.arange(0.0, 401.0, 10.0)
DEPTH = bottom(*np.meshgrid(AXIS, AXIS, indexing="ij"))[::-1]
UTM = "EPSG:32632"


def tif(path, bands, *, crs=UTM, scale=1.0, offset=0.0, unit="", names=(), nodata=None, flip=False, **more):
    """Writes bands (41, 41), the first row in the north; `more` are further options of the driver."""
    bands = np.asarray(bands) if np.ndim(bands) == 3 else np.asarray(bands)[None]
    transform = rasterio.transform.Affine(10.0, 0.0, 500_000.0, 0.0, -10.0, 5_200_000.0)
    if flip:
        bands, transform = bands[:, ::-1], rasterio.transform.Affine(10.0, 0.0, 500_000.0, 0.0, 10.0, 5_199_590.0)
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=41,
        height=41,
        count=len(bands),
        dtype=bands.dtype,
        transform=transform,
        crs=crs,
        nodata=nodata,
        **more,
    ) as file:
        file.write(bands)
        file.scales, file.offsets = [scale] * len(bands), [offset] * len(bands)
        if unit:
            file.units = [unit] * len(bands)
        for number, name in enumerate(names, 1):
            file.set_band_description(number, name)
    return path


def check(path, config=None):
    ground = load_ground(path, config)
    check_bottom(ground, offset=(200.0, 200.0), tolerance=0.35)  # 0.22 deg between UTM's north and the true one
    return ground.describe()


def test_scale_and_offset_are_applied(tmp_path):
    raw = np.round((-DEPTH + 5.0) * 10.0).astype("int16")
    assert "scale 0.1 and offset -5 of the file applied" in check(tif(tmp_path / "g.tif", raw, scale=0.1, offset=-5.0))


@pytest.mark.parametrize(("unit", "metres"), [("ft", 0.3048), ("US survey foot", 0.3048006), ("cm", 0.01), ("m", 1.0)])
def test_the_unit_is_converted(tmp_path, unit, metres):
    described = check(tif(tmp_path / "g.tif", -DEPTH / metres, unit=unit))
    assert ("converted from units of" in described) == (unit != "m")


@pytest.mark.parametrize(("file", "names"), [("depth.tif", ["Depth (ft)"]), ("depth_feet.tif", ())])
def test_a_unit_in_a_name_counts(tmp_path, file, names):
    said = check(tif(tmp_path / file, (DEPTH / 0.3048).astype("float32"), names=names))
    assert "converted from units of 0.3048 m" in said


@pytest.mark.parametrize("file", ["depth_1_ft.tif", "depth_10cm.tif", "depth_ft_2026.tif"])
def test_the_resolution_in_a_files_name_is_no_unit(tmp_path, file):
    assert "converted" not in check(tif(tmp_path / file, DEPTH.astype("float32")))


def test_a_unit_that_is_no_length_is_refused(tmp_path):
    with pytest.raises(GroundError, match="its unit is 'degC', which is not a length"):
        load_ground(tif(tmp_path / "g.tif", -DEPTH, unit="degC"))


@pytest.mark.parametrize(
    ("name", "crs", "sign"),
    [
        ("depth", UTM, 1.0), ("Tiefe (depth)", UTM, 1.0), ("elevation", UTM, -1.0), ("lake-depths", UTM, 1.0),
        ("", "EPSG:32632+5714", -1.0), ("", "EPSG:32632+5715", 1.0),
    ],
)  # fmt: skip
def test_the_name_or_the_vertical_axis_tells_depths_from_elevations(tmp_path, name, crs, sign):
    check(tif(tmp_path / "g.tif", sign * DEPTH, names=[name] if name else (), crs=crs))


def test_the_vertical_axis_has_a_unit(tmp_path):
    assert "converted from units of 0.304801 m" in check(
        tif(tmp_path / "g.tif", -DEPTH / 0.3048006, crs="EPSG:32632+6360")
    )


def test_positive_values_far_from_zero_are_asked_about_only_if_nothing_describes_them(tmp_path):
    path = tif(tmp_path / "g.tif", DEPTH)
    with pytest.raises(GroundError, match=r"none near 0: depths, or elevations of .*\? Say which: --depths, or"):
        load_ground(path)
    check(path, BathymetryConfig(depth_sign="down"))
    check(tif(tmp_path / "h.tif", 100.0 - DEPTH), BathymetryConfig(depth_sign="up", water_level_m=100.0))
    check(tif(tmp_path / "my_depth.tif", DEPTH))
    shallow = DEPTH.copy()
    shallow[:, 0] = np.linspace(0.1, 1.0, 41)
    assert load_ground(tif(tmp_path / "s.tif", shallow)).describe()


def test_elevations_above_the_sea_need_the_water_level(tmp_path):
    path = tif(tmp_path / "g.tif", 100.0 - DEPTH, crs="EPSG:32632+5773")
    with pytest.raises(GroundError, match=r"as elevations, none below the water surface at 0 m.*--water-level M"):
        load_ground(path)
    check(path, BathymetryConfig(water_level_m=100.0))


def test_depths_that_are_negative_are_refused(tmp_path):
    with pytest.raises(GroundError, match="depth are depths, but mostly negative"):
        load_ground(tif(tmp_path / "g.tif", -DEPTH, names=["depth"]))


def test_masks_are_unknown_ground(tmp_path):
    path = tif(tmp_path / "g.tif", -DEPTH)
    with rasterio.open(path, "r+") as file:
        mask = np.full((41, 41), 255, dtype="uint8")
        mask[:, 20:] = 0
        file.write_mask(mask)
    ground = load_ground(path)
    assert np.isnan(ground.depth_m(0.0, 100.0))
    assert np.isfinite(ground.depth_m(0.0, -100.0))


@pytest.mark.parametrize("value", [50_000.0, -1e20, np.inf, -np.inf])
def test_absurd_values_are_left_out_and_counted(tmp_path, value):
    values = -DEPTH
    values[3, 5:8] = value
    described = load_ground(tif(tmp_path / "g.tif", values)).describe()
    assert f"3 nodes of {value:g} left out: deeper or higher than 12000 m" in described


def test_the_band_of_depths_is_used_and_named(tmp_path):
    uncertainty = np.full_like(DEPTH, 0.3)
    described = check(tif(tmp_path / "g.tif", [uncertainty, -DEPTH], names=["uncertainty", "elevation"]))
    assert "band 2 of 2 (elevation)" in described
    with pytest.raises(GroundError, match="its bands are uncertainty, slope; none holds depths"):
        load_ground(tif(tmp_path / "h.tif", [uncertainty, uncertainty], names=["uncertainty", "slope"]))


@pytest.mark.parametrize("name", ["depth (sound speed corrected)", "Depth from pressure", "meanDepth"])
def test_depths_may_be_named_with_another_quantity(tmp_path, name):
    file = tif(tmp_path / "g.tif", DEPTH - DEPTH.min(), names=[name])
    assert "depth positive down" in load_ground(file).describe()
    with pytest.raises(GroundError, match="none holds depths or elevations"):
        load_ground(tif(tmp_path / "h.tif", DEPTH, names=["depth error"]))


@pytest.mark.parametrize("name", ["Water_percentage", "currentSpeed", "WaterPercentage"])
@pytest.mark.parametrize("band", ["", "Band 1"])
def test_a_file_named_after_another_quantity_is_refused(tmp_path, name, band):
    share = np.clip(DEPTH, 0, 100)
    with pytest.raises(GroundError, match=rf"{name}\.tif is named after another quantity, .* add --depths"):
        load_ground(tif(tmp_path / f"{name}.tif", share, names=[band]))


@pytest.mark.parametrize("name", ["continental_slope_5m", "lake_high_quality", "bathymetry_mean_speed", "Time Lake"])
def test_other_file_names_are_no_quantities(tmp_path, name):
    assert load_ground(tif(tmp_path / f"{name}.tif", DEPTH - DEPTH.min())).describe()
    assert load_ground(tif(tmp_path / "speed.tif", DEPTH - DEPTH.min(), names=["depth"])).describe()


@pytest.mark.parametrize(("unit", "shown"), [("", True), ("m", False), ("US survey foot", False)])
def test_values_without_a_unit_beside_coordinates_in_feet_are_noted(tmp_path, unit, shown):
    described = load_ground(tif(tmp_path / "g.tif", DEPTH - DEPTH.min(), crs="EPSG:2263", unit=unit)).describe()
    assert ("values without a unit taken as metres, though coordinates are in US survey foot" in described) is shown


def test_a_picture_is_refused(tmp_path):
    shade = np.clip(DEPTH * 8.0, 0, 255).astype("uint8")
    with pytest.raises(GroundError, match="is a picture"):
        load_ground(tif(tmp_path / "rgb.tif", [shade] * 3, photometric="RGB"))
    palette = tif(tmp_path / "p.tif", shade)
    with rasterio.open(palette, "r+") as file:
        file.write_colormap(1, {k: (k, k, k, 255) for k in range(256)})
    with pytest.raises(GroundError, match="is a picture"):
        load_ground(palette)
    gray = tif(tmp_path / "gray.tif", shade)
    with pytest.raises(GroundError, match="whole numbers from 0 to 255, as in a picture"):
        load_ground(gray)
    assert load_ground(gray, BathymetryConfig(depth_sign="down")).describe()


def test_rows_from_south_to_north_are_turned(tmp_path):
    check(tif(tmp_path / "g.tif", -DEPTH, flip=True))


def test_a_raster_without_a_position_and_a_vrt_are_refused(tmp_path):
    path = tif(tmp_path / "g.tif", -DEPTH)
    with rasterio.open(path) as file:
        profile = {**file.profile, "transform": rasterio.transform.Affine.identity(), "crs": None}
    with rasterio.open(tmp_path / "h.tif", "w", **profile) as file:
        file.write(-DEPTH, 1)
    with pytest.raises(GroundError, match="no position on Earth"):
        load_ground(tmp_path / "h.tif")
    (tmp_path / "v.tif").write_text("<VRTDataset rasterXSize='1' rasterYSize='1'></VRTDataset>")
    with pytest.raises(GroundError, match="neither TIFF, netCDF nor HDF5"):
        load_ground(tmp_path / "v.tif")


def netcdf(path, variables, **attributes):
    """Writes a netCDF file (classic) as GEBCO's, from south to north, with SciPy."""
    from scipy.io import netcdf_file

    lat, lon = 47.0 + 1e-4 * np.arange(41), 9.0 + 1.4e-4 * np.arange(41)
    with netcdf_file(path, "w") as file:
        for name, axis, unit in (("lat", lat, "degrees_north"), ("lon", lon, "degrees_east")):
            file.createDimension(name, 41)
            variable = file.createVariable(name, "f8", (name,))
            variable[:], variable.units = axis, unit
        for name, values in variables.items():
            variable = file.createVariable(name, "i2" if values.dtype == "int16" else "f4", ("lat", "lon"))
            variable[:] = values
            for key, value in attributes.get(name, {}).items():
                setattr(variable, key, value)
    return path


def test_netcdf_as_of_gebco(tmp_path):
    elevation = np.round(-DEPTH[::-1]).astype("int16")
    described = load_ground(
        netcdf(tmp_path / "g.nc", {"elevation": elevation, "tid": np.ones((41, 41), "int16")})
    ).describe()
    assert f"{-elevation.max()}.0 to {-elevation.min()}.0 m deep" in described
    depth = {"z": {"positive": "down", "units": "cm", "scale_factor": 10.0}}
    described = load_ground(netcdf(tmp_path / "h.nc", {"z": (10.0 * DEPTH).astype("f4")}, **depth)).describe()
    assert f"{DEPTH.min():.1f} to {DEPTH.max():.1f} m deep" in described
    with pytest.raises(GroundError, match=r"has the variables a, b; which are the depths\?"):
        load_ground(netcdf(tmp_path / "i.nc", {"a": elevation, "b": elevation}))


def test_bag_is_elevation(tmp_path):
    profile = {"driver": "BAG", "width": 41, "height": 41, "count": 2, "dtype": "float32", "crs": UTM}
    transform = rasterio.transform.from_origin(500_000.0, 5_200_000.0, 10.0, 10.0)
    try:
        with rasterio.open(tmp_path / "g.bag", "w", transform=transform, nodata=1e6, **profile) as file:
            file.write(np.stack([-DEPTH, np.full_like(DEPTH, 0.3)]).astype("float32"))
    except rasterio.errors.RasterioError as error:
        pytest.skip(f"this GDAL writes no BAG: {error}")
    assert "band 1 of 2 (elevation)" in check(tmp_path / "g.bag")


@pytest.mark.parametrize("head", ["dx 10\ndy 10\n", "cellsize 10,0\n", "cellsize 10\n"])
def test_ascii_grids_have_dx_dy_and_decimal_commas(tmp_path, head):
    rows = "\n".join(" ".join(f"{-v:.3f}".replace(".", ",") for v in row) for row in DEPTH)
    (tmp_path / "g.asc").write_text(f"ncols 41\nnrows 41\nxllcenter 0,0\nyllcenter 0\n{head}{rows}\n")
    check_bottom(load_ground(tmp_path / "g.asc"), tolerance=0.05)


@pytest.mark.parametrize("count", [7, 41, 100, 41 * 41])
def test_rows_of_an_ascii_grid_may_be_wrapped(tmp_path, count):
    values = [f"{-v:.3f}" for v in DEPTH.ravel()]
    lines = "\n".join(" ".join(values[i : i + count]) for i in range(0, len(values), count))
    (tmp_path / "g.asc").write_text(f"ncols 41\nnrows 41\nxllcenter 0\nyllcenter 0\ncellsize 10\n{lines}\n")
    check_bottom(load_ground(tmp_path / "g.asc"), tolerance=0.05)


def test_cells_of_an_ascii_grid_may_be_oblong(tmp_path):
    rows = "\n".join(" ".join(f"{-v:.3f}" for v in row) for row in DEPTH[:, ::2])
    (tmp_path / "g.asc").write_text(f"ncols 21\nnrows 41\nxllcenter 0\nyllcenter 0\ndx 20\ndy 10\n{rows}\n")
    check_bottom(load_ground(tmp_path / "g.asc"), tolerance=0.3)


@pytest.mark.parametrize(("separator", "decimal"), [(" ", "."), (",", "."), (";", ","), ("\t", ".")])
def test_xyz_without_a_header(tmp_path, separator, decimal):
    north, east = np.meshgrid(AXIS, AXIS, indexing="ij")
    rows = [
        (e + 500_000.0, n + 5_200_000.0, -d) for n, e, d in zip(north.flat, east.flat, DEPTH[::-1].flat, strict=True)
    ]
    text = "\n".join(separator.join(f"{v:.3f}".replace(".", decimal) for v in row) for row in rows)
    (tmp_path / "g.xyz").write_text(text + "\n")
    ground = load_ground(tmp_path / "g.xyz", BathymetryConfig(smoothing_m=0.0))
    check_bottom(ground, offset=(200.0, 200.0), tolerance=0.5)
    assert "local origin put at its 500200.0, 5200200.0" in ground.describe()
    with pytest.raises(GroundError, match=r"unknown projection, and the mission has an origin .* Write longitude"):
        load_ground(tmp_path / "g.xyz", origin=(47.0, 9.0))
    (tmp_path / "g.xyz").write_text(text + "\n1 2\n")
    with pytest.raises(GroundError, match=r"g\.xyz:1682: \d fields? '1 2', but the first row has 3"):
        load_ground(tmp_path / "g.xyz")


@pytest.mark.parametrize(
    ("head", "row"),
    [
        ("", "{lon} {lat} {z}"),
        ("x,y,z", "{lon},{lat},{z}"),
        ("# lat lon depth", "{lat} {lon} {z}"),
        ("# depth lat lon", "{z} {lat} {lon}"),
        ("# made of soundings", "{lon} {lat} {z}"),
        ("x;y;depth;remark", "{lon};{lat};{z};good"),
    ],
)
def test_xyz_names_its_columns_or_has_longitudes_first(tmp_path, head, row):
    north, east = np.meshgrid(AXIS, AXIS, indexing="ij")
    lat, lon = geodetic_from_local(north, east, 47.5, 9.3)
    values = zip(lat.flat, lon.flat, DEPTH[::-1].flat, strict=True)
    rows = [row.format(lat=f"{a:.8f}", lon=f"{o:.8f}", z=f"{z:.3f}") for a, o, z in values]
    (tmp_path / "g.xyz").write_text("\n".join([head, *rows]))
    ground = load_ground(tmp_path / "g.xyz", BathymetryConfig(smoothing_m=0.0, depth_sign="down"), (47.5, 9.3))
    check_bottom(ground, tolerance=0.5)
    assert ("columns not used: remark" in ground.describe()) is ("remark" in head)


@pytest.mark.parametrize(
    ("at", "origin", "order"),
    [
        ((35.1, 139.3), None, "latitude, longitude"),  # a latitude of 139 deg is none
        ((47.5, 9.3), (47.5, 9.3), "latitude, longitude"),  # the other order is thousands of km from the area
        ((47.5, 9.3), (9.3, 47.5), "longitude, latitude"),
        ((47.5, 9.3), None, "longitude, latitude"),
        ((45.1, 45.1), (45.1, 45.1), "longitude, latitude"),
    ],
)
def test_latitudes_come_first_in_xyz_where_only_that_is_possible(tmp_path, at, origin, order):
    north, east = np.meshgrid(AXIS, AXIS, indexing="ij")
    lat, lon = geodetic_from_local(north, east, *at)
    rows = [f"{a:.8f} {o:.8f} {z:.3f}" for a, o, z in zip(lat.flat, lon.flat, DEPTH[::-1].flat, strict=True)]
    (tmp_path / "g.xyz").write_text("\n".join(rows))
    config = BathymetryConfig(smoothing_m=0.0, depth_sign="down")
    ground = load_ground(tmp_path / "g.xyz", config, origin)
    assert f"x, y taken as {order}" in ground.describe()
    if order == "latitude, longitude":
        check_bottom(ground, offset=(0.0, 0.0) if origin else (200.0, 200.0), tolerance=0.5)
    (tmp_path / "g.xyz").write_text("\n".join(["# lon lat depth", *rows]))  # a name counts
    if origin is not None and order == "latitude, longitude":
        with pytest.raises(GroundError, match="Change the origin"):
            load_ground(tmp_path / "g.xyz", config, origin)


def test_an_unknown_value_of_xyz_is_left_out_and_a_wrong_one_refused(tmp_path):
    rows = [f"{10 * (i % 7)} {10 * (i // 7)} {i % 3}" for i in range(60)]
    for cell in ("nan", "-9999"):
        (tmp_path / "g.xyz").write_text("\n".join([*rows, f"5 5 {cell}"]))
        assert "1 point without a value left out" in load_ground(tmp_path / "g.xyz").describe()
    (tmp_path / "g.xyz").write_text("\n".join([*rows, "5 5 nan", "5 5 2o"]))
    with pytest.raises(GroundError, match=r"g\.xyz:62: the third column is '2o'\. Write a finite number"):
        load_ground(tmp_path / "g.xyz")


@pytest.mark.parametrize("ending", ["csv", "xyz"])
def test_a_coordinate_beyond_reason_is_named_with_its_line(tmp_path, ending):
    head = "east_m,north_m,depth_m\n" if ending == "csv" else ""
    rows = "".join(f"{i % 7 * 10},{i // 7 * 10},{i % 3 + 1}\n" for i in range(40))
    (tmp_path / f"g.{ending}").write_text(head + rows + "1e308,5,3\n")
    with pytest.raises(GroundError, match=rf"g\.{ending}:{42 if head else 41}: the position 5 m north, 1e\+308 m east"):
        load_ground(tmp_path / f"g.{ending}")


def test_a_damaged_file_is_refused_without_noise(tmp_path, capfd):
    path = netcdf(tmp_path / "g.nc", {"elevation": (-DEPTH).astype("f4")})
    for data in (path.read_bytes()[:-300], b"\x89HDF\r\n\x1a\n" + bytes(400)):
        path.write_bytes(data)
        with contextlib.suppress(GroundError):
            load_ground(path)
        assert capfd.readouterr().err == ""


def test_a_raster_outside_of_its_projection_is_refused(tmp_path):
    path = tif(tmp_path / "g.tif", -DEPTH)
    with rasterio.open(path, "r+") as file:
        file.transform = rasterio.transform.Affine(10.0, 0.0, 500_000.0, 0.0, -10.0, 5.2e30)
    with pytest.raises(GroundError, match=r"outside of its projection|no grid|in degrees|farther than"):
        load_ground(path)


@pytest.mark.parametrize(("rows", "step", "expected"), [(1, 10.0, "1 x 41 nodes"), (41, 1e-9, "m wide|make no grid")])
def test_a_raster_that_is_no_grid_is_refused(tmp_path, rows, step, expected):
    transform = rasterio.transform.Affine(step, 0.0, 500_000.0, 0.0, -step, 5_200_000.0)
    options = {"width": 41, "height": rows, "count": 1, "dtype": "float64", "crs": UTM, "transform": transform}
    with rasterio.open(tmp_path / "g.tif", "w", driver="GTiff", **options) as file:
        file.write(-DEPTH[:rows], 1)
    with pytest.raises(GroundError, match=expected):
        load_ground(tmp_path / "g.tif")


def test_a_projection_that_is_no_text_is_refused_in_words(tmp_path):
    path = tif(tmp_path / "a.tif", -DEPTH, crs="+proj=tmerc +lon_0=9.1 +k=0.9996 +x_0=500000 +ellps=WGS84")
    data = path.read_bytes()
    assert b"unknown" in data, "the projection's name"
    path.write_bytes(data.replace(b"unknown", b"unkn\xf4wn"))
    with pytest.raises(GroundError, match=r"a\.tif is not a readable raster: UnicodeDecodeError"):
        load_ground(path)


def test_a_netcdf_header_that_asks_for_endless_memory_is_refused_and_not_crashed_on(tmp_path):
    path = netcdf(tmp_path / "g.nc", {"elevation": (-DEPTH).astype("f4")})
    data = bytearray(path.read_bytes())
    data[data.index(b"\0\0\0\x0b") + 4] = 7  # the number of variables: 117 million
    path.write_bytes(data)
    child = os.fork()
    if child == 0:  # a crash ends a process of its own, in which memory is bounded as on a small computer
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        limit = pages * resource.getpagesize() + 3_000_000_000
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        try:
            load_ground(path)
        except GroundError as error:
            os._exit(0 if "damaged netCDF file" in str(error) else 1)
        finally:
            os._exit(2)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_a_grid_of_gmt_3_is_named_with_a_way_to_convert_it(tmp_path):
    from scipy.io import netcdf_file

    with netcdf_file(tmp_path / "old.grd", "w") as file:
        file.createDimension("side", 2)
        file.createDimension("xysize", 12)
        for name in ("x_range", "y_range", "z_range", "spacing"):
            file.createVariable(name, "f8", ("side",))[:] = (0.0, 1.0)
        file.createVariable("dimension", "i4", ("side",))[:] = (4, 3)
        file.createVariable("z", "f4", ("xysize",))[:] = np.arange(12.0)
    with pytest.raises(
        GroundError, match=r"old\.grd is a netCDF grid of GMT 3, .*: gmt grdconvert old\.grd old-new\.nc"
    ):
        load_ground(tmp_path / "old.grd")


def test_a_raster_with_too_many_nodes_is_read_as_means_of_blocks(tmp_path, monkeypatch):
    path = tif(tmp_path / "depth.tif", DEPTH.astype("float32"), nodata=-9999.0)
    for module in (gdal_ground, grid_ground):
        monkeypatch.setattr(module, "MAX_GRID_NODES", 500)
    ground = load_ground(path)
    check_bottom(ground, offset=(205.0, 195.0), tolerance=0.6)  # its middle; the last row and column are left out
    assert "means of 2 x 2 nodes, from 41 x 41" in ground.describe()
    for module in (gdal_ground, grid_ground):
        monkeypatch.setattr(module, "MAX_GRID_NODES", 35)
    with pytest.raises(GroundError, match=r"has 41 x 41 nodes, more than 35 blocks of 6 x 6\. Cut the grid"):
        load_ground(path)


def test_of_a_large_raster_the_part_around_the_area_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(ground_source, "AROUND_M", 50.0)
    utm = rasterio.transform.Affine(10.0, 0.0, 500_000.0, 0.0, -10.0, 5_200_000.0)
    degrees = rasterio.transform.Affine(1e-4, 0.0, 360.0, 0.0, -1e-4, 45.0)  # longitudes from 360 on
    for crs, transform, origin in (
        (UTM, utm, load_ground(tif(tmp_path / "depth.tif", DEPTH.astype("float32"), nodata=-9999.0)).origin),
        ("EPSG:4326", degrees, (45.0 - 21e-4, 21e-4)),
    ):
        path = tmp_path / "depth.tif"
        about = {"driver": "GTiff", "width": 41, "height": 41, "count": 1, "dtype": "float32", "nodata": -9999.0}
        with rasterio.open(path, "w", transform=transform, crs=crs, **about) as file:
            file.write(DEPTH.astype("float32"), 1)
        area = {"polygon_m": [-80.0, -80.0, 80.0, -80.0, 80.0, 80.0], "origin_lat_deg": origin[0]}
        area["origin_lon_deg"] = origin[1]
        settings = Settings.load(None, {"sim.bathymetry.file": str(path), **{f"area.{k}": v for k, v in area.items()}})
        monkeypatch.setattr(gdal_ground, "LARGE_NODES", 41 * 41)
        whole = ground_source.ground_of(settings)
        monkeypatch.setattr(gdal_ground, "LARGE_NODES", 41 * 41 - 1)
        monkeypatch.setattr(ground_source, "_last", None)
        part = ground_source.ground_of(settings)
        assert "nodes around the area are read" not in whole.describe()
        assert "nodes around the area are read" in part.describe()
        assert part.extent.height_m < 280.0 < whole.extent.height_m
        north, east = np.random.default_rng(1).uniform(-80.0, 80.0, (2, 300))
        assert np.abs(part.depth_m(north, east) - whole.depth_m(north, east)).max() < 0.1  # two splines
        off = settings.with_overrides({"area.origin_lat_deg": 1.0})
        with pytest.raises(GroundError):  # all of it is too far from there
            ground_source.ground_of(off)
