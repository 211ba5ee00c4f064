"""The whole mission file: strict, complete, and the same after a round trip."""

import subprocess
import sys

import pytest

from auv_lse_common.mission_file.parameter_file import parameters_for, read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError, describe
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.mission_file.sections.positions import positions_of
from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.mission_file.sections.vehicle import DEPTHS_M
from auv_lse_common.mission_file.settings import Settings


def write(tmp_path, text):
    path = tmp_path / "mission.yaml"
    path.write_text(text)
    return path


MISSION = """
/**:
  ros__parameters:
    mission: {vehicles: 4, seed: 9}
    sim.dvl.noise_mps: 0.02
    planner: {method: plain}
/auv2/**:
  ros__parameters:
    vehicle: {depth_m: 4.5, start_delay_s: 30.0}
    planner: {iterations: 50}
/auv7/**:
  ros__parameters:
    vehicle: {depth_m: 9.0}
"""


def test_defaults_are_those_of_the_papers_field_trial():
    s = Settings.load()
    assert (s.mission.vehicles, s.mission.steps) == (3, 100)
    assert [own.vehicle.depth_m for own in s.vehicles] == [3.0, 4.0, 5.0]
    assert (s.level_set.level_m, s.tdma.slot_s, s.motion.turn_radius_m) == (15.0, 10.0, 15.0)
    assert s.sim.altimeter.noise_m == 0.012


def test_file_and_overrides(tmp_path):
    path = write(tmp_path, MISSION)
    s = Settings.load(path)
    assert s.mission.seed == 9
    assert s.sim.dvl.noise_mps == 0.02  # ROS's dotted names nest
    assert [own.vehicle.depth_m for own in s.vehicles] == [DEPTHS_M[0], 4.5, DEPTHS_M[2], DEPTHS_M[0]]
    assert s.vehicle(2).vehicle.start_delay_s == 30.0
    assert (s.vehicle(1).planner.iterations, s.vehicle(2).planner.iterations) == (None, 50)
    over = Settings.load(path, {"mission.seed": 3, "planner": {"iterations": 20}, "auv3.vehicle.speed_mps": 1.0})
    assert over.mission.seed == 3
    assert [own.planner.iterations for own in over.vehicles] == [20, 20, 20, 20]  # the last word, over /auv2 too
    assert [own.planner.method for own in over.vehicles] == ["plain"] * 4
    assert [own.vehicle.speed_mps for own in over.vehicles] == [1.5, 1.5, 1.0, 1.5]
    assert over.vehicle(2).vehicle.depth_m == 4.5


def test_complete_file_loads_to_the_same(tmp_path):
    s = Settings.load(write(tmp_path, MISSION), {"area.no_go": {"island": [0.0, 0.0, 50.0, 0.0, 50.0, 50.0]}})
    text = s.to_parameter_file()
    again = Settings.load(write(tmp_path, text))
    assert again.to_patterns() == s.to_patterns()
    assert again.to_parameter_file() == text
    assert again.mission.seed == 9
    for number in range(1, 5):
        assert again.vehicle(number) == s.vehicle(number)
        assert again.planner_settings(number) == s.planner_settings(number)
    assert again.sim == s.sim


def test_complete_file_contains_every_default(tmp_path):
    path = write(tmp_path, Settings.load().to_parameter_file())
    values = parameters_for(read_parameter_file(path), "/auv1/gp_node")["sim"]
    for name, default, *_ in describe(SimConfig):
        level = values
        *parents, leaf = name.split(".")
        for parent in parents:
            level = level[parent]
        if default not in ((), {}, None):
            got = level[leaf]
            assert (tuple(got) if isinstance(got, list) else got) == default, name
            assert isinstance(got, type(default) if not isinstance(default, tuple) else list), name


def test_ros_reads_the_complete_file(tmp_path):
    """rcl's YAML knows neither aliases nor nulls, and takes 1e-05 for a text."""
    text = Settings.load(None, {"sim.gyro.noise_deg_rth": 1e-5}).to_parameter_file()
    assert "1.0e-05" in text
    for word in ("null", "&id", "*id", "[]", "{}"):
        assert word not in text


