"""planner_node: plans for one vehicle. Takes odometry, map and team plans; publishes the plan and the next leg."""

from __future__ import annotations

import auv_lse_common.node.executable  # noqa: F401  # first: prepares the process

# isort: split

import dataclasses
import time
from collections.abc import Callable
from typing import Any

from auv_lse_common.mission_file.parameters import section
from auv_lse_common.mission_file.sections.planner import PlannerConfig, PlannerSettings
from auv_lse_common.node.entry_point import Main
from auv_lse_common.node.periodic import Periodic
from auv_lse_common.node.vehicle_node import VehicleNode
from auv_lse_common.topics.records import (
    BoundReport,
    CentersReport,
    MissionOrder,
    Odometry,
    PlanReport,
    RunReport,
    Waypoint,
)
from auv_lse_common.vocabulary.dead_reckoning import CorrectedPosition
from auv_lse_common.vocabulary.health import NewProblems
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import LONGEST_SILENCE_S, UNWATCHED, Command
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_gp.inference.centers import Centers
from auv_lse_planner.methods.decision import BoundRecord, Decision
from auv_lse_planner.vehicle.health import planner_health, warnings_of
from auv_lse_planner.vehicle.intake import InputsUsed, PlannerIntake
from auv_lse_planner.vehicle.problems import of_state
from auv_lse_planner.vehicle.until import IN_A_ROW
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner

_DIAGNOSTICS_PERIOD_S = 10.0
#: The mission's end is reported again after this time (s), until the mission's state confirms it.
_END_PERIOD_S = 1.0
#: The first decision searches this many times as long as the deadline: no vehicle is under way yet.
_FIRST_DEADLINES = 2.5
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
        super().__init__("planner_node", replaced=("decided", "judged"))
        settings = PlannerSettings.from_parameters(self.parameters, self.where, self.vehicle)
        self._settings = settings
        self._planner = VehiclePlanner(self.vehicle, settings, stream(settings.mission.seed, "planner", self.vehicle))
        self._intake = PlannerIntake(self._planner)
        # do not restart a running mission at step 0
        self._state_lost = "" if self.state.values else self.state.lost
        self._planner.set_blocked(0.0, self._state_lost or "safety_node has not reported the mission's state")
        if not (self.journal.records or self.state.values):  # skipped after a restart, to be ready sooner
            rehearse_decision(settings, self.vehicle)
        self.show_parameters(
            {f.name: getattr(settings, f.name) for f in dataclasses.fields(settings)},
            tunable=tuple(f"planner.{name}" for name in _TUNABLE),
            apply=self._tune,
        )
        self._published = 0
        self._finish_journaled = False
        self._health_reports = Periodic(_DIAGNOSTICS_PERIOD_S)
        self._planning_s = 0.0
        self._end_reports = Periodic(_END_PERIOD_S)
        self._state_s = self.now_s()  # time of the last mission/state
        self._new_problems = NewProblems()
        self._plan = self.publisher("plan")
        self._path = self.publisher("path")
        self._waypoint = self.publisher("waypoint")
        self._bound = self.publisher("planner/bound")
        self._end = self.publisher("mission/end")
        self.listen("odometry", self._on_odometry)
        self.listen("corrected", self._on_corrected)
        self.listen("kernel_centers", self._on_centers)
        self.listen("map/quality", self._intake.set_quality)
        self.listen("mission/state", self._on_state)
        self.listen("team/plans", self._on_team_plan)
        self.phase("planner", self.step, lambda: (self._published,) * 2, lambda: self._planner.finished)
        with self.journal.restoring():
            self._resume()
        self.begin()

    def _resume(self) -> None:
        """After a restart: resumes after the journal's last decision, with the team plans received until then.

        Skips steps that are decided by the state file, but are missing from the journal. Republishes plan and waypoint
        with their original stamps, for readers that start later.
        """
        decided: list[Any] | None = None
        judged: dict[str, Any] | None = None  # after that decision
        for kind, *values in self.journal.records:
            if kind == "decided":
                decided, judged = values, None
            elif kind == "judged":
                judged = values[0]
            elif kind == "heard":
                stamp_s, vehicle, plan = values
                self._planner.receive_plan(stamp_s, vehicle, Plan.from_mapping(plan))
            elif kind == "finished":
                self._finish_journaled = True
        if decided is not None:
            self._planner.restore(decided[0])
        if judged is not None:
            self._planner.until.restore(judged)
        known = self._planner.decided
        self._planner.resume_at(self.state.values.get("decided", 0), self._finish_journaled)
        if self.state.rebooted:
            self._planner.forget_clock()
        if self._planner.decided > known:
            text = f"steps {known} to {self._planner.decided - 1} were decided, but are not in the journal: skipped"
            self.get_logger().error(text)
        elif decided is not None:
            _, stamp_s, plan = decided
            self._publish_plan(stamp_s, Plan.from_mapping(plan))
            leg = self._planner.decided_leg
            assert leg is not None  # it was decided
            self._publish_waypoint(stamp_s, leg)

    def _tune(self, parameters: dict[str, Any]) -> None:
        self._planner.set_planner(section(PlannerConfig, parameters, "planner", self.where))
        self.get_logger().info("planner parameters changed; they take effect at the next decision")

    def _on_odometry(self, odometry: Odometry) -> None:
        self._intake.set_odometry(odometry.stamp_s, odometry.heading_rad, odometry.north_m, odometry.east_m)

    def _on_corrected(self, position: CorrectedPosition) -> None:
        self._intake.set_corrected(position)

    def _on_centers(self, report: CentersReport) -> None:
        centers = Centers(report.locations_m, report.depths_m, report.noise_std_m, report.position_effect_m)
        self._intake.set_centers(centers, report.revision)

    def _on_team_plan(self, report: PlanReport) -> None:
        self._intake.add_plan(report.stamp_s, report.vehicle, report.plan)
        self.journal.write("heard", report.stamp_s, report.vehicle, dataclasses.asdict(report.plan))

    def _on_state(self, report: RunReport) -> None:
        if not self._state_lost:
            self._intake.set_run_status(report.status)
        self._state_s = self.now_s()

    def _deadline(self) -> Callable[[], bool] | None:
        """The deadline of a decision, by wall clock; None in lockstep, where runs must not depend on the machine."""
        limit_s = self._planner.planner.deadline_s * (1.0 if self._planner.decided else _FIRST_DEADLINES)
        if self.lockstep or limit_s <= 0.0:
            return None
        until = time.monotonic() + limit_s
        return lambda: time.monotonic() >= until

    def step(self, now_s: float) -> None:
        """Applies the queued inputs; if a decision is due, makes and publishes it."""
        quality = self._planner.until.quality
        if not (self.lockstep or self._state_lost) and now_s - self._state_s > LONGEST_SILENCE_S:
            self._intake.set_run_status(UNWATCHED)
        is_due = self._intake.take(now_s)
        if self._planner.until.quality is not quality:
            self._note_judgement()
        if is_due:
            began = time.perf_counter()
            decision = self._planner.decide(now_s, self._deadline())
            self._planning_s = time.perf_counter() - began
            if self.journal.kept:
                self.journal.write("decided", self._planner.snapshot(), now_s, dataclasses.asdict(decision.plan))
            self.state.write({"decided": self._planner.decided})  # saved before it is published
            self._publish(now_s, decision)
        if self._planner.finished and not self._finish_journaled:
            self._finish_journaled = True
            self.journal.write("finished")
        if self._intake.end_unreported and self._end_reports.is_due(now_s):
            self._end_reports.done(now_s)
            self._end.publish(MissionOrder(stamp_s=now_s, command=Command.END, source=self.get_name()))
        self._diagnose(now_s)

    def _note_judgement(self) -> None:
        """Journals a judgement of the map for `mission.until`."""
        until = self._planner.until
        self.journal.write("judged", until.snapshot())
        if until.met == IN_A_ROW:
            self.get_logger().info(
                f"step {self._planner.decided}: the map has the quality asked for: {until.asked.text}"
            )

    def _publish(self, now_s: float, decision: Decision) -> None:
        self._publish_plan(now_s, decision.plan)
        self._publish_waypoint(now_s, decision.leg)
        self._bound.publish(_bound_report(now_s, decision.bound, self._planning_s, self._intake.inputs_used))
        if self._planner.path is not None:
            self._path.publish((now_s, self._planner.path.states, self._settings.vehicle.depth_m))
        self._published += 1
        for warning in warnings_of(decision, self._planner.planner.deadline_s):
            self.get_logger().warning(warning)

    def _publish_plan(self, stamp_s: float, plan: Plan) -> None:
        self._plan.publish(PlanReport(stamp_s=stamp_s, vehicle=self.vehicle, plan=plan))

    def _publish_waypoint(self, stamp_s: float, leg: Leg) -> None:
        vehicle = self._settings.vehicle
        then = vehicle.stop_at_end if self._planner.is_last(leg) else None
        self._waypoint.publish(
            Waypoint(
                stamp_s=stamp_s,
                leg=leg,
                speed_mps=vehicle.speed_mps,
                depth_m=self._planner.shallow_ground.travel_depth_m(leg, vehicle),
                end=tuple(leg.end_state),
                then=then,
            )
        )

    def _diagnose(self, now_s: float) -> None:
        problems = self._planner.problems(now_s)
        if not self.lockstep:
            problems |= of_state(now_s - self._state_s)
        new = self._new_problems.of(problems)
        for problem in new:
            self.get_logger().warning(problem)
        if new or self._health_reports.is_due(now_s):
            self._health_reports.done(now_s)
            self.publish_health(now_s, planner_health(self._planner, problems, self._planning_s))


