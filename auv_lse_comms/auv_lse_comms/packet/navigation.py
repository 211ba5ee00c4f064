"""The sender's navigation in a packet: its dead-reckoned position at transmission, and its last fix.

Bytes, before the path's terminal byte; the first one selects the content:

    0xEC  dead-reckoned position: north, east (int24, cm)                                           7 bytes in all
    0xED  the same; then the last fix: its dead-reckoned position: north, east (int16, 0.5 m), and the GPS
          position minus that: north, east (int12, dm; packed into 3 bytes)                        14 bytes in all

Little-endian, two's complement. The samples of such a packet are in its sender's raw frame: dead-reckoned from its
start without any fix, like the dead-reckoned position. The fix's dead-reckoned position only locates the fix on the
track, so a resolution of 0.5 m suffices; the offset to GPS corrects the track.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix

#: First byte where the dead-reckoned position follows, and where a fix follows it.
RAW, RAW_AND_FIX = 0xEC, 0xED
#: Sizes in bytes, the first one included.
SIZES = {RAW: 7, RAW_AND_FIX: 14}
#: Largest size of navigation in bytes.
MAX_BYTES = SIZES[RAW_AND_FIX]

_CM, _HALF_M, _DM = 0.01, 0.5, 0.1
_BITS = {"dead-reckoned position": 24, "dead-reckoned position of the fix": 16, "fix minus dead-reckoned position": 12}


def _units(what: str, north_m: float, east_m: float, unit_m: float) -> tuple[int, int]:
    """Two numbers (m), rounded to units."""
    high = 2 ** (_BITS[what] - 1) - 1
    if not (math.isfinite(north_m) and math.isfinite(east_m)):
        raise ValueError(f"{what} must be finite, not {north_m}, {east_m} m")
    north, east = round(north_m / unit_m), round(east_m / unit_m)
    if max(abs(north), abs(east)) > high:
        raise ValueError(f"{what} is {north_m:.1f}, {east_m:.1f} m; a packet holds at most +-{high * unit_m:.1f} m")
    return north, east


@dataclass(frozen=True, slots=True, kw_only=True)
class Navigation:
    """A sender's dead-reckoned position and its last fix, in the packet's units, so that decoding restores it exactly.

    Attributes:
        raw_cm: Dead-reckoned position at transmission: north, east (cm).
        fix_raw_half_m: Dead-reckoned position at the last fix: north, east (0.5 m); None if there was no fix.
        fix_off_dm: GPS position minus that dead-reckoned position: north, east (dm); None likewise.
    """

    raw_cm: tuple[int, int]
    fix_raw_half_m: tuple[int, int] | None = None
    fix_off_dm: tuple[int, int] | None = None

    @classmethod
    def of(cls, raw: DeadReckoning, fix: Fix | None) -> Navigation:
        """A dead-reckoned position and the last fix, rounded to the packet's units.

        Raises:
            ValueError: naming the position or offset that is not finite or does not fit.
        """
        raw_cm = _units("dead-reckoned position", raw.north_m, raw.east_m, _CM)
        if fix is None:
            return cls(raw_cm=raw_cm)
        off_m = fix.north_m - fix.raw_north_m, fix.east_m - fix.raw_east_m
        return cls(
            raw_cm=raw_cm,
            fix_raw_half_m=_units("dead-reckoned position of the fix", fix.raw_north_m, fix.raw_east_m, _HALF_M),
            fix_off_dm=_units("fix minus dead-reckoned position", *off_m, _DM),
        )

    @property
    def raw_m(self) -> tuple[float, float]:
        """Dead-reckoned position at transmission: north, east (m)."""
        return self.raw_cm[0] * _CM, self.raw_cm[1] * _CM

    @property
    def fix_raw_m(self) -> tuple[float, float]:
        """Dead-reckoned position at the last fix: north, east (m); NaN without a fix."""
        if self.fix_raw_half_m is None:
            return math.nan, math.nan
        return self.fix_raw_half_m[0] * _HALF_M, self.fix_raw_half_m[1] * _HALF_M

    @property
    def fix_m(self) -> tuple[float, float]:
        """The same position by GPS: north, east (m); NaN without a fix."""
        if self.fix_off_dm is None:
            return math.nan, math.nan
        north_m, east_m = self.fix_raw_m
        return north_m + self.fix_off_dm[0] * _DM, east_m + self.fix_off_dm[1] * _DM

    @property
    def size(self) -> int:
        """Bytes on the wire."""
        return SIZES[RAW if self.fix_off_dm is None else RAW_AND_FIX]

    def to_bytes(self) -> bytes:
        """Its bytes."""
        raw = b"".join(value.to_bytes(3, "little", signed=True) for value in self.raw_cm)
        if self.fix_raw_half_m is None or self.fix_off_dm is None:
            return bytes([RAW]) + raw
        position = b"".join(value.to_bytes(2, "little", signed=True) for value in self.fix_raw_half_m)
        north, east = (value & 0xFFF for value in self.fix_off_dm)
        return bytes([RAW_AND_FIX]) + raw + position + (north | east << 12).to_bytes(3, "little")

    @classmethod
    def from_bytes(cls, data: bytes) -> Navigation:
        """From bytes that begin with `RAW` or `RAW_AND_FIX` and have its size."""
        raw_cm = _signed(data[1:4]), _signed(data[4:7])
        if data[0] == RAW:
            return cls(raw_cm=raw_cm)
        both = int.from_bytes(data[11:14], "little")
        north, east = (value - 0x1000 if value & 0x800 else value for value in (both & 0xFFF, both >> 12))
        return cls(raw_cm=raw_cm, fix_raw_half_m=(_signed(data[7:9]), _signed(data[9:11])), fix_off_dm=(north, east))


def _signed(data: bytes) -> int:
    return int.from_bytes(data, "little", signed=True)
