"""safety_node: manages one vehicle's mission. It takes commands, monitors the limits and publishes the action."""

from __future__ import annotations

import auv_lse_common.node.executable  # noqa: F401  # first: prepares the process

# isort: split

import os
import time
from typing import Any

from auv_lse_common.mission_file.parameters import section
from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.node.dive import WAIT_VARIABLE
from auv_lse_common.node.entry_point import Main
from auv_lse_common.node.periodic import Periodic
from auv_lse_common.node.state_file import DOUBT_VARIABLE
from auv_lse_common.node.vehicle_node import VehicleNode
from auv_lse_common.topics.codecs import decode_order
from auv_lse_common.topics.records import MissionOrder, Odometry, RunReport
from auv_lse_common.vocabulary.health import NewProblems
from auv_lse_common.vocabulary.mission_run import VALID_S, Command, Given
from auv_lse_msgs.srv import RunMission
from auv_lse_planner.safety import Safety

_DIAGNOSTICS_PERIOD_S = 10.0
#: Without lockstep the state is republished after this time (s), for readers that missed it or started late.
_HEARTBEAT_S = 1.0
#: Time (s) for which the watch waits for a slow disk. The state is in memory by then, for a restarted node.
_DISK_WAIT_S = 0.2
#: Period (s) at which the node notes that it takes commands; after a pause, time (s) for delayed commands to arrive.
_LISTENING_PERIOD_S, _BACKLOG_S = 0.5, 3.0


