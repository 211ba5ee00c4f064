"""One running vehicle, started by auv_lse vehicle: topics, nodes and parameters are looked at; a node dies; it ends."""

from __future__ import annotations

import importlib.util
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from auv_lse_run.inspect import nodes, params, topics
from auv_lse_run.inspect import run as mission
from auv_lse_run.inspect.graph_node import Graph, GraphError
from auv_lse_run.process.domain import VEHICLE_DOMAINS, node_environment, own_domain

pytestmark = pytest.mark.ros

ROOT = Path(__file__).resolve().parents[3]

PARAMETERS = """\
/**:
  ros__parameters:
    mission: {vehicles: 2, steps: 20, seed: 7}
    gp: {publish_period_s: 0.2, map_resolution_m: 20.0}
    planner: {iterations: 30}
    vehicle: {start: on_call}
"""

Run = Callable[..., str]


class Vehicle:
    """auv1 under auv_lse vehicle, in a ROS domain of its own."""

    def __init__(self, folder: Path, domain: int) -> None:
        self.folder, self.domain = folder, domain
        (folder / "vehicles.yaml").write_text(PARAMETERS)
        self.process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "auv_lse_run",
                "vehicle",
                "auv1",
                str(folder / "vehicles.yaml"),
                "--out",
                folder / "dive",
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**node_environment(domain), "AUV_LSE_ROOT": str(ROOT)},
        )

    def pids(self) -> dict[str, int]:
        """Process ids of its nodes that run now."""
        found = {}
        for path in Path("/proc").glob("[0-9]*/cmdline"):
            try:
                words = path.read_bytes().decode(errors="replace").split("\0")
            except OSError:
                continue
            # The nodes read their parameters from the keeper's memory.
            own = any(word.startswith(f"/proc/{self.process.pid}/fd/") for word in words)
            if own and "--ros-args" in words:
                found[Path(words[words.index("--ros-args") - 1]).name] = int(path.parent.name)
        return found


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Vehicle]:
    with own_domain(VEHICLE_DOMAINS) as domain:
        running = Vehicle(tmp_path_factory.mktemp("vehicle"), domain)
        try:
            yield running
        finally:
            running.process.terminate()
            running.process.communicate(timeout=20)


@pytest.fixture(scope="module")
def graph(vehicle: Vehicle) -> Iterator[Graph]:
    before = dict(os.environ)
    os.environ.update(node_environment(vehicle.domain))
    try:
        with Graph() as found:
            until = time.monotonic() + 40.0
            last = ("/auv1/risk_map", "/auv1/diagnostics", "/auv1/plan", "/auv1/tdma")  # nodes make them at the end
            while not all(found.endpoints(topic)[0] for topic in last) or len(found.nodes()) < 3:
                assert time.monotonic() < until, found.nodes()
                found.spin(0.1)
            found.spin(0.5)
            yield found
    finally:
        os.environ.clear()
        os.environ.update(before)


@pytest.fixture
def run(graph: Graph, capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*words: str, code: int = 0) -> str:
        tool = {"topics": topics, "nodes": nodes, "params": params, "run": mission}[words[0]]
        options = tool.parser().parse_args(words[1:])
        assert options.call(options, graph) == code
        printed = capsys.readouterr()
        return printed.out if code == 0 else printed.err

    return call


def test_topics_list(run: Run) -> None:
    names = run("topics", "list").splitlines()
    assert {"/auv1/plan", "/auv1/risk_map", "/auv1/modem/tx"} <= set(names)
    assert names == sorted(names)
    assert "/auv1/plan [auv_lse_msgs/msg/Plan]" in run("topics", "list", "-t").splitlines()
    assert int(run("topics", "list", "-c")) == len(names)
    assert " * /auv1/plan [auv_lse_msgs/msg/Plan] 1 publisher\n" in run("topics", "list", "-v")


