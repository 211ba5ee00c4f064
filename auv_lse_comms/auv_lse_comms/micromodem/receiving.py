"""Assembles what a Micromodem receives: from its sentences to whole packets.

$CARXP or $CACYC opens a reception, $CARXD adds a frame, $CAMSG,BAD_CRC a bad one, and $CACST closes it. A reception
whose $CACST was lost is closed by the next reception or by a timeout.
"""

import math
from dataclasses import dataclass, field

from auv_lse_common.mission_file.sections.modem import PAYLOAD_BYTES
from auv_lse_common.vocabulary.modem_rates import BROADCAST, RATES, packet_duration_s
from auv_lse_comms.micromodem.clock import ClockCheck
from auv_lse_comms.micromodem.events import PacketReceived, ReceptionFailed
from auv_lse_comms.micromodem.sentences.receive_messages import (
    MODE_GOOD,
    MODE_PACKET_TIMEOUT,
    Detection,
    FrameHeard,
    ReceptionStart,
    ReceptionStatistics,
    clock_is_synchronous,
)
from auv_lse_comms.micromodem.sentences.transmit_messages import Cycle
from auv_lse_comms.micromodem.session import Session

#: The modem's arrival time is used if the packet's end, computed from it, is within this of the host's clock (s).
ARRIVAL_WINDOW_S = 5.0
_UNTIMED = (math.nan, math.nan, math.nan)


@dataclass(slots=True)
class _Reception:
    """A packet being received: its cycle, its good frames by number, and how many were bad."""

    cycle: Cycle | None = None
    frames: dict[int, FrameHeard] = field(default_factory=dict)
    bad: int = 0

    def problem(self, why: str, statistics: ReceptionStatistics | None) -> str:
        """Why it gives no packet, "" if it gives one; `why` if no other reason is known."""
        if statistics is not None and statistics.mode == MODE_PACKET_TIMEOUT:
            return "packet timeout"
        if self.bad or (statistics is not None and (statistics.mode != MODE_GOOD or statistics.bad_frames)):
            return "bad CRC"
        if not self.frames:
            return why
        expected = max(
            statistics.frames if statistics is not None else 0,
            self.cycle.frames if self.cycle is not None else 0,
            max(self.frames),
        )
        return "frames missing" if len(self.frames) < expected else ""


