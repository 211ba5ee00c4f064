"""Ground from tables of soundings."""

import numpy as np
import pytest
from ground_helpers import check_bottom, soundings, write_csv

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.ground_files import load_ground
from auv_lse_sim.ground.soundings_ground import grid_soundings


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
        if i % 50 == 0:  # a spike among repeats at one location: the median keeps it out
            lines += [f"L{i},{row[0]},{row[1]},{row[2]},x", "", f"L{i},{row[0]},{row[1]},{row[2] + 30},spike"]
    path.write_text("\n".join(lines))
    ground = load_ground(path)
    check_bottom(ground)
    assert "columns not used: line, quality;" in ground.describe()


@pytest.mark.parametrize(("name", "header"), [("s.csv", ["lon", "lat", "depth_m"]), ("depth.xyz", None)])
def test_soundings_on_both_sides_of_the_antimeridian(tmp_path, name, header):
    north, east, depth = soundings()
    lat, lon = geodetic_from_local(north - 200.0, east - 200.0, -16.8, 180.0)
    assert np.ptp(lon) > 359.0
    path = write_csv(tmp_path / name, header or ["# lon", "lat", "depth"], lon, lat, depth)
    ground = load_ground(path)
    assert abs(ground.origin[1]) == pytest.approx(180.0, abs=1e-4)
    check_bottom(ground, offset=(200.0, 200.0), tolerance=0.4)


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
    assert "lat, lon ignored" in wrong.describe()


def test_marks_for_no_data_among_soundings_are_refused(tmp_path):
    north, east, depth = soundings(100)
    depth[[40, 60]] = -9999.0
    path = write_csv(tmp_path / "s.csv", ["north_m", "east_m", "depth_m"], north, east, depth)
    with pytest.raises(
        GroundError,
        match=r"s\.csv:42: depth_m is '-9999.*'\. This is .* mark for missing data, as on 2 of 100 lines",
    ):
        load_ground(path)


def test_unknown_far_from_soundings():
    north, east, depth = soundings()
    keep = ~((np.abs(north - 200) < 80) & (np.abs(east - 200) < 80))
    ground = grid_soundings(north[keep], east[keep], depth[keep], BathymetryConfig(max_gap_m=30.0))
    assert np.isnan(ground.depth_m(200.0, 200.0))
    assert np.isfinite(ground.depth_m(200.0, 135.0))
    assert np.isnan(ground.depth_m(-50.0, 200.0))
    whole = grid_soundings(north[keep], east[keep], depth[keep], BathymetryConfig(max_gap_m=200.0))
    assert np.isfinite(whole.depth_m(200.0, 200.0))


@pytest.mark.parametrize("names", [("easting", "northing"), ("Easting_m", "Northing_m"), ("east_m", "north_m")])
def test_projected_soundings_are_refused_by_name(tmp_path, names):
    north, east, depth = soundings(300)
    path = write_csv(tmp_path / "u.csv", [*names, "depth_m"], east + 523_000.0, north + 5_262_000.0, depth)
    with pytest.raises(
        GroundError,
        match=r"u\.csv: north from 526200\d to 526[23]\d\d\d m, east from 52300\d to 523[34]\d\d m"
        r" .* so they may be projected.*lat, lon.*subtract an origin, here perhaps 5262200 and 523200",
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
    assert "metres ignored: far from any local origin (projected?)" in ground.describe()
    check_bottom(ground)


@pytest.mark.parametrize("mark", [999.0, -99.0, 1e10])
def test_soundings_that_repeat_one_value_far_from_all_others_are_refused(tmp_path, mark):
    north, east, depth = soundings()
    depth = np.where(np.arange(len(depth)) % 5 == 0, mark, depth)
    path = write_csv(tmp_path / "s.csv", ["north_m", "east_m", "depth_m"], north, east, depth)
    with pytest.raises(GroundError, match=r"s\.csv:2: depth_m is .* missing data, as on 600 of 3,000 lines"):
        load_ground(path)
