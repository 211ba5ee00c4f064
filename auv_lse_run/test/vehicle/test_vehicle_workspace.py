"""A workspace with only the packages of a vehicle: every node of a vehicle runs, without simulator and shore."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs the built workspace (scripts/test sets it up)", allow_module_level=True)

from auv_lse_run.process.domain import VEHICLE_DOMAINS, own_domain

pytestmark = pytest.mark.ros

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = tuple(f"auv_lse_{name}" for name in ("msgs", "common", "run", "gp", "planner", "comms", "record"))
PORTS = {"modem.port": "micromodem_node", "link.endpoint": "vehicle_link_node"}
NODES = ("recorder_node", "gp_node", "safety_node", "planner_node", "modem_node", *PORTS.values())
MISSION = {
    "mission": {"vehicles": 1, "steps": 5},
    "area": {"polygon_m": [0.0, 0.0, 300.0, 0.0, 300.0, 300.0, 0.0, 300.0]},
    "tdma": {"send_duration_s": 4.1, "slot_s": 20.0},
    "modem": {"kind": "micromodem", "port": "tcp://127.0.0.1:1"},
    "link": {"kind": "mavlink", "endpoint": "udpin://127.0.0.1:0"},
    "record": {"folder": "bag", "least_free_mb": 1e9},  # no disk has that much room
    "vehicle": {"start": "on_call"},
}


def workspace_of(folder: Path, packages: tuple[str, ...]) -> dict[str, str]:
    """The environment of an install folder with links to these packages in the built workspace alone."""
    found = importlib.util.find_spec("auv_lse_msgs")
    assert found is not None
    assert found.origin is not None
    built_site = Path(found.origin).parents[1]
    built = built_site.parents[2]
    site, index = folder / built_site.relative_to(built), Path("share/ament_index/resource_index")
    site.mkdir(parents=True)
    for pattern in ("lib/*.so", *(f"{position}/{package}" for package in packages for position in ("share", "lib"))):
        for path in built.glob(pattern):
            (folder / path.relative_to(built)).parent.mkdir(parents=True, exist_ok=True)
            (folder / path.relative_to(built)).symlink_to(path)
    for path in (path for package in packages for path in (built / index).glob(f"*/{package}")):
        (folder / path.relative_to(built)).parent.mkdir(parents=True, exist_ok=True)
        (folder / path.relative_to(built)).symlink_to(path)
    paths = [ROOT / package for package in packages[1:]]
    for path in built_site.iterdir():
        if path.name.replace("-", "_").startswith(packages):
            if path.suffix == ".egg-link":
                paths.append(Path(path.read_text().splitlines()[0]))
            else:
                (site / path.name).symlink_to(path)
    prefixes = [p for p in os.environ["AMENT_PREFIX_PATH"].split(":") if Path(p).resolve() != built.resolve()]
    return {
        **os.environ,
        "PYTHONPATH": ":".join(map(str, [*paths, site])),
        "AMENT_PREFIX_PATH": ":".join([str(folder), *prefixes]),
        "LD_LIBRARY_PATH": f"{folder}/lib:{os.environ.get('LD_LIBRARY_PATH', '')}",
        "AUV_LSE_ROOT": str(ROOT),
    }


@pytest.fixture(scope="module")
def vehicle_workspace(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """All packages of a vehicle."""
    return workspace_of(tmp_path_factory.mktemp("install"), (*PACKAGES, "auv_lse_mavlink"))


def run(environment: dict[str, str], *command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *command], env=environment, capture_output=True, text=True, timeout=300, check=False
    )


def mission_file(folder: Path, link: str = "mavlink") -> Path:
    path = folder / "vehicles.yaml"
    sections = {**MISSION, "link": {**MISSION["link"], "kind": link}}
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": sections}}))
    return path


def dive(environment: dict[str, str], mission: Path, nodes: tuple[str, ...]) -> None:
    """Runs a vehicle until its nodes have started and its terminal shows what it waits for, and ends it."""
    expected = [*(f"auv1.{name} started, process " for name in nodes), "auv1: WAITING: waits for GO\n"]
    expected += ["recorder: record.folder has 0 MB of free space", "recorder: the recording has ended; the mission con"]
    expected += [f"auv1: waiting for a device on {port} " for port, node in PORTS.items() if node in nodes]
    output = mission.with_name("out.txt")
    with own_domain(VEHICLE_DOMAINS) as domain, output.open("w") as file:
        command = ("vehicle", "auv1", str(mission), "--domain", str(domain))
        process = subprocess.Popen(
            [sys.executable, "-m", "auv_lse_run", *command, "--out", str(mission.parent / "dive")],
            env=environment, stdout=file, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            until = time.monotonic() + 120.0
            while not all(text in output.read_text() for text in expected):
                assert process.poll() is None, output.read_text()
                assert time.monotonic() < until, output.read_text()
                time.sleep(0.2)
            process.send_signal(signal.SIGTERM)
            assert process.wait(60.0) == 0
        finally:
            process.kill()
    text = output.read_text()
    assert "died" not in text
    assert "auv1: all nodes have ended" in text
    assert (mission.parent / "dive" / "bag").is_dir()


def test_every_node_of_a_vehicle_runs(vehicle_workspace: dict[str, str], tmp_path: Path) -> None:
    dive(vehicle_workspace, mission_file(tmp_path), NODES)


def test_a_vehicle_with_a_driver_of_its_own_needs_no_mavlink(tmp_path: Path) -> None:
    without = workspace_of(tmp_path / "install", PACKAGES)
    dive(without, mission_file(tmp_path, "direct"), NODES[:-1])
    refused = run(without, "-m", "auv_lse_run", "vehicle", "auv1", str(mission_file(tmp_path)))
    assert refused.returncode != 0
    assert "vehicle_link_node needs the package auv_lse_mavlink, which is not installed" in refused.stderr
    refused = run(without, "-m", "auv_lse_run", "autopilot-check", "udpin://127.0.0.1:0")
    assert refused.returncode == 2
    assert refused.stderr.startswith("error: auv_lse autopilot-check needs the package auv_lse_mavlink, which is not ")


def test_the_launch_file_finds_every_node(vehicle_workspace: dict[str, str], tmp_path: Path) -> None:
    code = f"""
