"""Drives a Micromodem-2 (or an emulated one): modem/tx to its port, what it receives to modem/rx."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType

from auv_lse_common.params import ParameterError, section
from auv_lse_common.ros_conversions import EVERY, ConfiguredNode, diagnostics, header, run, seconds
from auv_lse_comms.micromodem import events
from auv_lse_comms.micromodem.config import ModemConfig
from auv_lse_comms.micromodem.port import ModemPort
from auv_lse_comms.micromodem.state import State
from auv_lse_comms.transport import PortWatcher, Transport
from auv_lse_msgs.msg import LockstepDone, LockstepTick, ModemRx, ModemTx

_POLL_PERIOD_S = 0.05
_DIAGNOSTICS_PERIOD_S = 5.0


class MicromodemNode(ConfiguredNode):
    """micromodem_node: the acoustic modem of one vehicle. Namespace: the vehicle's (/auv1)."""

    def __init__(self) -> None:
        """Makes the driver from the parameters, wires the topics and begins to open the port."""
        super().__init__("micromodem_node")
        config = section(ModemConfig, self.parameters, "modem", self.where)
        if config.kind != "micromodem":
            raise ParameterError(f"{self.where}: modem.kind: got {config.kind!r}; expected 'micromodem'")
        try:
            self._port = ModemPort(config, self.vehicle)
        except (ValueError, OSError) as error:  # an address, of the port or the modem; the line log
            raise ParameterError(f"{self.where}: modem: {error}") from error
        self.show_parameters({"modem": config})
        self._tick_s = 0.0
        self._tick: int | None = None  # lockstep: announced, and not answered yet
        self._greeted = False
        self._started: set[int] = set()
        self._lost = 0
        self._watched: tuple[Transport, PortWatcher] | None = None
        self._problem = ""
        self._rx = self.create_publisher(ModemRx, "modem/rx", EVERY)
        self._failed = self.create_publisher(ModemTx, "modem/failed", EVERY)
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", EVERY)
        self.create_subscription(ModemTx, "modem/tx", self._on_transmit, EVERY)
        self._bytes = self.create_guard_condition(self._on_bytes)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_POLL_PERIOD_S, self._on_timer, clock=steady)
        self.create_timer(_DIAGNOSTICS_PERIOD_S, self._diagnose, clock=steady)
        self._matched = not self.lockstep
        if self.lockstep:
            self._done = self.create_publisher(LockstepDone, "lockstep/done", EVERY)
            self.create_subscription(LockstepTick, "/lockstep/tick", self._on_tick, EVERY)
            self.when_matched({self._done: 4, self._rx: 1 + self.recorded}, self._on_matched)

    def _now_s(self) -> float:
        return self._tick_s if self.lockstep else self.now_s()

    def _on_matched(self) -> None:
        self._matched = True

    # ------------------------------------------------------------------ what wakes it

    def _on_timer(self) -> None:
        # in lockstep time passes by ticks alone; the timer only opens the port
        self._step(poll=not self.lockstep)

    def _on_bytes(self) -> None:
        self._step(poll=False)
        if self._watched is not None:
            self._watched[1].handled()

    def _on_transmit(self, message: ModemTx) -> None:
        self._tick_s = max(self._tick_s, seconds(message.header.stamp))  # it may overtake the tick's announcement
        try:
            self._port.send(self._now_s(), bytes(message.payload), message.destination or None)
        except ValueError as error:
            self.get_logger().error(f"packet of {len(message.payload)} bytes: {error}")
        self._step(poll=False)

    def _on_tick(self, message: LockstepTick) -> None:
        self._tick, self._tick_s = message.tick, seconds(message.stamp)
        self._step(poll=True)

    def _step(self, poll: bool) -> None:
        for event in self._port.step(self._now_s(), time.monotonic(), poll):
            self._tell(event)
        self._watch()
        if not self.lockstep or not self._port.modem.quiet:
            return
        if not self._greeted and self._matched and self._port.modem.state is State.IDLE:
            self._greeted = True
            self._answer("micromodem", 0)
        if self._tick is not None:
            self._answer("micromodem", self._tick)
            self._tick = None

    def _answer(self, node: str, tick: int) -> None:
        self._done.publish(LockstepDone(node=node, vehicle=self.vehicle, tick=tick, first=self._lost))

    def _watch(self) -> None:
        transport = self._port.transport
        if self._watched is not None and self._watched[0] is not transport:
            self._watched[1].stop()
            self._watched = None
        if self._watched is None and transport is not None:
            self._watched = (transport, PortWatcher(transport, self._bytes.trigger))

    # ------------------------------------------------------------------ what it tells

    def _tell(self, event: events.Event) -> None:
        log = self.get_logger()
        match event:
            case events.PacketReceived():
                self._rx.publish(
                    ModemRx(
                        header=header(event.utc_s),
                        source=event.source,
                        destination=event.destination,
                        snr_db=event.snr_db,
                        travel_s=event.travel_s,
                        payload=event.payload,
                    )
                )
            case events.TransmitStarted():
                self._started.add(event.number)
            case events.TransmitDone():
                self._started.discard(event.number)
            case events.TransmitFailed():
                log.warning(f"packet {event.number} not sent: {event.reason}")
                if event.number not in self._started:  # never reached the water: nobody need wait for it
                    self._lost += 1
                    self._failed.publish(ModemTx(header=header(self._now_s()), source=self.vehicle))
                    if self.lockstep:
                        self._answer("micromodem_lost", max(1, self._tick or 0))
                self._started.discard(event.number)
            case events.ModemReady():
                log.info(f"modem ready, firmware {event.version or 'unknown'}")
                self._problem = ""
                self._diagnose()
            case events.ModemLost():
                log.warning(f"modem lost: {event.reason}")
                self._problem = event.reason
                self._diagnose()
            case events.ClockChecked() if not event.within_tolerance:
                log.warning(f"modem clock {event.offset_s:+.1f} s off (source {event.source}, PPS {event.pps})")
            case events.ReceptionFailed():
                log.info(f"reception failed: {event.reason}")
            case events.Problem():
                log.warning(event.text)

    def _diagnose(self) -> None:
        modem = self._port.modem
        ready = modem.state not in (State.CLOSED, State.CONFIGURING, State.CLOCK)
        level = DiagnosticStatus.OK if ready else DiagnosticStatus.ERROR
        text = modem.state.value if ready else self._problem or self._port.connection.problem or modem.state.value
        values = {"firmware": modem.version, "state": modem.state.value, **modem.counts}
        values |= {f"line {name}": count for name, count in modem.reader.counts.items()}
        values |= {f"ignored {name}": count for name, count in modem.ignored.counts.items()}
        self._diagnostics.publish(diagnostics(self.now_s(), "micromodem", level, text, values))

    def destroy_node(self) -> None:
        """Stops watching, and closes port and log."""
        if self._watched is not None:
            self._watched[1].stop()
        self._port.close(self._now_s(), time.monotonic())
        super().destroy_node()


def main() -> int:
    """Entry point of `ros2 run auv_lse_comms micromodem_node`."""
    return run(MicromodemNode)
