"""The acoustic bridge of a vehicle: sends plan, samples and navigation in its own slots; publishes the team's."""

from __future__ import annotations

import auv_lse_common.node.executable  # noqa: F401  # first: prepares the process

# isort: split

from typing import Any

from auv_lse_common.mission_file.parameters import ParameterError, section
from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.mission_file.sections.modem import HANDSHAKE_S
from auv_lse_common.node.entry_point import Main
from auv_lse_common.node.periodic import Periodic
from auv_lse_common.node.vehicle_node import VehicleNode
from auv_lse_common.topics.records import MissionOrder, PlanReport, Reception, RunReport, Transmission
from auv_lse_common.vocabulary.health import NewProblems
from auv_lse_common.vocabulary.mission_run import Command
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_comms.bridge import EVENTS, Received
from auv_lse_comms.health import bridge_health, bridge_problems
from auv_lse_comms.intake import BridgeIntake
from auv_lse_comms.ranging import Timing
from auv_lse_comms.settings import bridge_of
from auv_lse_comms.tdma_report import tdma_report

_STATUS_PERIOD_S = 10.0
_TUNABLE = ("order", "slot_s", "guard_s", "epoch_s", "send_duration_s")


class ModemNode(VehicleNode):
    """modem_node: packets and TDMA of one vehicle. Namespace: the vehicle's (/auv1)."""

    def __init__(self) -> None:
        """Builds the bridge from the parameters and wires the topics."""
        super().__init__("modem_node")
        simulated = self.get_parameter("use_sim_time").value
        self._bridge = bridge_of(
            self.parameters,
            self.where,
            self.vehicle,
            not self.lockstep,
            handshake_s=0.0 if simulated else HANDSHAKE_S,
        )
        with self.journal.restoring():
            self._bridge.recall(record for record in self.journal.records if record[0] in EVENTS)
        self._bridge.remember = self.journal.write
        if self.state.values:
            self._bridge.restore_counters(self.state.values)
        if self.state.rebooted or (self.state.lost and not self.state.values):
            self._bridge.begin_era()
        self.state.write(self._bridge.counters())
        self._intake = BridgeIntake(self._bridge)
        tdma = section(TdmaConfig, self.parameters, "tdma", self.where)
        packet = section(PacketConfig, self.parameters, "packet", self.where)
        self.show_parameters(
            {"tdma": tdma, "packet": packet},
            tunable=tuple(f"tdma.{name}" for name in _TUNABLE),
            apply=self._change_tdma,
        )
        self._published = {"plans": 0, "samples": 0, "navigation": 0, "commands": 0, "packets": 0}
        self._reports = Periodic(_STATUS_PERIOD_S)
        self._problems = NewProblems()
        self._tx = self.publisher("modem/tx")
        self._team_plans = self.publisher("team/plans")
        self._team_samples = self.publisher("team/samples")
        self._team_command = self.publisher("team/command")
        self._team_navigation = self.publisher("team/navigation")
        self._lines = self.publisher("packets")
        self._plan: Plan | None = None
        self._status = self.publisher("tdma")
        self.listen("sounding", lambda sounding: self._intake.add_soundings([sounding]))
        self.listen("dead_reckoning", self._intake.set_dead_reckoning)
        self.listen("fix", self._intake.add_fix)
        self.listen("modem/rx", self._on_reception)
        self.listen("plan", self._on_plan)
        self.listen("modem/sent", lambda packet: self._bridge.confirm(packet.stamp_s))
        self.listen("mission/state", self._on_state)
        self.listen("modem/failed", self._on_failed)
        self.phase(
            "modem",
            self.publish_received,
            lambda: tuple(self._published[name] for name in ("plans", "samples", "navigation", "commands")),
        )
        self.phase("modem_sent", self.send, lambda: (self._published["packets"],))
        self.begin()

    def _change_tdma(self, parameters: dict[str, Any]) -> None:
        config = section(TdmaConfig, parameters, "tdma", self.where)
        try:
            effective_s = self._bridge.tdma.change(config, self.now_s())
        except ValueError as error:
            raise ParameterError(f"{self.where}: {error}") from error
        self.get_logger().info(f"TDMA settings change at {effective_s:.1f} s, at the start of a cycle")

    def _on_reception(self, heard: Reception) -> None:
        timing = Timing(sent_s=heard.sent_s, arrival_s=heard.arrival_s, travel_s=heard.travel_s)
        if heard.ping:
            self._intake.add_answer(heard.stamp_s, heard.source, timing)
        else:
            self._intake.add_packet(heard.stamp_s, heard.source, heard.payload, timing)

    def _on_plan(self, report: PlanReport) -> None:
        self._plan = report.plan
        self._intake.set_plan(report.plan)

    def _on_failed(self, packet: Transmission) -> None:
        """The modem could not send the packet with this stamp: its samples are requeued."""
        sent_s = packet.stamp_s
        self._bridge.not_sent(sent_s)
        self.get_logger().warning(f"packet of {sent_s:.1f} s not sent: samples requeued")

    def _on_state(self, report: RunReport) -> None:
        self._bridge.set_run_status(report.status)

    def _pass_on_abort(self, received: Received) -> None:
        """Publishes a team mate's call to abort the mission, if it must be obeyed."""
        if not self._bridge.must_abort(received):
            if received.packet.abort and not self._bridge.abort_calls.allowed:
                self.get_logger().warning(
                    f"vehicle {received.source} calls to abort: ignored without packet.tag (or "
                    "packet.abort_without_tag)"
                )
            return
        source = f"vehicle {received.source}, by acoustic packet"
        order = MissionOrder(stamp_s=received.stamp_s, command=Command.ABORT, team=True, source=source)
        self._team_command.publish(order)
        self._published["commands"] += 1

    def publish_received(self, now_s: float) -> None:
        """Processes own soundings and received packets; publishes the team's plans and samples."""
        taken = self._intake.process()
        self.state.write(self._bridge.counters())
        for received in taken:
            stamp_s, source, packet = received.stamp_s, received.source, received.packet
            self._team_plans.publish(PlanReport(stamp_s=stamp_s, vehicle=source, plan=packet.plan))
            self._published["plans"] += 1
            if self._plan is not None:
                self._lines.publish((stamp_s, source, packet.plan, self._plan))
            self._pass_on_abort(received)
            if received.navigation is not None:  # before the samples, whose positions depend on it
                self._team_navigation.publish(received.navigation)
                self._published["navigation"] += 1
            if len(packet.samples):
                self._team_samples.publish(Soundings.of_packet(stamp_s, source, packet.samples))
                self._published["samples"] += 1
        for ranged in self._intake.ranges:
            self._team_navigation.publish(ranged)
            self._published["navigation"] += 1
        for problem in self._intake.problems:
            self.get_logger().warning(problem, throttle_duration_sec=_STATUS_PERIOD_S)
        if self._reports.is_due(now_s):
            self._reports.done(now_s)
            self._status.publish(tdma_report(now_s, self._bridge))
            problems = bridge_problems(self._bridge, now_s)
            for problem in self._problems.of(problems):
                self.get_logger().warning(problem)
            self.publish_health(now_s, bridge_health(self._bridge, problems))

    def send(self, now_s: float) -> None:
        """In the vehicle's slot publishes a packet with its plan for the modem, and then a ping."""
        payload = self._intake.poll(now_s)
        for problem in self._intake.problems:
            self.get_logger().error(problem)
        self.state.write(self._bridge.counters())  # before its packet is given out
        if payload is not None:
            self._tx.publish(Transmission(stamp_s=now_s, source=self.vehicle, payload=payload))
            self._published["packets"] += 1
        elif (mate := self._bridge.ping(now_s)) is not None:
            self._tx.publish(Transmission(stamp_s=now_s, source=self.vehicle, destination=mate, ping=True))
            self._published["packets"] += 1


#: Entry point of `ros2 run auv_lse_comms modem_node`.
main = Main(ModemNode)
