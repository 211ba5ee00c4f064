"""Fitting a mission to the ground: what is navigable, where to start, what to expect."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from ground_helpers import SURVEY_FILES, SURVEY_ORIGIN, write_survey
from numpy.testing import assert_allclose
from sim_helpers import FunctionGround

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.extent import Extent
from auv_lse_sim.ground.grid_ground import GridGround
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.ground_source import ground_of
from auv_lse_sim.ground.navigable import depth_warnings, expectations, fit_to_ground, prior_warnings
from auv_lse_sim.ground.shore import MAX_CORNERS, shore_of

EXTENT = Extent(north_min_m=-200, north_max_m=700, east_min_m=-200, east_max_m=800)
SQUARE = [0.0, 0.0, 500.0, 0.0, 500.0, 500.0, 0.0, 500.0]


def ground(function):
    return FunctionGround(lambda n, e: np.broadcast_to(function(n, e), np.shape(n)).astype(float), EXTENT)


def settings(**overrides):
    return Settings.load(None, {"area.polygon_m": SQUARE, "auv1.vehicle.start_north_m": 250.0, **overrides})


def check_safe(fitted, terrain, limit_m=8.0, spacing_m=3.0):
    """No location that a vehicle may go to is shallower than the limit."""
    area = OperatingArea(fitted.area)
    grid = area.grid(spacing_m)
    locations = grid.locations_m
    depth = terrain.depth_m(locations[:, 0], locations[:, 1])
    allowed = area.clearance_m(locations) >= fitted.area.margin_m
    assert allowed.any()
    assert np.isfinite(depth[allowed]).all()
    assert depth[allowed].min() >= limit_m
    for own in fitted.vehicles:
        v = own.vehicle
        assert float(area.clearance_m(np.array([[v.start_north_m, v.start_east_m]]))[0]) >= fitted.area.margin_m
    return area


def test_default_mission_is_left_alone():
    s = Settings.load()
    for seed in range(3):
        s = s.with_overrides({"mission.seed": seed})
        fitted, notes = fit_to_ground(s, ground_of(s))
        assert fitted.to_patterns() == s.to_patterns()
        assert len(notes) == 2
        assert "3 vehicles x 100 steps, 7.1 km of path in 0.42 km2, 59 m between lawnmower lanes." in notes[1]
        assert "too" not in notes[1]


def test_shallow_island_becomes_a_no_go_area():
    terrain = ground(lambda n, e: np.where(np.hypot(n - 250, e - 250) < 60, 3.0, 25.0))
    fitted, notes = fit_to_ground(settings(), terrain)
    assert list(fitted.area.no_go) == ["ground_1"]
    area = check_safe(fitted, terrain)
    assert not area.contains(np.array([[250.0, 250.0], [250.0, 195.0]])).any()
    assert area.contains(np.array([[250.0, 100.0], [30.0, 30.0], [460.0, 460.0]])).all()
    assert any("around 1 no-go area" in note for note in notes)


def test_own_no_go_areas_stay():
    terrain = ground(lambda n, e: np.where(n > 400, np.nan, 25.0))
    own = {"wreck": [200.0, 200.0, 260.0, 200.0, 260.0, 260.0, 200.0, 260.0]}
    fitted, _ = fit_to_ground(settings(**{"area.no_go": own}), terrain)
    assert fitted.area.no_go["wreck"] == tuple(own["wreck"])
    check_safe(fitted, terrain)


def test_unknown_ground_is_cut_off_and_the_largest_near_part_kept():
    # A wall of unknown ground leaves two parts; the start lies in the smaller one, which is large enough.
    terrain = ground(lambda n, e: np.where(np.abs(e - 180.0) < 15.0, np.nan, 25.0))
    fitted, notes = fit_to_ground(settings(), terrain)
    area = check_safe(fitted, terrain)
    assert area.contains(np.array([[250.0, 80.0]])).all()
    assert not area.contains(np.array([[250.0, 400.0]])).any()
    assert any("in 1 other part cannot" in note and "cannot be reached" in note for note in notes)
    # A sliver by the start is not chosen.
    terrain = ground(lambda n, e: np.where(np.abs(e - 80.0) < 15.0, np.nan, 25.0))
    fitted, notes = fit_to_ground(settings(), terrain)
    area = check_safe(fitted, terrain)
    assert area.contains(np.array([[250.0, 400.0]])).all()
    assert any("start of every vehicle" in note or "start of auv1" in note for note in notes)


def test_a_start_of_other_coordinates_is_refused_and_not_moved():
    """UTM coordinates, or exchanged latitude and longitude: the vehicle would start where nobody puts it in."""
    terrain = ground(lambda n, e: np.full(np.broadcast(n, e).shape, 25.0))
    far = settings(**{"auv1.vehicle.start_north_m": 745250.0, "auv1.vehicle.start_east_m": 250.0})
    with pytest.raises(GroundError, match=r"start of auv1: north 745250, east 250 m is 745 km from the area's water: "):
        fit_to_ground(far, terrain)


def test_a_passage_narrower_than_the_margins_divides():
    def depth(n, e):
        wall = (np.abs(e - 250.0) < 20.0) & (np.abs(n - 250.0) > 9.0)  # an 18 m gap; margins of 10 m on either side
        return np.where(wall, 2.0, 25.0)

    fitted, _ = fit_to_ground(settings(), ground(depth))
    inside = OperatingArea(fitted.area).contains(np.array([[250.0, 100.0], [250.0, 400.0]]))
    assert inside.sum() == 1
    wide, _ = fit_to_ground(
        settings(), ground(lambda n, e: np.where((np.abs(e - 250.0) < 20.0) & (np.abs(n - 250.0) > 40.0), 2.0, 25.0))
    )
    assert OperatingArea(wide.area).contains(np.array([[250.0, 100.0], [250.0, 400.0]])).all()


def test_start_on_land_is_moved_to_where_it_can_turn():
    terrain = ground(lambda n, e: np.where(n + e < 150.0, np.nan, 25.0))
    s = settings(**{"auv1.vehicle.start_north_m": 0.0})
    fitted, notes = fit_to_ground(s, terrain)
    area = check_safe(fitted, terrain)
    v = fitted.vehicle(1).vehicle
    location = np.array([[v.start_north_m, v.start_east_m]])
    assert float(area.clearance_m(location)[0]) >= 10.0 + 2.0 * 15.0
    # The nearest such location: not much farther than the shore, its margin and two turning radii.
    assert np.hypot(*location[0]) < 150.0 / np.sqrt(2) + 40.0 + 25.0
    assert any("moved" in note for note in notes)


def test_deeper_vehicles_need_deeper_water():
    terrain = ground(lambda n, e: 10.0 + e / 50.0)
    limits = []
    for depth in (3.0, 10.0):
        fitted, _ = fit_to_ground(settings(**{"mission.vehicles": 1, "auv1.vehicle.depth_m": depth}), terrain)
        limits.append(fitted.area.polygon_m)
        check_safe(fitted, terrain, depth + 3.0)
    assert limits[0] == tuple(SQUARE)
    assert min(limits[1][1::2]) >= 150.0


@pytest.mark.parametrize(
    ("function", "match"),
    [
        (lambda n, e: np.full(np.shape(n), np.nan), "no known water of 8 m or more"),
        (lambda n, e: np.where(np.abs(n - 250.0) < 12.0, 20.0, 2.0), "wide enough for margin_m = 10 m"),
        (lambda n, e: np.where(np.hypot(n - 250.0, e - 250.0) < 30.0, 20.0, 2.0), "turning circle"),
    ],
)
def test_an_area_without_navigable_water_is_an_error(function, match):
    with pytest.raises(GroundError, match=match):
        fit_to_ground(settings(), ground(function))


def test_no_go_areas_that_cover_the_area_are_named():
    whole = [-100.0, -100.0, 600.0, -100.0, 600.0, 600.0, -100.0, 600.0]
    with pytest.raises(GroundError, match="the no-go areas wreck cover all of"):
        fit_to_ground(settings(**{"area.no_go": {"wreck": whole}}), ground(lambda n, e: 20.0 + 0.0 * n))


def test_an_area_without_the_isobath_is_reported():
    def coverage(function, **overrides):
        return [note for note in fit_to_ground(settings(**overrides), ground(function))[1] if note.startswith("level:")]

    assert coverage(lambda n, e: 12.0 + 0.01 * e) == []  # 12 to 17 m
    (note,) = coverage(lambda n, e: 12.0 + 0.005 * e)
    assert "no 15 m isobath in the area: all of it is shallower (12.0 to 14.5 m)" in note
    (note,) = coverage(lambda n, e: 12.0 + 0.01 * e, **{"level_set.level_m": 11.0})
    assert "no 11 m isobath in the area: all of it is deeper (12.0 to 17.0 m)" in note
    # The shallow part is outside of what is flown.
    (note,) = coverage(lambda n, e: np.where(e < 100.0, 5.0, 25.0))
    assert "all of it is deeper (25.0 to 25.0 m)" in note


def test_a_bottom_beyond_the_dvls_range_is_reported():
    def coverage(function, **overrides):
        return [note for note in fit_to_ground(settings(**overrides), ground(function))[1] if note.startswith("dvl:")]

    def slope(n, e):
        return 10.0 + 0.16 * e  # 90 m at 500 m east

    (note,) = coverage(slope)
    # 63 m at 331 m east: a third of the area lies beyond.
    assert (
        "34 % of the area is deeper than 63 m, the reach of auv1 (depth_m 3 m and sim.dvl.max_altitude_m 60 m)" in note
    )
    assert coverage(slope, **{"sim.dvl.max_altitude_m": 90.0}) == []
    assert coverage(slope, **{"sim.dvl.ideal": True}) == []
    (note,) = coverage(slope, **{"mission.vehicles": 1, "auv1.vehicle.depth_m": 5.0})
    assert "deeper than 65 m" in note


def test_the_origin_of_the_ground_holds():
    axis = np.arange(-50.0, 551.0, 50.0)
    terrain = GridGround(axis, axis, np.full((13, 13), 25.0), origin=(47.0, 8.0))
    elsewhere = settings(**{"area.origin_lat_deg": 47.0009, "area.origin_lon_deg": 8.0})
    fitted, notes = fit_to_ground(elsewhere, terrain)
    assert (fitted.area.origin_lat_deg, fitted.area.origin_lon_deg) == (47.0, 8.0)
    replaced = "area.origin 47.00090, 8.00000 deg is replaced by the origin of the ground, 47.00000, 8.00000 deg"
    assert any(replaced in note for note in notes)
    assert min(fitted.area.polygon_m[::2]) == pytest.approx(min(elsewhere.area.polygon_m[::2]) + 100.1, abs=15.0)
    with pytest.raises(GroundError, match=r"47\.00000, 9\.50000 puts the area off the ground"):
        fit_to_ground(settings(**{"area.origin_lat_deg": 47.0, "area.origin_lon_deg": 9.5}), terrain)
    again, notes = fit_to_ground(fitted, terrain)
    assert again.area.origin_lon_deg == 8.0
    assert not any(note.startswith("origin:") for note in notes)
    new, notes = fit_to_ground(settings(), terrain)
    assert new.area.origin_lon_deg == 8.0
    assert not any(note.startswith("origin:") for note in notes)


def test_expectations():
    def coverage(**overrides):
        return expectations(Settings.load(None, overrides))[0]

    # 3 x 100 x 23.56 m in 600 m x 700 m: lanes 420000 / 7069 = 59 m apart.
    assert "59 m between lawnmower lanes" in coverage()
    assert "too large" in coverage(**{"mission.vehicles": 1})
    assert "48 %" in coverage(**{"mission.vehicles": 1})  # 2356 m x 85 m / 420000 m2
    assert "too small" in coverage(**{"mission.steps": 300})
    assert "71 m of path in 0.42 km2, less than one lawnmower lane." in coverage(**{"mission.steps": 1})
    assert "5.9 m between lawnmower lanes" in coverage(**{"mission.steps": 1000})


#: 3 km x 3 km: 200 legs of three vehicles cover .13 of it.
WIDE = [-1500.0, -1500.0, 1500.0, -1500.0, 1500.0, 1500.0, -1500.0, 1500.0]


@pytest.mark.parametrize(
    ("values", "advised"),
    [
        ({"mission.steps": 20}, True),  # 1414 m x 85 m / 420000 m2 = .29
        ({"mission.steps": 30}, True),  # .43
        ({"mission.steps": 40}, False),  # .57
        ({"mission.steps": 20, "mission.goal": "line"}, False),
        ({"mission.steps": 20, "planner.method": "plain"}, False),
        ({"mission.steps": 201, "area.polygon_m": WIDE}, False),  # more legs than `line` plans
        ({"mission.steps": 200, "area.polygon_m": WIDE}, True),
    ],
)
def test_the_goal_that_fits_a_mission_too_short_for_a_chart(values, advised):
    assert ("mission.goal: line locates more" in expectations(Settings.load(None, values))[0]) == advised


def test_a_goal_that_a_given_method_overrides_is_named():
    def said(**overrides):
        return "because planner.method is set (" in expectations(Settings.load(None, overrides))[0]

    assert said(**{"mission.goal": "line", "planner.method": "tour"})
    assert not said(**{"mission.goal": "line"})
    assert not said(**{"mission.goal": "line", "planner.method": "line"}), "as in a run's own mission file"
    assert not said(**{"mission.goal": "line", "planner.method": "tour", "mission.steps": 201}), "what the goal chooses"
    assert not said(**{"planner.method": "tour"})


def test_coverage_rounds_half_a_length_scale():
    assert "length scale (24.8 m)" in expectations(Settings.load(None, {"gp.length_scale_m": 49.549}))[0]


def test_the_goal_chooses_the_method_of_the_shipped_mission():
    shipped = Path(__file__).parents[3] / "config/missions/default.yaml"
    short = Settings.load(shipped, {"mission.goal": "line", "mission.vehicles": 1})
    assert (Settings.load(shipped).vehicles[0].planner.method, short.vehicles[0].planner.method) == ("tour", "line")


@pytest.mark.parametrize("name", SURVEY_FILES)
def test_a_survey(tmp_path, name):
    write_survey(tmp_path)
    s = Settings.load(None, {"sim.bathymetry.file": str(tmp_path / name)})
    terrain = ground_of(s)
    fitted, notes = fit_to_ground(s, terrain)
    check_safe(fitted, terrain, spacing_m=12.0)
    assert fitted.area.origin_lat_deg == pytest.approx(SURVEY_ORIGIN[0], abs=1e-8)  # the file's digits
    assert any("the file's extent" in note for note in notes)
    assert any("too large for this mission" in note for note in notes)


def test_the_shore_is_where_known_ground_becomes_too_shallow():
    terrain = ground(lambda n, e: 25.0 - 0.2 * np.maximum(e - 300.0, 0.0))  # 8 m deep at 385 m east
    fitted, notes = fit_to_ground(settings(), terrain)
    assert fitted.area.shore_depth_m == 8.0  # 5 m, the deepest vehicle, and 3 m of water
    (line,) = fitted.area.shore.values()
    north_m, east_m = np.reshape(line, (-1, 2)).T
    assert_allclose(east_m, 385.0, atol=1.0)
    # The polygon's other edges lie on open water, and are no shore.
    assert north_m.min() < 10.0
    assert north_m.max() > 490.0
    assert any(note.startswith("shore: 0.5 km, where the depth falls to 8 m") for note in notes)
    again, _ = fit_to_ground(fitted, terrain, area_given=True)
    assert again.area.shore == fitted.area.shore


def test_a_shore_that_the_mission_has_is_kept():
    own = {"drawn": [0.0, 420.0, 500.0, 420.0]}
    terrain = ground(lambda n, e: 25.0 - 0.2 * np.maximum(e - 300.0, 0.0))
    fitted, _ = fit_to_ground(settings(**{"area.shore": own}), terrain)
    assert fitted.area.shore == {"drawn": tuple(own["drawn"])}
    assert fitted.area.shore_depth_m == 0.0


def test_where_the_survey_ends_there_is_no_shore():
    fitted, notes = fit_to_ground(settings(), ground(lambda n, e: np.where(e > 300.0, np.nan, 25.0)))
    assert not fitted.area.shore
    assert not any(note.startswith("shore:") for note in notes)


def test_a_rugged_shore_has_fewer_corners():
    axis = np.arange(0.0, 3000.0, 5.0)
    north, east = np.meshgrid(axis, axis, indexing="ij")
    depth = 8.0 + 4.0 * np.sin(north / 9.0) + 4.0 * np.sin(east / 9.0)
    found = shore_of(axis, axis, depth, 8.0, shapely.box(0.0, 0.0, 3000.0, 3000.0))
    assert 0 < sum(map(len, found.values())) <= 2 * MAX_CORNERS


@pytest.mark.parametrize("prior", [{"gp.mean": "survey", "gp.survey_file": "a.csv"}, {"gp.mean": "plane"}])
def test_a_prior_does_not_move_with_the_origin_and_is_refused(prior):
    axis = np.arange(-50.0, 551.0, 50.0)
    terrain = GridGround(axis, axis, np.full((13, 13), 25.0), origin=(47.0, 8.0))
    with pytest.raises(GroundError, match=r"47\.00090.*47\.00000.*gp.mean: (survey|plane)\) would stay.*lat and lon"):
        fit_to_ground(settings(**{"area.origin_lat_deg": 47.0009, "area.origin_lon_deg": 8.0, **prior}), terrain)
    fit_to_ground(settings(**{"area.origin_lat_deg": 47.0, "area.origin_lon_deg": 8.0, **prior}), terrain)


def test_a_prior_of_the_grounds_origin_fits(tmp_path):
    axis = np.arange(-50.0, 551.0, 50.0)
    terrain = GridGround(axis, axis, np.full((13, 13), 25.0), origin=(47.0, 8.0))
    rows = [f"{n},{e},{47.0 + n / 111_190.0},{8.0 + e / 75_900.0},25" for n in (0, 200, 400) for e in (0, 300)]
    (tmp_path / "a.csv").write_text("\n".join(["north_m,east_m,lat,lon,depth_m", *rows]) + "\n")
    prior = {"gp.mean": "survey", "gp.survey_file": str(tmp_path / "a.csv")}
    moved = settings(**{"area.origin_lat_deg": 47.0009, "area.origin_lon_deg": 8.0, **prior})
    assert fit_to_ground(moved, terrain)[0].area.origin_lat_deg == 47.0


def test_the_shore_moves_with_the_origin():
    axis = np.arange(-50.0, 551.0, 50.0)
    terrain = GridGround(axis, axis, np.full((13, 13), 25.0), origin=(47.0, 8.0))
    shore = {"west": [10.0, 20.0, 30.0, 20.0]}
    elsewhere = settings(**{"area.origin_lat_deg": 47.0009, "area.origin_lon_deg": 8.0, "area.shore": shore})
    fitted, _ = fit_to_ground(elsewhere, terrain)
    assert_allclose(fitted.area.shore["west"], [110.07, 20.0, 130.07, 20.0], atol=0.1)  # .0009 deg: 100.07 m


def test_fitting_again_changes_little():
    terrain = ground(lambda n, e: np.where(np.hypot(n - 250, e - 250) < 60, 3.0, np.where(n + e < 200, np.nan, 25.0)))
    fitted, _ = fit_to_ground(settings(), terrain)
    again, _ = fit_to_ground(fitted, terrain, area_given=True)
    first, second = (
        OperatingArea(fitted.area).grid(10.0).inside.sum(),
        OperatingArea(again.area).grid(10.0).inside.sum(),
    )
    assert 0.95 * first < second <= first


@pytest.mark.parametrize(
    ("gp", "level_m", "nearest"),
    [
        ({"mean_depth_m": 4.2, "signal_std_m": 4.4}, 15.0, "4.2 m"),
        ({"mean_depth_m": 4.2, "signal_std_m": 6.0}, 15.0, None),
        ({"mean_depth_m": 30.0, "signal_std_m": 4.4}, 15.0, "30 m"),
        ({"mean": "plane", "mean_depth_m": 4.2, "signal_std_m": 4.4, "mean_slope_north": 0.05}, 15.0, None),
    ],
)
def test_a_prior_that_nearly_excludes_the_isobath_is_reported(gp, level_m, nearest):
    overrides = {f"gp.{name}": value for name, value in gp.items()}
    texts = prior_warnings(Settings.load(None, {**overrides, "level_set.level_m": level_m}))
    assert [f"nearest prior mean, {nearest}, more than" in text for text in texts] == (
        [] if nearest is None else [True]
    )
    proposed = abs(level_m - gp["mean_depth_m"]) / 2.0
    assert all(f"Set gp.signal_std_m to {proposed:.1f} or more" in text for text in texts)
    wider = {**overrides, "gp.signal_std_m": round(proposed, 1)}
    assert not prior_warnings(Settings.load(None, {**wider, "level_set.level_m": level_m}))


@pytest.mark.parametrize(
    ("changes", "warns"),
    [
        ({"vehicle.speed_mps": 3.0}, True),  # 11.5 deg/s
        ({"motion.turn_radius_m": 1.0, "vehicle.speed_mps": 0.3}, True),
        ({"motion.turn_radius_m": 2.0, "vehicle.speed_mps": 0.3}, False),
        ({"vehicle.speed_mps": 2.3}, False),  # 8.8 deg/s
        ({"vehicle.speed_mps": 3.0, "sim.dynamics.turn_rate_max_dps": 12.0}, False),
        ({"vehicle.speed_mps": 3.0, "sim.dynamics.ideal": True}, False),
        ({"vehicle.speed_mps": 3.0, "sim.ideal": True}, False),
        ({"vehicle.speed_mps": 3.0, "link.kind": "mavlink"}, False),  # the autopilot's business
    ],
)
def test_turns_that_the_simulated_vehicle_cannot_make_are_reported(changes, warns):
    texts = [text for text in expectations(settings(**changes)) if text.startswith("motion.turn_radius_m")]
    assert len(texts) == warns
    if changes == {"vehicle.speed_mps": 3.0}:
        assert "15 m is too small for auv1, auv2, auv3 at 3 m/s" in texts[0]
        assert texts[0].endswith("Use at least 19.1 m, or less vehicle.speed_mps")


def test_each_vehicle_has_its_own_speed_for_turns():
    (text,) = expectations(settings(**{"auv2.vehicle.speed_mps": 4.0}))[1:]
    assert "too small for auv2 at 4 m/s" in text


def test_the_isobath_of_a_pool_is_found():
    pool = {"area.polygon_m": [0.0, 0.0, 20.0, 0.0, 20.0, 10.0, 0.0, 10.0], "level_set.level_m": 4.0}
    s = settings(**pool)
    assert depth_warnings(s, ground(lambda n, e: np.where(n < 2.0, 3.0, 5.0))) == []
    (note,) = depth_warnings(s, ground(lambda n, e: 5.0 + 0.0 * e))
    assert "no 4 m isobath" in note


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sim.current.north_mps": 1.5}, "too fast for auv1, auv2, auv3 to"),
        ({"sim.current.east_mps": -1.0, "auv2.vehicle.speed_mps": 0.2}, "sim.current: 1 m/s is too fast for auv2 to"),
        ({"sim.current.east_mps": 0.9, "sim.current.tide_mps": 0.9, "sim.current.tide_heading_deg": 270.0}, "1.8 m/s"),
        ({"sim.current.north_mps": 1.4}, None),
        ({"sim.current.north_mps": 1.0, "sim.current.east_mps": 1.0}, None),  # 1.41 m/s
        ({"sim.current.north_mps": 2.0, "sim.current.ideal": True}, None),
        ({"sim.current.north_mps": 2.0, "sim.ideal": True}, None),
    ],
)
def test_a_current_as_fast_as_a_vehicle_is_reported(changes, words):
    texts = [text for text in expectations(settings(**changes)) if text.startswith("sim.current")]
    assert len(texts) == (words is not None)
    assert words is None or words in texts[0]


def test_a_turning_circle_larger_than_the_area_names_the_turning_radius():
    with pytest.raises(GroundError, match=r"less than 410 m .* Choose a larger area, or less motion.turn_radius_m"):
        fit_to_ground(settings(**{"motion.turn_radius_m": 400.0}), ground(lambda n, e: 30.0 + 0.0 * e))