def _bound_report(now_s: float, bound: BoundRecord, planning_s: float, taken: InputsUsed) -> BoundReport:
    """The report of a decision that took `planning_s` of wall clock and used the inputs `taken`."""
    return BoundReport(
        stamp_s=now_s,
        step=bound.step,
        jbar=bound.expected_end,
        reward_so_far=bound.reward_so_far,
        lower_bound=bound.lower_bound,
        lower_bound_max=bound.lower_bound_max,
        incumbent_value=bound.incumbent_value,
        incumbent_kept=bound.incumbent_kept,
        iterations=bound.iterations,
        planning_s=planning_s,
        deadline_hit=bound.deadline_hit,
        map_revision=taken.map_revision,
        plans_heard=taken.plans,
        odometry_taken=taken.odometry_s,
    )


def rehearse_decision(settings: PlannerSettings, vehicle: int) -> None:
    """Makes and discards a decision in a two-step mission, to load the compiled code before the first real one."""
    settings = dataclasses.replace(settings, mission=dataclasses.replace(settings.mission, steps=2))
    planner = VehiclePlanner(vehicle, settings, stream(settings.mission.seed, "rehearsal"))
    start = settings.vehicle
    planner.odometry(0.0, start.start_heading_rad, start.start_north_m, start.start_east_m)
    planner.decide(0.0)


def prepare() -> None:
    """Loads the compiled code, so that processes forked later share it."""
    rehearse_decision(PlannerSettings.from_parameters({}, "rehearsal", 1), 1)


#: Entry point of `ros2 run auv_lse_planner planner_node`.
main = Main(PlannerNode)