def test_topics_echo_once_with_and_without_a_field(run: Run) -> None:
    whole = run("topics", "echo", "auv1/risk_map", "--once", "-l", "3")
    message = yaml.safe_load(whole.removesuffix("---\n"))
    assert list(message) == ["header", "info", "data"]
    assert message["data"][3:] == ["..."]
    assert run("topics", "echo", "/auv1/risk_map", "--once", "--field", "info.resolution") == "20.0\n---\n"
    line = run("topics", "echo", "/auv1/risk_map", "--once", "--csv", "--field", "info")
    assert re.fullmatch(r"\d+,\d+,20\.0,\d+,\d+,.*\n", line), "map_load_time, resolution, width, height, ..."


def test_topics_hz_and_bw(run: Run) -> None:
    text = run("topics", "hz", "/auv1/risk_map", "--duration", "2")
    rate = float(
        re.search(r"average rate: ([\d.]+)\n\tmin: [\d.]+s max: [\d.]+s std dev: [\d.]+s window: \d+", text)[1]
    )
    assert 2.0 < rate < 8.0, "every 0.2 s; a loaded machine is late"
    text = run("topics", "bw", "/auv1/risk_map", "--duration", "2", "-w", "20")
    assert text.startswith("Subscribed to [/auv1/risk_map]\n")
    assert re.search(r"B/s from \d+ messages\n\tMessage size mean: [\d.]+ K?B min: ", text)


def test_messages_from_before_a_time_jump_do_not_count_in_a_rate(graph: Graph) -> None:
    """A plan made minutes ago comes at once to a late reader: with the next one it made a rate of its own."""
    other, counted, read = rclpy.create_node("latched", namespace="/auv1"), [], []
    quality = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = other.create_publisher(String, "/kept", quality)
    publisher.publish(String(data="before"))
    try:
        graph.listen("/kept", String, counted.append, raw=True)
        graph.listen("/kept", String, read.append)
        until = time.monotonic() + 20.0
        while not read:
            assert time.monotonic() < until
            graph.spin(0.1)
        publisher.publish(String(data="now"))
        while len(read) < 2 or not counted:
            assert time.monotonic() < until
            graph.spin(0.1)
        assert [message.data for message in read] == ["before", "now"]
        assert len(counted) == 1
    finally:
        other.destroy_node()


def test_topics_info_reports_endpoints_with_incompatible_quality(run: Run) -> None:
    text = run("topics", "info", "/auv1/plan", "-v")
    assert text.startswith("Type: auv_lse_msgs/msg/Plan\n\nPublisher count: 1\n\nNode name: planner_node\n")
    assert "Endpoint type: PUBLISHER\n" in text
    assert "  Reliability: RELIABLE\n  History (Depth): " in text
    assert "  Durability: TRANSIENT_LOCAL\n" in text
    assert "Subscription count: 1\n\nNode name: modem_node\nNode namespace: /auv1\n" in text
    assert "Mismatch" not in text
    other = rclpy.create_node("driver", namespace="/auv1")
    other.create_publisher(String, "/chat", QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
    other.create_subscription(String, "/chat", print, QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE))
    try:
        assert run("topics", "info", "/chat") == (
            "Type: std_msgs/msg/String\nPublisher count: 1\nSubscription count: 1\n"
            "Mismatch: /auv1/driver does not receive /auv1/driver: it requests RELIABLE and is offered BEST_EFFORT "
            "(fix: request BEST_EFFORT)\n"
        )
    finally:
        other.destroy_node()
    assert "topic /auv1/plam: not found; did you mean /auv1/plan?" in run("topics", "info", "/auv1/plam", code=1)


def test_nodes_list_and_info(run: Run) -> None:
    assert run("nodes", "list") == ("/auv1/gp_node\n/auv1/modem_node\n/auv1/planner_node\n/auv1/safety_node\n")
    assert run("nodes", "list", "-c") == "4\n"
    text = run("nodes", "info", "/auv1/planner_node")
    assert text.startswith("/auv1/planner_node\n  Subscribers:\n")
    assert "    /auv1/kernel_centers: auv_lse_msgs/msg/KernelCenters\n" in text
    assert "  Publishers:\n" in text
    assert "    /auv1/plan: auv_lse_msgs/msg/Plan\n" in text
    assert text.endswith("  Service Clients:\n  Action Servers:\n  Action Clients:\n")
    with pytest.raises(GraphError, match=r"node /auv1/plannr_node: not found; did you mean /auv1/planner_node\?"):
        run("nodes", "info", "auv1/plannr_node")


