"""An emulated WHOI Micromodem-2: the modem's side of the sentences, joined to a channel.

`ModemEmulator` takes bytes and times and gives bytes. A packet goes into the simulated water by the callable
`transmit`; what comes out of the water is handed in by `arrive`. `host_ports.py` carries the bytes, `modem_rack.py`
serves one emulated modem per vehicle.

The time is the caller's: simulated time in a mission. Answers come at once, however fast time runs; what takes time
in the water (a transmission, the wait for data) ends in `poll`. Not modelled: the speed of the serial line (a 252-byte
frame takes 0.28 s each way at 19200 Bd), acknowledgements, mini-packets other than those of pings.

Settings start as in a modem fresh from the box: address 0, no statistics. A driver that does not configure it gets
neither packets nor `$CACST`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

from auv_lse_common.vocabulary.modem_rates import BROADCAST, RATES, packet_duration_s
from auv_lse_comms.micromodem.sentences.fields import SentenceError, clock_time, read_iso_time
from auv_lse_comms.micromodem.sentences.layout import Message
from auv_lse_comms.micromodem.sentences.ping_messages import PingEcho
from auv_lse_comms.micromodem.sentences.receive_messages import (
    MODE_BAD_CRC,
    MODE_GOOD,
    Detection,
    FrameHeard,
    ReceptionStart,
    ReceptionStatistics,
)
from auv_lse_comms.micromodem.sentences.status_messages import (
    ClockSet,
    ClockTime,
    ErrorReport,
    Notice,
    Revision,
    Setting,
)
from auv_lse_comms.micromodem.sentences.transmit_messages import (
    Cycle,
    DataRequest,
    FrameGiven,
    FrameTaken,
    TransmitEnd,
    TransmitStart,
    TransmitStatistics,
)
from auv_lse_comms.micromodem.sentences.wire import Sentence, SentenceReader
from auv_lse_sim.emulated.pings import MiniPacket, Pings

VERSION = "2.0.27087"
#: The modem waits so long for `$CCTXD` after `$CADRQ` (s).
DATA_TIMEOUT_S = 2.0
#: With SNV on, the modem waits so long for the edge of a PPS (s).
SYNC_TIMEOUT_S = 1.5
#: With REV on, the revision is sent this often (s).
REVISION_PERIOD_S = 120.0

#: Settings known, and what they are at first.
SETTINGS = {"SRC": "0", "CST": "0", "RXP": "0", "REV": "0", "XST": "0", "MFD": "0", "ASD": "0", "SNV": "0"}
SETTINGS |= {"TXP": "1", "TXF": "1", "RXD": "1", "BND": "1"}

#: Nearer to a second than this (s) is on it.
_EDGE_S = 1e-3

_RTC_USER_COMMAND = 2
_PPS_EXTERNAL = 3 << 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Transmission:
    """A packet that goes into the water.

    Attributes:
        start_s: When its transmission starts (s, the simulation's clock).
        source: The sender's modem address.
        destination: Whom it is for, 0: all.
        rate: Packet rate number.
        frames: Number of frames.
        payload: The frames' bytes, one after another.
    """

    start_s: float
    source: int
    destination: int
    rate: int
    frames: int
    payload: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class HeardPacket:
    """A packet that comes out of the water.

    Attributes:
        start_s: When its first sound arrives (s, the simulation's clock).
        source: The sender's modem address.
        destination: Whom it is for, 0: all.
        payload: What was sent; None if it could not be decoded.
        snr_db: Signal to noise ratio (dB), not finite if unknown.
        rate: Packet rate number.
        frames: Number of frames.
        doppler_mps: Relative speed of the sender (m/s).
        measured_s: When its first sound arrives as the two modems measure it: by this one's clock, where the sender's
            clock was right when it sent (s). NaN: as `start_s`.
    """

    start_s: float
    source: int
    destination: int
    payload: bytes | None
    snr_db: float = math.nan
    rate: int = 4
    frames: int = 1
    doppler_mps: float = 0.0
    measured_s: float = math.nan

    @property
    def timed_s(self) -> float:
        """`measured_s`, or `start_s` where that is not known."""
        return self.measured_s if math.isfinite(self.measured_s) else self.start_s


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


class ModemEmulator:
    """One emulated modem.

    Attributes:
        settings: Its settings by name, as text.
        counts: What happened: "transmitted", "heard", "heard_bad", "data_timeouts", "refused", "boots".
    """

    def __init__(
        self,
        transmit: Callable[[Transmission], float | None],
        *,
        clock_error_s: float = 0.0,
        version: str = VERSION,
        pps: bool = True,
    ) -> None:
        """A modem without power; `boot` it.

        Args:
            transmit: Takes a packet into the water; returns its duration (s), or None for the nominal one.
            clock_error_s: Modem's clock less the simulation's, until it is set.
            version: Firmware version in `$CAREV`.
            pps: Whether a PPS is connected; it is used with SNV on.
        """
        self.settings = dict(SETTINGS)
        self.counts: Counter[str] = Counter()
        self._transmit = transmit
        self._version = version
        self._clock_error_s = clock_error_s
        self._pps = pps
        self._clock_set = False
        self._reader = SentenceReader()
        self._bad_lines = 0
        self._sending: _Outgoing | None = None
        self._pings = Pings(lambda: self.address, self._write, self._transmit_mini)
        self._revision_s = -math.inf
        self._out = bytearray()

    @property
    def address(self) -> int:
        """Own modem address, 0 until it is set."""
        return int(self.settings["SRC"])

    def boot(self, now_s: float, forget: bool = False) -> None:
        """Power on, or a restart: drops what was under way, and with `forget` the settings and the clock too."""
        self.counts["boots"] += 1
        self._sending = None
        self._reader.reset()
        if forget:
            self.settings = dict(SETTINGS)
            self._clock_set = False
        self._write(Revision(time=self._clock_text(now_s), ident="INIT", version=""))
        self._write(Revision(time=self._clock_text(now_s), ident="AUV", version=self._version))
        self._revision_s = now_s

    def receive(self, now_s: float, data: bytes) -> None:
        """Takes bytes from the host."""
        for sentence in self._reader.feed(data):
            command = COMMANDS.get(sentence.type)
            if command is None:
                self._refuse(now_s, 1, f"{sentence.type}: unknown command")
                continue
            try:
                command(self, now_s, sentence)
            except SentenceError as error:
                self._refuse(now_s, 2, str(error).replace(",", ";"))
        bad_lines = sum(self._reader.counts.values()) - self._reader.counts["sentences"]
        if bad_lines > self._bad_lines:
            self._refuse(now_s, 3, "bad line")
        self._bad_lines = bad_lines

    def poll(self, now_s: float) -> None:
        """Lets time pass: ends transmissions, gives up waiting for data, sends the revision."""
        sending = self._sending
        if sending is not None:
            if not sending.started:
                if len(sending.frames) >= sending.cycle.frames:
                    self._try_start(now_s)
                elif now_s - sending.asked_s >= DATA_TIMEOUT_S:
                    self._data_timeout(now_s)
            if sending.started and now_s >= sending.end_s:
                self._end(sending)
        if self.settings["REV"] != "0" and now_s - self._revision_s >= REVISION_PERIOD_S:
            self._revision_s = now_s
            self._write(Revision(time=self._clock_text(now_s), ident="AUV", version=self._version))

    def arrive(self, now_s: float, arrival: HeardPacket) -> bool:
        """Reports a packet from the water to the host, as far as the settings ask for it; answers pings.

        Returns:
            Whether it brings the host a packet, or the answer to its ping.
        """
        mini = MiniPacket.read(arrival.payload) if arrival.payload is not None else None
        if mini is not None:
            return self._pings.hear(now_s, mini, arrival.timed_s, free=self._sending is None)
        self._report(arrival)
        return arrival.payload is not None and arrival.destination in (BROADCAST, self.address)

    def _report(self, arrival: HeardPacket) -> None:
        good = arrival.payload is not None
        self.counts["heard" if good else "heard_bad"] += 1
        size = RATES[arrival.rate].frame_bytes
        payload = arrival.payload or b""
        snr_db = arrival.snr_db if math.isfinite(arrival.snr_db) else 0.0
        detection = Detection(
            peak=max(0, round(300 * 10 ** (min(snr_db, 40.0) / 40))),
            power_db=round(120 + snr_db),
            ratio_db=max(0, round(snr_db + 20)),
            spl_db=round(110 + snr_db),
        )
        self._write(
            Cycle(
                source=arrival.source,
                destination=arrival.destination,
                rate=arrival.rate,
                ack=False,
                frames=arrival.frames,
            )
        )
        if self.settings["RXP"] != "0":
            self._write(ReceptionStart(kind=0 if arrival.rate == 0 else 1))
        if self.settings["MFD"] != "0":
            self._write(detection)
        for number in range(1, arrival.frames + 1):
            if not good:
                self._write(Notice(kind="BAD_CRC", detail=str(number)))
            elif arrival.destination in (BROADCAST, self.address):
                self._write(
                    FrameHeard(
                        source=arrival.source,
                        destination=arrival.destination,
                        ack=False,
                        frame=number,
                        data=payload[(number - 1) * size : number * size],
                    )
                )
        if self.settings["CST"] != "0":
            self._write(
                ReceptionStatistics(
                    mode=MODE_GOOD if good else MODE_BAD_CRC,
                    utc_s=max(0.0, self._heard_s(arrival) + self._clock_error_s),
                    clock=self._clock_status,
                    detection=detection,
                    rate=arrival.rate,
                    source=arrival.source,
                    destination=arrival.destination,
                    frames=arrival.frames,
                    bad_frames=0 if good else arrival.frames,
                    snr_rss_db=round(snr_db),
                    snr_in_db=snr_db,
                    snr_out_db=snr_db,
                    snr_symbol_db=snr_db,
                    mse_db=-snr_db,
                    doppler_mps=arrival.doppler_mps,
                    noise_db=60,
                )
            )

    def outgoing(self) -> bytes:
        """Bytes for the host; they are handed out once."""
        data = bytes(self._out)
        self._out.clear()
        return data

    # ------------------------------------------------------------------ pings

    def _on_ping(self, now_s: float, sentence: Sentence) -> None:
        ping = PingEcho.read(sentence.fields)
        if self._sending is not None:
            self._refuse(now_s, 6, "transmitting")
            return
        if ping.source != self.address or ping.destination in (BROADCAST, self.address):
            self._refuse(now_s, 5, f"ping from {ping.source} to {ping.destination}")
            return
        self._pings.ask(now_s, ping)

    def _transmit_mini(self, start_s: float, mini: MiniPacket) -> None:
        self._transmit(
            Transmission(
                start_s=start_s,
                source=mini.source,
                destination=mini.destination,
                rate=0,
                frames=0,
                payload=mini.to_bytes(),
            )
        )
        self.counts["mini_packets"] += 1

    # ------------------------------------------------------------------ output

    def _write(self, message: Message) -> None:
        self._out += message.sentence().encode()

    def _clock_text(self, now_s: float) -> str:
        return clock_time(max(0.0, now_s + self._clock_error_s))

    @property
    def _clock_status(self) -> int:
        rtc = _RTC_USER_COMMAND if self._clock_set else 1
        return rtc | (_PPS_EXTERNAL if self._held else 1 << 2)

    @property
    def _held(self) -> bool:
        """The clock is held by the PPS."""
        return self._pps and self.settings["SNV"] != "0"

    def _heard_s(self, arrival: HeardPacket) -> float:
        return arrival.timed_s if self._held else arrival.start_s

    def _refuse(self, now_s: float, number: int, why: str) -> None:
        self.counts["refused"] += 1
        self._write(ErrorReport(time=self._clock_text(now_s), module="NMEA", number=number, detail=why))

    # ------------------------------------------------------------------ commands

    def _on_set(self, now_s: float, sentence: Sentence) -> None:
        setting = Setting.read(sentence.fields)
        if setting.name not in self.settings or not setting.value.isdigit():
            self._refuse(now_s, 4, f"{setting.name}: unknown setting or value")
            return
        if setting.name == "SRC" and not 0 <= int(setting.value) <= 127:
            self._refuse(now_s, 4, "SRC: out of range")
            return
        self.settings[setting.name] = setting.value
        self._write(setting)

    def _on_query(self, now_s: float, sentence: Sentence) -> None:
        name = sentence.fields[0] if sentence.fields else ""
        names = list(self.settings) if name == "ALL" else [name]
        if names[0] not in self.settings:
            self._refuse(now_s, 4, f"{name}: unknown setting")
            return
        for known in names:
            self._write(Setting(name=known, value=self.settings[known]))

    def _on_clock_set(self, now_s: float, sentence: Sentence) -> None:
        text = sentence.fields[0] if sentence.fields else ""
        # WHOI's acomms 3.1.1 ends the time in "ZZ", and real modems take it
        wanted_s, _ = read_iso_time(text.rstrip("Z"), "time")
        at_edge = sentence.fields[1:2] == ("1",)  # the time holds from the next edge of the PPS on
        self._clock_error_s = wanted_s - (math.floor(now_s) + 1.0 if at_edge else now_s)
        self._clock_set = True
        self._write(ClockSet(timed_out=False, utc_s=wanted_s))

    def _on_clock_query(self, now_s: float, sentence: Sentence) -> None:
        source = "USER_CMD" if self._clock_set else "RTC"
        pps = "EXT" if self._held else "RTC"
        utc_s = max(0.0, now_s + self._clock_error_s)
        self._write(ClockTime(utc_s=utc_s, resolution_s=1.0, source=source, pps=pps))

    def _on_sleep(self, now_s: float, sentence: Sentence) -> None:
        """No sleep at all is a restart; settings and clock stay."""
        if sentence.fields != (str(self.address), str(self.address), "0"):
            self._refuse(now_s, 5, f"sleep {','.join(sentence.fields)}: only of this modem, 0 minutes, is modelled")
            return
        self.boot(now_s)

    def _on_cycle(self, now_s: float, sentence: Sentence) -> None:
        cycle = Cycle.read(sentence.fields)
        rate = RATES.get(cycle.rate)
        if rate is None or not 1 <= cycle.frames <= rate.frames:
            self._refuse(now_s, 5, f"rate {cycle.rate} with {cycle.frames} frames")
            return
        if self._sending is not None and self._sending.started:
            self._refuse(now_s, 6, "transmitting")
            return
        self._write(cycle)
        if cycle.source == self.address and self.address != 0:
            self._sending = _Outgoing(cycle=cycle, asked_s=now_s)
            self._request(now_s)

    def _on_frame(self, now_s: float, sentence: Sentence) -> None:
        frame = FrameGiven.read(sentence.fields)
        sending = self._sending
        self._write(
            FrameTaken(source=frame.source, destination=frame.destination, ack=frame.ack, count=len(frame.data))
        )
        if sending is None or sending.started:
            return  # a real modem keeps it for the next cycle, which would be wrong here
        size = RATES[sending.cycle.rate].frame_bytes
        if not 1 <= len(frame.data) <= size:
            self._refuse(now_s, 7, f"frame of {len(frame.data)} bytes: expected 1 to {size}")
            return
        sending.frames.append(frame.data)
        sending.asked_s = now_s
        if len(sending.frames) < sending.cycle.frames:
            self._request(now_s)
        else:
            self._try_start(now_s)

    # ------------------------------------------------------------------ sending

    def _request(self, now_s: float) -> None:
        assert self._sending is not None
        cycle = self._sending.cycle
        self._write(
            DataRequest(
                time=self._clock_text(now_s),
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
        if self.settings["SNV"] != "0":
            if not self._pps:
                if now_s - sending.asked_s >= SYNC_TIMEOUT_S:
                    self._give_up(now_s, mode=2)
                return
            start_s = math.ceil(sending.asked_s + self._clock_error_s - _EDGE_S) - self._clock_error_s
            if now_s < start_s - _EDGE_S:
                return  # waits for the second
        sending.start_s = start_s
        payload = b"".join(sending.frames)
        if self.settings["TXP"] != "0":
            self._write(TransmitStart(count=len(payload)))
        self.counts["transmitted"] += 1
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
        if self.settings["TXF"] != "0":
            self._write(TransmitEnd(count=count))
        self._write_transmit_statistics(sending, mode=0)

    def _data_timeout(self, now_s: float) -> None:
        assert self._sending is not None
        self.counts["data_timeouts"] += 1
        number = len(self._sending.frames) + 1
        self._write(ErrorReport(time=self._clock_text(now_s), module="DATA_TIMEOUT", number=number, detail=""))
        self._give_up(now_s, mode=4)

    def _give_up(self, now_s: float, mode: int) -> None:
        """Drops what was to be sent; `mode` says why (`NOT_SENT`)."""
        sending, self._sending = self._sending, None
        assert sending is not None
        sending.start_s = now_s
        self._write_transmit_statistics(sending, mode)

    def _write_transmit_statistics(self, sending: _Outgoing, mode: int) -> None:
        if self.settings["XST"] == "0":
            return
        self._write(
            TransmitStatistics(
                utc_s=max(0.0, sending.start_s + self._clock_error_s),
                clock=self._clock_status,
                mode=mode,
                rate=sending.cycle.rate,
                source=sending.cycle.source,
                destination=sending.cycle.destination,
                frames_expected=sending.cycle.frames,
                frames_sent=len(sending.frames),
                count=sum(len(frame) for frame in sending.frames),
            )
        )


#: What each of the host's sentences does.
COMMANDS: dict[str, Callable[[ModemEmulator, float, Sentence], None]] = {
    "CCCFG": ModemEmulator._on_set,
    "CCCFQ": ModemEmulator._on_query,
    "CCTMS": ModemEmulator._on_clock_set,
    "CCTMQ": ModemEmulator._on_clock_query,
    "CCCYC": ModemEmulator._on_cycle,
    "CCTXD": ModemEmulator._on_frame,
    "CCMPC": ModemEmulator._on_ping,
    "CCMSC": ModemEmulator._on_sleep,
}
