"""What runs for one vehicle, by its parameter file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from verb_main import verb_main

from auv_lse_common.mission_file.parameter_file import read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.node.journal import FOLDER_VARIABLE
from auv_lse_common.node.state_file import open_state
from auv_lse_common.vocabulary.mission_run import RunState
from auv_lse_run.process.domain import VEHICLE_DOMAINS, own_domain, simulation_domain
from auv_lse_run.vehicle.run_vehicle import (
    begin_dive,
    ignored_parameters,
    open_dive,
    vehicle_number,
    vehicle_processes,
)

main = verb_main("vehicle")

FOR_ALL = {
    "mission": {"vehicles": 3, "steps": 100},
    "modem": {"kind": "micromodem", "port": "/dev/ttyS0"},
    "link": {"kind": "mavlink"},
    "record": {"folder": "bag"},
}


def write(folder: Path, own: dict[str, object] | None = None, **sections: object) -> Path:
    path = folder / "vehicles.yaml"
    body = {"/**": {"ros__parameters": {**FOR_ALL, **sections}}}
    if own is not None:
        body["/auv2/**"] = {"ros__parameters": own}
    path.write_text(yaml.safe_dump(body))
    return path


def processes(file: Path, *, simulated: bool = False, record: bool | None = None):
    return vehicle_processes("auv2", file, file.parent / "dive", simulated, record)


def test_a_full_disk_keeps_no_vehicle_with_positions_in_degrees_from_continuing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = write(tmp_path, area={"polygon_deg": [47.3, 8.5, 47.31, 8.5, 47.31, 8.51]})

    def full(path: Path, *_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    monkeypatch.setattr(Path, "mkdir", full)
    whole = read_parameter_file(processes(file).file)["/**"]
    assert "polygon_m" in whole["area"], "the file is in memory, with positions in metres"


def test_an_edited_area_in_degrees_begins_a_new_dive(tmp_path: Path) -> None:
    file = write(tmp_path, area={"polygon_deg": [47.3, 8.5, 47.31, 8.5, 47.31, 8.51]})

    def opened():
        return open_dive("auv2", file, None, tmp_path / "dives", False)[0]

    record = opened()
    environment = record.begin(tmp_path / "dive", "auv2-1123-184534-3f2a")
    state = open_state(Path(environment[FOLDER_VARIABLE]) / "auv2.safety_node.state", {}, environment)
    state.write({"run": {"state": int(RunState.RUNNING)}, "under_water": True})
    assert opened().continued == tmp_path / "dive"
    text = file.read_text()
    file.write_text(text.replace("8.51", "8.511"))
    assert opened().continued is None
    file.write_text(text)
    assert opened().continued == tmp_path / "dive"


def test_mission_file_selects_the_nodes(tmp_path: Path) -> None:
    found = processes(write(tmp_path))
    names = ["safety_node", "gp_node", "planner_node", "modem_node", "micromodem_node", "vehicle_link_node"]
    assert [p.name for p in found.nodes] == [f"auv2.{name}" for name in names]
    assert found.recording == tmp_path / "dive" / "bag"
    assert all(task.node is not None for task in found.tasks()), "forked, also the recorder, and watched"
    assert not found.simulated
    assert not found.lockstep
    bare = processes(
        write(tmp_path, own={"modem": {"kind": "direct"}, "link": {"kind": "direct"}}, record={"folder": ""})
    )
    assert [p.executable for p in bare.nodes] == names[:4], "this vehicle's own sections count"
    assert bare.recording is None
    assert processes(write(tmp_path), record=False).recording is None


@pytest.mark.ros
@pytest.mark.parametrize(
    ("section", "name", "value"),
    [
        ("area: {polygon_m: [0, 0, 600.5, 0, 600, 700]}", "area.polygon_m", [0.0, 0.0, 600.5, 0.0, 600.0, 700.0]),
        ("modem: {kind: micromodem, port: tcp://10.9.0.2:7001}", "modem.port", "tcp://10.9.0.2:7001"),
        ("motion: {actions_deg: &some [-5.0, 0.0, 5.0]}\n    safety: {min_battery: 1e-05}", "safety.min_battery", 1e-5),
        ("planner: {iterations: 1_00}", "planner.iterations", 100),
        ("record: {folder: see/Müggelsee}", "record.folder", "see/Müggelsee"),
        ("record: {folder: '0801'}", "record.folder", "0801"),
        ("record: {folder: '1e5'}", "record.folder", "1e5"),
        ("record: {folder: 'y'}", "record.folder", "y"),
        ("record: {folder: '.inf'}", "record.folder", ".inf"),
        ("record: {folder: 'off'}", "record.folder", "off"),
        ("record: {folder: 'Infinity'}", "record.folder", "Infinity"),
        ("record: {topics: ['1e5', b, 'N']}", "record.topics", ["1e5", "b", "N"]),
    ],
)
def test_ros_reads_what_a_mission_file_may_hold(section: str, name: str, value: object, tmp_path: Path) -> None:
    """Its YAML parser refuses much that YAML allows, and every node would die at its start."""
    rclpy = pytest.importorskip("rclpy", reason="needs rclpy (scripts/test sets it up)")
    file = tmp_path / "vehicles.yaml"
    file.write_text(f"/**:\n  ros__parameters:\n    mission: {{vehicles: 3, steps: 10}}\n    {section}\n")
    context = rclpy.context.Context()
    context.init(["--ros-args", "--params-file", str(processes(file).file)])
    node = rclpy.create_node(
        "planner_node", context=context, namespace="/auv2", automatically_declare_parameters_from_overrides=True
    )
    try:
        found = node.get_parameter(name).value
    finally:
        node.destroy_node()
        context.shutdown()
    assert (list(found) if isinstance(value, list) else found) == value


def test_comments_of_the_mission_file_stay_in_the_one_that_is_recorded(tmp_path: Path) -> None:
    file = write(tmp_path)
    bare = processes(file).file.read_text()
    assert "#" not in bare
    file.write_text("# for Monday\n" + file.read_text() + "\n# chlorine: 3\n")
    kept = processes(file).file
    assert read_parameter_file(kept)["/**"] == FOR_ALL
    assert kept.read_text().startswith(bare)
    assert "# # for Monday\n" in kept.read_text()
    assert "# # chlorine: 3\n" in kept.read_text()


def test_file_with_section_sim_follows_the_simulator_and_its_recorder(tmp_path: Path) -> None:
    found = processes(write(tmp_path, sim={"lockstep": True, "tick_s": 1.0}))
    assert (found.simulated, found.lockstep, found.recording) == (True, True, None)
    paced = processes(write(tmp_path, sim={"lockstep": False}))
    assert (paced.simulated, paced.lockstep) == (True, False)


def test_file_without_section_sim_can_follow_the_simulator(tmp_path: Path) -> None:
    found = processes(write(tmp_path), simulated=True)
    assert (found.simulated, found.lockstep) == (True, True)
    whole = read_parameter_file(found.file)["/**"]
    assert whole == {**FOR_ALL, "sim": {"lockstep": True}}, "the nodes' own default is false"


@pytest.mark.parametrize("name", ["auv0", "auv256", "auv", "uav2", "auv-1", ""])
def test_invalid_vehicle_name_is_rejected(name: str) -> None:
    with pytest.raises(ParameterError, match="use a name from auv1 to auv255"):
        vehicle_number(name)
    assert {vehicle_number(typed) for typed in ("auv7", "/auv7", "7", "AUV7", "/7")} == {7}


def test_a_recording_of_a_dive_that_was_ended_is_not_added_to(tmp_path: Path) -> None:
    file, out = write(tmp_path), tmp_path / "dive"
    record, _ = open_dive("auv1", file, out, tmp_path / "dives", False)
    record.begin(out, "auv1-1123-184534-3f2a")
    (out / "bag").mkdir()
    record.end()
    with pytest.raises(ParameterError, match="contains a recording"):
        open_dive("auv1", file, out, tmp_path / "dives", False)
    (out / "auv1.dive").unlink()
    assert "auv1.dive is missing" in open_dive("auv1", file, out, tmp_path / "dives", False)[0].doubt


@pytest.mark.parametrize("name", ["mission", "sim", "modem", "link", "record"])
@pytest.mark.parametrize("value", [5, None, [1]])
def test_unknown_section_is_rejected(name: str, value: object, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=rf"vehicles.yaml: {name} must be a mapping of parameters, not"):
        processes(write(tmp_path, **{name: value}))


def test_a_dive_that_runs_is_not_started_again_in_another_domain(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = write(tmp_path), tmp_path / "dive"
    with own_domain(VEHICLE_DOMAINS) as one, own_domain(VEHICLE_DOMAINS) as other:
        record, _ = open_dive("auv2", file, out, tmp_path / "dives", False)
        with begin_dive(processes(file), str(one), file, out, record):
            kept = (out / "auv2.dive").read_bytes()
            assert main(["auv2", str(file), "--out", str(out), "--domain", str(other)]) == 2
            assert f"the dive of auv2 that runs now, in ROS domain {one} (process " in capsys.readouterr().err
            assert (out / "auv2.dive").read_bytes() == kept


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ({"mission": {**FOR_ALL["mission"], "seed": 5}}, "mission.seed is 5, but 1"),
        ({"mission": {**FOR_ALL["mission"], "vehicles": 2}}, "mission.vehicles is 2, but 3"),
        ({"level_set": {"level_m": 9.0}}, "level_set.level_m is 9.0, but 12.0"),
        ({"sim": {"lockstep": False}}, "sim.lockstep is False, but True"),
        ({"own": {"vehicle": {"speed_mps": 0.7}}}, "vehicle.speed_mps is 0.7, but "),
    ],
)
def test_a_vehicle_of_another_mission_than_the_simulated_one_is_refused(
    other: dict[str, Any], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, level = tmp_path / "run", {"level_set": {"level_m": 12.0}}
    run.mkdir()
    simulated = write(run, **level, sim={"lockstep": True}).rename(run / "mission.yaml")
    with simulation_domain(None, run) as domain:
        same = write(tmp_path, **level, record={"folder": "elsewhere"})
        record, out = open_dive("auv2", same, None, tmp_path / "dives", True)
        with begin_dive(processes(same, simulated=True), str(domain), same, out, record) as (joined, _):
            assert joined == domain, "recorder and world are the simulator's own"
        own = write(tmp_path, **(level | other))
        assert main(["auv2", str(own), "--simulated", "--domain", str(domain), "--out", str(tmp_path / "new")]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert f"start auv2 with {simulated}" in error.lower()


def test_parameters_that_no_vehicle_has_are_listed(tmp_path: Path) -> None:
    file = write(tmp_path)
    text = file.read_text()
    assert ignored_parameters(file) == []
    file.write_text(f"{text}/auv7/**: {{ros__parameters: {{vehicle: {{depth_m: 3.0}}}}}}\n")
    assert ignored_parameters(file) == [
        f"{file}: /auv7/**: there is no vehicle 7, because mission.vehicles is 3. These parameters are ignored"
    ]
    file.write_text(f"{text}/auv2/sounder_node: {{ros__parameters: {{baud: 9600}}}}\n")
    assert ignored_parameters(file) == [], "a driver's own parameters"


@pytest.mark.parametrize("pattern", ["/auv2", "auv2", "/AUV2/**", "/auv02/**", "/auv2/*", "auv_2/**"])
def test_a_vehicles_parameters_that_reach_none_of_its_nodes_are_refused(
    pattern: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = write(tmp_path), tmp_path / "dive"
    file.write_text(f"{file.read_text()}{pattern}: {{ros__parameters: {{vehicle: {{start: on_call}}}}}}\n")
    assert main(["auv2", str(file), "--out", str(out)]) == 2
    assert f"{pattern} matches" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("pattern", "sections", "words"),
    [
        (
            "/auv2/**",
            {"gp": {"length_scale": 20.0}},
            "gp.length_scale: unknown parameter (value 20.0); did you mean 'length_scale_m'?",
        ),
        ("/auv2/**", {"vehicle": {"speed_mps": "fast"}}, "vehicle.speed_mps"),
        ("/auv2/**", {"safety": {"depth_response": "dive"}}, "safety.depth_response"),
        ("/auv2/gp_node", {"gp": {"length_scale": 20.0}}, "gp.length_scale: unknown parameter"),
        ("/**", {"record": {"folders": "bag"}}, "record.folders: unknown parameter"),
        ("/**", {"mission": {"vehicles": 3, "steps": 5000}}, "mission.steps"),
    ],
)
def test_a_parameter_that_a_node_would_refuse_is_refused_before_anything_is_made(
    pattern: str, sections: dict[str, object], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = write(tmp_path), tmp_path / "dive"
    body = yaml.safe_load(file.read_text())
    body.setdefault(pattern, {"ros__parameters": {}})["ros__parameters"] |= sections
    file.write_text(yaml.safe_dump(body))
    assert main(["auv2", str(file), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {file}")
    assert f": {words}" in error
    assert not out.exists()


def test_parameters_of_other_vehicles_and_drivers_are_not_checked(tmp_path: Path) -> None:
    file = write(tmp_path)
    for pattern in ("/auv3/**", "/auv2/sounder_node"):
        file.write_text(f"{file.read_text()}{pattern}: {{ros__parameters: {{gp: {{baud: 9600}}}}}}\n")
    assert len(processes(file).nodes) == 6


def test_a_file_in_place_of_the_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write(tmp_path)
    for out in (file, file / "dive"):
        assert main(["auv2", str(file), "--out", str(out)]) == 2
        assert f"--out {out}: {file} is a file. Choose a new or empty folder" in capsys.readouterr().err


def test_impossible_request_is_reported_and_creates_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out = write(tmp_path), tmp_path / "dive"
    assert main(["auv4", str(file), "--out", str(out)]) == 2
    assert "mission.vehicles is 3, so there is no auv4" in capsys.readouterr().err
    assert main(["auv1", str(tmp_path / "none.yaml"), "--out", str(out)]) == 2
    assert "none.yaml: cannot be read: No such file" in capsys.readouterr().err
    assert main(["auv1", str(write(tmp_path, plannner={})), "--out", str(out)]) == 2
    assert "plannner: unknown section; did you mean 'planner'?" in capsys.readouterr().err
    assert main(["auv1", str(write(tmp_path, mission={"steps": 30})), "--out", str(out)]) == 2
    assert "mission.vehicles is missing; all vehicles must share it. Add" in capsys.readouterr().err
    assert main(["auv1", str(write(tmp_path)), "--simulated", "--domain", "47", "--out", str(out)]) == 2
    assert "ROS domain 47 has no simulator of this machine" in capsys.readouterr().err
    assert not out.exists()
