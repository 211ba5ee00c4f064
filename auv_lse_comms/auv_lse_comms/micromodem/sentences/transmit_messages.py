"""The sentences of a transmission: the cycle asked for, the frames handed over, the start and the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from auv_lse_comms.micromodem.sentences.fields import (
    arrival_time,
    read_arrival_time,
    take_flag,
    take_hex,
    take_int,
    take_text,
    whole_or,
)
from auv_lse_comms.micromodem.sentences.wire import Sentence


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
            command=take_int(fields, 0, "cmd"),
            source=take_int(fields, 1, "src", 0, 127),
            destination=take_int(fields, 2, "dest", 0, 127),
            rate=take_int(fields, 3, "rate", 0, 6),
            ack=take_flag(fields, 4, "ack"),
            frames=take_int(fields, 5, "frames", 0, 64),
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
            time=take_text(fields, 0, "time"),
            source=take_int(fields, 1, "src", 0, 127),
            destination=take_int(fields, 2, "dest", 0, 127),
            ack=take_flag(fields, 3, "ack"),
            max_bytes=take_int(fields, 4, "nbytes", 0, 2048),
            frame=take_int(fields, 5, "frame", 1, 64),
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
            source=take_int(fields, 0, "src", 0, 127),
            destination=take_int(fields, 1, "dest", 0, 127),
            ack=take_flag(fields, 2, "ack"),
            data=take_hex(fields, 3, "data"),
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
            source=take_int(fields, 0, "src", 0, 127),
            destination=take_int(fields, 1, "dest", 0, 127),
            ack=take_flag(fields, 2, "ack"),
            count=take_int(fields, 3, "nbytes", 0, 4096),
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
        return cls(count=take_int(fields, 0, "nbytes", 0, 65535))

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
        return cls(count=take_int(fields, 0, "nbytes", 0, 65535))

    def sentence(self) -> Sentence:
        """`$CATXF`."""
        return Sentence("CATXF", (str(self.count),))


#: Why nothing was sent, by `TransmitStatistics.mode`.
NOT_SENT = {
    1: "it is too hot",
    2: "no external synchronization came in time",
    3: "transmission is inhibited",
    4: "data timeout",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitStatistics:
    """`$CAXST,6,date,time,toa_mode,mode,probe,bandwidth,carrier,rate,src,dest,ack,expected,sent,type,nbytes`.

    Attributes:
        utc_s: When the transmission began, s since 1970 (UTC); NaN if unreadable.
        clock: Clock status, see `clock_is_synchronous`.
        mode: 0 transmitted; others: nothing was sent, see `NOT_SENT`.
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
        first = take_int(fields, 0, "version")
        rest = fields[1:] if first < 1970_00_00 else fields
        utc_s = read_arrival_time(take_text(rest, 0, "date") + take_text(rest, 1, "time"))
        mode = take_int(rest, 3, "mode")
        return cls(  # where nothing was sent, most is not filled in
            utc_s=utc_s,
            clock=whole_or(rest, 2, "toa_mode"),
            mode=mode,
            bandwidth_hz=whole_or(rest, 5, "bandwidth"),
            carrier_hz=whole_or(rest, 6, "carrier"),
            rate=whole_or(rest, 7, "rate", -1),
            source=whole_or(rest, 8, "src", -1),
            destination=whole_or(rest, 9, "dest", -1),
            frames_expected=whole_or(rest, 11, "frames expected"),
            frames_sent=whole_or(rest, 12, "frames sent"),
            count=whole_or(rest, 14, "nbytes"),
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
