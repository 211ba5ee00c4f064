"""The sentences of a reception: the probe detected, the frames received, and how the reception went."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from auv_lse_comms.micromodem.sentences.fields import (
    arrival_time,
    number_or,
    read_arrival_time,
    take_flag,
    take_hex,
    take_int,
    take_text,
    whole_or,
)
from auv_lse_comms.micromodem.sentences.wire import Sentence

#: `ReceptionStatistics.mode`
MODE_GOOD, MODE_BAD_CRC, MODE_PACKET_TIMEOUT = 0, 1, 2


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceptionStart:
    """`$CARXP,type`: a packet's probe has been detected (0: FSK mini-packet, 1: PSK)."""

    kind: int

    @classmethod
    def read(cls, fields: Sequence[str]) -> ReceptionStart:
        """From the fields of `$CARXP`."""
        return cls(kind=take_int(fields, 0, "type"))

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
        peak, power, ratio, spl = (take_int(fields, i, name) for i, name in enumerate(names))
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
            source=take_int(fields, 0, "src", 0, 127),
            destination=take_int(fields, 1, "dest", 0, 127),
            ack=take_flag(fields, 2, "ack"),
            frame=take_int(fields, 3, "frame", 1, 64),
            data=take_hex(fields, 4, "data"),
        )

    def sentence(self) -> Sentence:
        """`$CARXD`."""
        fields = (str(self.source), str(self.destination), f"{self.ack:d}", str(self.frame), self.data.hex().upper())
        return Sentence("CARXD", fields)


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
        version = take_int(fields, 0, "version")
        rest = fields[1:] if version >= 6 else fields
        mode = take_int(rest, 0, "mode")
        utc_s = read_arrival_time(take_text(rest, 1, "toa"))  # an old one has no date: NaN
        if mode == MODE_PACKET_TIMEOUT:
            return cls(mode=mode, utc_s=utc_s)
        return cls(
            mode=mode,
            utc_s=utc_s,
            clock=whole_or(rest, 2, "toa_mode"),
            detection=Detection(
                peak=whole_or(rest, 3, "mfd_peak"),
                power_db=whole_or(rest, 4, "mfd_pow"),
                ratio_db=whole_or(rest, 5, "mfd_ratio"),
                spl_db=whole_or(rest, 6, "mfd_spl"),
            ),
            rate=whole_or(rest, 12, "rate", -1),
            source=whole_or(rest, 13, "src", -1),
            destination=whole_or(rest, 14, "dest", -1),
            psk_error=whole_or(rest, 15, "psk_error"),
            frames=whole_or(rest, 17, "frames"),
            bad_frames=whole_or(rest, 18, "bad_frames"),
            snr_rss_db=whole_or(rest, 19, "snr_rss"),
            snr_in_db=number_or(rest, 20, "snr_in"),
            snr_out_db=number_or(rest, 21, "snr_out"),
            snr_symbol_db=number_or(rest, 22, "snr_sym"),
            mse_db=number_or(rest, 23, "mse"),
            doppler_mps=number_or(rest, 25, "doppler"),
            noise_db=whole_or(rest, 26, "noise"),
            carrier_hz=whole_or(rest, 27, "carrier"),
            bandwidth_hz=whole_or(rest, 28, "bandwidth"),
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
    """Whether a clock status of `$CACST` or `$CAXST` (from firmware 2.0.26038) means: set, and held by a PPS.

    Bits 0-1: where the time comes from (2 user command, 3 user GPS: set). Bits 2-4: the PPS (3 external, 4 the
    modem's clock synchronized to the last external one).
    """
    return clock & 0b11 in (2, 3) and (clock >> 2) & 0b111 in (3, 4)