class SafetyNode(VehicleNode):
    """safety_node: start, hold, abort and the safety watch of one vehicle. Namespace: the vehicle's (/auv1)."""

    def __init__(self) -> None:
        super().__init__("safety_node")
        self._safety = Safety.of(self.parameters, self.where, self.vehicle, waits=bool(os.environ.get(WAIT_VARIABLE)))
        doubt = os.environ.get(DOUBT_VARIABLE, "")
        self._safety.run.note_start(time.monotonic())
        self._safety.recover(self.state.values, self.state.lost, self.state.rebooted, doubt)
        self._save_state()
        self.show_parameters(
            {
                "safety": section(SafetyConfig, self.parameters, "safety", self.where),
                "vehicle": section(VehicleConfig, self.parameters, "vehicle", self.where),
            }
        )
        self._published = 0
        self._reported: tuple[object, ...] = ()
        self._report: RunReport | None = None  # last published
        self._heartbeats = Periodic(_HEARTBEAT_S)
        self._health_reports = Periodic(_DIAGNOSTICS_PERIOD_S)
        self._new_problems, self._new_to_operator = NewProblems(), NewProblems()
        self._listened_s = time.monotonic()  # when it last noted that it takes commands
        self._pause: tuple[float, float] | None = None  # last pause in which it took none: from, to
        self.create_timer(_LISTENING_PERIOD_S, self._note_listening)
        self._state = self.publisher("mission/state")
        self.listen("odometry", self._on_odometry)
        self.listen("altitude", lambda altitude: self._safety.watch.altitude(altitude.altitude_m))
        self.listen("autopilot", self._safety.watch.autopilot)
        self.listen("mission/command", self._on_command)
        self.listen("mission/end", self._on_command)
        self.listen("team/command", self._on_command)
        self.create_service(RunMission, "mission/run", self._on_call)
        self.phase("safety", self.step, lambda: (self._published,))
        self.begin()

    def settled(self) -> bool:
        """Lockstep: whether the autopilot, if any, has reported its status, so that every mission starts alike."""
        return self._safety.watch.autopilot_known

    def _on_odometry(self, o: Odometry) -> None:
        self._safety.watch.odometry(o.stamp_s, o.heading_rad, o.north_m, o.east_m, o.depth_m, o.speed_mps)

    def _on_command(self, order: MissionOrder) -> None:
        refused = self._command(order)
        if refused:
            self.get_logger().warning(f"refused: {refused}")

    def _on_call(self, request: Any, response: Any) -> Any:
        refused = "" if request.ask else self._command(decode_order(request.command), request.given_s, request.valid_s)
        status = self._safety.run.status
        response.accepted, response.state = not refused, int(status.state)
        response.message = refused or f"{status.state.name}: {status.reason}".rstrip(": ")
        response.clock_s = time.monotonic()
        return response

    def _note_listening(self) -> None:
        """Notes that the node takes commands, and the pause in which it took none because it was stopped or busy."""
        now_s = time.monotonic()
        if now_s - self._listened_s > VALID_S:
            self._pause = self._listened_s, now_s
        self._listened_s = now_s

    def _earliest_s(self) -> float | None:
        """Earliest time at which a command without a time may have been given; None: now, as always in lockstep."""
        if self.lockstep:
            return None
        self._note_listening()
        in_backlog = self._pause is not None and self._listened_s - self._pause[1] < _BACKLOG_S
        return self._pause[0] if self._pause is not None and in_backlog else None

    def _command(self, order: MissionOrder, given_s: float = 0.0, valid_s: float = 0.0) -> str:
        try:
            command = Command(order.command)
        except ValueError:
            return f"{order.command} is not a command; use one of {', '.join(f'{c} {c.name}' for c in Command)}"
        source = order.source or "unknown source"
        if command is Command.GO and (loss := self.state.loss_of("planner_node")):
            return f"GO: planner_node plans no legs ({loss}). End the dive with Ctrl-C at the surface, and start again"
        given = Given(given_s or self._earliest_s(), time.monotonic(), valid_s or VALID_S)
        refused = self._safety.command(command, source, order.team, given)
        self._save_state()  # an accepted command outlives this process
        self.get_logger().info(f"{command.name} by {source}{': refused' if refused else ''}")
        return refused

    def _save_state(self) -> None:
        self._under_water = self._safety.watch.under_water
        self.state.write(self._safety.snapshot(), _DISK_WAIT_S)

    def step(self, now_s: float) -> None:
        """Checks the limits; publishes the state when it changes and, without lockstep, every second."""
        tripped = len(self._safety.run.limits)
        self._safety.step(now_s)
        if len(self._safety.run.limits) > tripped:
            self._safety.run.note_trip(time.monotonic())
        status, warnings = self._safety.run.status, self._safety.warnings
        if self._safety.watch.under_water is not self._under_water:
            self._save_state()
        if (status, *warnings) != self._reported:  # compares keys: the numbers in warnings change constantly
            self._reported = (status, *warnings)
            self._published += 1
            self._save_state()  # saved before it is published
            texts = tuple(f"{name}: {reason}" for name, reason in warnings.items())
            if self._report is None or status != self._report.status:
                self._report_to_operator(f"{status.state.name}: {status.reason or 'travelling'}")
            self._report = RunReport(stamp_s=now_s, revision=self._published, status=status, warnings=texts)
            self._publish_state(now_s)
            self.get_logger().info(f"mission {status.state.name}: {status.reason or 'travelling'}")
        elif not self.lockstep and self._heartbeats.is_due(now_s):
            self._publish_state(now_s)
        self._diagnose(now_s)

    def _report_to_operator(self, text: str) -> None:
        """Reports on the vehicle's terminal, but not in lockstep, where the mission's display has its own lines."""
        if not self.lockstep:
            self.report_on_terminal(f"auv{self.vehicle}: {text}")

    def _publish_state(self, now_s: float) -> None:
        self._heartbeats.done(now_s)
        self._state.publish(self._report)

    def _diagnose(self, now_s: float) -> None:
        problems = self._safety.problems()
        new = self._new_problems.of(problems)
        for problem in new:
            self.get_logger().warning(problem)
        for problem in self._new_to_operator.of(self._safety.news(now_s)):
            if not (reason := self._safety.run.status.reason) or reason not in problem:
                self._report_to_operator(f"warning: {problem}")
        if new or self._health_reports.is_due(now_s):
            self._health_reports.done(now_s)
            self._save_state()  # updates the running time
            self.publish_health(now_s, self._safety.health())


#: Entry point of `ros2 run auv_lse_planner safety_node`.
main = Main(SafetyNode)
