"""NMEA-like sentences of the WHOI Micromodem-2: bytes in, sentences and typed messages out, and back.

A sentence is `$TYPE,field,...*HH` and CR LF, HH the XOR of the characters between `$` and `*` in two upper-case
hexadecimal digits. `$CC...` goes from host to modem, `$CA...` from modem to host. `SentenceReader` survives
anything a serial line does to them and counts it; `read_message` turns a sentence into one of the dataclasses
below by an explicit table (`MESSAGES`): text from the modem never chooses what code runs in any other way.

Sources: WHOI Micromodem-2 User's Guide and the sentences as understood by WHOI's `acomms` and Goby3.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import reduce
from operator import xor
from typing import ClassVar, NamedTuple, Protocol

#: Longest line taken for a sentence (characters without CR LF): a 256-byte frame in hexadecimal, and room.
MAX_LINE = 1024
#: Distinct unknown sentence types counted by name; more are counted together, so garbage cannot fill memory.
MAX_UNKNOWN_TYPES = 32

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_PRINTABLE = re.compile(rb"[\x20-\x7e]*\Z")
_TYPE = re.compile(r"[A-Z][A-Z0-9]{2,7}\Z")
_INT = re.compile(r"[+-]?[0-9]{1,15}\Z")
_FLOAT = re.compile(r"[+-]?([0-9]{1,15}(\.[0-9]{0,12})?|\.[0-9]{1,12})\Z")
_CHECKSUM = re.compile(r"[0-9A-Fa-f]{2}\Z")


class PacketRate(NamedTuple):
    """What one packet rate of the Micromodem carries.

    Attributes:
        frames: Most frames in one packet.
        frame_bytes: Bytes in one frame.
        bit_rate: Nominal bits per second.
    """

    frames: int
    frame_bytes: int
    bit_rate: float


#: Packet rates by number (Micromodem-2 User's Guide; docs/micromodem.md).
RATES = {
    0: PacketRate(1, 32, 80.0),
    1: PacketRate(3, 64, 250.0),
    2: PacketRate(3, 64, 500.0),
    3: PacketRate(2, 256, 1200.0),
    4: PacketRate(2, 256, 1300.0),
    5: PacketRate(8, 256, 5300.0),
}

BROADCAST = 0

#: What a packet takes besides its data: probe, header and equalizer training (s). With it a 252-byte packet at rate 4
#: takes 2.00 s, the "about 2 s" of the field.
PACKET_OVERHEAD_S = 0.45


def packet_duration_s(rate: int, count: int) -> float:
    """Nominal duration (s) on the water of a packet of `count` bytes at packet rate number `rate`."""
    return PACKET_OVERHEAD_S + 8.0 * count / RATES[rate].bit_rate


class SentenceError(ValueError):
    """A sentence whose fields do not fit its type; says which field, its text and what was expected."""


def checksum(body: str) -> str:
    """XOR of the characters of `body` (between `$` and `*`) as two upper-case hexadecimal digits."""
    return f"{reduce(xor, body.encode('ascii'), 0):02X}"


class Sentence(NamedTuple):
    """One sentence: its type ("CADRQ") and its fields as text."""

    type: str
    fields: tuple[str, ...]

    @property
    def body(self) -> str:
        """The text between `$` and `*`."""
        return ",".join((self.type, *self.fields))

    def encode(self) -> bytes:
        """The line as it goes over the wire, CR LF included."""
        return f"${self.body}*{checksum(self.body)}\r\n".encode("ascii")


class SentenceReader:
    """Cuts bytes into sentences; keeps what is incomplete; counts what is not a sentence.

    `counts` has a key for each thing that happens to lines: "sentences" (good ones), "bad_checksum",
    "no_checksum", "bad_character" (not printable ASCII), "broken_off" (a `$` inside a sentence: the line before
    it never ended), "overlong", "not_a_sentence" (text without `$`, such as a boot banner), "bad_type".
    """

    def __init__(self, max_line: int = MAX_LINE) -> None:
        """Starts with nothing read; `max_line`: longest line taken, in characters."""
        self.counts: Counter[str] = Counter()
        self._max_line = max_line
        self._line = bytearray()
        self._skipping = False

    def feed(self, data: bytes) -> list[Sentence]:
        """The sentences that `data` completes, in order; whatever else it holds is counted."""
        found: list[Sentence] = []
        start = 0
        while start < len(data):
            ends = [i for i in (data.find(b"\n", start), data.find(b"\r", start), data.find(b"$", start)) if i >= 0]
            end = min(ends, default=len(data))
            self._take(data[start:end])
            if end == len(data):
                break
            if data[end : end + 1] == b"$":
                if self._line or self._skipping:
                    self._drop("broken_off" if self._line[:1] == b"$" else "not_a_sentence")
                self._line += b"$"
            else:
                sentence = self._finish()
                if sentence is not None:
                    found.append(sentence)
            start = end + 1
        return found

    def reset(self) -> None:
        """Forgets an incomplete line: the port has been opened anew."""
        if self._line:
            self._drop("broken_off")
        self._skipping = False

    def _take(self, part: bytes) -> None:
        if self._skipping or not part:
            return
        if len(self._line) + len(part) > self._max_line:
            self._line.clear()
            self._skipping = True
            self.counts["overlong"] += 1
            return
        self._line += part

    def _drop(self, reason: str) -> None:
        if not self._skipping:
            self.counts[reason] += 1
        self._line.clear()
        self._skipping = False

    def _finish(self) -> Sentence | None:
        line = bytes(self._line)
        self._line.clear()
        if self._skipping:
            self._skipping = False
            return None
        if not line:
            return None
        problem = self._check(line)
        if isinstance(problem, Sentence):
            self.counts["sentences"] += 1
            return problem
        self.counts[problem] += 1
        return None

    @staticmethod
    def _check(line: bytes) -> Sentence | str:
        if not line.startswith(b"$"):
            return "not_a_sentence"
        if not _PRINTABLE.match(line):
            return "bad_character"
        text = line[1:].decode("ascii")
        body, star, digits = text.rpartition("*")
        if not star:
            return "no_checksum"
        if not _CHECKSUM.match(digits) or digits.upper() != checksum(body):
            return "bad_checksum"
        kind, *fields = (field.strip() for field in body.split(","))
        if not _TYPE.match(kind):
            return "bad_type"
        return Sentence(kind, tuple(fields))


# ----------------------------------------------------------------------------------------------- fields and times


def _text(fields: Sequence[str], index: int, name: str) -> str:
    if index >= len(fields):
        raise SentenceError(f"{name}: missing; expected field {index + 1}, got {len(fields)} fields")
    return fields[index]


def _int(fields: Sequence[str], index: int, name: str, low: int | None = None, high: int | None = None) -> int:
    text = _text(fields, index, name)
    if not _INT.match(text):
        raise SentenceError(f"{name}: got {text[:40]!r}; expected an integer in field {index + 1}")
    value = int(text)
    if (low is not None and value < low) or (high is not None and value > high):
        raise SentenceError(f"{name}: got {value}; expected {low} to {high} in field {index + 1}")
    return value


def _float(fields: Sequence[str], index: int, name: str) -> float:
    text = _text(fields, index, name)
    if not _FLOAT.match(text):
        raise SentenceError(f"{name}: got {text[:40]!r}; expected a number in field {index + 1}")
    return float(text)


def _flag(fields: Sequence[str], index: int, name: str) -> bool:
    return _int(fields, index, name, 0, 1) == 1


def _hex(fields: Sequence[str], index: int, name: str) -> bytes:
    text = _text(fields, index, name)
    try:
        return bytes.fromhex(text)
    except ValueError as error:
        raise SentenceError(f"{name}: got {text[:20]!r}...; expected hexadecimal digits ({error})") from None


def iso_time(utc_s: float) -> str:
    """`2019-12-02T03:02:59Z`, the second that `utc_s` (s since 1970, UTC) falls in."""
    return (_EPOCH + timedelta(seconds=math.floor(utc_s))).strftime("%Y-%m-%dT%H:%M:%SZ")


def clock_time(utc_s: float) -> str:
    """`030259`: hours, minutes and seconds of `utc_s` (s since 1970, UTC)."""
    return (_EPOCH + timedelta(seconds=math.floor(utc_s))).strftime("%H%M%S")


def arrival_time(utc_s: float) -> str:
    """`20191202030259.1234`: date and time of `utc_s` (s since 1970, UTC), to 0.1 ms."""
    ticks = round(utc_s * 10000.0)
    return (_EPOCH + timedelta(seconds=ticks // 10000)).strftime("%Y%m%d%H%M%S") + f".{ticks % 10000:04d}"


def read_iso_time(text: str, name: str) -> tuple[float, float]:
    """Time and resolution (s since 1970 UTC, s) of an ISO 8601 time, with or without a fraction, ending in Z or not."""
    match = re.match(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)(\.\d{1,9})?Z?\Z", text)
    try:
        if match is None:
            raise ValueError("shape")
        whole = datetime.strptime(match[1], "%Y-%m-%dT%H:%M:%S").replace(tzinfo=UTC)
    except ValueError:
        raise SentenceError(f"{name}: got {text[:40]!r}; expected a time such as 2019-12-02T03:02:59Z") from None
    fraction = match[2] or ""
    resolution = 10.0 ** -(len(fraction) - 1) if fraction else 1.0
    return (whole - _EPOCH).total_seconds() + (float(fraction) if fraction else 0.0), resolution


def read_arrival_time(text: str) -> float:
    """Seconds since 1970 (UTC) of `20191202030259.1234`; NaN if it is no date (firmware sends such ones)."""
    match = re.match(r"(\d{14})(\.\d{1,9})?\Z", text)
    if match is None:
        return math.nan
    try:
        whole = datetime.strptime(match[1], "%Y%m%d%H%M%S").replace(tzinfo=UTC)
    except ValueError:
        return math.nan
    return (whole - _EPOCH).total_seconds() + float(match[2] or 0.0)


# ----------------------------------------------------------------------------------------------- messages


class Message(Protocol):
    """What `read_message` gives: a dataclass that can also make its sentence."""

    def sentence(self) -> Sentence:
        """The sentence that says this."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Revision:
    """`$CAREV,hhmmss,IDENT,version`: said at start-up (ident INIT, then AUV) and, with REV on, now and then."""

    time: str
    ident: str
    version: str

    @classmethod
    def read(cls, fields: Sequence[str]) -> Revision:
        """From the fields of `$CAREV`."""
        return cls(time=_text(fields, 0, "time"), ident=_text(fields, 1, "ident"), version=",".join(fields[2:]))

    def sentence(self) -> Sentence:
        """`$CAREV`."""
        return Sentence("CAREV", (self.time, self.ident, self.version))


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """`$CACFG,NAME,value`: a setting as the modem holds it; `$CCCFG,NAME,value` asks for it."""

    name: str
    value: str

    @classmethod
    def read(cls, fields: Sequence[str]) -> Setting:
        """From the fields of `$CACFG` or `$CCCFG`."""
        return cls(name=_text(fields, 0, "name"), value=_text(fields, 1, "value"))

    def sentence(self) -> Sentence:
        """`$CACFG`."""
        return Sentence("CACFG", (self.name, self.value))

    def command(self) -> Sentence:
        """`$CCCFG`."""
        return Sentence("CCCFG", (self.name, self.value))


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockSet:
    """`$CATMS,timed_out,time`: answer to `$CCTMS`."""

    timed_out: bool
    utc_s: float

    @classmethod
    def read(cls, fields: Sequence[str]) -> ClockSet:
        """From the fields of `$CATMS`."""
        return cls(timed_out=_flag(fields, 0, "timed_out"), utc_s=read_iso_time(_text(fields, 1, "time"), "time")[0])

    def sentence(self) -> Sentence:
        """`$CATMS`."""
        return Sentence("CATMS", (f"{self.timed_out:d}", iso_time(self.utc_s)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockTime:
    """`$CATMQ,time,source,pps`: the modem's clock.

    Attributes:
        utc_s: Its time, s since 1970 (UTC).
        resolution_s: What its last digit is worth, s: the clock stands between utc_s and utc_s + resolution_s.
        source: Where its time comes from: "NONE", "RTC", "USER_CMD", "USER_GPS".
        pps: What holds it: "NONE", "RTC", "CAL", "EXT_SYNC", "EXT".
    """

    utc_s: float
    resolution_s: float
    source: str
    pps: str

    @classmethod
    def read(cls, fields: Sequence[str]) -> ClockTime:
        """From the fields of `$CATMQ`."""
        utc_s, resolution_s = read_iso_time(_text(fields, 0, "time"), "time")
        return cls(
            utc_s=utc_s, resolution_s=resolution_s, source=_text(fields, 1, "source"), pps=_text(fields, 2, "pps")
        )

    def sentence(self) -> Sentence:
        """`$CATMQ`."""
        return Sentence("CATMQ", (iso_time(self.utc_s), self.source, self.pps))


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycle:
    """`$CACYC,cmd,src,dest,rate,ack,frames`: a packet begins, own (echo of `$CCCYC`) or heard."""

    source: int
    destination: int
    rate: int
    ack: bool
    frames: int
    command: int = 0

    @classmethod
    def read(cls, fields: Sequence[str]) -> Cycle:
        """From the fields of `$CACYC` or `$CCCYC`."""
        return cls(
            command=_int(fields, 0, "cmd"),
            source=_int(fields, 1, "src", 0, 127),
            destination=_int(fields, 2, "dest", 0, 127),
            rate=_int(fields, 3, "rate", 0, 6),
            ack=_flag(fields, 4, "ack"),
            frames=_int(fields, 5, "frames", 0, 64),
        )

    def _fields(self) -> tuple[str, ...]:
        numbers = (self.command, self.source, self.destination, self.rate, int(self.ack), self.frames)
        return tuple(str(number) for number in numbers)

    def sentence(self) -> Sentence:
        """`$CACYC`."""
        return Sentence("CACYC", self._fields())

    def initiate(self) -> Sentence:
        """`$CCCYC`."""
        return Sentence("CCCYC", self._fields())


@dataclass(frozen=True, slots=True, kw_only=True)
class DataRequest:
    """`$CADRQ,hhmmss,src,dest,ack,nbytes,frame#`: the modem asks for a frame (numbered from 1)."""

    time: str
    source: int
    destination: int
    ack: bool
    max_bytes: int
    frame: int

    @classmethod
    def read(cls, fields: Sequence[str]) -> DataRequest:
        """From the fields of `$CADRQ`."""
        return cls(
            time=_text(fields, 0, "time"),
            source=_int(fields, 1, "src", 0, 127),
            destination=_int(fields, 2, "dest", 0, 127),
            ack=_flag(fields, 3, "ack"),
            max_bytes=_int(fields, 4, "nbytes", 0, 2048),
            frame=_int(fields, 5, "frame", 1, 64),
        )

    def sentence(self) -> Sentence:
        """`$CADRQ`."""
        numbers = (self.source, self.destination, int(self.ack), self.max_bytes, self.frame)
        return Sentence("CADRQ", (self.time, *(str(number) for number in numbers)))


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameGiven:
    """`$CCTXD,src,dest,ack,HEX`: one frame of data for the packet that is being made up."""

    source: int
    destination: int
    ack: bool
    data: bytes

    @classmethod
    def read(cls, fields: Sequence[str]) -> FrameGiven:
        """From the fields of `$CCTXD`."""
        return cls(
            source=_int(fields, 0, "src", 0, 127),
            destination=_int(fields, 1, "dest", 0, 127),
            ack=_flag(fields, 2, "ack"),
            data=_hex(fields, 3, "data"),
        )

    def sentence(self) -> Sentence:
        """`$CCTXD`."""
        fields = (str(self.source), str(self.destination), f"{self.ack:d}", self.data.hex().upper())
        return Sentence("CCTXD", fields)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTaken:
    """`$CATXD,src,dest,ack,nbytes`: the modem has taken a frame."""

    source: int
    destination: int
    ack: bool
    count: int

    @classmethod
    def read(cls, fields: Sequence[str]) -> FrameTaken:
        """From the fields of `$CATXD`."""
        return cls(
            source=_int(fields, 0, "src", 0, 127),
            destination=_int(fields, 1, "dest", 0, 127),
            ack=_flag(fields, 2, "ack"),
            count=_int(fields, 3, "nbytes", 0, 4096),
        )

    def sentence(self) -> Sentence:
        """`$CATXD`."""
        return Sentence("CATXD", (str(self.source), str(self.destination), f"{self.ack:d}", str(self.count)))


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitStart:
    """`$CATXP,nbytes`: the transducer begins to send."""

    count: int

    @classmethod
    def read(cls, fields: Sequence[str]) -> TransmitStart:
        """From the fields of `$CATXP`."""
        return cls(count=_int(fields, 0, "nbytes", 0, 65535))

    def sentence(self) -> Sentence:
        """`$CATXP`."""
        return Sentence("CATXP", (str(self.count),))


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitEnd:
    """`$CATXF,nbytes`: the transmission is over."""

    count: int

    @classmethod
    def read(cls, fields: Sequence[str]) -> TransmitEnd:
        """From the fields of `$CATXF`."""
        return cls(count=_int(fields, 0, "nbytes", 0, 65535))

    def sentence(self) -> Sentence:
        """`$CATXF`."""
        return Sentence("CATXF", (str(self.count),))


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitStatistics:
    """`$CAXST,6,date,time,toa_mode,mode,probe,bandwidth,carrier,rate,src,dest,ack,expected,sent,type,nbytes`.

    Attributes:
        utc_s: When the transmission began, s since 1970 (UTC); NaN if unreadable.
        clock: Clock status, see `clock_is_synchronous`.
        mode: 0 or 1 transmitted; 4: data timeout (nothing was sent).
    """

    utc_s: float
    clock: int
    mode: int
    rate: int
    source: int
    destination: int
    frames_expected: int
    frames_sent: int
    count: int
    bandwidth_hz: int = 5000
    carrier_hz: int = 25000

    @classmethod
    def read(cls, fields: Sequence[str]) -> TransmitStatistics:
        """From the fields of `$CAXST`, with the version in front (from firmware 2.0) or without."""
        first = _int(fields, 0, "version")
        rest = fields[1:] if first < 1970_00_00 else fields
        utc_s = read_arrival_time(_text(rest, 0, "date") + _text(rest, 1, "time"))
        mode = _int(rest, 3, "mode")
        nothing = mode == 4  # data timeout: the rest is not filled in
        return cls(
            utc_s=utc_s,
            clock=_int(rest, 2, "toa_mode"),
            mode=mode,
            bandwidth_hz=0 if nothing else _int(rest, 5, "bandwidth"),
            carrier_hz=0 if nothing else _int(rest, 6, "carrier"),
            rate=-1 if nothing else _int(rest, 7, "rate"),
            source=-1 if nothing else _int(rest, 8, "src"),
            destination=-1 if nothing else _int(rest, 9, "dest"),
            frames_expected=0 if nothing else _int(rest, 11, "frames expected"),
            frames_sent=0 if nothing else _int(rest, 12, "frames sent"),
            count=0 if nothing else _int(rest, 14, "nbytes"),
        )

    def sentence(self) -> Sentence:
        """`$CAXST`, version 6; probe length 200 samples, packet type 3 (PSK) or 1 (FSK)."""
        stamp = arrival_time(self.utc_s)
        numbers = (
            self.clock,
            self.mode,
            200,
            self.bandwidth_hz,
            self.carrier_hz,
            self.rate,
            self.source,
            self.destination,
            0,
            self.frames_expected,
            self.frames_sent,
            1 if self.rate == 0 else 3,
            self.count,
        )
        return Sentence("CAXST", ("6", stamp[:8], stamp[8:], *(str(number) for number in numbers)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceptionStart:
    """`$CARXP,type`: a packet's probe has been detected (0: FSK mini-packet, 1: PSK)."""

    kind: int

    @classmethod
    def read(cls, fields: Sequence[str]) -> ReceptionStart:
        """From the fields of `$CARXP`."""
        return cls(kind=_int(fields, 0, "type"))

    def sentence(self) -> Sentence:
        """`$CARXP`."""
        return Sentence("CARXP", (str(self.kind),))


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """`$CAMFD,peak,power,ratio,spl`: the matched filter's detection, in counts and dB."""

    peak: int
    power_db: int
    ratio_db: int
    spl_db: int

    @classmethod
    def read(cls, fields: Sequence[str]) -> Detection:
        """From the fields of `$CAMFD`."""
        names = ("peak", "power", "ratio", "spl")
        peak, power, ratio, spl = (_int(fields, i, name) for i, name in enumerate(names))
        return cls(peak=peak, power_db=power, ratio_db=ratio, spl_db=spl)

    def sentence(self) -> Sentence:
        """`$CAMFD`."""
        numbers = (self.peak, self.power_db, self.ratio_db, self.spl_db)
        return Sentence("CAMFD", tuple(f"{number:05d}" for number in numbers))


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameHeard:
    """`$CARXD,src,dest,ack,frame#,HEX`: one frame of a packet, received without error."""

    source: int
    destination: int
    ack: bool
    frame: int
    data: bytes

    @classmethod
    def read(cls, fields: Sequence[str]) -> FrameHeard:
        """From the fields of `$CARXD`."""
        return cls(
            source=_int(fields, 0, "src", 0, 127),
            destination=_int(fields, 1, "dest", 0, 127),
            ack=_flag(fields, 2, "ack"),
            frame=_int(fields, 3, "frame", 1, 64),
            data=_hex(fields, 4, "data"),
        )

    def sentence(self) -> Sentence:
        """`$CARXD`."""
        fields = (str(self.source), str(self.destination), f"{self.ack:d}", str(self.frame), self.data.hex().upper())
        return Sentence("CARXD", fields)


#: `ReceptionStatistics.mode`
MODE_GOOD, MODE_BAD_CRC, MODE_PACKET_TIMEOUT = 0, 1, 2


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceptionStatistics:
    """`$CACST,6,mode,toa,toa_mode,...`: a reception is over, and how it went.

    Attributes:
        mode: 0 good, 1 bad CRC in a frame, 2 packet timeout (then only `utc_s` and `mode` are known).
        utc_s: Arrival of the packet's probe on the modem's clock, s since 1970 (UTC); NaN if unreadable.
        clock: Clock status, see `clock_is_synchronous`.
        snr_in_db: Signal to noise ratio at the equalizer's input, dB; NaN if unknown.
        doppler_mps: Relative speed of the sender, m/s; NaN if unknown.
    """

    mode: int
    utc_s: float
    clock: int = 0
    detection: Detection = Detection(peak=0, power_db=0, ratio_db=0, spl_db=0)
    rate: int = -1
    source: int = -1
    destination: int = -1
    psk_error: int = 0
    frames: int = 0
    bad_frames: int = 0
    snr_rss_db: int = 0
    snr_in_db: float = math.nan
    snr_out_db: float = math.nan
    snr_symbol_db: float = math.nan
    mse_db: float = math.nan
    doppler_mps: float = math.nan
    noise_db: int = 0
    carrier_hz: int = 25000
    bandwidth_hz: int = 5000

    @classmethod
    def read(cls, fields: Sequence[str]) -> ReceptionStatistics:
        """From the fields of `$CACST`: version 6 and later; older ones have no version, no date, no carrier."""
        version = _int(fields, 0, "version")
        rest = fields[1:] if version >= 6 else fields
        mode = _int(rest, 0, "mode")
        utc_s = read_arrival_time(_text(rest, 1, "toa"))  # an old one has no date: NaN
        if mode == MODE_PACKET_TIMEOUT:
            return cls(mode=mode, utc_s=utc_s)
        return cls(
            mode=mode,
            utc_s=utc_s,
            clock=_int(rest, 2, "toa_mode"),
            detection=Detection(
                peak=_int(rest, 3, "mfd_peak"),
                power_db=_int(rest, 4, "mfd_pow"),
                ratio_db=_int(rest, 5, "mfd_ratio"),
                spl_db=_int(rest, 6, "mfd_spl"),
            ),
            rate=_int(rest, 12, "rate"),
            source=_int(rest, 13, "src"),
            destination=_int(rest, 14, "dest"),
            psk_error=_int(rest, 15, "psk_error"),
            frames=_int(rest, 17, "frames"),
            bad_frames=_int(rest, 18, "bad_frames"),
            snr_rss_db=_int(rest, 19, "snr_rss"),
            snr_in_db=_float(rest, 20, "snr_in"),
            snr_out_db=_float(rest, 21, "snr_out"),
            snr_symbol_db=_float(rest, 22, "snr_sym"),
            mse_db=_float(rest, 23, "mse"),
            doppler_mps=_float(rest, 25, "doppler"),
            noise_db=_int(rest, 26, "noise") if len(rest) > 26 else 0,
            carrier_hz=_int(rest, 27, "carrier") if len(rest) > 27 else 0,
            bandwidth_hz=_int(rest, 28, "bandwidth") if len(rest) > 28 else 0,
        )

    def sentence(self) -> Sentence:
        """`$CACST`, version 6, 30 fields; gains and shifts are 0, data quality 0."""
        stamp = "" if math.isnan(self.utc_s) else arrival_time(self.utc_s)
        detection = self.detection
        # the same whatever the mode: firmware fills a packet timeout's fields with zeros
        fields = (
            "6",
            str(self.mode),
            stamp,
            str(self.clock),
            *(f"{n:05d}" for n in (detection.peak, detection.power_db, detection.ratio_db, detection.spl_db)),
            *("0",) * 5,
            str(self.rate),
            str(self.source),
            str(self.destination),
            str(self.psk_error),
            "1" if self.rate == 0 else "3",
            str(self.frames),
            str(self.bad_frames),
            str(self.snr_rss_db),
            *(
                f"{0.0 if math.isnan(x) else x:.1f}"
                for x in (self.snr_in_db, self.snr_out_db, self.snr_symbol_db, self.mse_db)
            ),
            "0",
            f"{0.0 if math.isnan(self.doppler_mps) else self.doppler_mps:.1f}",
            str(self.noise_db),
            str(self.carrier_hz),
            str(self.bandwidth_hz),
        )
        return Sentence("CACST", fields)


def clock_is_synchronous(clock: int) -> bool:
    """Whether the clock status of `$CACST` and `$CAXST` (from firmware 2.0.26038) says set, and held by a PPS.

    Bits 0-1: where the time comes from (2 user command, 3 user GPS: set). Bits 2-4: the PPS (3 external, 4 the
    modem's clock synchronized to the last external one).
    """
    return clock & 0b11 in (2, 3) and (clock >> 2) & 0b111 in (3, 4)


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """`$CAMSG,KIND,...`: BAD_CRC, PACKET_TIMEOUT and others."""

    kind: str
    detail: str

    @classmethod
    def read(cls, fields: Sequence[str]) -> Notice:
        """From the fields of `$CAMSG`; older firmware says "Bad CRC" and "Packet Timeout"."""
        return cls(kind=_text(fields, 0, "kind").upper().replace(" ", "_"), detail=",".join(fields[1:]))

    def sentence(self) -> Sentence:
        """`$CAMSG`."""
        return Sentence("CAMSG", (self.kind, self.detail))


@dataclass(frozen=True, slots=True, kw_only=True)
class Trouble:
    """`$CAERR,hhmmss,module,num,msg`: a command refused, data that never came, a fault inside."""

    time: str
    module: str
    number: int
    detail: str

    @classmethod
    def read(cls, fields: Sequence[str]) -> Trouble:
        """From the fields of `$CAERR`; number -1 where the modem gives none."""
        number = fields[2] if len(fields) > 2 else ""
        return cls(
            time=_text(fields, 0, "time"),
            module=_text(fields, 1, "module").upper(),
            number=int(number) if _INT.match(number) else -1,
            detail=",".join(fields[3:]),
        )

    def sentence(self) -> Sentence:
        """`$CAERR`."""
        return Sentence("CAERR", (self.time, self.module, str(self.number), self.detail))


class _Reader(Protocol):
    def __call__(self, fields: Sequence[str], /) -> Message: ...


#: Every sentence the driver understands, and what reads it.
MESSAGES: dict[str, _Reader] = {
    "CAREV": Revision.read,
    "CACFG": Setting.read,
    "CATMS": ClockSet.read,
    "CATMQ": ClockTime.read,
    "CACYC": Cycle.read,
    "CADRQ": DataRequest.read,
    "CATXD": FrameTaken.read,
    "CATXP": TransmitStart.read,
    "CATXF": TransmitEnd.read,
    "CAXST": TransmitStatistics.read,
    "CARXP": ReceptionStart.read,
    "CAMFD": Detection.read,
    "CARXD": FrameHeard.read,
    "CACST": ReceptionStatistics.read,
    "CAMSG": Notice.read,
    "CAERR": Trouble.read,
}


def read_message(sentence: Sentence) -> Message | None:
    """The message that a modem's sentence says, or None if the driver has no use for its type.

    Raises:
        SentenceError: if the fields do not fit the type; names the sentence, the field and its text.
    """
    reader: Callable[[Sequence[str]], Message] | None = MESSAGES.get(sentence.type)
    if reader is None:
        return None
    try:
        return reader(sentence.fields)
    except SentenceError as error:
        raise SentenceError(f"${sentence.type}: {error}") from None


class TypeCounts:
    """Counts sentence types by name, up to `MAX_UNKNOWN_TYPES` of them; the rest as "others"."""

    OTHERS: ClassVar[str] = "others"

    def __init__(self) -> None:
        """Starts with nothing counted."""
        self.counts: Counter[str] = Counter()

    def add(self, kind: str) -> None:
        """Counts one more of `kind`."""
        if kind not in self.counts and len(self.counts) >= MAX_UNKNOWN_TYPES:
            kind = self.OTHERS
        self.counts[kind] += 1
