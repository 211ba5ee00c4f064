"""Recomputes a vehicle's decisions from the odometry, map and team plans that its planner received.

Where a decision differs from the recorded one, the planner continues from the recorded one. So one difference does
not cause all that follow.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.mission_file.parameters import ParameterError, nest, section
from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.topics.records import Odometry, PlanReport
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_comms.intake import BridgeIntake
from auv_lse_comms.settings import bridge_of
from auv_lse_gp.inference.centers import Centers
from auv_lse_planner.vehicle.intake import InputsUsed, PlannerIntake
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner
from auv_lse_shore.replay.inputs import Pending, RecordedDecision, VehicleInputs, ticks_of
from auv_lse_shore.replay.recompute_map import RecomputedMap

#: Why a decision cannot be repeated.
CUT, AFTER_CUT = "the deadline ended the recorded search", "other random numbers, after a search ended by the deadline"


@dataclass(frozen=True, slots=True, kw_only=True)
class DecisionStep:
    """A recorded decision compared with the recomputed one; pairs are (recorded, recomputed).

    Attributes:
        now_s: Mission time.
        turns_deg: Heading change of the leg.
        plans: The plan in words.
        note: The reason, or what else differs.
        same_plan: Whether plan and leg are the recorded ones.
        comparable: Whether the values measure the same reward.
        differs: Whether the decisions differ.
    """

    vehicle: int
    step: int
    now_s: float
    turns_deg: tuple[float, float]
    plans: tuple[str, str]
    values: tuple[float, float]
    note: str
    same_plan: bool
    comparable: bool
    differs: bool

    TITLES = ("vehicle", "step", "time (s)", "turn (deg)", "turn now (deg)", "plan", "plan now", "value", "value now",
              "difference", "note")  # fmt: skip

    @property
    def only_value_differs(self) -> bool:
        """Whether all but the value is as recorded."""
        return self.same_plan and not self.note

    @property
    def cells(self) -> tuple[str, ...]:
        """One row of the table."""
        turns, values = (f"{v:+z.0f}" for v in self.turns_deg), (f"{v:.6g}" for v in self.values)
        plan, now = self.plans
        by = f"{self.values[1] - self.values[0]:+.3g}" if self.comparable else ""
        head = (f"auv{self.vehicle}", str(self.step), f"{self.now_s:.1f}")
        return (*head, *turns, plan, "same" if plan == now else now, *values, by, self.note)


def recompute_decisions(
    inputs: VehicleInputs,
    settings: Settings,
    lockstep: bool,
    tolerance: float,
    show: Callable[[float], None],
    comparable: bool = True,
) -> list[DecisionStep]:
    """Compares every recorded decision with the one that the current planner makes from the same inputs.

    Args:
        settings: The current parameters.
        lockstep: Whether the mission flew in lockstep.
        tolerance: Relative difference of values that is ignored.
        show: Called with the share done, 0 to 1.
        comparable: Whether the values measure the same reward as the recorded ones; if not, they are no difference.
    """
    return _Recomputer(inputs, settings, lockstep, tolerance if comparable else None).run(show)


def _has_every_map(inputs: VehicleInputs) -> bool:
    """Whether the kernel centers of every map from which the planner decided are recorded."""
    revisions = {report.revision for _, report in inputs.centers}
    used = {decision.taken.map_revision for decision in inputs.decisions if decision.taken is not None}
    return bool(revisions) and used <= revisions


class _Recomputer:
    """One vehicle's planner with its recorded inputs."""

    def __init__(self, inputs: VehicleInputs, settings: Settings, lockstep: bool, tolerance: float | None) -> None:
        number = inputs.vehicle
        own = settings.planner_settings(number)
        self._planner = VehiclePlanner(number, own, stream(own.mission.seed, "planner", number))
        self._intake = PlannerIntake(self._planner)
        self._parameters = parameters_for(settings.to_patterns(), f"/auv{number}/planner_node")
        self._inputs, self._lockstep, self._tolerance = inputs, lockstep, tolerance
        # A recording of the fleet engine has neither the map's centers nor the plans as the modem node passed them on;
        # one with record.map_bytes_per_s has the centers of a few decisions only.
        positions = settings.positions_in_force(number)
        self._map = None if _has_every_map(inputs) else RecomputedMap(inputs, own, positions, lockstep)
        self._plans = Pending(inputs.plans or _plans_heard(inputs, settings))
        self._odometry, self._corrected = Pending(inputs.odometry), Pending(inputs.corrected)
        self._centers, self._tuned = Pending(inputs.centers if self._map is None else []), Pending(inputs.tuned)
        self._qualities, self._states = Pending(inputs.qualities), Pending(inputs.states)
        self._revision = -1
        self._was_cut = False  # whether a deadline has ended a search: others draw other random numbers since

    def run(self, show: Callable[[float], None]) -> list[DecisionStep]:
        decisions = {decision.now_s: decision for decision in self._inputs.decisions}
        times = sorted({*ticks_of(self._inputs), *decisions}) if self._lockstep else sorted(decisions)
        rows: list[DecisionStep] = []
        early = False
        for now_s in times:
            decision = decisions.get(now_s)
            self._take(now_s, None if self._lockstep or decision is None else decision.taken)
            due = self._intake.take(now_s)
            if decision is None:
                early |= due
            elif decision.step < self._planner.settings.mission.steps:
                note = "due earlier now" if early else "" if due or not self._lockstep else "not due yet now"
                rows.append(self._decide(decision, note))
                early = False
                show(len(rows) / len(decisions))
        return rows

    def _take(self, now_s: float, taken: InputsUsed | None) -> None:
        """Applies the inputs up to `now_s` (s), or those that the planner reported as `taken`."""

        def is_due(received_s: float, value: Any) -> bool:
            return received_s <= now_s + 1e-9

        def is_stamped(received_s: float, value: DeadReckoning | Odometry) -> bool:
            return is_due(received_s, value) if taken is None else value.stamp_s <= taken.odometry_s + 1e-9

        for changed in self._tuned.take(is_due):
            self._tune(changed)
        for report in self._plans.take(is_due if taken is None else lambda *_: self._plans.taken < taken.plans):
            self._intake.add_plan(report.stamp_s, report.vehicle, report.plan)
        for quality in self._qualities.take(is_due):
            self._intake.set_quality(quality)
        for position in self._corrected.take(is_stamped):
            self._intake.set_corrected(position)
        # Without lockstep: the first decision had an odometry, whenever the recorder received it.
        for odometry in self._odometry.take(
            lambda received_s, o: is_stamped(received_s, o) or not (self._lockstep or self._odometry.taken)
        ):
            entry = (odometry.stamp_s, odometry.heading_rad, odometry.north_m, odometry.east_m)
            self._take_states(odometry.stamp_s)
            if not self._lockstep:  # each odometry advances the vehicle, as in the node
                self._planner.odometry(*entry)
            self._intake.set_odometry(*entry)
        if self._map is not None:
            self._take_map(self._map, now_s, None if taken is None else taken.map_revision)
        for found in self._centers.take(
            is_due if taken is None else lambda received_s, found: found.revision <= taken.map_revision
        ):
            centers = Centers(found.locations_m, found.depths_m, found.noise_std_m, found.position_effect_m)
            self._intake.set_centers(centers, found.revision)

    def _take_states(self, now_s: float) -> None:
        """Pauses and resumes the mission as its states up to `now_s` (s) did."""
        for report in self._states.take(lambda received_s, _: received_s <= now_s + 1e-9):
            self._planner.set_blocked(report.stamp_s, report.status.blocked_reason)

    def _take_map(self, own: RecomputedMap, now_s: float, revision: int | None) -> None:
        own.advance(now_s, revision)
        if own.map.revision != self._revision:
            self._revision = own.map.revision
            self._intake.set_centers(own.map.centers, self._revision)
        if own.position is not None and not self._inputs.corrected:
            self._intake.set_corrected(own.position)

    def _tune(self, changed: dict[str, Any]) -> None:
        """Applies parameters that were changed by hand while the planner ran."""
        own = {**self._parameters, "planner": {**self._parameters.get("planner", {}), **nest(changed)["planner"]}}
        self._planner.set_planner(section(PlannerConfig, own, "planner", "recorded parameter change"))
        self._parameters = own

    def _decide(self, recorded: RecordedDecision, note: str) -> DecisionStep:
        planner, turns = self._planner, np.deg2rad(self._planner.settings.motion.actions_deg)
        if not planner.rollout.can_follow(recorded.plan):
            raise ParameterError(
                f"auv{self._inputs.vehicle}, step {recorded.step}: the recorded plan cannot be followed with "
                "these parameters (actions, steps, naive paths); use those of the dive"
            )
        decision = planner.decide(recorded.now_s)
        leg = recorded.leg or self._leg(recorded, decision.leg.surface)
        same_leg = math.isclose(decision.leg.action_rad, leg.action_rad) and decision.leg.surface == leg.surface
        same_plan = decision.plan == recorded.plan and same_leg
        if decision.leg.surface != leg.surface:
            note = "surfaces now" if decision.leg.surface else "does not surface now"
        if decision.leg.step != recorded.step:
            note = f"step {decision.leg.step} now"
        if recorded.deadline_hit:
            note, self._was_cut = CUT, True
        elif self._was_cut and not same_plan and not note:
            note = AFTER_CUT
        if not same_plan:
            planner.adopt(recorded.plan, leg)
        values = (recorded.jbar, decision.bound.expected_end)
        tolerance = self._tolerance  # None: the values are not comparable
        close = (
            tolerance is None or math.isnan(values[0]) or math.isclose(*values, rel_tol=tolerance, abs_tol=tolerance)
        )
        return DecisionStep(
            vehicle=self._inputs.vehicle,
            step=recorded.step,
            now_s=recorded.now_s,
            turns_deg=(math.degrees(leg.action_rad), math.degrees(decision.leg.action_rad)),
            plans=(in_words(recorded.plan, turns), in_words(decision.plan, turns)),
            values=values,
            note=note,
            same_plan=same_plan,
            comparable=tolerance is not None,
            differs=not (same_plan and close and not note),
        )

    def _leg(self, recorded: RecordedDecision, surface: bool) -> Leg:
        """The leg of a decision whose plan alone was recorded; it surfaces if the recomputed one does."""
        path = self._planner.rollout.follow(recorded.plan).from_step(recorded.step)
        leg = self._planner.motion.leg(recorded.step, path.states[0], int(path.actions[0]))
        return self._planner.in_odometry_frame(dataclasses.replace(leg, surface=surface))


