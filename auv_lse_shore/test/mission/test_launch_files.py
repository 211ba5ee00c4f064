"""The launch files, against stand-ins for launch and launch_ros, which no wheel brings: what they declare and start."""

from __future__ import annotations

import contextlib
import importlib.util
import sys
import types
from pathlib import Path
from typing import Any

import pytest
import yaml

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.confinement import is_confined
from auv_lse_run.process import domain
from auv_lse_run.process.domain import SIMULATOR_DOMAINS, DomainError, busy_domains

ROOT = Path(__file__).resolve().parents[3]


class Action:
    """Whatever a launch file makes: it keeps what it was made with."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.args, self.kwargs = args, kwargs


class LaunchConfiguration(Action):
    def perform(self, context: dict[str, str]) -> str:
        return context[self.args[0]]


@pytest.fixture
def launch(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    locks = tmp_path / "locks"
    locks.mkdir()
    monkeypatch.setattr(domain.tempfile, "gettempdir", lambda: str(locks))
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    names = {
        "launch": ["LaunchDescription"],
        "launch.actions": ["DeclareLaunchArgument", "EmitEvent", "ExecuteProcess", "LogInfo", "OpaqueFunction"],
        "launch.events": ["Shutdown"],
        "launch.substitutions": [],
        "launch_ros": [],
        "launch_ros.actions": ["Node"],
        "ament_index_python": [],
        "ament_index_python.packages": [],
    }
    for module, classes in names.items():
        made: Any = types.ModuleType(module)
        for name in classes:
            setattr(made, name, type(name, (Action,), {}))
        monkeypatch.setitem(sys.modules, module, made)
    sys.modules["launch.substitutions"].LaunchConfiguration = LaunchConfiguration  # type: ignore[attr-defined]
    share = lambda package: str(ROOT / package)
    sys.modules["ament_index_python.packages"].get_package_share_directory = share  # type: ignore[attr-defined]

    def load(path: str, **given: str) -> tuple[dict[str, str], Any]:
        """The arguments' defaults, and a function that gives the nodes."""
        spec = importlib.util.spec_from_file_location("a_launch_file", ROOT / path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        reserved.push(module._RESERVED)
        *declared, start = module.generate_launch_description().args[0]
        assert all(action.kwargs["description"] for action in declared), "--show-args has something to say"
        arguments = {action.args[0]: action.kwargs["default_value"] for action in declared}
        return arguments, lambda: start.kwargs["function"]({**arguments, **given})

    with contextlib.ExitStack() as reserved:
        yield load


VEHICLE_NODES = ("safety_node", "gp_node", "planner_node", "modem_node")


def names(nodes: list[Action]) -> list[str]:
    return [f"{n.kwargs.get('namespace', '/').rstrip('/')}/{n.kwargs['executable']}" for n in nodes]


def test_a_mission(launch: Any, tmp_path: Path) -> None:
    out = tmp_path / "run"
    given = {"vehicles": "2", "steps": "7", "seed": "3", "real_time_factor": "5", "out": str(out)}
    arguments, start = launch("auv_lse_sim/launch/mission.launch.py", **given)
    assert Path(arguments["params_file"]).is_file()
    *nodes, report = start()
    of_vehicles = [f"/auv{k}/{name}" for k in (1, 2) for name in VEHICLE_NODES]
    assert names(nodes) == ["/recorder_node", *of_vehicles, "/sim_node"]
    settings = Settings.load(out / "mission.yaml")
    assert (settings.mission.vehicles, settings.mission.steps, settings.mission.seed) == (2, 7, 3)
    assert (settings.sim.real_time_factor, settings.sim.lockstep) == (5.0, False)
    assert settings.record.folder == str(out / "bag")
    assert [n.kwargs["parameters"][1]["use_sim_time"] for n in nodes] == [*[True] * 9, False]
    assert nodes[0].kwargs["sigterm_timeout"] == "30.0", "a recorder has the time to close its file"
    variables = nodes[0].kwargs["additional_env"]
    assert int(variables["ROS_DOMAIN_ID"]) in busy_domains()
    assert int(variables["ROS_DOMAIN_ID"]) in SIMULATOR_DOMAINS, "a free one: the shell has none"
    assert variables["AUV_LSE_DIVE"].startswith("sim-")
    assert is_confined(variables)
    assert all(action.kwargs["additional_env"] == variables for action in (*nodes, report))
    assert report.kwargs["cmd"][1:] == ["-m", "auv_lse_shore.mission.launched", str(out)]
    assert all(action.kwargs["on_exit"] for action in (*nodes, report)), "the launch ends with any of them"
    assert float(report.kwargs["sigterm_timeout"]) > 600, "SIGINT starts the report, which takes a while"
    with pytest.raises(ValueError, match="is not empty, and was left as it is"):
        start()


def test_a_mission_with_emulated_modems_has_ranges(launch: Any, tmp_path: Path) -> None:
    out = tmp_path / "run"
    _, start = launch("auv_lse_sim/launch/mission.launch.py", modem="emulated", out=str(out))
    assert "/auv1/micromodem_node" in names(start()[:-1])
    assert Settings.load(out / "mission.yaml").vehicle(1).modem.synchronous, "as with auv_lse mission"


def test_a_mission_without_a_recorder(launch: Any, tmp_path: Path) -> None:
    _, start = launch("auv_lse_sim/launch/mission.launch.py", record="false", out=str(tmp_path / "run"))
    assert "/recorder_node" not in names(start()[:-1])
    assert Settings.load(tmp_path / "run" / "mission.yaml").record.folder == ""
    _, start = launch("auv_lse_sim/launch/mission.launch.py", record="maybe", out=str(tmp_path / "other"))
    with pytest.raises(ValueError, match="record must be true or false, not maybe"):
        start()


def test_a_vehicle(launch: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "vehicles.yaml"
    modem, record = {"kind": "micromodem", "port": "/dev/ttyS0"}, {"folder": "bag"}
    mission = {"vehicles": 2, "steps": 100}
    file.write_text(
        yaml.safe_dump({"/**": {"ros__parameters": {"mission": mission, "modem": modem, "record": record}}})
    )
    path = "auv_lse_run/launch/vehicle.launch.py"
    monkeypatch.setenv("ROS_DOMAIN_ID", "82")
    _, start = launch(path, name="auv2", params_file=str(file), out=str(tmp_path / "dive"))
    nodes = start()
    of_vehicle = [f"/auv2/{name}" for name in (*VEHICLE_NODES, "micromodem_node")]
    assert names(nodes) == ["/recorder_node", *of_vehicle]
    assert nodes[0].kwargs["parameters"][1] == {"record.folder": str(tmp_path / "dive" / "bag")}
    assert nodes[0].kwargs["sigterm_timeout"] == "30.0", "a recorder has the time to close its file"
    assert all(node.kwargs["respawn"] for node in nodes), "also the recorder, which finds a new folder"
    assert is_confined(variables := nodes[0].kwargs["additional_env"])
    assert variables["ROS_DOMAIN_ID"] == "82"
    assert variables["AUV_LSE_DIVE"].startswith("auv2-")
    assert nodes[1].kwargs["additional_env"] == variables
    _, start = launch(path, name="auv2", params_file=str(file), out=str(tmp_path / "other"))
    with pytest.raises(DomainError, match="ROS domain 82 already has the nodes of auv2"):
        start()
    monkeypatch.setenv("ROS_DOMAIN_ID", "12")
    with pytest.raises(DomainError, match=r"ROS domain 12 is for simulations.*; a vehicle uses 81 to 101 or 0"):
        start()
    _, start = launch(path)
    with pytest.raises(ValueError, match=r"expected name:=auv2 params_file:=vehicles\.yaml"):
        start()
