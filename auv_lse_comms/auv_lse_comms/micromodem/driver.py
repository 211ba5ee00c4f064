"""Driver of a WHOI Micromodem-2: a state machine from bytes and times to bytes and events. It opens no port.

Theory of operation
-------------------
The shell (a node) tells the driver what happens: `opened`, `closed`, `receive` (bytes from the modem), `send` (a
packet to transmit) and, often, `poll` (time passes); after each it takes `outgoing` (bytes to write) and `events`.
Every call carries `now_s`, the host's clock, s since 1970 (UTC, or simulated): it times the waits, is what the
modem's clock is compared with, and may be stepped: after a step back every running wait starts anew.

A fresh connection, or a modem that says it has rebooted (or whose address is suddenly another), is configured
setting by setting, each sent when the one before is confirmed; then its clock is checked, set if it is off, and
checked again. Only then are packets sent. One transmission is one cycle of sentences:

    host                              modem
    $CCCYC,0,src,dest,rate,0,frames   $CACYC (echo)
                                      $CADRQ (give me a frame)        once per frame
    $CCTXD (frame)                    $CATXD (taken)
                                      $CATXP (transducer on) ... $CATXF (off), $CAXST (statistics)

A packet that has not begun `start_timeout_s` after it was asked for is dropped, because its TDMA slot has gone:
a late $CADRQ is then left unanswered, and the modem gives up by itself ($CAERR,...,DATA_TIMEOUT). One packet can
wait while the modem is busy; a second one is refused. Every `send` is answered by exactly one `TransmitStarted` or
`TransmitFailed`, and every `TransmitStarted` by exactly one `TransmitDone` or `TransmitFailed`.

Receptions run beside this: $CARXP or $CACYC opens one, $CARXD adds frames, $CAMSG,BAD_CRC a bad one, and $CACST
closes it. Lost lines are lived with: a reception whose $CACST never came is closed by the next one or by time.

Commands without an answer are repeated; after `retries` the driver asks for the connection to be made anew
(`wants_reopen`). Any sentence that passes its checksum proves the modem alive. The clock and the modem's address
are asked for every `clock_period_s`, so silence and missed reboots are noticed.

Transitions (`TRANSITIONS` below; another move raises RuntimeError, as it is a bug here, not in the modem)
--------------------------------------------------------------------------------------------------------
    state        cause       next
    CLOSED       OPENED      CONFIGURING
    CONFIGURING  CONFIGURED  CLOCK         every setting is confirmed, or refused and not vital
    CLOCK        CLOCKED     IDLE          clock right, or set, or given up on (and reported)
    IDLE         SEND        CYCLING       $CCCYC written
    CYCLING      ECHO        REQUESTING    $CACYC with our address
    CYCLING      REQUEST     GIVING        the echo's line was lost; $CCTXD written
    REQUESTING   REQUEST     GIVING        $CADRQ; $CCTXD written
    GIVING       REQUEST     GIVING        $CADRQ for the next frame; $CCTXD written
    GIVING       STARTED     SENDING       $CATXP
    GIVING       FINISHED    IDLE          $CATXF: the line of $CATXP was lost
    SENDING      FINISHED    IDLE          $CATXF
    CYCLING, REQUESTING, GIVING, SENDING
                 FAILED      IDLE          refused, data timeout, or too late
    any but CLOSED
                 REBOOTED    CONFIGURING   $CAREV,..,INIT, or the modem's address is not ours
    any          CLOSED      CLOSED
"""

from __future__ import annotations

import enum
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from auv_lse_comms.micromodem import sentences as nmea
from auv_lse_comms.micromodem.config import PAYLOAD_BYTES, ModemConfig

#: $CCTMS carries whole seconds: it is written this soon after one begins (s) ...
SECOND_START_S = 0.1
#: ... or, when the driver is polled too seldom to hit that, after waiting so long (s).
SECOND_WAIT_S = 3.0
#: Tries at setting the clock before it is reported and left.
CLOCK_TRIES = 3
#: A modem that has said INIT is left alone until it says AUV, or for so long (s).
REBOOT_WAIT_S = 2.0
#: A time of arrival on the modem's clock is believed if the packet's end by it is within this of the host's clock (s).
ARRIVAL_WINDOW_S = 5.0