def test_parameters_of_a_vehicle_apply_only_to_it(tmp_path):
    s = Settings.load(write(tmp_path, MISSION))
    assert s.parameters(2)["vehicle"]["depth_m"] == 4.5
    assert s.parameters(3)["vehicle"]["depth_m"] == 5.0
    assert s.parameters(3)["tdma"]["slot_s"] == 10.0


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("/**: {ros__parameters: {missions: {seed: 1}}}", r"missions: unknown section; did you mean 'mission'"),
        ("/**: {ros__parameters: {sim: {dvl: {noise: 1.0}}}}", r"sim\.dvl\.noise: unknown parameter .*noise_mps"),
        ("/**: {ros__parameters: {sim: {dvl: {noise_mps: -1.0}}}}", r"must be a number from 0 to 10 m/s, not -1\.0"),
        (
            "/**: {ros__parameters: {sim: {dvl: {dropout_min_s: 3.0}}}}",
            r"dropout_min_s is 3 s, but must not exceed dropout_max_s",
        ),
        ("/**: {ros__parameters: {mission: {seed: 1.5}}}", r"seed must be a whole number of at least 0, not 1\.5"),
        ("/**: {ros__parameters: {sim: {ideal: 1}}}", r"ideal must be true or false, not 1"),
        (
            "/**: {ros__parameters: {link: {kind: mavlink, endpoint: 'udpin://1.2.3.4'}}}",
            r"endpoint: 'udpin://1\.2\.3\.4' is not an ad",
        ),
        (
            "/**: {ros__parameters: {modem: {kind: micromodem, port: ttyUSB0}}}",
            r"modem\.port: 'ttyUSB0' is not an address; write /dev/",
        ),
        ("/auv1/**: {ros__parameters: {tdma: {slot_s: 20.0}}}", r"/auv1/\*\*: tdma is the same for the whole team"),
        ("/auv1/**: {ros__parameters: {sim: {ideal: true}}}", r"sim is the same for the whole team"),
        (
            "/auv1/gp_node: {ros__parameters: {gp: {noise_std_m: 0.1}}}",
            r"/auv1/gp_node matches no vehicle; write '/\*\*' \(all ve",
        ),
        (
            "/auv0/**: {ros__parameters: {vehicle: {depth_m: 1.0}}}",
            r"there is no vehicle 0; the mission has vehicles 1 to 3",
        ),
        ("/auv2: {ros__parameters: {vehicle: {depth_m: 9.0}}}", r"/auv2 matches only a node.*write '/auv2/\*\*'"),
        ("auv2: {ros__parameters: {vehicle: {depth_m: 9.0}}}", r"auv2 matches only a node.*write '/auv2/\*\*'"),
        (
            "/auv2/*: {ros__parameters: {vehicle: {depth_m: 9.0}}}",
            r"/auv2/\* matches no vehicle; write '/\*\*' \(all vehicles\)",
        ),
        (
            "/auv02/**: {ros__parameters: {vehicle: {depth_m: 9.0}}}",
            r"/auv02/\*\* matches no vehicle; write '/\*\*' \(all vehicles\)",
        ),
        (
            "/auv*/**: {ros__parameters: {vehicle: {depth_m: 9.0}}}",
            r"/auv\*/\*\* matches no vehicle; write '/\*\*' \(all vehicles\)",
        ),
        ("/auv2/**: {ros__parameters: {vehicle: {depht_m: 1.0}}}", r"auv2.*depht_m: unknown parameter .*depth_m"),
        ("", "is empty; write a ROS 2 parameter file"),
    ],
)
def test_errors_name_the_problem_and_the_expectation(tmp_path, text, match):
    with pytest.raises(ParameterError, match=match):
        Settings.load(write(tmp_path, text))


@pytest.mark.parametrize(
    "text",
    [
        "auv2/**: {ros__parameters: {vehicle: {depth_m: 8.0}}}\n/auv2/**: {ros__parameters: {vehicle: {depth_m: 9.0}}}",
        "/auv2/**: {ros__parameters: {vehicle: {depth_m: 8.0}}}\n/**: {ros__parameters: {vehicle: {depth_m: 9.0}}}",
    ],
)
def test_override_of_one_vehicle_replaces_all_patterns(tmp_path, text):
    path = write(tmp_path, text)
    assert Settings.load(path).vehicle(2).vehicle.depth_m == 9.0
    assert Settings.load(path, {"auv2.vehicle.depth_m": 6.0}).vehicle(2).vehicle.depth_m == 6.0


def test_overrides_are_checked_like_the_file(tmp_path):
    with pytest.raises(ParameterError, match=r"/auv2/\*\*: tdma is the same for the whole team"):
        Settings.load(None, {"auv2.tdma.slot_s": 20.0})
    with pytest.raises(ParameterError, match="there is no vehicle 0; the mission has vehicles 1 to 3"):
        Settings.load(None, {"auv0.vehicle.depth_m": 2.0})


