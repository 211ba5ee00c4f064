"""Driver of a WHOI Micromodem-2: a state machine from bytes and times to bytes and events. It opens no port.

The owner (`port.py`, or a program of your own) calls `opened`, `closed`, `receive` (bytes from the modem), `send` (a
packet to transmit), `ping` (another modem) and, often, `poll` (time passes). After each call it takes `outgoing` (bytes
to write) and `events`. Every call carries `now_s`, the host's clock, s since 1970 (UTC, or simulated). It times the
waits, and the modem's clock is compared with it. It may be stepped: after a step back every running wait restarts.

`state.py` explains the states. `Micromodem` passes each message to the part that handles it: `configuration.py`,
`clock.py`, `sending.py`, `pinging.py` or `receiving.py`.

A command without an answer is repeated; after `retries` the driver requests a new connection (`wants_reopen`). Any
sentence with a valid checksum proves that the modem is alive. The clock and the modem's address are queried every
`clock_period_s`, which reveals silence and missed reboots. Any line may be lost.
"""

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_comms.micromodem.clock import ClockCheck, ClockStep
from auv_lse_comms.micromodem.configuration import Configuration
from auv_lse_comms.micromodem.events import Event, ModemLost, Problem
from auv_lse_comms.micromodem.pinging import Pinging
from auv_lse_comms.micromodem.receiving import Receiving
from auv_lse_comms.micromodem.sending import Sending
from auv_lse_comms.micromodem.sentences import ping_messages as ping
from auv_lse_comms.micromodem.sentences import receive_messages as rx
from auv_lse_comms.micromodem.sentences import status_messages as status
from auv_lse_comms.micromodem.sentences import transmit_messages as tx
from auv_lse_comms.micromodem.sentences.fields import SentenceError
from auv_lse_comms.micromodem.sentences.messages import read_message
from auv_lse_comms.micromodem.sentences.wire import SentenceReader, TypeCounts
from auv_lse_comms.micromodem.session import Session
from auv_lse_comms.micromodem.state import STARTING, TRANSMITTING, Cause, State

#: Kinds of the entries of a line log (`log.py`).
FROM_MODEM, TO_MODEM, CALL = "<", ">", "="
#: Takes an entry of the line log: time (s since 1970), kind, and the bytes or the call (as bytes).
Record = Callable[[float, str, bytes], None]

#: Kinds of `$CAMSG` and modules of `$CAERR` counted by name; any other is counted as "other".
NOTICES = frozenset({"BAD_CRC", "PACKET_TIMEOUT", "PSK_ERROR", "NO_CARRIER", "BAD_HEADER"})
MODULES = frozenset({"NMEA", "DATA_TIMEOUT", "TX", "RX", "PSK", "FSK", "AUX", "COPROC", "POWER", "CLOCK", "SYSTEM"})