class State(enum.Enum):
    """Where the driver is with its modem."""

    CLOSED = "closed"
    CONFIGURING = "configuring"
    CLOCK = "clock"
    IDLE = "idle"
    CYCLING = "cycling"
    REQUESTING = "requesting"
    GIVING = "giving"
    SENDING = "sending"


class Cause(enum.Enum):
    """What moves the driver from state to state."""

    OPENED = "opened"
    CLOSED = "closed"
    CONFIGURED = "configured"
    CLOCKED = "clocked"
    SEND = "send"
    ECHO = "echo"
    REQUEST = "request"
    STARTED = "started"
    FINISHED = "finished"
    FAILED = "failed"
    REBOOTED = "rebooted"


TRANSITIONS: dict[tuple[State, Cause], State] = {
    (State.CLOSED, Cause.OPENED): State.CONFIGURING,
    (State.CONFIGURING, Cause.CONFIGURED): State.CLOCK,
    (State.CLOCK, Cause.CLOCKED): State.IDLE,
    (State.IDLE, Cause.SEND): State.CYCLING,
    (State.CYCLING, Cause.ECHO): State.REQUESTING,
    (State.CYCLING, Cause.REQUEST): State.GIVING,
    (State.REQUESTING, Cause.REQUEST): State.GIVING,
    (State.GIVING, Cause.REQUEST): State.GIVING,
    (State.GIVING, Cause.STARTED): State.SENDING,
    (State.GIVING, Cause.FINISHED): State.IDLE,
    (State.SENDING, Cause.FINISHED): State.IDLE,
    **{(state, Cause.FAILED): State.IDLE for state in (State.CYCLING, State.REQUESTING, State.GIVING, State.SENDING)},
    **{(state, Cause.REBOOTED): State.CONFIGURING for state in State if state is not State.CLOSED},
    **{(state, Cause.CLOSED): State.CLOSED for state in State},
}

#: States in which a packet is in the modem's hands or on its way there.
TRANSMITTING = (State.CYCLING, State.REQUESTING, State.GIVING, State.SENDING)


# ----------------------------------------------------------------------------------------------- events


@dataclass(frozen=True, slots=True, kw_only=True)
class ModemReady:
    """The modem is configured and its clock checked: packets can be sent. `version` is its firmware's."""

    version: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ModemLost:
    """The connection is closed, or the modem has rebooted: nothing can be sent until `ModemReady`."""

    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockChecked:
    """The modem's clock was read. `offset_s`: modem less host, 0 within the reading's resolution."""

    offset_s: float
    within_tolerance: bool
    source: str
    pps: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitStarted:
    """A packet is going out: the transducer is on."""

    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitDone:
    """A packet has gone out."""

    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitFailed:
    """A packet was not sent, or (after `TransmitStarted`) its end was never reported."""

    number: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PacketReceived:
    """A packet was received whole.

    Attributes:
        utc_s: End of its reception, s since 1970: by the modem's clock to 0.1 ms where that is right, else the
            host's when it was reported.
        snr_db: At the equalizer's input, dB; NaN if its statistics were lost.
        travel_s: One-way travel time, s; NaN unless transmissions start on the second (`modem.synchronous`) and the
            modem's clock is held by a PPS; ambiguous by whole seconds (1.5 km of water each).
    """

    utc_s: float
    source: int
    destination: int
    payload: bytes
    snr_db: float
    travel_s: float
    rate: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceptionFailed:
    """Something was heard that made no packet."""

    reason: str
    snr_db: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """Something an operator should read: a setting refused, an error sentence, a clock that cannot be set."""

    text: str


Event = (
    ModemReady
    | ModemLost
    | ClockChecked
    | TransmitStarted
    | TransmitDone
    | TransmitFailed
    | PacketReceived
    | ReceptionFailed
    | Problem
)


# ----------------------------------------------------------------------------------------------- driver


class _Clock(enum.Enum):
    """Steps of a clock check, which runs beside the states."""

    REST = "rest"
    ASKED = "asked"
    WAITING = "waiting"
    SETTING = "setting"


@dataclass(slots=True)
class _Packet:
    number: int
    destination: int
    frames: tuple[bytes, ...]
    given: int = 0


