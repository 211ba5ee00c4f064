"""The values of netCDF grids: valid ranges, packed numbers, and the variable that is used."""

import numpy as np
import pytest
from ground_helpers import bottom

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_sim.ground import gdal_ground, grid_ground
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.ground_files import load_ground

rasterio = pytest.importorskip("rasterio")
AXIS = np.arange(0.0, 401.0, 10.0)
DEPTH = bottom(*np.meshgrid(AXIS, AXIS, indexing="ij"))
DOWN = BathymetryConfig(depth_sign="down")
#: A corner without a value.
HOLE = np.s_[:4, :5]


def netcdf(path, variables, turn=1):
    """Writes a classic netCDF file of {name: (values, attributes)}; `turn` is -1 for rows from the north."""
    from scipy.io import netcdf_file

    with netcdf_file(path, "w") as file:
        for name, start, step, unit in (("lat", 47.0, 9e-5, "degrees_north"), ("lon", 9.0, 1.3e-4, "degrees_east")):
            file.createDimension(name, 41)
            axis = file.createVariable(name, "f8", (name,))
            axis[:], axis.units = (start + step * np.arange(41))[:: turn if name == "lat" else 1], unit
        for name, (values, attributes) in variables.items():
            variable = file.createVariable(name, values.dtype.str[1:], ("lat", "lon"))
            variable[:] = values
            for key, value in attributes.items():
                setattr(variable, key, value)
    return path


def hdf5(path, values, attributes):
    """Writes a netCDF-4 file with the variable `depth`."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", track_order=True) as file:
        for name, start, step, unit in (("lat", 47.0, 9e-5, "degrees_north"), ("lon", 9.0, 1.3e-4, "degrees_east")):
            file[name] = start + step * np.arange(41)
            file[name].make_scale(name)
            file[name].attrs["units"] = unit
        file["depth"] = values
        for number, name in enumerate(("lat", "lon")):
            file["depth"].dims[number].attach_scale(file[name])
        file["depth"].attrs.update(attributes)
    return path


def filled(mark, factor=1.0, kind="f4"):
    values = np.round(factor * DEPTH) if kind == "i2" else factor * DEPTH
    values[HOLE] = mark
    return values.astype(kind)


@pytest.mark.parametrize(
    ("values", "attributes", "note"),
    [
        (filled(300.0), {"valid_max": np.float32(100.0)}, "20 nodes above 100 "),
        (filled(-5.0), {"valid_min": np.float32(0.0)}, "20 nodes below 0 "),
        (filled(500.0), {"valid_range": np.array([0.0, 100.0], "f4")}, "20 nodes below 0 or above 100 "),
        (
            filled(32000, 100.0, "i2"),
            {"valid_max": np.int16(10000), "scale_factor": np.float32(0.01)},
            "20 nodes above 10000 ",
        ),
        (  # meant for unpacked values: most stored ones are beyond it
            filled(32000, 100.0, "i2"),
            {"valid_max": np.float32(100.0), "scale_factor": np.float32(0.01)},
            "20 nodes above 100 ",
        ),
    ],
)
def test_values_outside_of_the_valid_range_are_unknown(tmp_path, values, attributes, note):
    paths = [netcdf(tmp_path / "a.nc", {"depth": (values, attributes)}), hdf5(tmp_path / "b.nc", values, attributes)]
    known = np.where(np.isin(values, values[HOLE]), np.nan, DEPTH)
    for path in paths:
        described = load_ground(path, DOWN).describe()
        assert note + "(the file's valid range) taken as unknown" in described
        assert f"{np.nanmin(known):.1f} to {np.nanmax(known):.1f} m deep" in described
        assert "land" not in described


@pytest.mark.parametrize("attributes", [{}, {"valid_range": np.array([0.0, 100.0], "f4")}, {"valid_min": "none"}])
def test_a_range_that_holds_all_values_changes_nothing(tmp_path, attributes):
    described = load_ground(netcdf(tmp_path / "a.nc", {"depth": (DEPTH.astype("f4"), attributes)}), DOWN).describe()
    assert "valid range" not in described
    assert f"{DEPTH.min():.1f} to {DEPTH.max():.1f} m deep" in described


@pytest.mark.parametrize(
    ("values", "attributes", "note"),
    [
        (filled(30.0), {"valid_range": np.array([100.0, 0.0], "f4")}, "below 100 or above 0"),
        (filled(30.0), {"valid_range": np.array([0.0, 0.0], "f4")}, "below 0 or above 0"),
        (-filled(30.0), {"valid_min": np.float32(0.0)}, "below 0"),  # of depths, on elevations
    ],
)
def test_a_range_that_no_value_is_in_is_a_mistake_of_the_writer_and_ignored(tmp_path, values, attributes, note):
    name = "elevation" if values.mean() < 0.0 else "depth"
    described = load_ground(netcdf(tmp_path / "a.nc", {name: (values, attributes)})).describe()
    assert f"the file's valid range is ignored: all its values are {note};" in described
    assert f"{np.abs(values).min():.1f} to {np.abs(values).max():.1f} m deep" in described


def test_the_variable_named_by_the_word_alone_is_used_and_the_others_are_reported_as_in_emodnets(tmp_path):
    elevation = (-DEPTH).astype("f4")
    others = {name: (elevation + 5.0, {}) for name in ("elevation_min", "elevation_max", "elevation_smoothed", "stdev")}
    described = load_ground(netcdf(tmp_path / "a.nc", {**others, "elevation": (elevation, {})})).describe()
    assert f"{DEPTH.min():.1f} to {DEPTH.max():.1f} m deep" in described
    assert "variable elevation, not elevation_min, elevation_max, elevation_smoothed" in described
    with pytest.raises(GroundError, match=r"has the variables elevation_min, elevation_max; which are the depths\?"):
        load_ground(netcdf(tmp_path / "b.nc", {name: others[name] for name in ("elevation_min", "elevation_max")}))
    with pytest.raises(GroundError, match=r"has the variables depth, elevation; which are the depths\?"):
        load_ground(netcdf(tmp_path / "c.nc", {"depth": (-elevation, {}), "elevation": (elevation, {})}))


@pytest.mark.parametrize("turn", [1, -1])
def test_a_grid_with_too_many_nodes_is_read_as_means_of_blocks(tmp_path, monkeypatch, turn):
    values = filled(-9999.0)
    data = {"depth": (values, {"missing_value": np.float32(-9999.0)})}
    fine = load_ground(netcdf(tmp_path / "depth.nc", data), DOWN, origin=(47.0, 9.0))
    for module in (gdal_ground, grid_ground):
        monkeypatch.setattr(module, "MAX_GRID_NODES", 500)
    path = netcdf(tmp_path / "large.nc", {"depth": (values[::turn], data["depth"][1])}, turn)
    coarse = load_ground(path, DOWN, origin=(47.0, 9.0))
    assert "means of 2 x 2 nodes, from 41 x 41" in coarse.describe()
    at = np.meshgrid(np.linspace(60.0, 350.0, 20), np.linspace(60.0, 350.0, 20))
    assert coarse.depth_m(*at) == pytest.approx(fine.depth_m(*at), abs=0.3)  # means of 20 m
    assert np.isnan(coarse.depth_m(10.0, 10.0))
    ranged = netcdf(tmp_path / "ranged.nc", {"depth": (values, {"valid_min": np.float32(0.0)})})
    with pytest.raises(GroundError, match=r"has 41 x 41 nodes, more than 500\. Cut the grid"):
        load_ground(ranged, DOWN)
