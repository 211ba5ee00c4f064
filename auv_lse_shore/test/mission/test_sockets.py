"""What can be reached from another computer: the sockets of every process of each entry point, by the kernel's tables.

Each entry point starts in an environment that names no network, as in a user's shell.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

from ament_index_python.packages import get_package_prefix

from auv_lse_common.support.confinement import NETWORK_VARIABLES
from auv_lse_common.vocabulary.vehicle_nodes import vehicle_nodes
from auv_lse_run.process.domain import VEHICLE_DOMAINS, own_domain
from auv_lse_run.process.processes import RECORDER
from benchmarks.faults.sockets import OpenSocket, family_of, open_sockets

pytestmark = pytest.mark.ros

ROOT = Path(__file__).resolve().parents[3]
#: A shell in which no network is named; the wish for this computer alone is a user's, too.
SHELL = {name: value for name, value in os.environ.items() if name not in NETWORK_VARIABLES}
NODES = [("auv_lse_sim", "sim_node"), (RECORDER.package, RECORDER.executable), *vehicle_nodes(modem=True, link=True)]
PARAMETERS = """\
/**:
  ros__parameters:
    mission: {vehicles: 1, steps: 20}
    vehicle: {start: on_call}
    record: {folder: BAG}
    link: {kind: mavlink, endpoint: "udpout://127.0.0.1:9"}
"""


@contextlib.contextmanager
def started(command: list[str], log: Path, environment: dict[str, str]) -> Iterator[subprocess.Popen[bytes]]:
    """A command in a group of its own, ended with the context."""
    with log.open("wb") as output:
        process = subprocess.Popen(
            command, stdout=output, stderr=output, stdin=subprocess.DEVNULL, env=environment, start_new_session=True
        )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(40.0)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def sockets_of(process: subprocess.Popen[bytes], participants: int, log: Path) -> list[OpenSocket]:
    """The sockets of a process and its children, once so many of them take part in ROS."""
    until = time.monotonic() + 60.0
    while True:
        found = open_sockets(family_of(process.pid))
        if len({s.pid for s in found if s.protocol.startswith("udp")}) >= participants:
            return found
        assert process.poll() is None, log.read_text()
        assert time.monotonic() < until, log.read_text()
        time.sleep(0.2)


def beyond(found: list[OpenSocket]) -> list[str]:
    """Those that another computer could reach."""
    return [f"{s.protocol} {s.address}:{s.port}" for s in found if not s.local]


@pytest.fixture
def vehicles_file(tmp_path: Path) -> Path:
    path = tmp_path / "vehicles.yaml"
    path.write_text(PARAMETERS.replace("BAG", str(tmp_path / "bag")))
    return path


def module(name: str, *arguments: str) -> list[str]:
    return [sys.executable, "-m", "auv_lse_run", name, *arguments]


def test_every_executable_started_bare(tmp_path: Path, vehicles_file: Path) -> None:
    """As `ros2 run` starts it: at once, in a shell with and without ROS_LOCALHOST_ONLY."""
    with own_domain(VEHICLE_DOMAINS) as domain, contextlib.ExitStack() as stack:
        running = {}
        for number, (package, executable) in enumerate(NODES):
            path = Path(get_package_prefix(package)) / "lib" / package / executable
            log = tmp_path / f"{executable}.log"
            environment = SHELL | {"ROS_DOMAIN_ID": str(domain)} | ({"ROS_LOCALHOST_ONLY": "1"} if number % 2 else {})
            arguments = ["--ros-args", "-r", "__ns:=/auv1", "--params-file", str(vehicles_file)]
            if executable == "micromodem_node":
                arguments += ["-p", "modem.kind:=micromodem", "-p", "modem.port:=/dev/ttyMISSING"]
            if executable == "sim_node":  # its autopilots have addresses of another kind
                without_link = tmp_path / "simulated.yaml"
                without_link.write_text(vehicles_file.read_text().partition("    link:")[0])
                arguments[-1] = str(without_link)
            running[executable] = stack.enter_context(started([str(path), *arguments], log, environment)), log
        for executable, (process, log) in running.items():
            assert beyond(sockets_of(process, 1, log)) == [], executable


def test_a_vehicle_and_what_watches_it(tmp_path: Path, vehicles_file: Path) -> None:
    with own_domain(VEHICLE_DOMAINS) as domain, contextlib.ExitStack() as stack:
        here = ("--domain", str(domain))
        commands = {
            "vehicle": (6, module("vehicle", "auv1", str(vehicles_file), *here)),
            "live": (
                1,
                module("live", "--no-open", "--mission", str(vehicles_file), "--port", "0", *here),
            ),
            "topics": (1, module("topics", "echo", "/auv1/nothing", "--spin-time", "20", *here)),
        }
        for name, (participants, command) in commands.items():
            log = tmp_path / f"{name}.log"
            command += ["--out", str(tmp_path / "dive")] if name == "vehicle" else []
            process = stack.enter_context(started(command, log, SHELL | {"AUV_LSE_ROOT": str(ROOT)}))
            assert beyond(sockets_of(process, participants, log)) == [], name


@pytest.mark.mission
def test_a_simulated_mission(tmp_path: Path) -> None:
    log = tmp_path / "mission.log"
    small = ("--vehicles", "1", "--steps", "40", "--out", str(tmp_path / "run"), "--no-report")
    command = module("mission", *small, "--live")
    with started(command, log, SHELL | {"AUV_LSE_ROOT": str(ROOT)}) as process:
        assert beyond(sockets_of(process, 4, log)) == [], log.read_text()


needs_launch = pytest.mark.skipif(
    shutil.which("ros2") is None or importlib.util.find_spec("launch_ros") is None,
    reason="needs ros2 launch, which PyPI does not have; the job ros:jazzy of CI runs this",
)


@needs_launch
def test_ros2_launch_starts_a_vehicle(tmp_path: Path, vehicles_file: Path) -> None:
    """The real launch, in the name of the vehicle: its nodes, then the recorder again after it was killed."""
    log, out = tmp_path / "launch.log", tmp_path / "dive"
    words = ("name:=auv1", f"params_file:={vehicles_file}", f"out:={out}")
    with own_domain(VEHICLE_DOMAINS) as domain:
        environment = SHELL | {"ROS_DOMAIN_ID": str(domain)}
        with started(["ros2", "launch", "auv_lse_run", "vehicle.launch.py", *words], log, environment) as process:
            assert beyond(sockets_of(process, 6, log)) == [], log.read_text()
            (recorder,) = re.findall(r"\[recorder_node-\d+\]: process started with pid \[(\d+)\]", log.read_text())
            os.kill(int(recorder), signal.SIGKILL)
            until = time.monotonic() + 30.0
            while not (out / "bag-2").is_dir():
                assert time.monotonic() < until, log.read_text()
                time.sleep(0.2)
            process.send_signal(signal.SIGINT)
            assert process.wait(60.0) == 0, log.read_text()


@needs_launch
def test_ros2_launch_flies_a_mission(tmp_path: Path) -> None:
    log, run = tmp_path / "launch.log", tmp_path / "run"
    words = ("vehicles:=1", "steps:=3", f"out:={run}")
    with started(["ros2", "launch", "auv_lse_sim", "mission.launch.py", *words], log, SHELL) as process:
        assert beyond(sockets_of(process, 6, log)) == [], log.read_text()
        assert process.wait(200.0) == 0, log.read_text()
    assert (run / "report.html").is_file(), log.read_text()