@dataclass(slots=True)
class _Reception:
    cycle: nmea.Cycle | None = None
    frames: dict[int, nmea.FrameHeard] = field(default_factory=dict)
    bad: int = 0


class Micromodem:
    """Drives one Micromodem-2; see the module's text for how.

    Attributes:
        state: Where it is.
        version: The modem's firmware, "" until it has said it.
        counts: What happened, by name: transmissions, receptions, troubles by kind, repeats, reboots.
        reader: Cuts the lines; `reader.counts` tells what the wire did to them.
        ignored: Sentences the driver has no use for, by type.
        wants_reopen: The modem does not answer: close the port, open it again, and say so.
    """

    def __init__(self, config: ModemConfig, address: int) -> None:
        """For the modem that will have `address` (1 to 127, the vehicle's number).

        Raises:
            ValueError: if the address cannot be one.
        """
        if not 1 <= address <= 127:
            raise ValueError(f"modem address: got {address}; expected 1 to 127 (0 is everyone)")
        self.address = address
        self.state = State.CLOSED
        self.version = ""
        self.counts: Counter[str] = Counter()
        self.reader = nmea.SentenceReader()
        self.ignored = nmea.TypeCounts()
        self.wants_reopen = False
        self._config = config
        self._settings: tuple[tuple[nmea.Setting, bool], ...] = tuple(
            (nmea.Setting(name=name, value=value), vital)
            for name, value, vital in (
                ("SRC", str(address), True),  # own address
                ("CST", "1", True),  # receive statistics, the end of every reception
                ("RXP", "1", False),  # say when a reception starts
                ("REV", "1", False),  # say the revision now and then
                ("XST", "1", False),  # transmit statistics
                ("MFD", "1", False),  # say what the matched filter detected
                ("ASD", "0", False),  # never send test data of its own when the host is late
                ("SNV", str(int(config.synchronous)), False),  # start transmissions on the second
            )
        )
        self._setting = 0
        self._tries = 0
        self._strikes = 0
        self._rebooting = False
        self._clock = _Clock.REST
        self._clock_tries = 0
        self._clock_right = False
        self._numbers = 0
        self._current: _Packet | None = None
        self._waiting: _Packet | None = None
        self._reception: _Reception | None = None
        self._now_s = -math.inf
        self._since_s: dict[str, float] = {}
        self._out = bytearray()
        self._events: list[Event] = []

    # ------------------------------------------------------------------ what the shell says

    def opened(self, now_s: float) -> None:
        """The port is open: configures the modem."""
        self._tick(now_s)
        self.reader.reset()
        self.wants_reopen = False
        self._strikes = 0
        self._rebooting = False
        self.counts["connections"] += 1
        self._move(Cause.OPENED)
        self._configure()

    def closed(self, now_s: float, reason: str) -> None:
        """The port is closed, or could not be read: drops what was on the way."""
        self._tick(now_s)
        if self.state is not State.CLOSED:
            self._events.append(ModemLost(reason=reason))
        self._fail_current(f"connection lost: {reason}")
        self._out.clear()
        self._close_reception("connection lost")
        self._clock = _Clock.REST
        self._clock_right = False
        self.wants_reopen = False
        self._move(Cause.CLOSED)

    def send(self, now_s: float, payload: bytes, destination: int | None = None) -> int:
        """Asks for a packet to be transmitted; returns its number, which the events about it carry.

        Raises:
            ValueError: if the payload is empty or does not fit one packet at the configured rate.
        """
        self._tick(now_s)
        rate = nmea.RATES[self._config.rate]
        if not 1 <= len(payload) <= rate.frames * rate.frame_bytes:
            raise ValueError(
                f"payload: got {len(payload)} bytes; expected 1 to {rate.frames * rate.frame_bytes} at rate "
                f"{self._config.rate} ({rate.frames} frames of {rate.frame_bytes})"
            )
        self._numbers += 1
        packet = _Packet(
            number=self._numbers,
            destination=self._config.destination if destination is None else destination,
            frames=tuple(payload[i : i + rate.frame_bytes] for i in range(0, len(payload), rate.frame_bytes)),
        )
        self.counts["asked"] += 1
        if self._waiting is not None:
            self._report_failure(packet.number, "busy: another packet is waiting")
        else:
            self._waiting = packet
            self._start("waiting")
            self._begin_waiting()
        return packet.number

    def receive(self, now_s: float, data: bytes) -> None:
        """Takes bytes that came from the modem."""
        self._tick(now_s)
        if self.state is State.CLOSED:
            self.counts["bytes_while_closed"] += len(data)
            return
        for sentence in self.reader.feed(data):
            self._strikes = 0
            try:
                message = nmea.read_message(sentence)
            except nmea.SentenceError as error:
                self.counts["bad_fields"] += 1
                self._events.append(Problem(text=str(error)))
                continue
            if message is None:
                self.ignored.add(sentence.type)
                continue
            HANDLERS[type(message)](self, message)
            self._begin_waiting()

    def poll(self, now_s: float) -> None:
        """Lets time pass: repeats, gives up, checks the clock. Call at least ten times a second, or once a tick."""
        self._tick(now_s)
        if self.state is State.CLOSED:
            self._drop_late_packet("no modem")
            return
        self._poll_reception()
        self._poll_packet()
        if self.state is State.CONFIGURING:
            self._poll_configuring()
        else:
            self._poll_clock()
        self._begin_waiting()

    def outgoing(self) -> bytes:
        """The bytes to write to the modem now; they are handed out once."""
        data = bytes(self._out)
        self._out.clear()
        return data

    def events(self) -> list[Event]:
        """What has happened since the last call."""
        events, self._events = self._events, []
        return events

    @property
    def activity(self) -> tuple[object, ...]:
        """Changes whenever a call has done anything: written, told, started or ended a wait."""
        waits = tuple(self._since_s.values())
        return (self.state, self._clock, self._rebooting, len(self._out), len(self._events), self._strikes, waits)

    @property
    def is_open(self) -> bool:
        """The shell has said `opened`, and not `closed` since."""
        return self.state is not State.CLOSED

    @property
    def quiet(self) -> bool:
        """No answer of the modem is awaited that would come at once (so a lockstep tick may end)."""
        at_rest = self.state in (State.IDLE, State.SENDING)
        return at_rest and (self._waiting is None or self.state is State.SENDING) and self._clock is _Clock.REST

    # ------------------------------------------------------------------ states and waits

    def _move(self, cause: Cause) -> None:
        try:
            self.state = TRANSITIONS[self.state, cause]
        except KeyError:
            raise RuntimeError(f"no transition from {self.state.name} by {cause.name}") from None

    def _tick(self, now_s: float) -> None:
        if now_s < self._now_s:  # the clock was stepped back: every running wait starts anew
            self.counts["clock_steps"] += 1
            self._since_s = dict.fromkeys(self._since_s, now_s)
        self._now_s = now_s

    def _start(self, wait: str) -> None:
        self._since_s[wait] = self._now_s

    def _waited_s(self, wait: str) -> float:
        return self._now_s - self._since_s.get(wait, self._now_s)

    def _write(self, sentence: nmea.Sentence) -> None:
        self._out += sentence.encode()

    def _strike(self) -> None:
        """An answer has not come in time."""
        self._strikes += 1
        self.counts["unanswered"] += 1
        if self._strikes > self._config.retries and not self.wants_reopen:
            self.wants_reopen = True
            self.counts["given_up"] += 1
            self._events.append(Problem(text=f"no answer from the modem to {self._strikes} commands: reopening"))

    # ------------------------------------------------------------------ configuration

    def _configure(self) -> None:
        self._setting = 0
        self._tries = 0
        self._clock = _Clock.REST
        self._clock_right = False
        if self._rebooting:
            self._start("reboot")
        else:
            self._write_setting()

    def _write_setting(self) -> None:
        self._write(self._settings[self._setting][0].command())
        self._start("setting")

    def _next_setting(self) -> None:
        self._setting += 1
        self._tries = 0
        if self._setting < len(self._settings):
            self._write_setting()
            return
        self._move(Cause.CONFIGURED)
        self.counts["configured"] += 1
        self._ask_clock(new=True)

    def _setting_refused(self, why: str) -> None:
        setting, vital = self._settings[self._setting]
        self._tries += 1
        if self._tries <= self._config.retries and vital:
            self._write_setting()
            return
        self.counts["settings_refused"] += 1
        self._events.append(Problem(text=f"the modem does not take {setting.name},{setting.value}: {why}"))
        if not vital:
            self._next_setting()
            return
        self._start("setting")  # asked again when this wait is over
        self._tries = 0

    def _poll_configuring(self) -> None:
        if self._rebooting:
            if self._waited_s("reboot") >= REBOOT_WAIT_S:
                self._rebooting = False
                self._write_setting()
        elif self._waited_s("setting") >= self._config.reply_timeout_s:
            self._strike()
            self._write_setting()

    def _reboot(self, why: str) -> None:
        self.counts["reboots"] += 1
        self._events.append(ModemLost(reason=why))
        self._fail_current(why)
        self._close_reception(why)
        self._move(Cause.REBOOTED)
        self._configure()

    # ------------------------------------------------------------------ clock

    def _ask_clock(self, new: bool) -> None:
        if new:
            self._clock_tries = 0
        self._clock = _Clock.ASKED
        self._start("clock")
        self._start("clock_period")
        self._write(nmea.Sentence("CCTMQ", ("0",)))

    def _clock_over(self) -> None:
        self._clock = _Clock.REST
        self._start("clock_period")
        if self.state is State.CLOCK:
            self._move(Cause.CLOCKED)
            self._events.append(ModemReady(version=self.version))

    def _poll_clock(self) -> None:
        if self._clock is _Clock.REST:
            if self.state is State.IDLE and self._waited_s("clock_period") >= self._config.clock_period_s:
                self._write(nmea.Sentence("CCCFQ", ("SRC",)))  # is it still ours? If not, it has rebooted unheard
                self._ask_clock(new=True)
        elif self._clock is _Clock.WAITING:
            fraction_s = self._now_s - math.floor(self._now_s)
            if fraction_s <= SECOND_START_S or self._waited_s("clock") >= SECOND_WAIT_S:
                self._clock = _Clock.SETTING
                self._start("clock")
                self._write(nmea.Sentence("CCTMS", (nmea.iso_time(round(self._now_s)), "0")))
        elif self._waited_s("clock") >= self._config.reply_timeout_s:
            self._strike()
            self._clock_tries += 1
            if self._clock_tries < CLOCK_TRIES:
                self._ask_clock(new=False)
            else:
                self._events.append(Problem(text="the modem does not answer about its clock"))
                self._clock_over()

    def _on_clock_time(self, message: nmea.ClockTime) -> None:
        if self._clock is not _Clock.ASKED:
            return
        early_s = message.utc_s - self._now_s
        late_s = self._now_s - (message.utc_s + message.resolution_s)
        offset_s = early_s if early_s > 0.0 else -late_s if late_s > 0.0 else 0.0
        self._clock_right = abs(offset_s) <= self._config.clock_tolerance_s
        self._events.append(
            ClockChecked(offset_s=offset_s, within_tolerance=self._clock_right, source=message.source, pps=message.pps)
        )
        self._clock_tries += 1
        # a time of arrival counts as synchronous only if the clock was set from outside, right as it may be
        unset = self._config.synchronous and message.source in ("NONE", "RTC")
        if (self._clock_right and not unset) or not self._config.set_clock or self._clock_tries > CLOCK_TRIES:
            if not self._clock_right:
                self.counts["clock_off"] += 1
                self._events.append(Problem(text=f"the modem's clock is {offset_s:+.1f} s off the host's"))
            self._clock_over()
        else:
            self._clock = _Clock.WAITING
            self._start("clock")
            self._poll_clock()

    def _on_clock_set(self, message: nmea.ClockSet) -> None:
        if self._clock is not _Clock.SETTING:
            return
        self.counts["clock_timed_out" if message.timed_out else "clock_set"] += 1
        self._ask_clock(new=False)

    # ------------------------------------------------------------------ transmission

    def _begin_waiting(self) -> None:
        if self.state is not State.IDLE or self._waiting is None:
            return
        self._current, self._waiting = self._waiting, None
        self._since_s["packet"] = self._since_s["waiting"]
        self._move(Cause.SEND)
        self._write(
            nmea.Cycle(
                source=self.address,
                destination=self._current.destination,
                rate=self._config.rate,
                ack=False,
                frames=len(self._current.frames),
            ).initiate()
        )

    def _drop_late_packet(self, why: str) -> None:
        if self._waiting is not None and self._waited_s("waiting") >= self._config.start_timeout_s:
            packet, self._waiting = self._waiting, None
            self._report_failure(packet.number, f"too late: {why} for {self._config.start_timeout_s:g} s")

    def _poll_packet(self) -> None:
        self._drop_late_packet(f"modem {self.state.value}")
        if self.state in (State.CYCLING, State.REQUESTING, State.GIVING):
            if self._waited_s("packet") >= self._config.start_timeout_s:
                if self.state is State.CYCLING:
                    self._strike()
                self._fail_current(f"too late: not begun within {self._config.start_timeout_s:g} s")
                self._move(Cause.FAILED)
        elif self.state is State.SENDING and self._waited_s("sending") >= self._config.transmit_timeout_s:
            self._fail_current(f"its end was not reported within {self._config.transmit_timeout_s:g} s")
            self._move(Cause.FAILED)

    def _report_failure(self, number: int, reason: str) -> None:
        self.counts["failed"] += 1
        self._events.append(TransmitFailed(number=number, reason=reason))

    def _fail_current(self, reason: str) -> None:
        if self._current is not None:
            packet, self._current = self._current, None
            self._report_failure(packet.number, reason)

    def _abort(self, reason: str) -> None:
        """The modem says that the packet in its hands will not be sent."""
        if self.state in TRANSMITTING:
            self._fail_current(reason)
            self._move(Cause.FAILED)

    def _on_request(self, message: nmea.DataRequest) -> None:
        packet = self._current
        states = (State.CYCLING, State.REQUESTING, State.GIVING)
        if packet is None or self.state not in states or message.source != self.address:
            self.counts["unasked_requests"] += 1
            return
        if message.frame > len(packet.frames):
            self._abort(f"the modem asks for frame {message.frame} of {len(packet.frames)}")
            return
        data = packet.frames[message.frame - 1]
        if len(data) > message.max_bytes:
            self._abort(f"the modem takes {message.max_bytes} bytes, the frame has {len(data)}")
            return
        self._move(Cause.REQUEST)
        self._write(
            nmea.FrameGiven(source=self.address, destination=packet.destination, ack=message.ack, data=data).sentence()
        )

    def _on_frame_taken(self, message: nmea.FrameTaken) -> None:
        packet = self._current
        if packet is None or self.state is not State.GIVING:
            return
        packet.given += 1
        # the count says what arrived over the wire; a wrong one means that another packet would go out
        expected = len(packet.frames[min(packet.given, len(packet.frames)) - 1])
        if message.count != expected:
            self.counts["short_frames"] += 1
            self._events.append(Problem(text=f"the modem took {message.count} of the frame's {expected} bytes"))

    def _on_transmit_start(self, message: nmea.TransmitStart) -> None:
        if self._current is None or self.state is not State.GIVING:
            self.counts["unasked_transmissions"] += 1
            return
        self._started()

    def _started(self) -> None:
        assert self._current is not None
        self._move(Cause.STARTED)
        self._start("sending")
        self.counts["started"] += 1
        self._events.append(TransmitStarted(number=self._current.number))

    def _on_transmit_end(self, message: nmea.TransmitEnd) -> None:
        if self._current is None or self.state not in (State.GIVING, State.SENDING):
            return
        if self.state is State.GIVING:  # the line that said the start was lost
            self._started()
        packet, self._current = self._current, None
        self._move(Cause.FINISHED)
        self.counts["sent"] += 1
        self._events.append(TransmitDone(number=packet.number))

    def _on_transmit_statistics(self, message: nmea.TransmitStatistics) -> None:
        if message.mode == 4:
            self._abort("data timeout (CAXST)")

    # ------------------------------------------------------------------ reception

    def _open_reception(self) -> _Reception:
        if self._reception is None:
            self._reception = _Reception()
        self._start("reception")
        return self._reception

    def _on_cycle(self, message: nmea.Cycle) -> None:
        if message.source == self.address:
            if self.state is State.CYCLING:
                self._move(Cause.ECHO)
            return
        if self._reception is not None and (self._reception.cycle is not None or self._reception.frames):
            self._close_reception("another packet began")
        self._open_reception().cycle = message

    def _on_reception_start(self, message: nmea.ReceptionStart) -> None:
        if self._reception is not None and (self._reception.frames or self._reception.bad):
            self._close_reception("another packet began")
        self._open_reception()

    def _on_detection(self, message: nmea.Detection) -> None:
        if self._reception is not None:
            self._start("reception")

    def _on_frame_heard(self, message: nmea.FrameHeard) -> None:
        reception = self._open_reception()
        if any(frame.source != message.source for frame in reception.frames.values()):
            self._close_reception("another packet began")
            reception = self._open_reception()
        if message.frame in reception.frames:
            self.counts["repeated_frames"] += 1
        reception.frames[message.frame] = message

    def _on_reception_statistics(self, message: nmea.ReceptionStatistics) -> None:
        reception = self._reception
        if (
            reception is not None
            and reception.cycle is not None
            and reception.cycle.rate == 0
            and not reception.frames
            and message.mode == nmea.MODE_GOOD
        ):
            return  # FSK: these belong to the mini-packet that announces the data; the data's own follow
        self._close_reception("no frame was received", message)

    def _poll_reception(self) -> None:
        if self._reception is not None and self._waited_s("reception") >= self._config.receive_timeout_s:
            self._close_reception("timed out")

    def _close_reception(self, why: str, statistics: nmea.ReceptionStatistics | None = None) -> None:
        reception, self._reception = self._reception, None
        if reception is None:
            if statistics is None:
                return
            reception = _Reception()
        snr_db = statistics.snr_in_db if statistics is not None else math.nan
        problem = self._judge(reception, why, statistics)
        if problem:
            self.counts["receptions_failed"] += 1
            self.counts[f"receptions_failed: {problem}"] += 1
            self._events.append(ReceptionFailed(reason=problem, snr_db=snr_db))
            return
        frames = [reception.frames[number] for number in sorted(reception.frames)]
        destination = frames[0].destination
        if destination not in (nmea.BROADCAST, self.address):
            self.counts["not_for_us"] += 1
            return
        payload = b"".join(frame.data for frame in frames)
        if len(payload) > PAYLOAD_BYTES and not any(payload[PAYLOAD_BYTES:]):
            payload = payload[:PAYLOAD_BYTES]  # some firmware fills the frame up with zeros
        if statistics is None:
            self.counts["receptions_without_statistics"] += 1
        rate = statistics.rate if statistics is not None else reception.cycle.rate if reception.cycle else -1
        self.counts["received"] += 1
        self._events.append(
            PacketReceived(
                utc_s=self._end_of_reception_s(statistics, len(payload)),
                source=frames[0].source,
                destination=destination,
                payload=payload,
                snr_db=snr_db,
                travel_s=self._travel_s(statistics),
                rate=rate,
            )
        )

    def _judge(self, reception: _Reception, why: str, statistics: nmea.ReceptionStatistics | None) -> str:
        """Why the reception made no packet, "" if it did."""
        if statistics is not None and statistics.mode == nmea.MODE_PACKET_TIMEOUT:
            return "packet timeout"
        if reception.bad or (statistics is not None and (statistics.mode != nmea.MODE_GOOD or statistics.bad_frames)):
            return "bad CRC"
        if not reception.frames:
            return why
        expected = max(
            statistics.frames if statistics is not None else 0,
            reception.cycle.frames if reception.cycle is not None else 0,
            max(reception.frames),
        )
        if len(reception.frames) < expected:
            return "frames missing"
        return ""

    def _end_of_reception_s(self, statistics: nmea.ReceptionStatistics | None, count: int) -> float:
        if statistics is None or not self._clock_right or statistics.rate not in nmea.RATES:
            return self._now_s
        end_s = statistics.utc_s + nmea.packet_duration_s(statistics.rate, count)
        return round(end_s, 4) if abs(end_s - self._now_s) <= ARRIVAL_WINDOW_S else self._now_s

    def _travel_s(self, statistics: nmea.ReceptionStatistics | None) -> float:
        if statistics is None or not self._config.synchronous or not nmea.clock_is_synchronous(statistics.clock):
            return math.nan
        return statistics.utc_s - math.floor(statistics.utc_s)

    # ------------------------------------------------------------------ settings, revisions, errors

    def _on_setting(self, message: nmea.Setting) -> None:
        if self.state is State.CONFIGURING and not self._rebooting:
            setting, _ = self._settings[self._setting]
            if message.name != setting.name:
                return
            if message.value == setting.value:
                self._next_setting()
            else:
                self._setting_refused(f"it answers {message.value!r}")
        elif message.name == "SRC" and message.value != str(self.address):
            self._reboot(f"the modem's address is {message.value}, not {self.address}: it must have rebooted")

    def _on_revision(self, message: nmea.Revision) -> None:
        if message.ident == "INIT":
            if self.state is State.CONFIGURING and self._rebooting:
                self._start("reboot")
                return
            self._rebooting = True
            self._reboot("the modem rebooted")
        elif message.ident == "AUV":
            self.version = message.version
            if self._rebooting:
                self._rebooting = False
                self._write_setting()

    def _on_notice(self, message: nmea.Notice) -> None:
        self.counts[f"notice: {_known(message.kind, NOTICES)}"] += 1
        if message.kind == "BAD_CRC":
            self._open_reception().bad += 1
        elif message.kind == "PACKET_TIMEOUT":
            if self._config.receive_timeout_s and self._reception is not None:
                self._start("reception")  # its statistics follow and close it
        else:
            self._events.append(Problem(text=f"modem: {message.kind} {message.detail}".rstrip()))

    def _on_trouble(self, message: nmea.Trouble) -> None:
        self.counts[f"error: {_known(message.module, MODULES)}"] += 1
        text = f"{message.module} {message.number} {message.detail}".rstrip()
        if message.module == "DATA_TIMEOUT":
            if self.state in TRANSMITTING:
                self._abort(f"data timeout at frame {message.number}")
            return  # else: the answer to a packet that was dropped as too late
        # NMEA: it did not understand our last command, whichever that was
        if message.module == "NMEA" and self.state is State.CONFIGURING and not self._rebooting:
            self._setting_refused(text)
            return
        if message.module == "NMEA" and self.state in (State.CYCLING, State.REQUESTING, State.GIVING):
            self._abort(f"refused by the modem: {text}")
            return
        self._events.append(Problem(text=f"modem error: {text}"))
        if message.module == "NMEA" and self._clock in (_Clock.ASKED, _Clock.SETTING):
            self._clock_over()


