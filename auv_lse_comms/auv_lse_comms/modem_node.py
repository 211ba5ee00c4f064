"""The acoustic bridge of a vehicle: plan and soundings out in its own slots, the team's plans and samples in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from auv_lse_common.lockstep import Gate
from auv_lse_common.params import ParameterError, section
from auv_lse_common.ros_conversions import EVERY, LATCHED, ConfiguredNode, plan_from_message, plan_message, run, seconds
from auv_lse_comms.bridge import Received
from auv_lse_comms.config import PacketConfig, TdmaConfig
from auv_lse_comms.packet.codec import PacketError
from auv_lse_comms.packet.selection import Receivers
from auv_lse_comms.ros_conversions import (
    sounding_row,
    tdma_status,
    team_samples,
    transmission,
)
from auv_lse_comms.settings import bridge_of
from auv_lse_msgs.msg import LockstepDone, LockstepTick, ModemRx, ModemTx, Plan, SampleArray, Sounding, TdmaStatus

_STEP_PERIOD_S = 0.1
_STATUS_PERIOD_S = 10.0


def _make_receivers(parameters: Mapping[str, Any], where: str, address: int) -> Receivers:
    """What the receivers know, by the map's own reckoning: the one place where this package uses auv_lse_gp.

    Imported only if `packet.selection: useful` asks for it: without it the node needs neither that package nor SciPy.
    """
    from auv_lse_gp.receivers_risk import ReceiversRisk

    return ReceiversRisk.from_parameters(parameters, where, address)


class ModemNode(ConfiguredNode):
    """modem_node: packets and TDMA of one vehicle. Namespace: the vehicle's (/auv1)."""

    def __init__(self) -> None:
        """Builds the bridge from the parameters and wires the topics."""
        super().__init__("modem_node")
        self._bridge = bridge_of(self.parameters, self.where, self.vehicle, _make_receivers)
        tdma = section(TdmaConfig, self.parameters, "tdma", self.where)
        packet = section(PacketConfig, self.parameters, "packet", self.where)
        self.show_parameters(
            {"tdma": tdma, "packet": packet},
            tunable=("tdma.order", "tdma.slot_s", "tdma.guard_s", "tdma.epoch_s", "tdma.send_duration_s"),
            apply=self._change_tdma,
        )
        self._soundings: list[Sounding] = []
        self._arrivals: list[ModemRx] = []
        self._plan: Plan | None = None
        self._published = {"plans": 0, "samples": 0, "tx": 0}
        self._status_s = -float("inf")
        self._tx = self.create_publisher(ModemTx, "modem/tx", EVERY)
        self._team_plans = self.create_publisher(Plan, "team/plans", EVERY)
        self._team_samples = self.create_publisher(SampleArray, "team/samples", EVERY)
        self._status = self.create_publisher(TdmaStatus, "tdma", EVERY)
        self.create_subscription(Sounding, "sounding", self._on_sounding, EVERY)
        self.create_subscription(ModemRx, "modem/rx", self._on_arrival, EVERY)
        self.create_subscription(Plan, "plan", self._on_plan, LATCHED)
        self.create_subscription(ModemTx, "modem/failed", self._on_failed, EVERY)
        self._heard = Gate(("soundings", "arrivals"))  # opens the tick's first half: what has come in
        self._said = Gate(("plans",))  # opens its second half: what goes out
        self._tick_s: dict[int, float] = {}
        if self.lockstep:
            self._done = self.create_publisher(LockstepDone, "lockstep/done", EVERY)
            self.create_subscription(LockstepTick, "/lockstep/tick", self._on_tick, EVERY)
            self.create_subscription(LockstepDone, "lockstep/done", self._on_done, EVERY)
            readers = {self._done: 4, self._tx: 1 + self.recorded, self._team_plans: 1 + self.recorded}
            readers |= {self._team_samples: 1 + self.recorded, self._status: self.recorded}
            self.when_matched(readers, lambda: self._done.publish(self._message("modem", 0)))
        else:
            self.create_timer(_STEP_PERIOD_S, self._on_timer)

    def _change_tdma(self, parameters: dict[str, Any]) -> None:
        config = section(TdmaConfig, parameters, "tdma", self.where)
        try:
            effective_s = self._bridge.tdma.change(config, self.now_s())
        except ValueError as error:
            raise ParameterError(f"{self.where}: {error}") from error
        self.get_logger().info(f"TDMA settings change at {effective_s:.1f} s, the start of a cycle")

    def _on_sounding(self, message: Sounding) -> None:
        self._soundings.append(message)
        self._heard.count("soundings")
        self._advance()

    def _on_arrival(self, message: ModemRx) -> None:
        self._arrivals.append(message)
        self._heard.count("arrivals")
        self._advance()

    def _on_plan(self, message: Plan) -> None:
        self._plan = message
        self._said.count("plans")
        self._advance()

    def _on_failed(self, message: ModemTx) -> None:
        """The modem could not send the last packet: its samples are unsent again."""
        self._bridge.not_sent()
        self.get_logger().warning(f"the packet of {seconds(message.header.stamp):.1f} s was not sent; its samples wait")

    def _on_tick(self, message: LockstepTick) -> None:
        self._tick_s[message.tick] = seconds(message.stamp)
        self._heard.announce(message.tick, "soundings", message.soundings[self.vehicle - 1])
        self._heard.announce(message.tick, "arrivals", message.arrivals[self.vehicle - 1])
        self._advance()

    def _on_done(self, message: LockstepDone) -> None:
        if message.node == "planner":
            self._said.announce(message.tick, "plans", message.first)
            self._advance()

    def _on_timer(self) -> None:
        self.hear(self.now_s())
        self.say(self.now_s())

    def _advance(self) -> None:
        """Lockstep: each half of a tick once all that belongs to it is here."""
        if not self.lockstep:
            return
        tick = self._heard.ready()
        if tick is not None:
            self.hear(self._tick_s[tick])
            self._heard.handled(tick)
            self._done.publish(self._message("modem", tick))
        tick = self._said.ready()
        if tick is not None:
            self.say(self._tick_s.pop(tick))
            self._said.handled(tick)
            self._done.publish(self._message("modem_sent", tick))

    def _message(self, node: str, tick: int) -> LockstepDone:
        sent = node == "modem_sent"
        first, second = (self._published["tx"], 0) if sent else (self._published["plans"], self._published["samples"])
        return LockstepDone(node=node, vehicle=self.vehicle, tick=tick, first=first, second=second)

    def hear(self, now_s: float) -> None:
        """Takes own soundings and what the modem has received; gives the team's plans and samples."""
        if self._soundings:
            bad = self._bridge.counts["samples.bad"]
            self._bridge.add_soundings([sounding_row(m) for m in self._soundings])
            self._soundings.clear()
            if self._bridge.counts["samples.bad"] > bad:
                text = f"soundings that are not finite: {self._bridge.counts['samples.bad']} so far, none is sent"
                self.get_logger().warning(text, throttle_duration_sec=_STATUS_PERIOD_S)
        for message in sorted(self._arrivals, key=lambda m: (seconds(m.header.stamp), m.source)):
            received = self._bridge.receive(seconds(message.header.stamp), message.source, bytes(message.payload))
            if received is not None:
                self._publish(received)
        self._arrivals.clear()
        if now_s - self._status_s >= _STATUS_PERIOD_S or now_s < self._status_s:
            self._status_s = now_s
            self._status.publish(tdma_status(now_s, self._bridge))

    def _publish(self, received: Received) -> None:
        self._team_plans.publish(plan_message(received.stamp_s, received.source, received.packet.plan))
        self._published["plans"] += 1
        if len(received.packet.samples):
            self._team_samples.publish(team_samples(received))
            self._published["samples"] += 1

    def say(self, now_s: float) -> None:
        """Takes the vehicle's plan; in its own slot gives the modem a packet."""
        if self._plan is not None:
            try:
                self._bridge.set_plan(plan_from_message(self._plan))
            except PacketError as error:
                self.get_logger().error(f"plan of step {self._plan.step} cannot be sent: {error}")
            self._plan = None
        payload = self._bridge.poll(now_s)
        if payload is not None:
            self._tx.publish(transmission(now_s, self.vehicle, payload))
            self._published["tx"] += 1


def main() -> int:
    """Entry point of `ros2 run auv_lse_comms modem_node`."""
    return run(ModemNode)
