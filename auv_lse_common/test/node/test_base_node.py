"""What every node shares, on a real node: parameters that change while it runs, how it ends, lockstep alone."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import ClockType
from rclpy.parameter import Parameter

from auv_lse_common.mission_file.parameters import parameter, section
from auv_lse_common.node import base_node, vehicle_node
from auv_lse_common.node.base_node import BaseNode
from auv_lse_common.node.entry_point import Main, Stopping
from auv_lse_common.node.vehicle_node import VehicleNode
from auv_lse_msgs.msg import Bound, LockstepTick

pytestmark = pytest.mark.ros

TUNABLE = ("planner.iterations", "planner.naive_paths", "planner.deadline_s")


@dataclass(frozen=True, slots=True, kw_only=True)
class Config:
    iterations: int | None = parameter(None, low=1, help="left out: the method's")
    naive_paths: tuple[int, ...] = parameter((), high=0xFE, help="empty: all")
    deadline_s: float = parameter(2.0, unit="s", help="has a value")
    spacing_m: float | None = parameter(None, unit="m", help="not tunable")


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Callable[[str], BaseNode]]:
    """Makes a node that gets the parameters given as YAML."""
    nodes = []

    def make(parameters: str) -> BaseNode:
        path = tmp_path / "p.yaml"
        path.write_text(f"/**:\n  ros__parameters:\n    {parameters}\n")
        rclpy.init(args=["--ros-args", "--params-file", str(path)])
        nodes.append(BaseNode("node_under_test"))
        return nodes[0]

    yield make
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def signals() -> Iterator[None]:
    """Puts back what an entry point does to signals."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    signal.set_wakeup_fd(-1)
    for number, handler in before.items():
        signal.signal(number, handler)


def change(node: BaseNode, name: str, value: object) -> Any:
    return node.set_parameters([Parameter(name, value=value)])[0]


def test_tunable_parameter_without_a_value_can_be_set(make: Callable[[str], BaseNode]) -> None:
    node = make("planner: {deadline_s: 1.5}")
    now = section(Config, node.parameters, "planner", "test")

    def apply(parameters: dict[str, Any]) -> None:
        nonlocal now
        now = section(Config, parameters, "planner", "test")

    node.show_parameters({"planner": now}, TUNABLE, apply)
    assert node.get_parameter("planner.iterations").value is None
    assert change(node, "planner.iterations", 4000).successful
    assert change(node, "planner.naive_paths", [0xF4, 0xF5]).successful
    assert now == Config(iterations=4000, naive_paths=(0xF4, 0xF5), deadline_s=1.5)
    assert node.get_parameter("planner.iterations").value == 4000
    for value, reason in ((0, "not 0"), ("many", "not 'many'"), (2.5, "not 2.5"), (None, "cannot be unset")):
        result = change(node, "planner.iterations", value)
        assert not result.successful
        assert reason in result.reason
    assert now.iterations == 4000
    assert change(node, "planner.iterations", 50).successful, "the refusals left it as it was"


def test_list_parameter_can_be_written_to_a_journal(make: Callable[[str], BaseNode]) -> None:
    node, noted = make("planner: {deadline_s: 1.5}"), []
    node.note_tuned = noted.append  # type: ignore[method-assign]
    node.show_parameters({"planner": section(Config, node.parameters, "planner", "test")}, TUNABLE, lambda _: None)
    message = Parameter("planner.naive_paths", value=[0xF4, 0xF5]).to_parameter_msg()
    assert node.set_parameters([Parameter.from_parameter_msg(message)])[0].successful  # as `ros2 param set` does
    assert json.loads(json.dumps(noted)) == [{"planner.naive_paths": [0xF4, 0xF5]}]


