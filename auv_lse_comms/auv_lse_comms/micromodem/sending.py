"""Sends packets through a Micromodem, one cycle of sentences each (`state.py` shows the cycle).

A packet whose transmission has not begun `start_timeout_s` after the request is dropped, because its TDMA slot is over.
A late $CADRQ is then not answered, and the modem times out ($CAERR,...,DATA_TIMEOUT). One packet can wait while the
modem is busy; a second one is refused. Every packet gets exactly one `TransmitStarted` or `TransmitFailed`, and every
`TransmitStarted` exactly one `TransmitDone` or `TransmitFailed`.
"""

from dataclasses import dataclass

from auv_lse_common.vocabulary.modem_rates import RATES
from auv_lse_comms.micromodem.events import Problem, TransmitDone, TransmitFailed, TransmitStarted
from auv_lse_comms.micromodem.sentences import transmit_messages as tx
from auv_lse_comms.micromodem.session import Session
from auv_lse_comms.micromodem.state import STARTING, TRANSMITTING, Cause, State


@dataclass(slots=True)
class _Packet:
    """A packet to send: its number, its frames, and how many of them the modem has accepted."""

    number: int
    destination: int
    frames: tuple[bytes, ...]
    taken: int = 0


class Sending:
    """The outgoing packets of one modem: one in transmission and one waiting."""

    def __init__(self, session: Session) -> None:
        """Starts without packets; writes to `session`."""
        self._session = session
        self._current: _Packet | None = None
        self._waiting: _Packet | None = None

    @property
    def waiting(self) -> bool:
        """Whether a packet waits for the modem."""
        return self._waiting is not None

    def ask(self, payload: bytes, destination: int | None) -> int:
        """Queues a packet; returns its number, which the events about it carry.

        Raises:
            ValueError: if the payload is empty or does not fit one packet at the configured rate.
        """
        session, config = self._session, self._session.config
        rate = RATES[config.rate]
        if not 1 <= len(payload) <= rate.frames * rate.frame_bytes:
            raise ValueError(
                f"payload: {len(payload)} bytes do not fit rate {config.rate}; send 1 to "
                f"{rate.frames * rate.frame_bytes} ({rate.frames} frames of {rate.frame_bytes})"
            )
        packet = _Packet(
            number=session.next_number(),
            destination=config.destination if destination is None else destination,
            frames=tuple(payload[i : i + rate.frame_bytes] for i in range(0, len(payload), rate.frame_bytes)),
        )
        session.counts["asked"] += 1
        if self._waiting is not None:
            self._report_failure(packet.number, "busy: another packet is waiting")
        else:
            self._waiting = packet
            session.start("waiting")
            self.begin()
        return packet.number

    def begin(self) -> None:
        """Begins a cycle for the waiting packet, if there is one and the modem is idle."""
        session = self._session
        if session.state is not State.IDLE or self._waiting is None:
            return
        self._current, self._waiting = self._waiting, None
        session.start("packet", since="waiting")
        session.move(Cause.SEND)
        cycle = tx.Cycle(
            source=session.address,
            destination=self._current.destination,
            rate=session.config.rate,
            ack=False,
            frames=len(self._current.frames),
        )
        session.write(cycle.command())

    def poll(self) -> None:
        """Drops packets that are too late, and aborts a transmission whose end is not reported."""
        session, config = self._session, self._session.config
        self.drop_late(f"modem {session.state.value}")
        if session.state in STARTING:
            if session.waited_s("packet") >= config.start_timeout_s:
                if session.state is State.CYCLING:
                    session.strike()
                self.abort(f"too late: not begun within {config.start_timeout_s:g} s")
        elif session.state is State.SENDING and session.waited_s("sending") >= config.transmit_timeout_s:
            self.abort(f"its end was not reported within {config.transmit_timeout_s:g} s")

    def drop_late(self, why: str) -> None:
        """Drops the waiting packet if its slot is over."""
        timeout_s = self._session.config.start_timeout_s
        if self._waiting is not None and self._session.waited_s("waiting") >= timeout_s:
            packet, self._waiting = self._waiting, None
            self._report_failure(packet.number, f"too late: {why} for {timeout_s:g} s")

    def fail(self, reason: str) -> None:
        """Reports the packet in transmission, if there is one, as failed; the state does not change."""
        if self._current is not None:
            packet, self._current = self._current, None
            self._report_failure(packet.number, reason)

    def abort(self, reason: str) -> None:
        """Reports the packet in transmission, if there is one, as failed; the modem is idle again."""
        if self._session.state in TRANSMITTING:
            self.fail(reason)
            self._session.move(Cause.FAILED)

    def _report_failure(self, number: int, reason: str) -> None:
        self._session.counts["failed"] += 1
        self._session.report(TransmitFailed(number=number, reason=reason))

    # ------------------------------------------------------------------ the modem's sentences

    def on_echo(self) -> None:
        """The modem echoes our own `$CCCYC`."""
        if self._session.state is State.CYCLING:
            self._session.move(Cause.ECHO)

    def on_request(self, message: tx.DataRequest) -> None:
        """The modem requests a frame: sends it."""
        session, packet = self._session, self._current
        if packet is None or session.state not in STARTING or message.source != session.address:
            session.counts["unasked_requests"] += 1
            return
        if message.frame > len(packet.frames):
            self.abort(f"the modem requested frame {message.frame} of {len(packet.frames)}")
            return
        data = packet.frames[message.frame - 1]
        if len(data) > message.max_bytes:
            self.abort(f"the modem accepts {message.max_bytes} bytes, the frame has {len(data)}")
            return
        session.move(Cause.REQUEST)
        frame = tx.FrameGiven(source=session.address, destination=packet.destination, ack=message.ack, data=data)
        session.write(frame.sentence())

    def on_taken(self, message: tx.FrameTaken) -> None:
        """The modem has accepted a frame: checks that it received all its bytes."""
        session, packet = self._session, self._current
        if packet is None or session.state is not State.GIVING:
            return
        packet.taken += 1
        # the count is what arrived over the wire; if it is wrong, a damaged packet will be sent
        expected = len(packet.frames[min(packet.taken, len(packet.frames)) - 1])
        if message.count != expected:
            session.counts["short_frames"] += 1
            session.report(Problem(text=f"the modem accepted {message.count} of the frame's {expected} bytes"))

    def on_start(self, message: tx.TransmitStart) -> None:
        """The transducer is on."""
        if self._current is None or self._session.state is not State.GIVING:
            self._session.counts["unasked_transmissions"] += 1
            return
        self._started(self._current)

    def on_end(self, message: tx.TransmitEnd) -> None:
        """The transducer is off."""
        session, packet = self._session, self._current
        if packet is None or session.state not in (State.GIVING, State.SENDING):
            return
        if session.state is State.GIVING:  # the line that reported the start was lost
            self._started(packet)
        self._current = None
        session.move(Cause.FINISHED)
        session.counts["sent"] += 1
        session.report(TransmitDone(number=packet.number))

    def on_statistics(self, message: tx.TransmitStatistics) -> None:
        """The statistics of a transmission, or of one that never began."""
        if message.mode != 0:
            reason = tx.NOT_SENT.get(message.mode, f"mode {message.mode}")
            self.abort(f"the modem did not send it: {reason} (CAXST)")

    def _started(self, packet: _Packet) -> None:
        self._session.move(Cause.STARTED)
        self._session.start("sending")
        self._session.counts["started"] += 1
        self._session.report(TransmitStarted(number=packet.number))
