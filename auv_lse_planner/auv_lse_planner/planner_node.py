"""Plans for one vehicle: odometry, its map and the team's plans in; the plan and the next leg out."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry, Path

from auv_lse_common.mission_file.parameters import section
from auv_lse_common.mission_file.sections.planner import PlannerConfig, PlannerSettings
from auv_lse_common.node.entry_point import Main
from auv_lse_common.node.vehicle_node import VehicleNode
from auv_lse_common.topics.quality import NEWEST
from auv_lse_common.topics.ros_conversions import (
    diagnostics,
    header,
    plan_from_message,
    plan_message,
    seconds,
    standing_of,
)
from auv_lse_common.vocabulary.health import NewProblems
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.plan import Plan as CorePlan
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_gp.ros_conversions import centers_from_message
from auv_lse_msgs.msg import Bound, KernelCenters, MissionCommand, MissionState, Plan, Waypoint
from auv_lse_planner.methods.decision import Decision
from auv_lse_planner.ros_conversions import bound_message, navigation, path_message, waypoint_message
from auv_lse_planner.vehicle.health import planner_health, warnings_of
from auv_lse_planner.vehicle.intake import PlannerIntake
from auv_lse_planner.vehicle.problems import of_state
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner

_DIAGNOSTICS_PERIOD_S = 10.0
#: The end is said again after this time (s), until the mission's state says so.
_END_PERIOD_S = 1.0
_TUNABLE = (
    "method",
    "iterations",
    "exploration",
    "horizon",
    "naive_paths",
    "incumbent",
    "anytime_weight",
    "tour_interval",
    "deadline_s",
)


class PlannerNode(VehicleNode):
    """planner_node: decides the legs of one vehicle. Namespace: the vehicle's (/auv1)."""

    def __init__(self) -> None:
        """Builds the planner from the parameters and wires the topics."""
        super().__init__("planner_node")
        settings = PlannerSettings.from_parameters(self.parameters, self.where, self.vehicle)
        self._settings = settings
        self._planner = VehiclePlanner(self.vehicle, settings, stream(settings.mission.seed, "planner", self.vehicle))
        self._intake = PlannerIntake(self._planner)
        self._planner.set_blocked(0.0, "safety_node has not reported the mission's state")
        if not self.journal.records:  # else it is started again under way: the sooner it is back, the better
            rehearse(settings, self.vehicle)
        self.show_parameters(
            {f.name: getattr(settings, f.name) for f in dataclasses.fields(settings)},
            tunable=tuple(f"planner.{name}" for name in _TUNABLE),
            apply=self._tune,
        )
        self._published = 0
        self._diagnosed_s = -float("inf")
        self._planning_s = 0.0
        self._end_said_s = -float("inf")
        self._state_s = self.now_s()  # when the mission's state was told last
        self._new_problems = NewProblems()
        self._plan = self.publisher(Plan, "plan")
        self._path = self.publisher(Path, "path")
        self._waypoint = self.publisher(Waypoint, "waypoint")
        self._bound = self.publisher(Bound, "planner/bound")
        self._command = self.publisher(MissionCommand, "mission/command")
        self._diagnostics = self.publisher(DiagnosticArray, "diagnostics")
        self.listen(Odometry, "odometry", self._on_odometry, quality=NEWEST)
        self.listen(Odometry, "corrected", self._on_corrected, quality=NEWEST)
        self.listen(KernelCenters, "kernel_centers", self._on_centers, total=lambda m: m.revision + 1)
        self.listen(MissionState, "mission/state", self._on_state, total=lambda m: m.revision)
        self.listen(Plan, "team/plans", self._on_team_plan)
        self.phase("planner", self.step, lambda: (self._published,) * 2, lambda: self._planner.finished)
        self._go_on()
        self.begin()

    def _go_on(self) -> None:
        """After a restart: goes on after the last decision in the journal, with the team's plans heard until then.

        Plan and waypoint are said again, with the stamps that they had: readers that start later get them from here.
        """
        decided: list[Any] | None = None
        for kind, *values in self.journal.records:
            if kind == "decided":
                decided = values
            elif kind == "heard":
                stamp_s, vehicle, plan = values
                self._planner.hear(stamp_s, vehicle, CorePlan.from_mapping(plan))
        if decided is not None:
            snapshot, stamp_s, plan = decided
            self._planner.restore(snapshot)
            self._plan.publish(plan_message(stamp_s, self.vehicle, CorePlan.from_mapping(plan)))
            leg = self._planner.decided_leg
            assert leg is not None  # it was decided
            self._publish_waypoint(stamp_s, leg)

    def _tune(self, parameters: dict[str, Any]) -> None:
        self._planner.set_planner(section(PlannerConfig, parameters, "planner", self.where))
        self.get_logger().info("planner parameters changed; they take effect at the next decision")

    def _on_odometry(self, message: Odometry) -> None:
        self._intake.set_odometry(seconds(message.header.stamp), *navigation(message))

    def _on_corrected(self, message: Odometry) -> None:
        stamp_s, (_, north_m, east_m) = seconds(message.header.stamp), navigation(message)
        self._intake.set_corrected(stamp_s, north_m, east_m)

    def _on_centers(self, message: KernelCenters) -> None:
        try:
            self._intake.set_centers(centers_from_message(message), message.revision)
        except ValueError as error:
            self.get_logger().error(str(error))

    def _on_team_plan(self, message: Plan) -> None:
        stamp_s, plan = seconds(message.header.stamp), plan_from_message(message)
        self._intake.add_plan(stamp_s, message.vehicle, plan)
        self.journal.write("heard", stamp_s, message.vehicle, dataclasses.asdict(plan))

    def _on_state(self, message: MissionState) -> None:
        try:
            self._intake.set_standing(standing_of(message))
            self._state_s = self.now_s()
        except ValueError as error:
            self.get_logger().error(f"mission/state: {error}")

    def _deadline(self) -> Callable[[], bool] | None:
        """A guard on the decision's wall clock; none in lockstep, where a run must not depend on the machine."""
        limit_s = self._planner.planner.deadline_s
        if self.lockstep or limit_s <= 0.0:
            return None
        until = time.monotonic() + limit_s
        return lambda: time.monotonic() >= until

    def step(self, now_s: float) -> None:
        """Takes what has come in and, if a decision is due, makes and publishes it."""
        if self._intake.take(now_s):
            began = time.perf_counter()
            decision = self._planner.decide(now_s, self._deadline())
            self._planning_s = time.perf_counter() - began
            self._publish(now_s, decision)
            if self.journal.kept:
                self.journal.write("decided", self._planner.snapshot(), now_s, dataclasses.asdict(decision.plan))
        if self._intake.end_is_news and not 0.0 <= now_s - self._end_said_s < _END_PERIOD_S:
            self._end_said_s = now_s
            command = MissionCommand(header=header(now_s), command=MissionCommand.END, source=self.get_name())
            self._command.publish(command)
        self._diagnose(now_s)

    def _publish(self, now_s: float, decision: Decision) -> None:
        self._plan.publish(plan_message(now_s, self.vehicle, decision.plan))
        self._publish_waypoint(now_s, decision.leg)
        self._bound.publish(bound_message(now_s, decision.bound, self._planning_s, self._intake.taken))
        if self._planner.path is not None:
            self._path.publish(path_message(now_s, self._planner.path.states, self._settings.vehicle.depth_m))
        self._published += 1
        for warning in warnings_of(decision, self._planner.planner.deadline_s):
            self.get_logger().warning(warning)

    def _publish_waypoint(self, stamp_s: float, leg: Leg) -> None:
        vehicle = self._settings.vehicle
        last = leg.step == self._settings.mission.steps - 1
        then = vehicle.stop_at_end if last else None
        self._waypoint.publish(waypoint_message(stamp_s, leg, vehicle.speed_mps, vehicle.depth_m, then))

    def _diagnose(self, now_s: float) -> None:
        problems = self._planner.problems(now_s)
        if not self.lockstep:
            problems |= of_state(now_s - self._state_s)
        new = self._new_problems.of(problems)
        for problem in new:
            self.get_logger().warning(problem)
        if new or now_s - self._diagnosed_s >= _DIAGNOSTICS_PERIOD_S or now_s < self._diagnosed_s:
            self._diagnosed_s = now_s
            health = planner_health(self._planner, problems, self._planning_s)
            self._diagnostics.publish(diagnostics(now_s, self.get_fully_qualified_name(), self.with_journal(health)))


def rehearse(settings: PlannerSettings, vehicle: int) -> None:
    """Decides in a mission of two steps, which nobody takes: it loads the compiled code before the first decision."""
    settings = dataclasses.replace(settings, mission=dataclasses.replace(settings.mission, steps=2))
    planner = VehiclePlanner(vehicle, settings, stream(settings.mission.seed, "rehearsal"))
    start = settings.vehicle
    planner.odometry(0.0, start.start_heading_rad, start.start_north_m, start.start_east_m)
    planner.decide(0.0)


def prepare() -> None:
    """Loads the compiled code: a process forked later has it."""
    rehearse(PlannerSettings.from_parameters({}, "rehearsal", 1), 1)


#: Entry point of `ros2 run auv_lse_planner planner_node`.
main = Main(PlannerNode)