import sys, runpy
from unittest.mock import MagicMock
sys.modules |= {{n: MagicMock() for n in ("launch", "launch.actions", "launch.substitutions", "launch_ros.actions")}}
given = {{"name": "auv1", "params_file": {str(mission_file(tmp_path))!r}, "out": {str(tmp_path / "dive")!r}}}
given |= {{"record": "", "simulated": "false"}}
sys.modules["launch.substitutions"].LaunchConfiguration = lambda name: MagicMock(perform=lambda context: given[name])
runpy.run_path({str(ROOT / "auv_lse_run" / "launch" / "vehicle.launch.py")!r})["_nodes"](None)
print([call.kwargs["executable"] for call in sys.modules["launch_ros.actions"].Node.call_args_list])
"""
    with own_domain(VEHICLE_DOMAINS) as domain:
        done = run({**vehicle_workspace, "ROS_DOMAIN_ID": str(domain)}, "-c", code)
    assert sorted(yaml.safe_load(done.stdout)) == sorted(NODES), done.stderr


def test_loops_are_compiled_and_commands_name_missing_packages(vehicle_workspace: dict[str, str]) -> None:
    for package in ("auv_lse_sim", "auv_lse_shore"):
        assert "Error" in run(vehicle_workspace, "-c", f"from {package} import engine, mission").stderr
    warmed = run(vehicle_workspace, "-m", "auv_lse_run.vehicle.warm_up")
    assert warmed.returncode == 0, warmed.stderr
    refused = run(vehicle_workspace, "-m", "auv_lse_run", "mission", "--steps", "3")
    assert refused.returncode == 2
    assert refused.stderr.startswith("error: auv_lse mission needs the package auv_lse_shore, which is not installed: ")
