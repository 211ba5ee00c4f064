"""The sentences of a reception: the probe detected, the frames received, and the statistics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from auv_lse_comms.micromodem.sentences.fields import arrival_time, read_arrival_time, take_int, take_text
from auv_lse_comms.micromodem.sentences.layout import Message, address, flag, hexadecimal, rounded, tenths, whole
from auv_lse_comms.micromodem.sentences.wire import Sentence

#: `ReceptionStatistics.mode`
MODE_GOOD, MODE_BAD_CRC, MODE_PACKET_TIMEOUT = 0, 1, 2


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceptionStart(Message):
    """`$CARXP,type`: a packet's probe has been detected (0: FSK mini-packet, 1: PSK)."""

    TYPE: ClassVar[str] = "CARXP"
    kind: int = whole("type")


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection(Message):
    """`$CAMFD,peak,power,ratio,spl`: the matched filter's detection, in counts and dB."""

    TYPE: ClassVar[str] = "CAMFD"
    peak: int = whole("peak", digits=5)
    power_db: int = whole("power", digits=5)
    ratio_db: int = whole("ratio", digits=5)
    spl_db: int = whole("spl", digits=5)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameHeard(Message):
    """`$CARXD,src,dest,ack,frame#,HEX`: one frame of a packet, received without error."""

    TYPE: ClassVar[str] = "CARXD"
    source: int = address("src")
    destination: int = address("dest")
    ack: bool = flag("ack")
    frame: int = whole("frame", 1, 64)
    data: bytes = hexadecimal("data")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceptionStatistics(Message):
    """`$CACST,6,mode,toa,toa_mode,...`: the statistics of a reception, as far as the driver uses them.

    Attributes:
        mode: 0 good, 1 bad CRC in a frame, 2 packet timeout (then only `utc_s` and `mode` are known).
        utc_s: Arrival of the packet's probe on the modem's clock, s since 1970 (UTC); NaN if unreadable.
        clock: Clock status, see `clock_is_synchronous`.
        snr_in_db: Signal to noise ratio at the equalizer's input, dB; NaN if unknown.
    """

    TYPE: ClassVar[str] = "CACST"
    mode: int
    utc_s: float
    clock: int = rounded("toa_mode", 2, default=0)
    rate: int = rounded("rate", 12, missing=-1, default=-1)
    source: int = rounded("src", 13, missing=-1, default=-1)
    destination: int = rounded("dest", 14, missing=-1, default=-1)
    frames: int = rounded("frames", 17, default=0)
    bad_frames: int = rounded("bad_frames", 18, default=0)
    snr_in_db: float = tenths("snr_in", 20)

    @classmethod
    def read(cls, fields: Sequence[str]) -> ReceptionStatistics:
        """From the fields of `$CACST`: version 6 and later; older ones have no version, no date, no carrier."""
        version = take_int(fields, 0, "version")
        fields = fields[1:] if version >= 6 else fields
        mode = take_int(fields, 0, "mode")
        utc_s = read_arrival_time(take_text(fields, 1, "toa"))  # an old one has no date: NaN
        if mode == MODE_PACKET_TIMEOUT:
            return cls(mode=mode, utc_s=utc_s)
        return cls(mode=mode, utc_s=utc_s, **cls.read_columns(fields))

    def sentence(self) -> Sentence:
        """`$CACST`, version 6, 30 fields; those that the driver does not use are 0, carrier and bandwidth excepted."""
        texts = [*self.texts(), *["0"] * 6, "25000", "5000"]
        texts[:2] = str(self.mode), "" if math.isnan(self.utc_s) else arrival_time(self.utc_s)
        texts[16] = "1" if self.rate == 0 else "3"
        return Sentence(self.TYPE, ("6", *texts))


def clock_is_synchronous(clock: int) -> bool:
    """Whether a clock status of `$CACST` or `$CAXST` (from firmware 2.0.26038) means: set, and disciplined by a PPS.

    Bits 0-1: what the time was set from (2 user command, 3 user GPS). Bits 2-4: the PPS (3 external, 4 the modem's
    clock synchronized to the last external one).
    """
    return clock & 0b11 in (2, 3) and (clock >> 2) & 0b111 in (3, 4)
