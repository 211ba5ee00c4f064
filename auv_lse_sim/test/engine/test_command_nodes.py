"""Commands to a safety_node that was stopped for a while, and of two operators at once, over real rclpy."""

from __future__ import annotations

import importlib.util
import os
import signal
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data
from ros_bench import Bench, bench
from spinning import spun

from auv_lse_common.node.journal import FOLDER_VARIABLE
from auv_lse_common.node.state_file import START_VARIABLE, begin_state
from auv_lse_common.topics.quality import LATCHED
from auv_lse_common.topics.records import RunReport
from auv_lse_common.topics.ros_conversions import header
from auv_lse_common.vocabulary.mission_run import VALID_S, Command, RunState, RunStatus
from auv_lse_msgs.msg import MissionCommand, MissionState
from auv_lse_msgs.srv import RunMission
from auv_lse_planner import planner_node
from auv_lse_run.inspect.mission_calls_node import CommandCalls
from auv_lse_run.remote.mission_link import MissionLink
from auv_lse_run.remote.orders import ACTED, REFUSED, Order

pytestmark = pytest.mark.ros

PARAMETERS = """\
/**:
  ros__parameters:
    mission: {vehicles: 1, steps: 20, seed: 7}
    area: {polygon_m: [-50.0, -50.0, 350.0, -50.0, 350.0, 350.0, -50.0, 350.0]}
    safety: {patience_s: 1.0}
    vehicle: {start: on_call}
"""


class Operators:
    """A vehicle's safety_node, and those who command it."""

    def __init__(self, b: Bench) -> None:
        self.b = b
        b.start("auv_lse_planner", "safety_node", PARAMETERS)
        self.states = b.collect(MissionState, "/auv1/mission/state", LATCHED)
        self.topic = b.publisher(MissionCommand, "/auv1/mission/command")
        self.odometry = b.publisher(Odometry, "/auv1/odometry", qos_profile_sensor_data)
        self.client = b.node.create_client(RunMission, "/auv1/mission/run")
        b.until(self.client.service_is_ready, "the service")
        b.until(lambda: self.move() and self.states, "a state")

    def move(self, north_m: float = 0.0) -> bool:
        message = Odometry(header=header(time.time()))
        message.pose.pose.position.y = north_m
        message.pose.pose.orientation.w = 1.0
        self.odometry.publish(message)
        return True

    def until_state(self, state: int) -> None:
        self.b.until(lambda: self.move() and self.states[-1].state == state, f"state {state}")

    def call(self, command: int, **fields: Any) -> Any:
        """Calls as `ros2 service call` does; returns the future."""
        request = RunMission.Request(command=MissionCommand(command=command, source="by hand"), **fields)
        return self.client.call_async(request)

    def answer(self, command: int, **fields: Any) -> Any:
        future = self.call(command, **fields)
        self.b.until(future.done, "an answer")
        return future.result()


