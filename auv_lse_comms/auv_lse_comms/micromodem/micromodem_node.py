"""Drives a Micromodem-2 (or an emulated one): sends packets from modem/tx, publishes received ones on modem/rx."""

import auv_lse_common.node.executable  # noqa: F401  # first: prepares the process

# isort: split

from typing import Any

from auv_lse_common.mission_file.parameters import ParameterError, section
from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_common.node.entry_point import Main
from auv_lse_common.topics.records import Reception
from auv_lse_common.vocabulary.stamps import seconds
from auv_lse_comms.driver_node import DriverNode
from auv_lse_comms.micromodem import events
from auv_lse_comms.micromodem.port import Event, ModemPort, PacketLost
from auv_lse_msgs.msg import LockstepDone, ModemTx


class MicromodemNode(DriverNode):
    """micromodem_node: the acoustic modem of one vehicle. Namespace: the vehicle's (/auv1)."""

    def __init__(self) -> None:
        """Creates the driver from the parameters, wires the topics and begins to open the port."""
        super().__init__("micromodem_node", "micromodem")
        config = section(ModemConfig, self.parameters, "modem", self.where)
        if config.kind != "micromodem":
            raise ParameterError(f"{self.where}: modem.kind is {config.kind!r}, but this node drives only 'micromodem'")
        try:
            self._modem = ModemPort(config, self.vehicle)
        except (ValueError, OSError) as error:  # the port's or the modem's address; the line log
            raise ParameterError(f"{self.where}: modem: {error}") from error
        self.show_parameters({"modem": config})
        self._headers: dict[int, Any] = {}  # of the packets in progress, by number
        self._can_send: bool | None = None  # None before the first time
        self._rx = self.publisher("modem/rx")
        self._sent = self.publisher("modem/sent")
        self._failed = self.publisher("modem/failed")
        self.listen("modem/tx", self._on_transmit, raw=True)  # its header is returned unchanged
        self.drive(self._modem, f"modem.port {config.port}")

    def _on_transmit(self, message: ModemTx) -> None:
        self.reach_time(seconds(message.header.stamp))  # the packet may arrive before the tick's announcement
        try:
            if message.ping:
                self._modem.ping(self.now_s(), message.destination)
                return
            number = self._modem.send(self.now_s(), bytes(message.payload), message.destination or None)
            self._headers[number] = message.header
        except ValueError as error:
            self.get_logger().error(f"packet of {len(message.payload)} bytes: {error}")

    def _outcome_of(self, number: int) -> ModemTx:
        """The report on packet `number`, with the packet's own header."""
        return ModemTx(header=self._headers.pop(number), dive=self.dive, source=self.vehicle)

    def totals(self) -> tuple[int, ...]:
        """The number of packets that were never transmitted."""
        return (self._modem.packets_lost,)

    def on_event(self, event: Event) -> None:
        """Publishes or logs an event of the driver."""
        log = self.get_logger()
        match event:
            case events.PacketReceived():
                self._rx.publish(received_packet(event))
            case events.PingAnswered():
                self._rx.publish(answered_ping(event, self.vehicle))
            case events.PingFailed():
                log.info(f"ping {event.number}: {event.reason}")
            case PacketLost():
                if event.number in self._headers:  # a ping has no header
                    self._failed.publish_message(self._outcome_of(event.number))
                if self.lockstep:
                    self.announce(LockstepDone.MICROMODEM_LOST, max(1, self.last_tick("micromodem")), self.totals())
            case events.TransmitFailed():
                log.warning(f"packet {event.number} not sent: {event.reason}")
            case events.TransmitDone():
                self._sent.publish_message(self._outcome_of(event.number))
            case events.ModemReady():
                log.info(f"modem ready, firmware {event.version or 'unknown'}")
                if self._can_send is False:
                    self.report_on_terminal(f"auv{self.vehicle}: the modem is ready again")
                self._can_send = True
                self.diagnose()
            case events.ModemLost():
                log.warning(f"modem lost: {event.reason}")
                if self._can_send:
                    self.report_on_terminal(f"auv{self.vehicle}: modem lost: {event.reason}; trying again")
                    self._can_send = False
                self.diagnose()
            case events.ClockChecked() if not event.within_tolerance:
                log.warning(f"modem clock {event.offset_s:+z.1f} s off (source {event.source}, PPS {event.pps})")
            case events.ReceptionFailed():
                log.info(f"reception failed: {event.reason}")
            case events.Problem():
                log.warning(event.text)


def received_packet(event: events.PacketReceived) -> Reception:
    """The reception of a packet."""
    return Reception(
        stamp_s=event.utc_s,
        source=event.source,
        destination=event.destination,
        snr_db=event.snr_db,
        sent_s=event.sent_s,
        arrival_s=event.arrival_s,
        travel_s=event.travel_s,
        payload=event.payload,
    )


def answered_ping(event: events.PingAnswered, vehicle: int) -> Reception:
    """The answer to a ping of `vehicle`; `sent_s` is NaN, because the other modem's clock is not used."""
    return Reception(
        stamp_s=event.utc_s,
        source=event.source,
        destination=vehicle,
        arrival_s=event.utc_s,
        travel_s=event.travel_s,
        ping=True,
    )


#: Entry point of `ros2 run auv_lse_comms micromodem_node`.
main = Main(MicromodemNode)