class Receiving:
    """The reception in progress at one modem, if there is one."""

    def __init__(self, session: Session, clock: ClockCheck) -> None:
        """Reports to `session`; arrival times are the modem's while `clock` is right."""
        self._session = session
        self._clock = clock
        self._reception: _Reception | None = None

    def poll(self) -> None:
        """Closes a reception whose statistics did not come in time."""
        session = self._session
        if self._reception is not None and session.waited_s("reception") >= session.config.receive_timeout_s:
            self.close("timed out")

    def close(self, why: str, statistics: ReceptionStatistics | None = None) -> None:
        """Closes the reception in progress, if there is one: reports its packet, or `why` there is none."""
        session = self._session
        reception, self._reception = self._reception, None
        if reception is None:
            if statistics is None:
                return
            reception = _Reception()
        problem = reception.problem(why, statistics)
        if problem:
            session.counts["receptions_failed"] += 1
            session.counts[f"receptions_failed: {problem}"] += 1
            session.report(
                ReceptionFailed(reason=problem, snr_db=math.nan if statistics is None else statistics.snr_in_db)
            )
        else:
            self._report_packet(reception, statistics)

    def _report_packet(self, reception: _Reception, statistics: ReceptionStatistics | None) -> None:
        session = self._session
        frames = [reception.frames[number] for number in sorted(reception.frames)]
        destination = frames[0].destination
        if destination not in (BROADCAST, session.address):
            session.counts["not_for_us"] += 1
            return
        payload = b"".join(frame.data for frame in frames)
        if len(payload) > PAYLOAD_BYTES and not any(payload[PAYLOAD_BYTES:]):
            payload = payload[:PAYLOAD_BYTES]  # some firmware pads the frame with zeros
        if statistics is None:
            session.counts["receptions_without_statistics"] += 1
        rate = statistics.rate if statistics is not None else reception.cycle.rate if reception.cycle else -1
        session.counts["received"] += 1
        sent_s, travel_s, arrival_s = self._timing(statistics, len(payload))
        session.report(
            PacketReceived(
                utc_s=self._end_s(statistics, len(payload)),
                source=frames[0].source,
                destination=destination,
                payload=payload,
                snr_db=math.nan if statistics is None else statistics.snr_in_db,
                travel_s=travel_s,
                rate=rate,
                sent_s=sent_s,
                arrival_s=arrival_s,
            )
        )

    def _open(self) -> _Reception:
        if self._reception is None:
            self._reception = _Reception()
        self._session.start("reception")
        return self._reception

    def _end_s(self, statistics: ReceptionStatistics | None, count: int) -> float:
        """End of the reception (s), by the modem's clock if that is plausible, else now."""
        now_s = self._session.now_s
        if statistics is None or not self._is_plausible(statistics, count):
            return now_s
        return round(statistics.utc_s + packet_duration_s(statistics.rate, count), 4)

    def _timing(self, statistics: ReceptionStatistics | None, count: int) -> tuple[float, float, float]:
        """Start of transmission, travel time, start of reception (s) if a PPS disciplines both clocks; else NaN."""
        if statistics is None or not self._session.config.synchronous or not clock_is_synchronous(statistics.clock):
            return _UNTIMED
        if not self._is_plausible(statistics, count):
            return _UNTIMED
        sent_s = float(math.floor(statistics.utc_s))
        return sent_s, statistics.utc_s - sent_s, statistics.utc_s

    def _is_plausible(self, statistics: ReceptionStatistics, count: int) -> bool:
        """Whether the modem's start time fits a reception of `count` bytes that ends about now."""
        if not self._clock.right or statistics.rate not in RATES:
            return False
        end_s = statistics.utc_s + packet_duration_s(statistics.rate, count)
        return abs(end_s - self._session.now_s) <= ARRIVAL_WINDOW_S

    # ------------------------------------------------------------------ the modem's sentences

    def on_cycle(self, message: Cycle) -> None:
        """Another modem's packet begins."""
        if self._reception is not None and (self._reception.cycle is not None or self._reception.frames):
            self.close("another packet began")
        self._open().cycle = message

    def on_start(self, message: ReceptionStart) -> None:
        """A packet's probe was detected; a mini-packet's is ignored, because no packet follows it."""
        if message.kind == 0:
            return
        if self._reception is not None and (self._reception.frames or self._reception.bad):
            self.close("another packet began")
        self._open()

    def on_detection(self, message: Detection) -> None:
        """The matched filter's detection: extends the reception."""
        self.extend()

    def on_frame(self, message: FrameHeard) -> None:
        """Adds a frame without error."""
        reception = self._open()
        if any(frame.source != message.source for frame in reception.frames.values()):
            self.close("another packet began")
            reception = self._open()
        if message.frame in reception.frames:
            self._session.counts["repeated_frames"] += 1
        reception.frames[message.frame] = message

    def on_bad_frame(self) -> None:
        """Counts a frame with an error."""
        self._open().bad += 1

    def on_statistics(self, message: ReceptionStatistics) -> None:
        """Closes the reception that the statistics belong to."""
        reception = self._reception
        if reception is None and message.rate <= 0 and message.mode == MODE_GOOD:
            self._session.counts["mini_packets"] += 1
            return
        if (
            reception is not None
            and reception.cycle is not None
            and reception.cycle.rate == 0
            and not reception.frames
            and message.mode == MODE_GOOD
        ):
            return  # FSK: statistics of the mini-packet that announces the data; the data's own follow
        self.close("no frame was received", message)

    def extend(self) -> None:
        """Restarts the timeout of the reception in progress, if there is one."""
        if self._reception is not None:
            self._session.start("reception")