def in_words(plan: Plan, turns_rad: Any) -> str:
    """A plan in a few words: its step, the turns (deg), the tour's bearings (1/256 turn), the naive path."""
    shown = plan.actions[:6]
    turns = " ".join(f"{math.degrees(turns_rad[a]):.0f}" for a in shown) + (" .." if len(plan.actions) > 6 else "")
    parts = [f"{plan.step}:"] + ([turns] if turns else [])
    if plan.tour is not None:
        bearings = plan.tour.bearings
        last = " .." if len(bearings) > 4 else ""
        parts.append(f"tour {len(bearings)} x {plan.tour.segment_legs}: {' '.join(map(str, bearings[:4]))}{last}")
    if plan.naive_path != NONE:
        parts.append(f"path {plan.naive_path:X}")
    return " ".join(parts)


def _plans_heard(inputs: VehicleInputs, settings: Settings) -> list[tuple[float, PlanReport]]:
    """The team's plans in the packets that the modem received, as the bridge accepts them."""
    number = inputs.vehicle
    parameters = parameters_for(settings.to_patterns(), f"/auv{number}/modem_node")
    where = f"{settings.where} (auv{number})"
    intake = BridgeIntake(bridge_of(parameters, where, number))
    found = []
    for received_s, packet in inputs.packets:
        intake.add_packet(packet.stamp_s, packet.source, packet.payload)
        found += [
            (received_s, PlanReport(stamp_s=heard.stamp_s, vehicle=heard.source, plan=heard.packet.plan))
            for heard in intake.process()
        ]
    return found
