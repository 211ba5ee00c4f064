"""Keeps one vehicle's mission: takes commands, watches the limits, and says what the vehicle is to do."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Range

from auv_lse_common.mission_file.parameters import section
from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.node.entry_point import Main
from auv_lse_common.node.vehicle_node import VehicleNode
from auv_lse_common.topics.quality import NEWEST
from auv_lse_common.topics.ros_conversions import diagnostics, mission_state
from auv_lse_common.vocabulary.health import NewProblems
from auv_lse_common.vocabulary.mission_run import Command
from auv_lse_msgs.msg import AutopilotStatus, MissionCommand, MissionState
from auv_lse_msgs.srv import RunMission
from auv_lse_planner.ros_conversions import altitude_m, autopilot_report, navigation
from auv_lse_planner.safety import Safety

_DIAGNOSTICS_PERIOD_S = 10.0
#: Without lockstep the state is said again after this time (s): a reader may have missed it, or come late.
_HEARTBEAT_S = 1.0


class SafetyNode(VehicleNode):
    """safety_node: start, hold, abort and the safety watch of one vehicle. Namespace: the vehicle's (/auv1)."""

    def __init__(self) -> None:
        """Makes mission and watch from the parameters, wires topics and service."""
        super().__init__("safety_node")
        self._safety = Safety.of(self.parameters, self.where, self.vehicle)
        for kind, *values in self.journal.records:
            if kind == "standing":
                self._safety.restore(values[0])
        self.show_parameters(
            {
                "safety": section(SafetyConfig, self.parameters, "safety", self.where),
                "vehicle": section(VehicleConfig, self.parameters, "vehicle", self.where),
            }
        )
        self._published = 0
        self._said: tuple[object, ...] = ()
        self._message: MissionState | None = None  # as it was said last
        self._said_s = -float("inf")
        self._diagnosed_s = -float("inf")
        self._new_problems = NewProblems()
        self._state = self.publisher(MissionState, "mission/state")
        self._diagnostics = self.publisher(DiagnosticArray, "diagnostics")
        self.listen(Odometry, "odometry", self._on_odometry, quality=NEWEST)
        self.listen(Range, "altitude", lambda m: self._safety.watch.altitude(altitude_m(m)), quality=NEWEST)
        self.listen(AutopilotStatus, "autopilot", lambda m: self._safety.watch.autopilot(autopilot_report(m)))
        self.listen(MissionCommand, "mission/command", self._on_command, total=lambda m: m.number)
        self.listen(MissionCommand, "team/command", self._on_command)
        self.create_service(RunMission, "mission/run", self._on_call)
        self.phase("safety", self.step, lambda: (self._published,))
        self.begin()

    def settled(self) -> bool:
        """Lockstep: an autopilot, where there is one, has said how it is, so that every mission begins alike."""
        return self._safety.watch.autopilot_known

    def _on_odometry(self, message: Odometry) -> None:
        depth_m, speed_mps = -message.pose.pose.position.z, message.twist.twist.linear.x
        self._safety.watch.odometry(*navigation(message), depth_m, speed_mps)

    def _on_command(self, message: MissionCommand) -> None:
        refused = self._command(message)
        if refused:
            self.get_logger().warning(f"refused: {refused}")

    def _on_call(self, request: Any, response: Any) -> Any:
        refused = self._command(request.command)
        status = self._safety.run.status
        response.accepted, response.state = not refused, int(status.state)
        response.message = refused or f"{status.state.name}: {status.reason}".rstrip(": ")
        return response

    def _command(self, message: MissionCommand) -> str:
        try:
            command = Command(message.command)
        except ValueError:
            return f"command {message.command}; expected one of {', '.join(f'{c} {c.name}' for c in Command)}"
        source = message.source or "unknown source"
        refused = self._safety.run.command(command, source, message.team)
        self.get_logger().info(f"{command.name} by {source}{': refused' if refused else ''}")
        return refused

    def step(self, now_s: float) -> None:
        """Looks at the limits; publishes how it stands if that has changed, and without lockstep every second."""
        self._safety.watch.step(now_s, self._safety.run)
        status, warnings = self._safety.run.status, self._safety.watch.warnings
        if (status, *warnings) != self._said:  # the numbers in warnings change all the time
            self._said = (status, *warnings)
            self._published += 1
            self.journal.write("standing", self._safety.snapshot())
            texts = [f"{name}: {reason}" for name, reason in warnings.items()]
            self._message = mission_state(now_s, self._published, status, texts)
            self._say(now_s)
            self.get_logger().info(f"mission {status.state.name}: {status.reason or 'travels'}")
        elif not self.lockstep and not 0.0 <= now_s - self._said_s < _HEARTBEAT_S:
            self._say(now_s)
        self._diagnose(now_s)

    def _say(self, now_s: float) -> None:
        self._said_s = now_s
        self._state.publish(self._message)

    def _diagnose(self, now_s: float) -> None:
        problems = self._safety.problems()
        new = self._new_problems.of(problems)
        for problem in new:
            self.get_logger().warning(problem)
        if new or now_s - self._diagnosed_s >= _DIAGNOSTICS_PERIOD_S or now_s < self._diagnosed_s:
            self._diagnosed_s = now_s
            self.journal.write("standing", self._safety.snapshot())  # for how long it has run
            name = self.get_fully_qualified_name()
            self._diagnostics.publish(diagnostics(now_s, name, self.with_journal(self._safety.health())))


#: Entry point of `ros2 run auv_lse_planner safety_node`.
main = Main(SafetyNode)
