"""The axes of netCDF grids: order, spacing, direction and unit."""

import numpy as np
import pytest
from ground_helpers import bottom, check_bottom

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.ground_files import load_ground

rasterio = pytest.importorskip("rasterio")
AXIS = np.arange(0.0, 401.0, 10.0)
DEPTH = bottom(*np.meshgrid(AXIS, AXIS, indexing="ij"))
LAT, LON = 47.0 + AXIS / 111_320.0, 9.0 + AXIS / 75_900.0
DOWN = BathymetryConfig(depth_sign="down")
DEGREES = {"lat": (LAT, "degrees_north"), "lon": (LON, "degrees_east")}


def netcdf(path, axes, values, order=None, crs=None):
    """Writes a classic netCDF file with axes {name: (values, unit)} and depths."""
    from scipy.io import netcdf_file

    with netcdf_file(path, "w") as file:
        for name, (axis, unit) in axes.items():
            file.createDimension(name, len(axis))
            variable = file.createVariable(name, "f4" if axis.dtype == "f4" else "f8", (name,))
            variable[:] = axis
            if unit:
                variable.units = unit
            if name in ("x", "y") and unit:
                variable.standard_name = f"projection_{name}_coordinate"
        depth = file.createVariable("depth", "f4", order or tuple(axes))
        depth[:], depth.units = values, "m"
        if crs:
            mapping = file.createVariable("crs", "i4", ())
            mapping.grid_mapping_name, mapping.crs_wkt, mapping.spatial_ref = "transverse_mercator", crs, crs
            depth.grid_mapping = "crs"
    return path


def check(path):
    check_bottom(load_ground(path, DOWN), offset=(200.0, 200.0), tolerance=0.35)


def test_descending_axes_are_turned(tmp_path):
    for name, rows, columns in (("a.nc", -1, 1), ("b.nc", 1, -1), ("c.nc", -1, -1)):
        axes = {"lat": (LAT[::rows], "degrees_north"), "lon": (LON[::columns], "degrees_east")}
        check(netcdf(tmp_path / name, axes, DEPTH[::rows, ::columns]))


@pytest.mark.parametrize("step", [1, 2])
def test_longitude_before_latitude_is_refused(tmp_path, step):
    axes = {"lat": (LAT, "degrees_north"), "lon": (LON[::step], "degrees_east")}
    path = netcdf(tmp_path / "a.nc", axes, DEPTH[:, ::step].T, ("lon", "lat"))
    with pytest.raises(GroundError, match=r"a\.nc: its rows are not those of lat: .* ncpdq -a lat,lon a\.nc out\.nc"):
        load_ground(path, DOWN)


def test_an_axis_of_uneven_steps_is_refused(tmp_path):
    lat = LAT.copy()
    lat[20:] += 5.0 * (LAT[1] - LAT[0])
    axes = {**DEGREES, "lat": (lat, "degrees_north")}
    with pytest.raises(GroundError, match=r"a\.nc: its lat has uneven steps, from 8\.98\d*e-05 to 0\.00053"):
        load_ground(netcdf(tmp_path / "a.nc", axes, DEPTH), DOWN)


def test_longitudes_from_0_to_360_and_of_single_precision_are_even(tmp_path):
    check(netcdf(tmp_path / "a.nc", {**DEGREES, "lon": (LON + 360.0, "degrees_east")}, DEPTH))
    single = {name: (axis.astype("f4"), unit) for name, (axis, unit) in DEGREES.items()}
    load_ground(netcdf(tmp_path / "b.nc", single, DEPTH), DOWN)


@pytest.mark.parametrize("has_crs", [True, False])
def test_axes_in_kilometres_are_converted(tmp_path, has_crs):
    from pyproj import CRS

    crs = CRS.from_epsg(32632).to_wkt("WKT1_GDAL") if has_crs else None
    middle = (5_200_000.0, 500_000.0) if has_crs else (0.0, 0.0)
    axes = {name: ((at + AXIS) / 1000.0, "km") for name, at in zip(("y", "x"), middle, strict=True)}
    ground = load_ground(netcdf(tmp_path / "a.nc", axes, DEPTH, crs=crs), DOWN)
    check_bottom(ground, offset=(200.0, 200.0) if has_crs else (0.0, 0.0), tolerance=0.35)


def test_a_colon_in_the_path_is_part_of_it(tmp_path):
    (tmp_path / "at 10:30").mkdir()
    check(netcdf(tmp_path / "at 10:30" / "lake.nc", DEGREES, DEPTH))


@pytest.mark.parametrize("rows", [1, -1])
@pytest.mark.parametrize("names", [("y", "x"), ("northing", "easting"), ("lat", "lon")])
def test_axes_that_the_file_does_not_mark_count_by_their_names_as_gmt_writes_them(tmp_path, rows, names):
    axes = (LAT, LON) if names[0] == "lat" else (5_200_000.0 + AXIS, 500_000.0 + AXIS)
    marked = {name: (axis, "") for name, axis in zip(names, (axes[0][::rows], axes[1]), strict=True)}
    ground = load_ground(netcdf(tmp_path / "a.nc", marked, DEPTH[::rows]), DOWN)
    check_bottom(ground, offset=(200.0, 200.0), tolerance=0.35)


def test_axes_without_a_mark_must_be_even_and_those_in_kilometres_are_converted(tmp_path):
    uneven = AXIS.copy()
    uneven[20:] += 50.0
    with pytest.raises(GroundError, match=r"a\.nc: its y has uneven steps, from 10 to 60"):
        load_ground(netcdf(tmp_path / "a.nc", {"y": (uneven, ""), "x": (AXIS, "")}, DEPTH), DOWN)
    path = tmp_path / "b.nc"
    netcdf(path, {"northing": (AXIS / 1000.0, "km"), "easting": (AXIS / 1000.0, "km")}, DEPTH)
    check_bottom(load_ground(path, DOWN), tolerance=0.35)
    with pytest.raises(GroundError, match="no position on Earth"):
        load_ground(netcdf(tmp_path / "c.nc", {"row": (AXIS, ""), "col": (AXIS, "")}, DEPTH), DOWN)


def test_longitudes_may_jump_at_the_antimeridian(tmp_path):
    lon = 179.998 + AXIS / 75_900.0
    axes = {**DEGREES, "lon": (np.where(lon > 180.0, lon - 360.0, lon), "degrees_east")}
    check(netcdf(tmp_path / "a.nc", axes, DEPTH))


def test_a_grid_with_a_position_for_each_node_and_mere_points_name_the_way(tmp_path):
    from scipy.io import netcdf_file

    lat, lon = np.meshgrid(LAT, LON, indexing="ij")
    for name, dimensions in (("nodes.nc", ("y", "x")), ("points.nc", ("n",))):
        with netcdf_file(tmp_path / name, "w") as file:
            for dimension in dimensions:
                file.createDimension(dimension, 41)
            for variable, values in (("lat", lat), ("lon", lon), ("depth", DEPTH)):
                file.createVariable(variable, "f8", dimensions)[:] = values if len(dimensions) == 2 else values[0]
            file.variables["depth"].coordinates = "lon lat"
    with pytest.raises(GroundError, match=r"each node has a position \(lon lat\).* gdalwarp -geoloc nodes\.nc"):
        load_ground(tmp_path / "nodes.nc", DOWN)
    with pytest.raises(GroundError, match=r"If it holds points instead of a grid, write them as \.csv with lat, lon"):
        load_ground(tmp_path / "points.nc", DOWN)
