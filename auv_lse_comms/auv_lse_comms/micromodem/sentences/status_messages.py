"""The sentences in which a Micromodem reports its state: revision, settings, clock, notices and errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from auv_lse_comms.micromodem.sentences.fields import is_int, iso_time, read_iso_time, take_text
from auv_lse_comms.micromodem.sentences.layout import Message, column, flag, rest, text
from auv_lse_comms.micromodem.sentences.wire import Sentence


@dataclass(frozen=True, slots=True, kw_only=True)
class Revision(Message):
    """`$CAREV,hhmmss,IDENT,version`: sent at start-up (ident INIT, then AUV) and, with REV on, every few minutes."""

    TYPE: ClassVar[str] = "CAREV"
    time: str = text("time")
    ident: str = text("ident")
    version: str = rest()


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting(Message):
    """`$CACFG,NAME,value`: a setting's value in the modem; `$CCCFG,NAME,value` sets it."""

    TYPE: ClassVar[str] = "CACFG"
    name: str = text("name")
    value: str = text("value")


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockSet(Message):
    """`$CATMS,timed_out,time`: answer to `$CCTMS`."""

    TYPE: ClassVar[str] = "CATMS"
    timed_out: bool = flag("timed_out")
    utc_s: float = column(
        "time", lambda fields, index, name: read_iso_time(take_text(fields, index, name), name)[0], iso_time
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockTime(Message):
    """`$CATMQ,time,source,pps`: the modem's clock.

    Attributes:
        utc_s: Its time, s since 1970 (UTC).
        resolution_s: Resolution of that time, s: the clock stands between utc_s and utc_s + resolution_s.
        source: What the clock was set from: "NONE", "RTC", "USER_CMD", "USER_GPS".
        pps: What disciplines the clock: "NONE", "RTC", "CAL", "EXT_SYNC", "EXT".
    """

    TYPE: ClassVar[str] = "CATMQ"
    utc_s: float
    resolution_s: float
    source: str
    pps: str

    @classmethod
    def read(cls, fields: Sequence[str]) -> ClockTime:
        """From the fields of `$CATMQ`."""
        utc_s, resolution_s = read_iso_time(take_text(fields, 0, "time"), "time")
        source, pps = take_text(fields, 1, "source"), take_text(fields, 2, "pps")
        return cls(utc_s=utc_s, resolution_s=resolution_s, source=source, pps=pps)

    def sentence(self) -> Sentence:
        """`$CATMQ`."""
        return Sentence(self.TYPE, (iso_time(self.utc_s), self.source, self.pps))


def _kind(fields: Sequence[str], index: int, name: str) -> str:
    return take_text(fields, index, name).upper().replace(" ", "_")


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice(Message):
    """`$CAMSG,KIND,...`: BAD_CRC, PACKET_TIMEOUT and others; older firmware writes "Bad CRC" and "Packet Timeout"."""

    TYPE: ClassVar[str] = "CAMSG"
    kind: str = column("kind", _kind)
    detail: str = rest()


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorReport(Message):
    """`$CAERR,hhmmss,module,num,msg`: a refused command, data that never came, or an internal fault.

    `number` is -1 if the modem sends none.
    """

    TYPE: ClassVar[str] = "CAERR"
    time: str = text("time")
    module: str = column("module", lambda fields, index, name: take_text(fields, index, name).upper())
    number: int = column(
        "num", lambda fields, index, _: int(fields[index]) if len(fields) > index and is_int(fields[index]) else -1
    )
    detail: str = rest()