def test_reading_a_mission_file_imports_no_recorder_cluster_or_drawing():
    code = (
        "import sys, auv_lse_common.mission_file.settings; "
        "print([m for m in ('rosbags', 'matplotlib', 'distributed', 'dask', 'pyarrow', 'auv_lse_record.bag_writer', "
        "'auv_lse_sim.ground.ground_files') if m in sys.modules])"
    )
    path = ":".join(sys.path)
    done = subprocess.run([sys.executable, "-c", code], env={"PYTHONPATH": path}, capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr


def test_unknown_vehicle_is_rejected():
    with pytest.raises(ValueError, match="vehicle 4 does not exist; the mission has vehicles 1 to 3"):
        Settings.load().vehicle(4)


def test_complete_file_gives_default_depths_to_a_larger_team():
    complete = Settings.load(None, {"mission.vehicles": 2, "auv2.vehicle.depth_m": 7.5}).to_patterns()
    larger = Settings.from_patterns(complete, "mission.yaml", {"mission.vehicles": 5})
    assert [own.vehicle.depth_m for own in larger.vehicles] == [3.0, 7.5, 5.0, 3.0, 4.0]


def test_method_defaults_follow_an_overridden_method():
    """`positions.correct` is left out: it is off with the paper's methods, and on again with others."""
    settings = Settings.load(None, {"planner.method": "plain"})
    assert settings.positions_in_force(1).correct is False
    again = settings.with_overrides({"planner.method": "tour"})
    assert again.positions_in_force(1).correct is True
    own = Settings.load(None, {"auv2.planner.method": "plain"})
    assert [own.positions_in_force(k).correct for k in (1, 2, 3)] == [True, False, True]
    assert positions_of(own.parameters(2), "node").correct is False, "as its nodes take it"


@pytest.mark.parametrize("ideal", ["sim.ideal", "sim.navigation.ideal"])
def test_vehicle_with_ideal_navigation_does_not_surface(ideal):
    settings = Settings.load(None, {ideal: True})
    assert settings.planner_settings(1).vehicle.surfacings == 0
    assert PlannerSettings.from_parameters(settings.parameters(1), "node", 1).vehicle.surfacings == 0
    assert settings.with_overrides({ideal: False}).planner_settings(1).vehicle.surfacings is None
    asked = settings.with_overrides({"vehicle.surfacings": 2})
    assert asked.planner_settings(1).vehicle.surfacings == 2


@pytest.mark.parametrize(
    ("corners_m", "center", "sides"),
    [
        ((0.0, 0.0, 200.0, 0.0, 200.0, 200.0), (250.0, 300.0), (600.0, 700.0)),  # within the default lake
        ((-500.0, 0.0, 700.0, 0.0, 700.0, 900.0), (100.0, 450.0), (1200.0, 900.0)),
        ((-100.0, -50.0, 100.0, -50.0, 100.0, 2950.0), (0.0, 1450.0), (600.0, 3000.0)),  # a river
        ((0.0, 0.0, 40000.0, 0.0, 40000.0, 900.0), (20000.0, 450.0), (5000.0, 900.0)),
    ],
)
def test_synthetic_lake_is_as_large_as_the_area(corners_m, center, sides):
    settings = Settings.load(None, {"area.polygon_m": corners_m})
    window = settings.sim.lake.window
    assert (window.center, window.height_m, window.width_m) == (center, *sides)
    clipped = settings.with_overrides({"area.polygon_m": (0.0, 0.0, 50.0, 0.0, 50.0, 50.0)})
    assert clipped.sim.lake.window == window  # a smaller area of the same mission is in the same lake


def test_given_sides_of_a_synthetic_lake_stay():
    given = {
        "area.polygon_m": (0.0, 0.0, 900.0, 0.0, 900.0, 900.0),
        "sim.lake.north_m": 33.3,
        "sim.lake.width_m": 333.3,
    }
    lake = Settings.load(None, given).sim.lake
    assert (lake.north_m, lake.east_m, lake.height_m, lake.width_m) == (33.3, 450.0, 900.0, 333.3)


def test_a_mission_of_an_autopilot_needs_an_origin_by_the_time_the_ground_is_known() -> None:
    settings = Settings.load(None, {"auv2.link.kind": "mavlink", "auv2.link.mode": "mission"})
    with pytest.raises(ParameterError, match=r"\(auv2\): link.mode: 'mission' needs area.origin_lat_deg"):
        settings.check_origin()
    settings.with_overrides({"area.origin_lat_deg": 46.5, "area.origin_lon_deg": 6.6}).check_origin()
