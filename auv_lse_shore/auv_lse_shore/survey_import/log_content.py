"""The content of one log: every kind of position and every sounder that a reader finds, none of them chosen yet.

A reader adds all that it finds. `choice.py` then takes one sounder, so that no two are mixed and no ping counts twice.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from auv_lse_common.support.arrays import Array, Mask

#: Reasons of readers of several formats.
NO_FIX = "positions without a fix"
NO_POSITION = "positions at 0, 0"
NOT_ON_EARTH = "positions that are not on earth"
NO_ECHO = "depths of 0 or less: no echo"
#: A clock that goes back by more than this (s) was set back, if that happens at most this number of times.
_BACK_S, _MOST_BACK = 5.0, 5
#: Shares of negative depths: above the first, their sign is mere notation; up to the second, they are missing echoes.
_NEGATIVE, _FEW = 0.9, 0.05


class Reference(Enum):
    """The reference from which a sounder's depths are measured."""

    SURFACE = "the surface"
    TRANSDUCER = "the transducer"
    KEEL = "the keel"


class Clock(Enum):
    """The kind of a log's times."""

    UTC = "seconds since 1970"
    LOCAL = "seconds since 1970 by a clock whose time zone is unknown"
    DAY = "seconds of a day without a date"
    ELAPSED = "seconds since an unknown start"
    NONE = "row numbers"


@dataclass(slots=True, kw_only=True)
class Sounder:
    """The depths of one sounder.

    Attributes:
        reference: The reference of its depths.
        quality_scale: The quality that means certain; 0 if the scale is unknown, as in a table.
        offset_m: Depth of the transducer (m) that the log states, and that its depths contain.
        is_unchecked: Whether another sounder of the log has the same pings, and knows which are out of range.
        pings: Time (s), depth (m) and quality (NaN: none) of one ping after the other.
    """

    reference: Reference = Reference.TRANSDUCER
    quality_scale: float = 100.0
    offset_m: float = 0.0
    is_unchecked: bool = False
    pings: array[float] = field(default_factory=lambda: array("d"))

    @property
    def rows(self) -> Array:
        """Rows (time s, depth m, quality), shape (n, 3)."""
        return np.frombuffer(self.pings, dtype=float).reshape(-1, 3).copy()