def test_params(run: Run) -> None:
    node = "/auv1/planner_node"
    assert "  planner.iterations\n" in run("params", "list", node)
    assert f"{node}:\n  " in run("params", "list", "--filter", "planner.iter")
    assert "  planner.iterations (type: integer)\n" in run("params", "list", node, "--param-type")
    assert run("params", "get", node, "planner.iterations") == "Integer value is: 30\n"
    assert run("params", "set", node, "planner.iterations", "40") == "Set parameter successful\n"
    assert run("params", "get", node, "planner.iterations", "--hide-type") == "40\n"
    assert run("params", "set", node, "planner.deadline_s", "3") == "Set parameter successful\n", "3 is meant for 3.0"
    assert run("params", "get", node, "planner.deadline_s") == "Double value is: 3.0\n"
    assert "Setting parameter failed: " in run("params", "set", node, "mission.steps", "5", code=1)
    assert "Setting parameter failed: " in run("params", "set", node, "planner.iterations", "0", code=1)
    assert "YAML reads 010 in base 8" in run("params", "set", node, "planner.iterations", "010", code=2)
    dump = yaml.safe_load(run("params", "dump", node))
    assert dump[node]["ros__parameters"]["planner"]["iterations"] == 40
    assert run("params", "describe", node, "mission.steps").startswith(
        "Parameter name: mission.steps\n  Type: integer\n"
    )
    with pytest.raises(GraphError, match=r"parameter planner\.iteratons: .* did you mean planner\.iterations\?"):
        run("params", "get", node, "planner.iteratons")


def test_a_mission_is_started_held_and_aborted(run: Run, graph: Graph) -> None:
    """The vehicle has no odometry, and waits for GO."""
    assert run("run", "state").startswith("auv1: WAITING: waits for GO\n")
    assert run("run", "go", "auv1") == "auv1: WAITING: no position has arrived yet\n"
    assert run("run", "hold", "all", "--spin-time", "0.5").startswith("auv1: HOLDING: HOLD by ")
    assert run("run", "state").startswith("auv1: HOLDING: HOLD by ")
    assert run("run", "abort", "auv1", "--team").startswith("auv1: ABORTED: ABORT by ")
    graph.spin(1.0)  # a slow answer makes a GO count as older than it is
    assert "send RESET first" in run("run", "go", "auv1", code=1)
    assert run("run", "reset", "auv1").startswith("auv1: HOLDING: RESET by ")
    assert "auv7: error: not found; running: auv1" in run("run", "hold", "auv7", "--spin-time", "0.5", code=1)


def test_a_node_that_is_killed_comes_back_and_sigterm_ends_all(vehicle: Vehicle, graph: Graph) -> None:
    before = vehicle.pids()
    assert set(before) == {"gp_node", "planner_node", "modem_node", "safety_node"}
    os.kill(before["gp_node"], signal.SIGKILL)
    until = time.monotonic() + 30.0
    while vehicle.pids().get("gp_node") in (None, before["gp_node"]):
        assert time.monotonic() < until
        time.sleep(0.1)
    said = ""
    giving_up = threading.Timer(30.0, vehicle.process.kill)
    giving_up.start()
    assert vehicle.process.stdout is not None
    for line in vehicle.process.stdout:  # it is said once the new process has answered
        said += line
        if "(start 2)" in line:
            break
    giving_up.cancel()
    vehicle.process.send_signal(signal.SIGTERM)
    rest, _ = vehicle.process.communicate(timeout=20)
    output = said + rest
    assert vehicle.process.returncode == 0, output
    assert "auv1.gp_node died after " in output
    assert "auv1.gp_node restarted (start 2)" in output
    assert output.endswith("auv1: all nodes have ended after SIGTERM\n")
    assert vehicle.pids() == {}