def test_every_parameter_has_a_description(make: Callable[[str], BaseNode]) -> None:
    node = make("planner: {deadline_s: 1.5}")
    node.show_parameters({"planner": section(Config, node.parameters, "planner", "test")}, TUNABLE, lambda _: None)
    for name in ("planner.iterations", "planner.deadline_s"):  # not set; from the file
        described = node.describe_parameter(name)
        assert described.description, name
        assert described.read_only == (name not in TUNABLE), name
    assert node.describe_parameter("planner.iterations").additional_constraints == "at least 1"
    assert node.describe_parameter("planner.deadline_s").description.endswith("[s]")


def test_change_rejected_with_a_value_error_does_not_end_the_node(make: Callable[[str], BaseNode]) -> None:
    def refuse(parameters: dict[str, Any]) -> None:
        raise ValueError("tdma order (9,): [9] are not among the vehicles")

    node = make("planner: {deadline_s: 1.5}")
    node.show_parameters({"planner": section(Config, node.parameters, "planner", "test")}, TUNABLE, refuse)
    result = change(node, "planner.deadline_s", 3.0)
    assert not result.successful
    assert "not among the vehicles" in result.reason
    assert node.get_parameter("planner.deadline_s").value == 1.5


def test_node_with_invalid_parameters_ends_with_a_message(signals: None, capfd: pytest.CaptureFixture[str]) -> None:
    def make() -> BaseNode:
        raise ValueError("vehicle is 4; mission.vehicles is 3")

    assert Main(make)(arguments=[]) == 2
    assert capfd.readouterr().err == "error: vehicle is 4; mission.vehicles is 3\n"


class Closing(BaseNode):
    """Notes that it was closed; `at` says when it is interrupted."""

    closed: ClassVar[list[str]] = []

    def __init__(self, at: str, number: signal.Signals) -> None:
        super().__init__("node_under_test")
        self.at = at
        if at == "made":
            os.kill(os.getpid(), number)
            time.sleep(0.05)  # the signal is handled in here
        if at == "callback":
            self.create_timer(
                0.01, lambda: (os.kill(os.getpid(), number), time.sleep(0.05), self.closed.append("whole"))
            )
        if at == "waiting":
            threading.Timer(0.3, os.kill, (os.getpid(), number)).start()

    def destroy_node(self) -> None:
        self.closed.append("closed")
        super().destroy_node()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("at", ["made", "callback", "waiting"])
def test_stopped_node_completes_its_callback_and_is_closed(signals: None, at: str, number: signal.Signals) -> None:
    Closing.closed.clear()
    began = time.monotonic()
    assert Main(lambda: Closing(at, number))(arguments=[]) == 0
    assert Closing.closed == (["whole", "closed"] if at == "callback" else ["closed"])
    assert time.monotonic() - began < 10.0, "it does not wait for something to happen"


def test_under_nohup_a_closed_terminal_stops_no_node(signals: None) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    stopping = Stopping()
    signal.raise_signal(signal.SIGHUP)
    assert not stopping.requested
    signal.raise_signal(signal.SIGTERM)
    assert stopping.requested


def test_timers_continue_when_the_system_clock_is_set_back(make: Callable[[str], BaseNode]) -> None:
    timer = make("sim: {lockstep: false}").create_timer(0.1, lambda: None)
    assert timer.clock.clock_type is ClockType.STEADY_TIME


@pytest.mark.parametrize("lockstep", [True, False])
def test_missing_simulator_in_lockstep_is_logged_once(
    make: Callable[[str], BaseNode],
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    lockstep: bool,
) -> None:
    monkeypatch.setattr(base_node, "_NO_SIMULATOR_S", 0.1)
    monkeypatch.setattr(base_node, "_LOOK_S", 0.02)
    node = make(f"sim: {{lockstep: {str(lockstep).lower()}}}")
    for _ in range(20):  # the timer comes due every 0.02 s
        rclpy.spin_once(node, timeout_sec=0.05)
    assert capfd.readouterr().err.count("sim.lockstep is true") == int(lockstep)