class LogContent:
    """One log of one vehicle, as its reader found it.

    Attributes:
        name: The log's name for the user.
        sounders: Sounders by name, such as "SDDPT" or "RFND 1".
        clock: The kind of its times.
        stood_still: Whether the clock stood still, so that times only order the rows.
        is_geodetic: Whether positions are degrees; else metres north and east.
        is_submarine: Whether the log is of a vehicle under water, whose own depth has to be added.
        own_depths: Rows (time s, depth of the vehicle m) that the depths contain; no rows for a boat.
        is_checked: Whether this project wrote it: its soundings have passed the checks.
        position_std_m: Stated standard deviations north and east (m) of the positions, (n, 2), or None.
        depth_std_m: Largest stated standard deviation (m) of a depth; 0 if none is stated.
        lag_std_s: Standard deviation (s) of the time between a depth's measurement and its stamp.
        left_out: Positions and depths left out, by reason.
        notes: What the user should know about how it was read.
        questions: What the log leaves open, with the option that answers it.
    """

    def __init__(self, name: str, clock: Clock = Clock.UTC) -> None:
        self.name = name
        self.sounders: dict[str, Sounder] = {}
        self.clock = clock
        self.stood_still = False
        self.is_geodetic = True
        self.is_submarine = False
        self.own_depths: Array = np.empty((0, 2))
        self.is_checked = False
        self.position_std_m: Array | None = None
        self.depth_std_m = 0.0
        self.lag_std_s = 0.0
        self.left_out: Counter[str] = Counter()
        self.notes: list[str] = []
        self.questions: list[str] = []
        self._positions: dict[str, array[float]] = defaultdict(lambda: array("d"))
        self._pressures: dict[str, array[float]] = defaultdict(lambda: array("d"))

    def position(self, kind: str, stamp_s: float, lat_deg: float, lon_deg: float) -> None:
        """Adds a position in degrees; 0, 0 and impossible ones are ignored."""
        if lat_deg == 0.0 and lon_deg == 0.0:
            self.left_out[NO_POSITION] += 1
        elif not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 360.0 and math.isfinite(stamp_s)):
            self.left_out[NOT_ON_EARTH] += 1
        else:
            self._positions[kind].extend((stamp_s, lat_deg, lon_deg))

    def add_positions(self, kind: str, rows: ArrayLike) -> None:
        """Adds rows (time s, latitude, longitude deg, or north, east m), shape (n, 3); see `position`."""
        table = np.asarray(rows, dtype=float).reshape(-1, 3)
        if self.is_geodetic:
            zero = (table[:, 1:] == 0.0).all(axis=1)
            wrong = ~((np.abs(table[:, 1:]) <= (90.0, 360.0)).all(axis=1) & np.isfinite(table[:, 0]) | zero)
            self.left_out[NO_POSITION] += int(zero.sum())
            self.left_out[NOT_ON_EARTH] += int(wrong.sum())
            table = table[~(zero | wrong)]
        self._positions[kind].frombytes(np.ascontiguousarray(table).tobytes())

    def depth(self, sounder: str, stamp_s: float, depth_m: float, quality: float = math.nan) -> None:
        """Adds a ping of a sounder that `sounders` has, or of a new one that measures from the transducer."""
        if not depth_m > 0.0:
            self.left_out[NO_ECHO] += 1
            return
        self.sounders.setdefault(sounder, Sounder()).pings.extend((stamp_s, depth_m, quality))

    def add_depths(self, sounder: str, rows: ArrayLike) -> None:
        """Adds pings (time s, depth m, quality or NaN), shape (n, 3); those without an echo are counted."""
        table = np.asarray(rows, dtype=float).reshape(-1, 3)
        echo = table[:, 1] > 0.0
        self.left_out[NO_ECHO] += int((~echo).sum())
        pings = self.sounders.setdefault(sounder, Sounder()).pings
        pings.frombytes(np.ascontiguousarray(table[echo]).tobytes())

    def downward(self, depths: Array) -> Array:
        """Depths (n,), positive down, also if the log writes nearly all of them as negative numbers.

        Zeros, and one negative number among positive depths, mark missing echoes.
        """
        known = depths[np.isfinite(depths) & (depths != 0.0)]
        negative = known[known < 0.0]
        count = len(negative)
        is_mark = 0 < count < len(known) and bool((negative == negative[0]).all())
        if is_mark or count <= _NEGATIVE * len(known):
            if not is_mark and count > _FEW * len(known):
                self.questions.append(
                    f"{count:,} of {len(known):,} depths are negative, and left out. Positive ones are metres down: "
                    "write all of them that way"
                )
            return depths
        self.notes.append("negative depths are taken as metres down")
        return -depths

    def pressure(self, kind: str, stamp_s: float, pressure_pa: float) -> None:
        """Adds an absolute pressure (Pa)."""
        self._pressures[kind].extend((stamp_s, pressure_pa))

    def shift(self, by_s: float) -> None:
        """Moves all times by some seconds."""
        for columns, tables in ((3, self._positions), (2, self._pressures)):
            for values in tables.values():
                np.frombuffer(values, dtype=float).reshape(-1, columns)[:, 0] += by_s
        for sounder in self.sounders.values():
            np.frombuffer(sounder.pings, dtype=float).reshape(-1, 3)[:, 0] += by_s
        self.own_depths[:, 0] += by_s

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last time of the positions; NaN without any."""
        tables = self.positions.values()
        if not tables:
            return math.nan, math.nan
        return min(float(rows[0, 0]) for rows in tables), max(float(rows[-1, 0]) for rows in tables)

    def drop_impossible_times(self, last_s: float) -> None:
        """Drops and counts rows whose time is not between 0 and `last_s`."""
        reason = "positions and depths with an impossible time (--date gives the first day)"
        self._leave_out(lambda times: ~(np.abs(times) <= last_s), reason)

    def drop_unset_clock(self, begins_s: float, near_s: float, apart_s: float) -> None:
        """Drops rows near the time at which unset clocks begin, if a gap follows.

        Args:
            begins_s: Time at which they begin.
            near_s: Time until they are set; with a zone, they may also be that far behind.
            apart_s: Minimum time from there to the next positions.
        """
        last_s = begins_s + near_s
        later = [float(rows[rows[:, 0] > last_s, 0].min(initial=math.inf)) for rows in self.positions.values()]
        if last_s + apart_s < min(later, default=math.inf) < math.inf:
            reason = "positions and depths before the clock was set (times of years before the next ones)"
            self._leave_out(lambda times: np.abs(times - begins_s) <= near_s, reason)

    def _leave_out(self, is_out: Callable[[Array], Mask], reason: str) -> None:
        """Drops and counts rows for whose times `is_out` is true, and those without numbers."""
        if self.position_std_m is not None and self.positions:
            (rows,) = self.positions.values()
            self.position_std_m = self.position_std_m[~is_out(rows[:, 0])]
        for columns, tables in ((3, self._positions), (2, self._pressures)):
            for kind, values in tables.items():
                tables[kind] = self._without(values, columns, is_out, reason)
        for sounder in self.sounders.values():
            sounder.pings = self._without(sounder.pings, 3, is_out, reason)

    def _without(self, values: array[float], columns: int, is_out: Callable[[Array], Mask], why: str) -> array[float]:
        rows = np.frombuffer(values, dtype=float).reshape(-1, columns)
        good = np.isfinite(rows).T[:2].all(axis=0) & ~is_out(rows[:, 0])
        if good.all():
            return values
        self.left_out[why] += int((~good).sum())
        return array("d", rows[good].ravel())

    @property
    def positions(self) -> dict[str, Array]:
        """Rows (time s, latitude, longitude) of each kind of position that has any, in order of time."""
        return {kind: _table(rows, 3) for kind, rows in self._positions.items() if len(rows)}

    def set_back(self) -> tuple[float, bool]:
        """How the log's clock was set back.

        Returns:
            The largest step (s); 0 if there is none, or if the rows are in another order. And whether some rows before
            and after a step have the same times.
        """
        found, is_mixed = [0.0], False
        for rows in self._positions.values():
            times = np.frombuffer(rows, dtype=float)[::3]
            is_back = np.diff(times) < -_BACK_S
            if is_back.sum() <= _MOST_BACK:
                found += (-np.diff(times)[is_back]).tolist()
                order = np.argsort(times, kind="stable")
                part = np.append(0, np.cumsum(is_back))[order]
                is_mixed |= bool(np.count_nonzero(np.diff(part)) > is_back.sum())
        return max(found), is_mixed

    @property
    def pressures(self) -> dict[str, Array]:
        """Rows (time s, pressure Pa) of each barometer, in order of time."""
        return {kind: _table(rows, 2) for kind, rows in self._pressures.items() if len(rows)}


def _table(values: array[float], columns: int) -> Array:
    """Rows in order of time."""
    table = np.frombuffer(values, dtype=float).reshape(-1, columns)
    steps = np.diff(table[:, 0])
    return table.copy() if (steps >= 0.0).all() else table[np.argsort(table[:, 0], kind="stable")]
