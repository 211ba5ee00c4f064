"""The sentences of a transmission: the cycle requested, the frames handed over, the start and the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from auv_lse_comms.micromodem.sentences.fields import arrival_time, read_arrival_time, take_int, take_text
from auv_lse_comms.micromodem.sentences.layout import Message, address, flag, hexadecimal, rounded, text, whole
from auv_lse_comms.micromodem.sentences.wire import Sentence


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycle(Message):
    """`$CACYC,cmd,src,dest,rate,ack,frames`: a packet begins, our own (echo of `$CCCYC`) or another modem's."""

    TYPE: ClassVar[str] = "CACYC"
    command_number: int = whole("cmd", default=0)
    source: int = address("src")
    destination: int = address("dest")
    rate: int = whole("rate", 0, 6)
    ack: bool = flag("ack")
    frames: int = whole("frames", 0, 64)


@dataclass(frozen=True, slots=True, kw_only=True)
class DataRequest(Message):
    """`$CADRQ,hhmmss,src,dest,ack,nbytes,frame#`: the modem requests a frame (numbered from 1)."""

    TYPE: ClassVar[str] = "CADRQ"
    time: str = text("time")
    source: int = address("src")
    destination: int = address("dest")
    ack: bool = flag("ack")
    max_bytes: int = whole("nbytes", 0, 2048)
    frame: int = whole("frame", 1, 64)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameGiven(Message):
    """`$CCTXD,src,dest,ack,HEX`: one frame of data for the packet that the modem assembles."""

    TYPE: ClassVar[str] = "CCTXD"
    source: int = address("src")
    destination: int = address("dest")
    ack: bool = flag("ack")
    data: bytes = hexadecimal("data")


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTaken(Message):
    """`$CATXD,src,dest,ack,nbytes`: the modem has accepted a frame."""

    TYPE: ClassVar[str] = "CATXD"
    source: int = address("src")
    destination: int = address("dest")
    ack: bool = flag("ack")
    count: int = whole("nbytes", 0, 4096)


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitStart(Message):
    """`$CATXP,nbytes`: the transducer begins to send."""

    TYPE: ClassVar[str] = "CATXP"
    count: int = whole("nbytes", 0, 65535)


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitEnd(Message):
    """`$CATXF,nbytes`: the transmission is over."""

    TYPE: ClassVar[str] = "CATXF"
    count: int = whole("nbytes", 0, 65535)


#: Why nothing was sent, by `TransmitStatistics.mode`.
NOT_SENT = {
    1: "it is too hot",
    2: "no external synchronization came in time",
    3: "transmission is inhibited",
    4: "data timeout",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmitStatistics(Message):
    """`$CAXST,6,date,time,toa_mode,mode,probe,bandwidth,carrier,rate,src,dest,ack,expected,sent,type,nbytes`.

    Most fields are empty if nothing was sent.

    Attributes:
        utc_s: When the transmission began, s since 1970 (UTC); NaN if unreadable.
        clock: Clock status, see `clock_is_synchronous`.
        mode: 0 transmitted; others: nothing was sent, see `NOT_SENT`.
    """

    TYPE: ClassVar[str] = "CAXST"
    utc_s: float
    mode: int
    clock: int = rounded("toa_mode", 2)
    rate: int = rounded("rate", 7, missing=-1)
    source: int = rounded("src", 8, missing=-1)
    destination: int = rounded("dest", 9, missing=-1)
    frames_expected: int = rounded("frames expected", 11)
    frames_sent: int = rounded("frames sent", 12)
    count: int = rounded("nbytes", 14)

    @classmethod
    def read(cls, fields: Sequence[str]) -> TransmitStatistics:
        """From the fields of `$CAXST`, with the version in front (from firmware 2.0) or without."""
        first = take_int(fields, 0, "version")
        fields = fields[1:] if first < 1970_00_00 else fields
        utc_s = read_arrival_time(take_text(fields, 0, "date") + take_text(fields, 1, "time"))
        return cls(utc_s=utc_s, mode=take_int(fields, 3, "mode"), **cls.read_columns(fields))

    def sentence(self) -> Sentence:
        """`$CAXST`, version 6; probe length 200 samples, packet type 3 (PSK) or 1 (FSK)."""
        stamp, texts = arrival_time(self.utc_s), self.texts()
        texts[:7] = stamp[:8], stamp[8:], texts[2], str(self.mode), "200", "5000", "25000"
        texts[13] = "1" if self.rate == 0 else "3"
        return Sentence(self.TYPE, ("6", *texts))