def test_simulator_that_has_ended_is_not_missing(
    make: Callable[[str], BaseNode], capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(base_node, "_NO_SIMULATOR_S", 60.0)
    monkeypatch.setattr(base_node, "_LOOK_S", 0.02)
    node = make("sim: {lockstep: true}")
    ticks = node.create_publisher(LockstepTick, "/lockstep/tick", 1)
    for _ in range(20):
        rclpy.spin_once(node, timeout_sec=0.05)
    node.destroy_publisher(ticks)
    monkeypatch.setattr(base_node, "_NO_SIMULATOR_S", 0.1)
    for _ in range(20):
        rclpy.spin_once(node, timeout_sec=0.05)
    assert "sim.lockstep is true" not in capfd.readouterr().err


@pytest.mark.parametrize("recorder_comes", [True, False])
def test_recorded_node_waits_for_the_recorder_with_a_timeout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, recorder_comes: bool
) -> None:
    monkeypatch.setattr(vehicle_node, "_RECORDER_WAIT_S", 60.0 if recorder_comes else 0.5)
    path = tmp_path / "p.yaml"
    path.write_text(f"/**:\n  ros__parameters:\n    record: {{folder: {tmp_path}}}\n")
    rclpy.init(args=["--ros-args", "--params-file", str(path), "-r", "__ns:=/auv1"])
    node = VehicleNode("planner_node")
    recorder = rclpy.create_node("recorder_node", use_global_arguments=False)
    heard: list[int] = []
    try:
        bound = node.publisher("planner/bound")
        told = 0

        def tell(now_s: float) -> None:
            nonlocal told
            bound.publish_message(Bound(step=told))
            told += 1

        node.phase("planner", tell)
        node.begin()

        def spin(until: Callable[[], bool], within_s: float) -> bool:
            end = time.monotonic() + within_s
            while not until() and time.monotonic() < end:
                rclpy.spin_once(node, timeout_sec=0.02)
                rclpy.spin_once(recorder, timeout_sec=0.0)
            return until()

        if recorder_comes:
            spin(lambda: False, 0.5)
            recorder.create_subscription(Bound, "/auv1/planner/bound", lambda m: heard.append(m.step), 10)
            recorder.create_subscription(DiagnosticArray, "/auv1/diagnostics", lambda m: None, 10)
            assert spin(lambda: bool(heard), 10.0)
            assert heard[0] == 0, "the first is heard"
        else:
            assert spin(lambda: told > 0, 10.0), "it goes on without a recorder"
    finally:
        recorder.destroy_node()
        node.destroy_node()
        rclpy.try_shutdown()


def test_node_returns_freed_memory_at_most_once_a_second(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock_s, returned_s = [100.0], []
    monkeypatch.setattr(vehicle_node, "return_free_memory", lambda: returned_s.append(clock_s[0]))
    rclpy.init(args=["--ros-args", "-r", "__ns:=/auv1"])
    node = VehicleNode("planner_node")
    try:
        with monkeypatch.context() as patch:
            patch.setattr(vehicle_node.time, "monotonic", lambda: clock_s[0])
            for clock_s[0] in (100.0, 100.5, 100.9, 101.1, 102.0, 102.2):
                node._handle_all()
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    assert returned_s == [100.0, 101.1, 102.2]


def test_recorded_node_waits_only_for_readers_of_recorded_topics(
    tmp_path: Path,
) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(f"/**:\n  ros__parameters:\n    record: {{folder: {tmp_path}}}\n    modem: {{kind: micromodem}}\n")
    rclpy.init(args=["--ros-args", "--params-file", str(path), "-r", "__ns:=/auv1"])
    node = VehicleNode("micromodem_node")
    try:
        node.publisher("modem/failed")  # modem_node reads it, which is away; the recorder does not
        assert {publisher.topic_name for publisher in node._only_recorded} == {"/auv1/diagnostics"}
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
