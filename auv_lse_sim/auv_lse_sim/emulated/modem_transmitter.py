"""An emulated modem's transmissions: the host's cycle, its frames, and the packet in the water."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from auv_lse_common.vocabulary.modem_rates import RATES, packet_duration_s
from auv_lse_comms.micromodem.sentences.status_messages import ErrorReport
from auv_lse_comms.micromodem.sentences.transmit_messages import (
    Cycle,
    DataRequest,
    FrameGiven,
    FrameTaken,
    TransmitEnd,
    TransmitStart,
    TransmitStatistics,
)
from auv_lse_comms.micromodem.sentences.wire import Sentence
from auv_lse_sim.emulated.host_interface import HostInterface
from auv_lse_sim.emulated.modem_packets import Transmission

#: Time (s) that the modem waits for `$CCTXD` after `$CADRQ`.
DATA_TIMEOUT_S = 2.0
#: Time (s) that the modem waits for a PPS with SNV on.
SYNC_TIMEOUT_S = 1.5
#: A time counts as a whole second within this tolerance (s).
_EDGE_S = 1e-3


@dataclass(slots=True)
class _Outgoing:
    cycle: Cycle
    asked_s: float
    frames: list[bytes] = field(default_factory=list)
    start_s: float = math.nan
    end_s: float = math.nan

    @property
    def started(self) -> bool:
        return not math.isnan(self.start_s)


class Transmitter:
    """The packet that an emulated modem sends, if any."""

    def __init__(self, host: HostInterface, transmit: Callable[[Transmission], float | None]) -> None:
        """Starts idle.

        Args:
            host: Where the sentences go.
            transmit: Sends a packet into the water; returns its duration (s), or None for the nominal one.
        """
        self._host = host
        self._transmit = transmit
        self._sending: _Outgoing | None = None

    @property
    def busy(self) -> bool:
        """Whether a packet is being prepared or sent."""
        return self._sending is not None

    def reset(self) -> None:
        """Drops the packet."""
        self._sending = None

    def poll(self, now_s: float) -> None:
        """Ends a transmission that is over, and stops waiting for late data."""
        sending = self._sending
        if sending is None:
            return
        if not sending.started:
            if len(sending.frames) >= sending.cycle.frames:
                self._try_start(now_s)
            elif now_s - sending.asked_s >= DATA_TIMEOUT_S:
                self._data_timeout(now_s)
        if sending.started and now_s >= sending.end_s:
            self._end(sending)

    def start_cycle(self, now_s: float, sentence: Sentence) -> None:
        """Answers `$CCCYC`: begins a packet and asks for its first frame."""
        cycle = Cycle.read(sentence.fields)
        rate = RATES.get(cycle.rate)
        if rate is None or not 1 <= cycle.frames <= rate.frames:
            self._host.refuse(now_s, 5, f"rate {cycle.rate} with {cycle.frames} frames")
            return
        if self._sending is not None and self._sending.started:
            self._host.refuse(now_s, 6, "transmitting")
            return
        self._host.write(cycle)
        if cycle.source == self._host.address and self._host.address != 0:
            self._sending = _Outgoing(cycle=cycle, asked_s=now_s)
            self._request(now_s)

    def take_frame(self, now_s: float, sentence: Sentence) -> None:
        """Answers `$CCTXD`: adds a frame, and starts the transmission after the last one."""
        frame = FrameGiven.read(sentence.fields)
        sending = self._sending
        self._host.write(
            FrameTaken(source=frame.source, destination=frame.destination, ack=frame.ack, count=len(frame.data))
        )
        if sending is None or sending.started:
            return  # a real modem keeps it for the next cycle, which would be wrong here
        size = RATES[sending.cycle.rate].frame_bytes
        if not 1 <= len(frame.data) <= size:
            self._host.refuse(now_s, 7, f"a frame of {len(frame.data)} bytes is not sent; a frame has 1 to {size}")
            return
        sending.frames.append(frame.data)
        sending.asked_s = now_s
        if len(sending.frames) < sending.cycle.frames:
            self._request(now_s)
        else:
            self._try_start(now_s)

    def _request(self, now_s: float) -> None:
        assert self._sending is not None
        cycle = self._sending.cycle
        self._host.write(
            DataRequest(
                time=self._host.clock_text(now_s),
                source=cycle.source,
                destination=cycle.destination,
                ack=cycle.ack,
                max_bytes=RATES[cycle.rate].frame_bytes,
                frame=len(self._sending.frames) + 1,
            )
        )

    def _try_start(self, now_s: float) -> None:
        sending = self._sending
        assert sending is not None
        start_s = now_s
        if self._host.settings["SNV"] != "0":
            if not self._host.pps:
                if now_s - sending.asked_s >= SYNC_TIMEOUT_S:
                    self._drop(now_s, mode=2)
                return
            start_s = math.ceil(sending.asked_s + self._host.clock_error_s - _EDGE_S) - self._host.clock_error_s
            if now_s < start_s - _EDGE_S:
                return  # waits for the second
        sending.start_s = start_s
        payload = b"".join(sending.frames)
        if self._host.settings["TXP"] != "0":
            self._host.write(TransmitStart(count=len(payload)))
        self._host.counts["transmitted"] += 1
        cycle = sending.cycle
        duration_s = self._transmit(
            Transmission(
                start_s=start_s,
                source=cycle.source,
                destination=cycle.destination,
                rate=cycle.rate,
                frames=len(sending.frames),
                payload=payload,
            )
        )
        sending.end_s = start_s + (
            duration_s if duration_s is not None else packet_duration_s(cycle.rate, len(payload))
        )

    def _end(self, sending: _Outgoing) -> None:
        self._sending = None
        count = sum(len(frame) for frame in sending.frames)
        if self._host.settings["TXF"] != "0":
            self._host.write(TransmitEnd(count=count))
        self._write_transmit_statistics(sending, mode=0)

    def _data_timeout(self, now_s: float) -> None:
        assert self._sending is not None
        self._host.counts["data_timeouts"] += 1
        number = len(self._sending.frames) + 1
        time = self._host.clock_text(now_s)
        self._host.write(ErrorReport(time=time, module="DATA_TIMEOUT", number=number, detail=""))
        self._drop(now_s, mode=4)

    def _drop(self, now_s: float, mode: int) -> None:
        """Drops the packet; `mode` is the reason (`NOT_SENT`)."""
        sending, self._sending = self._sending, None
        assert sending is not None
        sending.start_s = now_s
        self._write_transmit_statistics(sending, mode)

    def _write_transmit_statistics(self, sending: _Outgoing, mode: int) -> None:
        if self._host.settings["XST"] == "0":
            return
        self._host.write(
            TransmitStatistics(
                utc_s=self._host.utc_s(sending.start_s),
                clock=self._host.clock_status,
                mode=mode,
                rate=sending.cycle.rate,
                source=sending.cycle.source,
                destination=sending.cycle.destination,
                frames_expected=sending.cycle.frames,
                frames_sent=len(sending.frames),
                count=sum(len(frame) for frame in sending.frames),
            )
        )