class Micromodem:
    """Drives one Micromodem-2; see the module's text.

    Attributes:
        address: The modem's address, which is the vehicle's number.
        reader: Splits bytes into sentences; `reader.counts` counts the damaged lines by kind.
        ignored: Sentences that the driver does not use, by type.
        handlers: Handler of each message. Text from the modem selects code only through this table.
    """

    def __init__(self, config: ModemConfig, address: int, record: Record | None = None) -> None:
        """Creates the driver of the modem that gets `address` (1 to 127, the vehicle's number).

        Args:
            record: Receives every input and output, for a line log; times then have its resolution of 1 us.

        Raises:
            ValueError: if the address is out of range.
        """
        if not 1 <= address <= 127:
            raise ValueError(f"modem address {address} is not from 1 to 127 (0 is everyone)")
        self.address = address
        self._record = record
        self.reader = SentenceReader()
        self.ignored = TypeCounts()
        self._session = Session(config, address)
        self._clock = ClockCheck(self._session)
        self._configuration = Configuration(self._session, self._clock)
        self._sending = Sending(self._session)
        self._pinging = Pinging(self._session)
        self._receiving = Receiving(self._session, self._clock)
        self.handlers: dict[type[Any], Callable[[Any], None]] = {
            status.Revision: self._on_revision,
            status.Setting: self._on_setting,
            status.Notice: self._on_notice,
            status.ErrorReport: self._on_error,
            status.ClockTime: self._clock.on_time,
            status.ClockSet: self._clock.on_set,
            tx.Cycle: self._on_cycle,
            tx.DataRequest: self._sending.on_request,
            tx.FrameTaken: self._sending.on_taken,
            tx.TransmitStart: self._sending.on_start,
            tx.TransmitEnd: self._sending.on_end,
            tx.TransmitStatistics: self._sending.on_statistics,
            ping.PingEcho: self._pinging.on_echo,
            ping.PingHeard: self._pinging.on_heard,
            ping.PingReply: self._pinging.on_reply,
            rx.ReceptionStart: self._receiving.on_start,
            rx.Detection: self._receiving.on_detection,
            rx.FrameHeard: self._receiving.on_frame,
            rx.ReceptionStatistics: self._receiving.on_statistics,
        }

    # ------------------------------------------------------------------ calls of the owner

    def opened(self, now_s: float) -> None:
        """The port is open: configures the modem."""
        session = self._session
        self._begin(now_s, "opened")
        self.reader.reset()
        session.wants_reopen = False
        session.strikes = 0
        self._configuration.rebooting = False
        session.counts["connections"] += 1
        session.move(Cause.OPENED)
        self._configuration.begin()

    def closed(self, now_s: float, reason: str) -> None:
        """The port is closed, or could not be read: drops transmissions, pings and receptions in progress."""
        session = self._session
        self._begin(now_s, f"closed {reason}")
        if self.is_open:
            session.report(ModemLost(reason=reason))
        self._sending.fail(f"connection lost: {reason}")
        self._pinging.fail(f"connection lost: {reason}")
        session.take_outgoing()
        self._receiving.close("connection lost")
        self._clock.reset()
        session.wants_reopen = False
        session.move(Cause.CLOSED)

    def send(self, now_s: float, payload: bytes, destination: int | None = None) -> int:
        """Queues a packet; returns its number, which the events about it carry.

        Args:
            payload: Its bytes, at most as many as one packet holds at the configured rate.
            destination: Modem address; None: `modem.destination`.

        Raises:
            ValueError: if the payload is empty or does not fit one packet at the configured rate.
        """
        self._begin(now_s, f"send {'-' if destination is None else destination} {payload.hex()}")
        return self._sending.ask(payload, destination)

    def ping(self, now_s: float, destination: int) -> int:
        """Pings another modem, for its distance; returns the ping's number, which the events about it carry.

        Raises:
            ValueError: if `destination` is not another modem's address.
        """
        self._begin(now_s, f"ping {destination}")
        return self._pinging.ask(destination, free=not self._sending.waiting)

    def receive(self, now_s: float, data: bytes) -> None:
        """Processes bytes from the modem."""
        session = self._session
        self._begin(now_s)
        self._record_lines(FROM_MODEM, data)
        if not self.is_open:
            session.counts["bytes_while_closed"] += len(data)
            return
        for sentence in self.reader.feed(data):
            session.strikes = 0
            try:
                message = read_message(sentence)
            except SentenceError as error:
                session.counts["bad_fields"] += 1
                session.report(Problem(text=str(error)))
                continue
            if message is None:
                self.ignored.add(sentence.type)
                continue
            self.handlers[type(message)](message)
            self._sending.begin()

    def poll(self, now_s: float) -> None:
        """Lets time pass: timeouts, repeats, clock checks. Call at least ten times a second, or once per tick."""
        before = self.activity
        self._begin(now_s)
        self._advance()
        if self._record is not None and self.activity != before:  # polls without effect are omitted
            self._record(self._session.now_s, CALL, b"poll")

    def _advance(self) -> None:
        if not self.is_open:
            self._sending.drop_late("no modem")
            return
        self._receiving.poll()
        self._sending.poll()
        self._pinging.poll()
        if self.state is State.CONFIGURING:
            self._configuration.poll()
        else:
            self._clock.poll()
        self._sending.begin()

    def outgoing(self) -> bytes:
        """The bytes to write to the modem now; each is returned once."""
        data = self._session.take_outgoing()
        self._record_lines(TO_MODEM, data)
        return data

    def events(self) -> list[Event]:
        """The events since the last call."""
        return self._session.take_events()

    def _begin(self, now_s: float, call: str = "") -> None:
        """Advances to the time of a call, and records the call."""
        if self._record is not None:
            now_s = round(now_s, 6)
            if math.isinf(self._session.now_s):
                self._record(now_s, CALL, f"address {self.address}".encode("ascii"))
            if call:
                self._record(now_s, CALL, call.encode("ascii", "backslashreplace"))
        self._session.tick(now_s)

    def _record_lines(self, kind: str, data: bytes) -> None:
        if self._record is not None:
            for line in data.splitlines(keepends=True):
                self._record(self._session.now_s, kind, line)

    # ------------------------------------------------------------------ what the owner can read

    @property
    def state(self) -> State:
        """The driver's state."""
        return self._session.state

    @property
    def version(self) -> str:
        """The modem's firmware, "" until it has reported it."""
        return self._session.version

    @property
    def counts(self) -> Counter[str]:
        """Counts by name: transmissions, receptions, errors by kind, repeats, reboots."""
        return self._session.counts

    @property
    def wants_reopen(self) -> bool:
        """The modem does not answer: close the port, open it again, and call `closed` and `opened`."""
        return self._session.wants_reopen

    @property
    def activity(self) -> tuple[object, ...]:
        """Changes whenever a call has had an effect: it wrote, reported, or started or ended a wait."""
        return (self._clock.step, self._configuration.rebooting, *self._session.activity)

    @property
    def is_open(self) -> bool:
        """Whether the owner has called `opened`, and not `closed` since."""
        return self.state is not State.CLOSED

    @property
    def quiet(self) -> bool:
        """Whether no immediate answer of the modem is pending (so a lockstep tick may end)."""
        if self._clock.step is not ClockStep.REST:
            return False
        return self.state in (State.SENDING, State.PINGING) or (self.state is State.IDLE and not self._sending.waiting)

    # ------------------------------------------------------------------ messages that concern several parts

    def _reboot(self, why: str) -> None:
        session = self._session
        session.counts["reboots"] += 1
        session.report(ModemLost(reason=why))
        self._sending.fail(why)
        self._pinging.fail(why)
        self._receiving.close(why)
        session.move(Cause.REBOOTED)
        self._configuration.begin()

    def _on_revision(self, message: status.Revision) -> None:
        configuration = self._configuration
        if message.ident == "INIT":
            if self.state is State.CONFIGURING and configuration.rebooting:
                self._session.start("reboot")
                return
            configuration.rebooting = True
            self._reboot("the modem rebooted")
        elif message.ident == "AUV":
            self._session.version = message.version
            if configuration.rebooting:
                configuration.rebooting = False
                configuration.write()

    def _on_setting(self, message: status.Setting) -> None:
        if self.state is State.CONFIGURING and not self._configuration.rebooting:
            self._configuration.answer(message)
        elif message.name == "SRC" and message.value != str(self.address):
            self._reboot(f"the modem's address is {message.value}, not {self.address}: it has rebooted")

    def _on_cycle(self, message: tx.Cycle) -> None:
        if message.source == self.address:
            self._sending.on_echo()
        else:
            self._receiving.on_cycle(message)

    def _on_notice(self, message: status.Notice) -> None:
        self.counts[f"notice: {message.kind if message.kind in NOTICES else 'other'}"] += 1
        if message.kind == "BAD_CRC":
            self._receiving.on_bad_frame()
        elif message.kind == "PACKET_TIMEOUT":
            self._receiving.extend()  # its statistics follow and close it
        else:
            self._session.report(Problem(text=f"modem: {message.kind} {message.detail}".rstrip()))

    def _on_error(self, message: status.ErrorReport) -> None:
        self.counts[f"error: {message.module if message.module in MODULES else 'other'}"] += 1
        text = f"{message.module} {message.number} {message.detail}".rstrip()
        if message.module == "DATA_TIMEOUT":
            if self.state in TRANSMITTING:
                self._sending.abort(f"data timeout at frame {message.number}")
            return  # outside a transmission: the response to a packet that was dropped as too late
        # NMEA: the modem did not understand our last command
        if message.module == "NMEA" and self.state is State.CONFIGURING and not self._configuration.rebooting:
            self._configuration.refuse(text)
            return
        if message.module == "NMEA" and self.state is State.PINGING:
            self._pinging.abort(f"refused by the modem: {text}")
            return
        if message.module == "NMEA" and self.state in STARTING:
            self._sending.abort(f"refused by the modem: {text}")
            return
        self._session.report(Problem(text=f"modem error: {text}"))
        if message.module == "NMEA":
            self._clock.on_refused()