def test_a_stopped_node_that_continues_obeys_no_go_that_it_was_sent_meanwhile(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        operators = Operators(b)
        (process,) = b.keepers[-1].running.values()
        os.kill(process, signal.SIGSTOP)
        operators.call(MissionCommand.GO)
        operators.topic.publish(MissionCommand(command=MissionCommand.GO, source="topic"))
        answers: dict[str, Any] = {}
        graph: Any = SimpleNamespace(node=b.node)
        calls = CommandCalls(graph, ["auv1"], Command.GO, False, answers.setdefault)
        end_s = time.monotonic() + 5.0
        while time.monotonic() < end_s:
            calls.step()
            b.spin(0.05)
        assert (answers, calls.unsent) == ({}, ["auv1"])
        calls.close()
        b.spin(VALID_S - 4.0)
        os.kill(process, signal.SIGCONT)
        operators.states.clear()
        b.until(lambda: operators.move() and len(operators.states) > 3, "the state every second")
        assert {s.state for s in operators.states} == {MissionState.WAITING}
        answer = operators.answer(MissionCommand.GO)
        assert answer.accepted, f"GO that is given now acts; {answer.message}"
        operators.until_state(MissionState.RUNNING)


def test_a_stopped_node_that_continues_obeys_hold(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        operators = Operators(b)
        assert operators.answer(MissionCommand.GO).accepted
        operators.until_state(MissionState.RUNNING)
        (process,) = b.keepers[-1].running.values()
        os.kill(process, signal.SIGSTOP)
        operators.call(MissionCommand.HOLD)
        b.spin(VALID_S + 1.0)
        os.kill(process, signal.SIGCONT)
        operators.until_state(MissionState.HOLDING)


def test_go_that_arrives_again_after_the_hold_of_another_operator_is_refused(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        operators = Operators(b)
        asked = operators.answer(MissionCommand.GO, ask=True)
        assert (asked.accepted, asked.state) == (True, MissionState.WAITING), "nothing is done"
        given_s = asked.clock_s
        assert operators.answer(MissionCommand.GO, given_s=given_s).accepted
        assert operators.answer(MissionCommand.GO, given_s=given_s).accepted, "its answer was lost"
        assert operators.answer(MissionCommand.HOLD).accepted
        again = operators.answer(MissionCommand.GO, given_s=given_s)
        assert (again.accepted, again.state) == (False, MissionState.HOLDING)
        assert again.message.startswith("GO: HOLD was given after it (HOLDING: HOLD by by hand)")
        assert operators.answer(MissionCommand.GO).accepted, "by hand, now"


def test_reset_from_before_a_limit_tripped_does_not_undo_it(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        operators = Operators(b)
        assert operators.answer(MissionCommand.GO).accepted
        operators.until_state(MissionState.RUNNING)
        given_s = operators.answer(MissionCommand.RESET, ask=True).clock_s
        b.until(lambda: operators.move(600.0) and operators.states[-1].limits, "a tripped limit")
        b.until(lambda: operators.move() and not operators.states[-1].warnings, "the vehicle inside the fence")
        late = operators.answer(MissionCommand.RESET, given_s=given_s)
        assert not late.accepted
        assert late.message.startswith("RESET: a limit has tripped since it was given (250 m outside the area")
        assert operators.answer(MissionCommand.RESET).accepted, "by hand, now"


def test_a_go_of_the_fleet_that_arrives_late_is_as_old_as_its_operator_gave_it(tmp_path: Path) -> None:
    with bench(tmp_path) as b:
        operators, link = Operators(b), MissionLink("auv1", 1)
        graph: Any = SimpleNamespace(node=b.node, spin=b.spin, discover=lambda s, done: b.until(done, "an answer"))
        link._graph = graph
        asked_s = operators.answer(MissionCommand.GO, ask=True).clock_s

        def go(given_s: float) -> tuple[str, str]:
            return link.give(Order("a", 1, "go", given_s=given_s, valid_s=600.0))

        outcome, text = go(asked_s - 60.0)
        assert outcome == REFUSED
        assert "nodes have started since" in text
        assert operators.answer(MissionCommand.HOLD).accepted
        outcome, text = go(asked_s)
        assert outcome == REFUSED
        assert "HOLD was given after it" in text
        b.spin(0.5)
        assert go(time.monotonic())[0] == ACTED


def test_a_planner_whose_safety_node_is_silent_counts_no_steps_until_its_state_arrives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The link surfaces the vehicle: legs would time out one after another."""
    monkeypatch.setattr(planner_node, "LONGEST_SILENCE_S", 1.0)
    parameters = "\n".join(line.strip() for line in PARAMETERS.splitlines()[2:])
    runs = RunReport(stamp_s=1.0, revision=1, status=RunStatus(state=RunState.RUNNING, stop=None))
    with spun(planner_node.PlannerNode, tmp_path / "p.yaml", parameters, "/auv1") as s:
        planner = s.node._planner
        for _ in range(2):
            s.node._on_state(runs)
            s.until(lambda: not planner._blocked_reason, each=lambda: s.node._on_state(runs))
            s.until(lambda: "safety_node has been silent" in planner._blocked_reason)


def test_go_is_refused_in_a_dive_whose_planner_has_lost_its_state(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The vehicle would be RUNNING, and never move."""
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "journal"))
    monkeypatch.setenv(START_VARIABLE, "a")
    for node, lost in (("safety_node", ""), ("planner_node", "its disk was swapped")):
        begin_state(tmp_path / "journal" / f"auv1.{node}.state", "", lost=lost)
    with bench(tmp_path) as b:
        operators = Operators(b)
        answer = operators.answer(MissionCommand.GO)
        assert (answer.accepted, answer.state) == (False, MissionState.WAITING)
        assert answer.message.startswith(
            "GO: planner_node plans no legs (its disk was swapped). End the dive with Ctrl-C"
        )
