"""What a Micromodem reports about itself: revision, settings, clock, notices and errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from auv_lse_comms.micromodem.sentences.fields import is_int, iso_time, read_iso_time, take_flag, take_text
from auv_lse_comms.micromodem.sentences.wire import Sentence


@dataclass(frozen=True, slots=True, kw_only=True)
class Revision:
    """`$CAREV,hhmmss,IDENT,version`: sent at start-up (ident INIT, then AUV) and, with REV on, every few minutes."""

    time: str
    ident: str
    version: str

    @classmethod
    def read(cls, fields: Sequence[str]) -> Revision:
        """From the fields of `$CAREV`."""
        return cls(time=take_text(fields, 0, "time"), ident=take_text(fields, 1, "ident"), version=",".join(fields[2:]))

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
        return cls(name=take_text(fields, 0, "name"), value=take_text(fields, 1, "value"))

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
        return cls(
            timed_out=take_flag(fields, 0, "timed_out"), utc_s=read_iso_time(take_text(fields, 1, "time"), "time")[0]
        )

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
        utc_s, resolution_s = read_iso_time(take_text(fields, 0, "time"), "time")
        return cls(
            utc_s=utc_s,
            resolution_s=resolution_s,
            source=take_text(fields, 1, "source"),
            pps=take_text(fields, 2, "pps"),
        )

    def sentence(self) -> Sentence:
        """`$CATMQ`."""
        return Sentence("CATMQ", (iso_time(self.utc_s), self.source, self.pps))


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """`$CAMSG,KIND,...`: BAD_CRC, PACKET_TIMEOUT and others."""

    kind: str
    detail: str

    @classmethod
    def read(cls, fields: Sequence[str]) -> Notice:
        """From the fields of `$CAMSG`; older firmware says "Bad CRC" and "Packet Timeout"."""
        return cls(kind=take_text(fields, 0, "kind").upper().replace(" ", "_"), detail=",".join(fields[1:]))

    def sentence(self) -> Sentence:
        """`$CAMSG`."""
        return Sentence("CAMSG", (self.kind, self.detail))


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorReport:
    """`$CAERR,hhmmss,module,num,msg`: a command refused, data that never came, a fault inside."""

    time: str
    module: str
    number: int
    detail: str

    @classmethod
    def read(cls, fields: Sequence[str]) -> ErrorReport:
        """From the fields of `$CAERR`; number -1 where the modem gives none."""
        number = fields[2] if len(fields) > 2 else ""
        return cls(
            time=take_text(fields, 0, "time"),
            module=take_text(fields, 1, "module").upper(),
            number=int(number) if is_int(number) else -1,
            detail=",".join(fields[3:]),
        )

    def sentence(self) -> Sentence:
        """`$CAERR`."""
        return Sentence("CAERR", (self.time, self.module, str(self.number), self.detail))
