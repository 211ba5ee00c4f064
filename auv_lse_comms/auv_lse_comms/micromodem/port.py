"""A modem's driver on its port, with its line log; `micromodem_node` owns one."""

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_common.vocabulary.health import Health, Level
from auv_lse_comms.micromodem.driver import Micromodem
from auv_lse_comms.micromodem.events import Event as DriverEvent
from auv_lse_comms.micromodem.events import (
    ModemLost,
    ModemReady,
    PingAnswered,
    PingFailed,
    PingStarted,
    Problem,
    TransmitDone,
    TransmitFailed,
    TransmitStarted,
)
from auv_lse_comms.micromodem.log import LogEntry, format_entry
from auv_lse_comms.micromodem.state import State
from auv_lse_comms.transport import Connection, Transport, open_transport, read_address

#: States in which no packet can be sent.
_NOT_READY = (State.CLOSED, State.CONFIGURING, State.CLOCK)


@dataclass(frozen=True, slots=True, kw_only=True)
class PacketLost:
    """Packet `number` was not sent: no transmission of it has begun."""

    number: int


Event = DriverEvent | PacketLost


class ModemPort:
    """The driver and its port, which is reopened whenever it fails.

    `step` transfers bytes both ways. `now_s` is the host's clock (UTC or simulated); `steady_s` is a clock that never
    jumps and times the waits before the port is reopened. A line log that cannot be written is closed and reported
    once; the modem continues without it.

    Attributes:
        packets_lost: How many packets were never transmitted.
    """

    def __init__(self, config: ModemConfig, address: int) -> None:
        """Prepares the modem of vehicle number `address`; opens only the log.

        Raises:
            AddressError: if `modem.port` is not an address.
            OSError: if the line log cannot be written.
        """
        where = read_address(config.port, config.baud)
        self.modem = Micromodem(config, address, self._write_log if config.log_file else None)
        # on some modem boards, a high RTS garbles the modem's output
        self.connection = Connection(
            lambda: open_transport(where, lines_low=True), config.backoff_min_s, config.backoff_max_s
        )
        self._log: TextIO | None = None
        self._log_problem: Problem | None = None  # not reported yet
        self.packets_lost = 0
        self._started: set[int] = set()  # numbers of the transmissions in progress
        self._problem = ""  # why the modem was lost
        if config.log_file:
            path = Path(config.log_file)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._log = path.open("a", encoding="ascii", buffering=1)  # line by line, so that a crash loses none

    @property
    def transport(self) -> Transport | None:
        """The open port, to wait on for bytes; None if it is closed."""
        return self.connection.transport

    def send(self, now_s: float, payload: bytes, destination: int | None = None) -> int:
        """Queues a packet, to `modem.destination` if `destination` is None; `step` writes it to the port.

        Raises:
            ValueError: see `Micromodem.send`.
        """
        return self.modem.send(now_s, payload, destination)

    def ping(self, now_s: float, destination: int) -> int:
        """Pings another modem; `step` writes the command to the port.

        Raises:
            ValueError: see `Micromodem.ping`.
        """
        return self.modem.ping(now_s, destination)

    def step(self, now_s: float, steady_s: float, poll: bool = True) -> list[Event]:
        """Opens the port if it is time, reads, lets time pass (if `poll`), writes; returns the events."""
        if self.connection.poll(steady_s):
            self.modem.opened(now_s)
        data = self.connection.read(steady_s)
        if data:
            self.modem.receive(now_s, data)
        if poll:
            self.modem.poll(now_s)
        if self.modem.wants_reopen:
            self.connection.close(steady_s, "the modem does not answer")
        self.connection.write(self.modem.outgoing(), steady_s)
        if self.connection.transport is None and self.modem.is_open:
            self.modem.closed(now_s, self.connection.problem)
        return self._events()

    @property
    def quiet(self) -> bool:
        """Whether the modem is ready and no immediate answer is pending."""
        return self.modem.quiet

    def health(self) -> Health:
        """The state of modem, port and lines."""
        modem = self.modem
        values = {"firmware": modem.version, "state": modem.state.value, **modem.counts}
        values |= {f"line {name}": count for name, count in modem.reader.counts.items()}
        values |= {f"ignored {name}": count for name, count in modem.ignored.counts.items()}
        values |= {f"port {name}": count for name, count in self.connection.counts.items()}
        if modem.state not in _NOT_READY:
            return Health(level=Level.OK, text=modem.state.value, values=values)
        text = self._problem or self.connection.problem or modem.state.value
        return Health(level=Level.ERROR, text=text, values=values)

    def close(self, now_s: float, steady_s: float) -> list[Event]:
        """Closes port and log."""
        self.connection.close(steady_s, "shutting down")
        if self.modem.is_open:
            self.modem.closed(now_s, "shutting down")
        events = self._events()
        self._close_log()
        return events

    def _events(self) -> list[Event]:
        events: list[Event] = []
        for event in self.modem.events():
            events.append(event)
            match event:
                case ModemReady():
                    self._problem = ""
                case ModemLost():
                    self._problem = event.reason
                case TransmitStarted() | PingStarted():
                    self._started.add(event.number)
                case TransmitFailed() | PingFailed() if event.number not in self._started:
                    self.packets_lost += 1
                    events.append(PacketLost(number=event.number))
                case TransmitDone() | TransmitFailed() | PingAnswered() | PingFailed():
                    self._started.discard(event.number)
        if self._log_problem is not None:
            events.append(self._log_problem)
            self._log_problem = None
        return events

    def _write_log(self, utc_s: float, kind: str, data: bytes) -> None:
        if self._log is None:
            return
        try:
            self._log.write(format_entry(LogEntry(utc_s, kind, data)) + "\n")
        except OSError as error:  # a full disk must not stop the modem
            self._log_problem = Problem(text=f"line log {self._log.name}: closed because it cannot be written: {error}")
            self._close_log()

    def _close_log(self) -> None:
        if self._log is not None:
            with contextlib.suppress(OSError):  # closing flushes what could not be written
                self._log.close()
            self._log = None
