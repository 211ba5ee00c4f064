"""Reads NMEA 0183 sentences in any stream of bytes: positions, dates and depths.

Depth sentences have no time. Several of them between two times are spread over the interval in the order of their
arrival, so that a boat that moves on between slow positions is not put where it was. Dates come from RMC with a fix, or
else from ZDA; each time of day gets the date that is nearest to it.
"""

from __future__ import annotations

import re
from array import array
from collections import Counter
from collections.abc import Callable
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from auv_lse_shore.survey_import.log_content import NO_FIX, Clock, LogContent, Reference, Sounder

Array = NDArray[np.float64]

_SENTENCE = re.compile(
    rb"\$([A-Z0-9]{2})(GGA|RMC|GLL|GNS|ZDA|DPT|DBT|DBS|DBK),([^$!*\r\n]{0,160})(?:\*([0-9A-Fa-f]{2}))?"
)
#: Any sentence, to recognize a log.
ANY_SENTENCE = re.compile(rb"[$!][A-Z0-9]{5},[^\r\n]{3}")
_DAY_S = 86_400.0
#: Metres in the units of depth sentences, in order of their accuracy: field of the number, and the factor.
_UNITS = ((2, 1.0), (0, 0.3048), (4, 1.8288))
_REFERENCES = {"DPT": Reference.TRANSDUCER, "DBT": Reference.TRANSDUCER, "DBS": Reference.SURFACE}
#: Qualities of GGA that are no measurement: no fix, estimated, typed in.
_NO_GGA = (b"0", b"6", b"7", b"")
_NUMBER = re.compile(rb"\s*[+-]?\d+\.?\d*")
#: A clock that goes back by more than this (s) has begun another day or another dive; less is disorder of talkers.
_BACK_S = 60.0
#: Sentences between two reports of progress.
_SENTENCES = 20_000
#: Standard deviation (s) of the time by which sounders and plotters deliver a depth late.
SOUNDER_LAG_STD_S = 0.5

#: Arrival of a sentence, in any unit, from its number and the position of its first byte.
Arrival = Callable[[int, int], float]


class _Timed(NamedTuple):
    """What sentences with a time of day hold, as columns; NaN where a sentence has none."""

    arrival: array[float]
    of_day_s: array[float]
    day: array[float]
    is_rmc: array[float]


