"""Which way the depths of a file grow: what is taken, and what is not guessed."""

import numpy as np
import pytest
from ground_helpers import bottom, check_bottom, soundings, topobathy, write_csv, write_grid

from auv_lse_common.mission_file.parameters import to_mapping
from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_gp.no_data import fill_values
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.ground_files import load_ground


def test_elevations_are_negated(tmp_path):
    north, east, depth = soundings()
    path = write_csv(tmp_path / "s.csv", ["north_m", "east_m", "elevation_m"], north, east, -depth)
    check_bottom(load_ground(path))
    path = write_csv(tmp_path / "t.csv", ["north_m", "east_m", "depth_m"], north, east, -depth)
    with pytest.raises(
        GroundError,
        match=r"t\.csv:2: depth -.* m is negative, as 3000 of 3000 soundings are, but depth_m is .*--elevations",
    ):
        load_ground(path)
    check_bottom(load_ground(path, BathymetryConfig(depth_sign="up")))


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
    with pytest.raises(
        GroundError, match=r"to 1230.* m, none near 0: depths, .*--depths, or --elevations --water-level"
    ):
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
        match=rf"g\.{ending}: elevation_m from 11\d\d.* to 1230.*none below .* at 0 m\..*--water-level M",
    ):
        load_ground(path)
    config = BathymetryConfig(water_level_m=1200.0, smoothing_m=0.0)
    assert load_ground(path, config).depth_m(200.0, 20.0) == pytest.approx(-0.75 * height[20, 2], abs=0.01)
    # Two thirds of land is no error where the name says what is up.
    land = write_grid(tmp_path / f"l.{ending}", *topobathy(2 / 3))
    assert "nodes are land" in load_ground(land).describe()
    depths = write_grid(tmp_path / f"d.{ending}", axis, -height, "depth_m")
    with pytest.raises(
        GroundError, match=r"depth_m from .* but sim\.bathymetry\.water_level_m = 1200 m needs elevations"
    ):
        load_ground(depths, config)
    shallow = write_grid(tmp_path / f"n.{ending}", *topobathy(0.1), "depth_m")
    with pytest.raises(GroundError, match=r"positive down: choose --elevations, or --depths"):
        load_ground(shallow)
    load_ground(shallow, BathymetryConfig(depth_sign="down"))


@pytest.mark.parametrize("mark", [-9999.0, 9999.0, -99999.0, -32768.0, 32767.0])
@pytest.mark.parametrize("ending", ["npz", "asc"])
def test_marks_for_no_data_are_unknown(tmp_path, ending, mark):
    axis = np.arange(0.0, 401.0, 10.0)
    depth = bottom(*np.meshgrid(axis, axis, indexing="ij"))
    depth[:, 20:] = mark
    path = write_grid(tmp_path / f"depth.{ending}", axis, depth, "depth_m")
    if ending == "asc":  # the header names another value
        path.write_text(path.read_text().replace("NODATA_value -9999", "NODATA_value -1"))
    ground = load_ground(path)
    assert np.isnan(ground.depth_m(200.0, 300.0))
    assert ground.depth_m(200.0, 100.0) == pytest.approx(bottom(200.0, 100.0), abs=0.01)
    assert f"; {41 * 21} nodes of {mark:g} taken as unknown" in ground.describe()


def test_a_water_level_that_is_not_set_is_not_written_to_the_mission_file():
    """Campaigns name their missions by their parameters: those of a default mission are what they were."""
    assert set(to_mapping(BathymetryConfig())) == {"file", "resolution_m", "max_gap_m", "smoothing_m", "depth_sign"}


@pytest.mark.parametrize("mark", [999.0, -99.0, -999.0, 1e20, -1e30, 9.96921e36, 500.0])
@pytest.mark.parametrize("ending", ["npz", "asc", "xyz", "tif"])
@pytest.mark.parametrize("share", [0.1, 0.7])
def test_a_block_of_one_value_far_from_all_others_is_unknown_and_reported(tmp_path, ending, mark, share):
    axis = np.arange(0.0, 401.0, 10.0)
    depth = bottom(*np.meshgrid(axis, axis, indexing="ij"))
    columns = round(share * 41)
    depth[:, 41 - columns :] = mark
    ground = load_ground(written(tmp_path / f"depth.{ending}", axis, depth))
    assert np.isnan(ground.depth_m(200.0, 395.0))
    assert ground.depth_m(200.0, 60.0) == pytest.approx(bottom(200.0, 60.0), abs=0.3)
    assert f"{41 * columns:,} nodes of {np.float32(mark):g} taken as unknown" in ground.describe().replace(
        "points", "nodes"
    )


@pytest.mark.parametrize(
    ("low", "high", "mark"),
    [(0.5, 2.0, 8.0), (3.0, 4.0, 10.0), (12.0, 12.3, 0.0), (430.0, 440.0, 512.0), (4.99, 5.01, 6.0)],
)
@pytest.mark.parametrize("share", [0.02, 0.5])
def test_a_basin_of_one_depth_is_no_missing_data(low, high, mark, share):
    """As dredged, or clipped to the sounder's range."""
    depth = np.random.default_rng(1).uniform(low, high, (41, 41))
    depth[:, : round(share * 41)] = mark
    assert fill_values(depth) == []


def written(path, axis, depth):
    """A grid of depths in another program's format."""
    if path.suffix == ".xyz":
        north, east = np.meshgrid(axis, axis, indexing="ij")
        np.savetxt(path, np.column_stack([east.ravel(), north.ravel(), depth.ravel()]), fmt="%.8g")
    elif path.suffix == ".tif":
        rasterio = pytest.importorskip("rasterio")
        transform = rasterio.Affine(10.0, 0.0, -5.0, 0.0, -10.0, 405.0)
        shape = {"height": 41, "width": 41, "count": 1}
        with rasterio.open(path, "w", driver="GTiff", dtype="float32", transform=transform, **shape) as file:
            file.write(depth[::-1].astype("float32"), 1)
    else:
        write_grid(path, axis, depth, "depth_m")
        if path.suffix == ".asc":
            path.write_text(path.read_text().replace("NODATA_value -9999", "NODATA_value -1"))
    return path


def test_zeros_in_a_grid_of_elevations_are_no_deep_water(tmp_path):
    axis = np.arange(0.0, 401.0, 10.0)
    height = 372.0 - bottom(*np.meshgrid(axis, axis, indexing="ij"))
    height[:, :20] = 0.0
    ground = load_ground(write_grid(tmp_path / "g.asc", axis, height), BathymetryConfig(water_level_m=372.0))
    assert np.isnan(ground.depth_m(200.0, 100.0))
    assert f"{41 * 20} nodes of 0 taken as unknown" in ground.describe()


def test_ground_of_steps_keeps_its_steps(tmp_path):
    """Whole metres repeat, and a plateau is no mark."""
    axis = np.arange(0.0, 401.0, 10.0)
    depth = np.round(bottom(*np.meshgrid(axis, axis, indexing="ij")))
    depth[:20, :20] = depth.max() + 12.0
    ground = load_ground(write_grid(tmp_path / "depth.asc", axis, depth))
    assert ground.known_share == 1.0
    two = np.where(np.arange(41)[:, None] < 20, 8.0, 20.0) * np.ones(41)
    assert load_ground(write_grid(tmp_path / "depth.asc", axis, two)).known_share == 1.0
