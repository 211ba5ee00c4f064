"""Plans for one vehicle: odometry, its map and the team's plans in; the plan and the next leg out."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry, Path

from auv_lse_common.lockstep import Gate
from auv_lse_common.params import section
from auv_lse_common.ros_conversions import (
    EVERY,
    LATCHED,
    NEWEST,
    ConfiguredNode,
    diagnostics,
    plan_from_message,
    plan_message,
    run,
    seconds,
)
from auv_lse_common.seeds import stream
from auv_lse_gp.ros_conversions import centers_from_message
from auv_lse_msgs.msg import Bound, KernelCenters, LockstepDone, LockstepTick, Plan, Waypoint
from auv_lse_planner.config import PlannerConfig, PlannerSettings
from auv_lse_planner.ros_conversions import (
    bound_message,
    navigation,
    path_message,
    waypoint_message,
)
from auv_lse_planner.vehicle_planner import Decision, VehiclePlanner

_STEP_PERIOD_S = 0.1
_DIAGNOSTICS_PERIOD_S = 10.0


class PlannerNode(ConfiguredNode):
    """planner_node: decides the legs of one vehicle. Namespace: the vehicle's (/auv1)."""

    def __init__(self) -> None:
        """Builds the planner from the parameters and wires the topics."""
        super().__init__("planner_node")
        settings = PlannerSettings.from_parameters(self.parameters, self.where, self.vehicle)
        self._settings = settings
        self._planner = VehiclePlanner(self.vehicle, settings, stream(settings.mission.seed, "planner", self.vehicle))
        self._warm_up(settings)
        sections = ("mission", "level_set", "area", "gp", "motion", "planner", "vehicle")
        tunable = ("method", "iterations", "exploration", "horizon", "naive_paths", "incumbent", "deadline_s")
        self.show_parameters(
            {name: getattr(settings, name) for name in sections},
            tunable=tuple(f"planner.{name}" for name in tunable),
            apply=self._tune,
        )
        self._odometry: Odometry | None = None
        self._centers: KernelCenters | None = None
        self._team: list[Plan] = []
        self._published = 0
        self._diagnosed_s = -float("inf")
        self._planning_s = 0.0
        self._warned: set[str] = set()  # keys of the problems that last
        self._plan = self.create_publisher(Plan, "plan", LATCHED)
        self._path = self.create_publisher(Path, "path", EVERY)
        self._waypoint = self.create_publisher(Waypoint, "waypoint", EVERY)
        self._bound = self.create_publisher(Bound, "planner/bound", EVERY)
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", EVERY)
        every = EVERY if self.lockstep else NEWEST  # lockstep counts messages: none may be missed
        self.create_subscription(Odometry, "odometry", self._on_odometry, every)
        self.create_subscription(KernelCenters, "kernel_centers", self._on_centers, LATCHED)
        self.create_subscription(Plan, "team/plans", self._on_team_plan, EVERY)
        self._gate = Gate(("odometries", "plans", "centers"))
        self._tick_s: dict[int, float] = {}
        if self.lockstep:
            self._done = self.create_publisher(LockstepDone, "lockstep/done", EVERY)
            self.create_subscription(LockstepTick, "/lockstep/tick", self._on_tick, EVERY)
            self.create_subscription(LockstepDone, "lockstep/done", self._on_done, EVERY)
            readers = {self._done: 4, self._plan: 1 + self.recorded, self._waypoint: 1 + self.recorded}
            readers |= {self._path: self.recorded, self._bound: self.recorded, self._diagnostics: self.recorded}
            self.when_matched(readers, lambda: self._done.publish(self._message(0)))
        else:
            self.create_timer(_STEP_PERIOD_S, lambda: self.step(self.now_s()))

    def _warm_up(self, settings: PlannerSettings) -> None:
        """A decision for nobody: compiled code is loaded now, not in the first decision of the mission."""
        rehearsal = VehiclePlanner(self.vehicle, settings, stream(settings.mission.seed, "rehearsal"))
        start = settings.vehicle
        rehearsal.odometry(0.0, start.start_heading_rad, start.start_north_m, start.start_east_m, start.speed_mps)
        rehearsal.decide(0.0)

    def _tune(self, parameters: dict[str, Any]) -> None:
        self._planner.set_planner(section(PlannerConfig, parameters, "planner", self.where))
        self.get_logger().info("planner parameters changed; they take effect at the next decision")

    def _on_odometry(self, message: Odometry) -> None:
        self._odometry = message
        self._gate.count("odometries")
        self._advance()

    def _on_centers(self, message: KernelCenters) -> None:
        self._centers = message
        self._gate.reach("centers", message.revision + 1)
        self._advance()

    def _on_team_plan(self, message: Plan) -> None:
        self._team.append(message)
        self._gate.count("plans")
        self._advance()

    def _on_tick(self, message: LockstepTick) -> None:
        self._tick_s[message.tick] = seconds(message.stamp)
        self._gate.announce(message.tick, "odometries", message.odometries[self.vehicle - 1])
        self._advance()

    def _on_done(self, message: LockstepDone) -> None:
        if message.node == "modem":
            self._gate.announce(message.tick, "plans", message.first)
        elif message.node == "gp":
            self._gate.announce(message.tick, "centers", message.first + 1)
        else:
            return
        self._advance()

    def _advance(self) -> None:
        """Lockstep: handles the next tick once all that belongs to it is here."""
        tick = self._gate.ready() if self.lockstep else None
        if tick is not None:
            self.step(self._tick_s.pop(tick))
            self._gate.handled(tick)
            self._done.publish(self._message(tick))

    def _message(self, tick: int) -> LockstepDone:
        return LockstepDone(
            node="planner",
            vehicle=self.vehicle,
            tick=tick,
            first=self._published,
            second=self._published,
            finished=self._planner.finished,
        )

    def _deadline(self) -> Callable[[], bool] | None:
        """A guard on the decision's wall clock; none in lockstep, where a run must not depend on the machine."""
        limit_s = self._planner.planner.deadline_s
        if self.lockstep or limit_s <= 0.0:
            return None
        until = time.monotonic() + limit_s
        return lambda: time.monotonic() >= until

    def step(self, now_s: float) -> None:
        """Takes what has come in and, if a decision is due, makes and publishes it."""
        if self._centers is not None:
            try:
                self._planner.set_centers(centers_from_message(self._centers), now_s)
            except ValueError as error:
                self.get_logger().error(str(error))
            self._centers = None
        for message in sorted(self._team, key=lambda m: (seconds(m.header.stamp), m.vehicle)):
            self._planner.hear(seconds(message.header.stamp), message.vehicle, plan_from_message(message))
        self._team.clear()
        if self._odometry is not None:
            self._planner.odometry(seconds(self._odometry.header.stamp), *navigation(self._odometry))
            self._odometry = None
        if self._planner.due(now_s):
            began = time.perf_counter()
            decision = self._planner.decide(now_s, self._deadline())
            self._planning_s = time.perf_counter() - began
            self._publish(now_s, decision)
        self._diagnose(now_s)

    def _publish(self, now_s: float, decision: Decision) -> None:
        vehicle, steps = self._settings.vehicle, self._settings.mission.steps
        last = decision.leg.step == steps - 1
        self._plan.publish(plan_message(now_s, self.vehicle, decision.plan))
        self._waypoint.publish(waypoint_message(now_s, decision.leg, vehicle.speed_mps, vehicle.depth_m, last))
        self._bound.publish(bound_message(now_s, decision.bound, self._planning_s))
        path = self._planner.path
        if path is not None:
            self._path.publish(path_message(now_s, path[0], vehicle.depth_m))
        self._published += 1
        if decision.bound.deadline_hit:
            self.get_logger().warning(
                f"step {decision.bound.step}: the deadline of {self._planner.planner.deadline_s:g} s ended the search "
                f"after {decision.bound.iterations} iterations; the best plan so far is taken"
            )
        if decision.statistics.escape:
            self.get_logger().warning(f"step {decision.bound.step}: nothing feasible; escaping, see docs/planner.md")

    def _diagnose(self, now_s: float) -> None:
        problems = self._planner.problems(now_s)
        news = [text for key, text in problems.items() if key not in self._warned]
        for problem in news:
            self.get_logger().warning(problem)
        self._warned = set(problems)
        if news or now_s - self._diagnosed_s >= _DIAGNOSTICS_PERIOD_S or now_s < self._diagnosed_s:
            self._diagnosed_s = now_s
            level = DiagnosticStatus.WARN if problems else DiagnosticStatus.OK
            records = self._planner.records
            values: dict[str, Any] = {"decisions": len(records), "planning_ms": f"{1e3 * self._planning_s:.1f}"}
            if records:
                values |= {"step": records[-1].step, "iterations": records[-1].iterations, "jbar": records[-1].jbar}
            text = "; ".join(problems.values()) or "ok"
            self._diagnostics.publish(diagnostics(now_s, self.get_fully_qualified_name(), level, text, values))


def main() -> int:
    """Entry point of `ros2 run auv_lse_planner planner_node`."""
    return run(PlannerNode)