class SentenceReader:
    """Takes the NMEA sentences of one log, in order."""

    def __init__(self, content: LogContent, accept_checksums: bool) -> None:
        """Adds what it finds to `content` when it finishes."""
        self._content = content
        self._accepts = accept_checksums
        self._timed = _Timed(*(array("d") for _ in range(4)))
        self._positions: dict[str, array[float]] = {}
        self._depths: dict[str, array[float]] = {}
        self._refused: Counter[str] = Counter()
        self._of_day: tuple[bytes, float] = (b"", float("nan"))
        self._has_fix = False
        self.count = 0

    def take(self, data: bytes, arrival: Arrival = lambda number, at: float(number)) -> None:
        """Reads every sentence in a piece of the log."""
        matches = list(_SENTENCE.finditer(data))
        good = [True] * len(matches) if self._accepts else _are_intact(data, matches)
        for match, is_good in zip(matches, good, strict=True):
            self.count += 1
            talker, kind, body, _ = match.groups()
            name = kind.decode()
            if not is_good:
                self._content.left_out[f"{name} sentences with a wrong checksum (--accept-checksums uses them)"] += 1
                continue
            try:
                self._take(talker.decode() + name, name, body.split(b","), arrival(self.count, match.start()))
            except (ValueError, IndexError, OverflowError):
                self._content.left_out[f"{name} sentences that are incomplete"] += 1

    def _take(self, source: str, kind: str, f: list[bytes], arrival: float) -> None:
        if kind in ("DPT", "DBT", "DBS", "DBK"):
            depth_m, offset_m = _dpt(f) if kind == "DPT" else (_in_metres(f), 0.0)
            self._depths.setdefault(source, array("d")).extend((arrival, depth_m, offset_m))
        elif kind == "ZDA":
            self._time(arrival, f[0], _day(int(f[3]), int(f[2]), int(f[1])) if f[3] and self._has_fix else None)
        elif kind == "GLL":
            is_fix = len(f) < 6 or (f[5][:1] == b"A" and (len(f) < 7 or f[6][:1] not in (b"E", b"N", b"M")))
            self._position(source, arrival, f[4] if len(f) > 4 else b"", f[:4], is_fix)
        elif kind == "RMC":
            is_fix = f[1] == b"A"
            self._position(source, arrival, f[0], f[2:6], is_fix)
            if is_fix and len(f[8]) == 6:
                year = int(f[8][4:])
                self._timed.day[-1] = _day(year + (1900 if year >= 80 else 2000), int(f[8][2:4]), int(f[8][:2]))
                self._timed.is_rmc[-1] = 1.0
        else:
            is_fix = f[5] not in _NO_GGA if kind == "GGA" else not set(f[5]) <= set(b"NEMS")
            self._position(source, arrival, f[0], f[1:5], is_fix)

    def _position(self, source: str, arrival: float, clock: bytes, place: list[bytes], is_fix: bool) -> None:
        if clock:
            self._time(arrival, clock, None)
        self._has_fix = is_fix
        if not is_fix:
            self._content.left_out[NO_FIX] += 1
            return
        of_day_s = self._timed.of_day_s[-1] if clock else float("nan")
        row = (arrival, of_day_s, _degrees(place[0], place[1]), _degrees(place[2], place[3]))
        self._positions.setdefault(source, array("d")).extend(row)

    def _time(self, arrival: float, clock: bytes, day: float | None) -> None:
        if clock != self._of_day[0]:
            self._of_day = clock, 3600.0 * int(clock[:2]) + 60.0 * int(clock[2:4]) + float(clock[4:])
        timed = self._timed
        timed.arrival.append(arrival)
        timed.of_day_s.append(self._of_day[1])
        timed.day.append(float("nan") if day is None else day)
        timed.is_rmc.append(0.0)

    def finish(self) -> None:
        """Adds the positions and depths, with their times, to the content."""
        content, timed = self._content, [np.frombuffer(column, dtype=float) for column in self._timed]
        arrival, of_day_s, day, is_rmc = timed
        if not len(arrival):
            content.clock, self._clock = Clock.NONE, (np.empty(0), np.empty(0))
        else:
            if is_rmc.any():
                day = np.where(is_rmc > 0.0, day, np.nan)
            content.clock = Clock.UTC if np.isfinite(day).any() else Clock.DAY
            self._clock = arrival, _absolute(of_day_s, day)
        for source, values in self._positions.items():
            self._add_positions(source, np.frombuffer(values, dtype=float).reshape(-1, 4))
        epochs = _epochs(*self._clock)
        for source, values in self._depths.items():
            self._add_depths(source, np.frombuffer(values, dtype=float).reshape(-1, 3), epochs)

    def _add_positions(self, source: str, rows: Array) -> None:
        arrivals, stamps = self._clock
        if not len(arrivals):
            times = rows[:, 0]
        else:  # the last time at or before the sentence, which is its own if it has one
            times = stamps[np.searchsorted(arrivals, rows[:, 0], side="right").clip(1) - 1]
        for stamp_s, (_, _, lat, lon) in zip(times.tolist(), rows.tolist(), strict=True):
            self._content.position(source, stamp_s, lat, lon)

    def _add_depths(self, source: str, rows: Array, epochs: tuple[Array, Array]) -> None:
        content = self._content
        offset_m = float(np.median(rows[:, 2]))
        reference = _REFERENCES.get(source[2:], Reference.KEEL)
        if source.endswith("DPT") and offset_m > 0.0:
            reference = Reference.SURFACE
            content.notes.append(f"{source} depths plus the transducer's depth that they state, {offset_m:g} m")
        content.sounders[source] = Sounder(reference=reference)
        stamps, before = rows[:, 0], np.zeros(len(rows), dtype=bool)
        if len(epochs[0]):
            stamps, before = _spread(rows[:, 0], *epochs)
        content.left_out["depths before the first time"] += int(before.sum())
        depths = rows[:, 1] + np.where(rows[:, 1] > 0.0, np.maximum(rows[:, 2], 0.0), 0.0)
        table = np.column_stack([stamps, depths, np.full(len(rows), np.nan)])[~before]
        content.add_depths(source, table)
        content.lag_std_s = SOUNDER_LAG_STD_S