#: Kinds of `$CAMSG` and modules of `$CAERR` counted by name; any other is counted as "other".
NOTICES = frozenset({"BAD_CRC", "PACKET_TIMEOUT", "PSK_ERROR", "NO_CARRIER", "BAD_HEADER"})
MODULES = frozenset({"NMEA", "DATA_TIMEOUT", "TX", "RX", "PSK", "FSK", "AUX", "COPROC", "POWER", "CLOCK", "SYSTEM"})


def _known(name: str, names: frozenset[str]) -> str:
    return name if name in names else "other"


#: What the driver does with each message. The table is the only way from a modem's text to code.
HANDLERS: dict[type[Any], Callable[[Micromodem, Any], None]] = {
    nmea.Revision: Micromodem._on_revision,
    nmea.Setting: Micromodem._on_setting,
    nmea.ClockSet: Micromodem._on_clock_set,
    nmea.ClockTime: Micromodem._on_clock_time,
    nmea.Cycle: Micromodem._on_cycle,
    nmea.DataRequest: Micromodem._on_request,
    nmea.FrameTaken: Micromodem._on_frame_taken,
    nmea.TransmitStart: Micromodem._on_transmit_start,
    nmea.TransmitEnd: Micromodem._on_transmit_end,
    nmea.TransmitStatistics: Micromodem._on_transmit_statistics,
    nmea.ReceptionStart: Micromodem._on_reception_start,
    nmea.Detection: Micromodem._on_detection,
    nmea.FrameHeard: Micromodem._on_frame_heard,
    nmea.ReceptionStatistics: Micromodem._on_reception_statistics,
    nmea.Notice: Micromodem._on_notice,
    nmea.Trouble: Micromodem._on_trouble,
}