def _are_intact(data: bytes, matches: list[re.Match[bytes]]) -> list[bool]:
    """Whether each sentence's checksum is right; sentences without one are intact."""
    if not matches:
        return []
    # The checksum is the exclusive or of all bytes between $ and *; reduceat folds every other of these pieces.
    edges = np.array([edge for m in matches for edge in (m.start() + 1, m.end(3))])
    padded = np.frombuffer(data + b"\0", dtype=np.uint8)
    sums = np.bitwise_xor.reduceat(padded, edges)[::2].tolist()
    return [not m[4] or int(m[4], 16) == total for m, total in zip(matches, sums, strict=True)]


def _absolute(of_day_s: Array, day: Array) -> Array:
    """Times (s) of sentences from their time of day and, where known, their day since 1970."""
    dated = np.flatnonzero(np.isfinite(day))
    if not len(dated):
        return of_day_s + _DAY_S * np.append(0.0, np.cumsum(np.diff(of_day_s) < -_BACK_S))
    after = np.searchsorted(dated, np.arange(len(day)))
    found = np.full(len(day), np.inf)
    stamps = np.zeros(len(day))
    for near in (dated[after.clip(max=len(dated) - 1)], dated[(after - 1).clip(0)]):
        turns = np.round((of_day_s[near] - of_day_s) / _DAY_S)
        apart = np.abs(of_day_s + _DAY_S * turns - of_day_s[near])
        better = apart < found
        stamps = np.where(better, of_day_s + _DAY_S * (day[near] + turns), stamps)
        found = np.where(better, apart, found)
    return stamps


def _epochs(arrivals: Array, stamps: Array) -> tuple[Array, Array]:
    """Where the clock moves on: arrivals and times. A clock a little behind another one does not count."""
    kept: list[int] = []
    last = -np.inf
    for i, stamp in enumerate(stamps.tolist()):
        if stamp > last or stamp < last - _BACK_S:
            kept.append(i)
            last = stamp
    return arrivals[kept], stamps[kept]


def _spread(arrivals: Array, epochs: Array, stamps: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Times (n,) of sentences without a time, and whether they came before the first epoch.

    The k-th of n sentences between two epochs is k / n of the interval after the first one. The interval after the
    last epoch, and one in which the clock goes back, are as long as the one before.
    """
    at = np.searchsorted(epochs, arrivals, side="right") - 1
    before = at < 0
    at = at.clip(0)
    first = np.append(True, np.diff(at) > 0)
    starts = np.flatnonzero(first)
    counts = np.diff(np.append(starts, len(at)))
    order = np.arange(len(at)) - np.repeat(starts, counts)
    steps = np.append(np.diff(stamps), np.nan)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 1.0
    steps = np.where(steps > 0.0, steps, usual)
    return stamps[at] + steps[at] * order / np.repeat(counts, counts), before


def _day(year: int, month: int, day: int) -> float:
    """Days since 1970."""
    return datetime(year, month, day, tzinfo=UTC).timestamp() / _DAY_S


def _degrees(text: bytes, side: bytes) -> float:
    """Degrees from dddmm.mmmm and its hemisphere."""
    point = text.find(b".")
    point = len(text) if point < 0 else point
    value = float(text[: point - 2]) + float(text[point - 2 :]) / 60.0
    if side not in (b"N", b"S", b"E", b"W"):
        raise ValueError(f"hemisphere {side!r}")
    return -value if side in (b"S", b"W") else value


def _in_metres(f: list[bytes]) -> float:
    """Depth (m) of DBT, DBS or DBK; 0 if the fields are empty: lost bottom."""
    for at, factor in _UNITS:
        if len(f) > at and f[at].strip():
            return factor * float(f[at])
    return 0.0


def _dpt(f: list[bytes]) -> tuple[float, float]:
    """Depth below the transducer and offset (m) of DPT.

    A positive offset is the transducer's distance from the surface, a negative one that to the keel. Plotters also
    write offsets such as -1.-1; what counts is the number at their beginning.
    """
    depth_m = float(f[0]) if f[0].strip() else 0.0
    offset = _NUMBER.match(f[1]) if len(f) > 1 else None
    return depth_m, float(offset[0]) if offset else 0.0
