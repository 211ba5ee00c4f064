"""Reads NMEA 0183 sentences in any stream of bytes: positions, dates and depths.

Depth sentences have no time. Several of them between two times are spread over the interval in the order of their
arrival, so that depths between slow positions follow the moving boat. Dates come from RMC with a fix, else from ZDA,
else from the times that a logger wrote before the sentences; each time of day gets the nearest date.
"""

import math
import re
from array import array
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support.arrays import Array, Ints, Mask
from auv_lse_shore.survey_import.log_content import NO_FIX, Clock, LogContent, Reference, Sounder
from auv_lse_shore.survey_import.parsing.sentence_fields import Sentences, day_of, days, degrees, numbers_of, of_day_s

#: Any sentence, to recognize a log.
ANY_SENTENCE = re.compile(rb"[$!][A-Z0-9]{5},[^\r\n]{3}")
#: Kinds of sentences that are read: positions with the numbers of their clock and of their latitude, and depths.
_POSITIONS = {b"GGA": (0, 1), b"GNS": (0, 1), b"GLL": (4, 0), b"RMC": (0, 2)}
_DEPTHS = (b"DPT", b"DBT", b"DBS", b"DBK")
_KINDS = (*_POSITIONS, b"ZDA", *_DEPTHS)
_DAY_S = 86_400.0
#: Fields of the numbers of depth sentences, in order of their accuracy, and the letter that follows each.
_NUMBERS = ((2, b"M"), (0, b"f"), (4, b"F"))
#: Metres in the unit of a letter. A letter overrides the unit of its field; without one, the field's unit counts.
_UNITS_M = {b"f": 0.3048, b"M": 1.0, b"m": 1.0, b"F": 1.8288}
_NO_UNIT = "sentences whose letters are not a unit, or may be two (f: feet, F: fathoms)"
_REFERENCES = {"DPT": Reference.TRANSDUCER, "DBT": Reference.TRANSDUCER, "DBS": Reference.SURFACE}
#: Qualities of GGA without a measurement: no fix, estimated, typed in. Such modes of other sentences.
_NO_GGA, _NO_MODE, _NO_GNS = (b"0", b"6", b"7", b""), (b"E", b"N", b"M"), b"NEMS"
_NUMBER = re.compile(rb"\s*[+-]?\d+\.?\d*")
#: Ranks of the sources of dates.
_OF_LOGGER, _OF_ZDA, _OF_RMC = 0.0, 1.0, 2.0
#: A clock that goes back by more than this (s) has begun another day or dive; smaller steps are talkers out of order.
_BACK_S = 60.0
#: Depths of a transducer (m) that differ by less are the same.
_SAME_OFFSET_M = 0.01
#: Standard deviation (s) of the delay with which sounders and plotters deliver a depth.
SOUNDER_LAG_STD_S = 0.5

#: Arrivals (n,) of sentences, in any unit, from the positions (n,) of their first bytes in the log.
Arrivals = Callable[[Ints], Array]


class _Timed(NamedTuple):
    """Columns of the sentences with a time of day; NaN where a sentence has no value.

    `rank` is that of the day's source: only the days of the best one count.
    """

    arrival: list[Array]
    of_day_s: list[Array]
    day: list[Array]
    rank: list[Array]


class SentenceReader:
    """Handles the NMEA sentences of one log, in order."""

    def __init__(self, content: LogContent, accept_checksums: bool) -> None:
        """Adds what it finds to `content` when it finishes."""
        self._content = content
        self._accepts = accept_checksums
        self._timed = _Timed([], [], [], [])
        self._positions: dict[str, array[float]] = {}
        self._depths: dict[str, array[float]] = {}
        self._has_fix = False
        self._taken = 0

    def take(self, data: bytes, arrivals: Arrivals | None = None) -> None:
        """Reads every sentence in a piece of the log that ends with a line."""
        found = Sentences(data, _KINDS)
        used = np.ones(len(found.names), dtype=bool) if self._accepts else found.are_intact()
        are_cut = found.are_cut()
        at = self._taken + np.arange(len(used), dtype=float) if arrivals is None else arrivals(found.positions)
        self._taken += len(used)
        fixes = np.full(len(found.names), np.nan)
        for name in np.unique(found.names).tolist():
            of_name = found.names == name
            source, kind = name.decode(), name[2:]
            if refused := int((of_name & ~used).sum()):
                reason = f"{source[2:]} sentences with a wrong checksum (--accept-checksums uses them)"
                self._content.left_out[reason] += refused
            is_cut = of_name & used & are_cut
            if 2 * is_cut.sum() < of_name.sum():  # else no line ends separate them
                self._incomplete(source[2:], int(is_cut.sum()))
                used &= ~is_cut
            rows = np.flatnonzero(of_name & used)
            if kind in _DEPTHS:
                self._add_depth_sentences(found, rows, at[rows], source)
            elif kind in _POSITIONS:
                fixes[rows] = self._add_position_sentences(found, rows, at[rows], source)
        self._add_dates(found, np.flatnonzero((np.char.endswith(found.names, b"ZDA")) & used), at, fixes)

    def _incomplete(self, kind: str, count: int) -> None:
        if count:
            self._content.left_out[f"{kind} sentences that are incomplete"] += count

    def _add_depth_sentences(self, found: Sentences, rows: Ints, at: Array, source: str) -> None:
        if source.endswith("DPT"):
            depths, offsets = found.numbers(rows, 0, empty=0.0), _leading_numbers(found.cells(rows, 1))
        else:
            offsets, depths = np.zeros(len(rows)), np.full(len(rows), np.nan)
            is_empty, is_unclear = np.ones(len(rows), dtype=bool), np.zeros(len(rows), dtype=bool)
            for number, letter in reversed(_NUMBERS):
                cells, factors = found.cells(rows, number), _factors(found.cells(rows, number + 1), letter)
                is_given = np.char.strip(cells) != b""
                is_empty, is_unclear = is_empty & ~is_given, is_unclear | (is_given & np.isnan(factors))
                depths = np.where(is_given & np.isfinite(factors), factors * numbers_of(cells), depths)
            depths = np.where(is_empty, 0.0, depths)  # lost bottom
            is_unclear &= ~np.isfinite(depths)
            self._content.left_out[f"{source[2:]} {_NO_UNIT}"] += int(is_unclear.sum())
            at, depths, offsets = at[~is_unclear], depths[~is_unclear], offsets[~is_unclear]
        good = np.isfinite(depths)
        self._incomplete(source[2:], int((~good).sum()))
        table = np.column_stack([at, depths, offsets])[good]
        if len(table):
            self._depths.setdefault(source, array("d")).frombytes(table.tobytes())

    def _add_position_sentences(self, found: Sentences, rows: Ints, at: Array, source: str) -> Array:
        """Adds the positions of one kind; returns whether each sentence has a fix, NaN for those that are damaged."""
        kind = source[2:]
        clock_at, first = _POSITIONS[kind.encode()]
        clocks = found.cells(rows, clock_at)
        no_clock, seconds = clocks == b"", of_day_s(clocks)
        is_fix = _is_fix(found, rows, kind)
        latitudes = degrees(found.cells(rows, first), found.cells(rows, first + 1), b"N", b"S")
        longitudes = degrees(found.cells(rows, first + 2), found.cells(rows, first + 3), b"E", b"W")
        timed = no_clock | np.isfinite(seconds)
        good = timed & (~is_fix | (np.isfinite(latitudes) & np.isfinite(longitudes)))
        self._incomplete(kind, int((~good).sum()))
        self._content.left_out[NO_FIX] += int((good & ~is_fix).sum())
        is_rmc = kind == "RMC"
        dates = days(found.cells(rows, 8)) if is_rmc else found.days_before(rows, seconds)
        dates = np.where(is_fix, dates, np.nan)
        ranks = np.full(len(rows), _OF_RMC if is_rmc else _OF_LOGGER)
        self._add_times(np.column_stack([at, seconds, dates, ranks])[timed & ~no_clock])
        table = np.column_stack([at, seconds, latitudes, longitudes])[good & is_fix]
        self._positions.setdefault(source, array("d")).frombytes(table.tobytes())
        flags: Array = np.where(timed, is_fix, np.nan)
        return flags

    def _add_dates(self, found: Sentences, rows: Ints, at: Array, fixes: Array) -> None:
        """Adds the times of ZDA; their dates count if the last position before them had a fix."""
        known = np.flatnonzero(np.isfinite(fixes))
        before = np.searchsorted(known, rows) - 1
        has_fix = np.append(fixes[known], float(self._has_fix))[before] > 0.0  # -1: the last one of the piece before
        self._has_fix = bool(fixes[known[-1]]) if len(known) else self._has_fix
        seconds = of_day_s(found.cells(rows, 0))
        date = [found.numbers(rows, number) for number in (3, 2, 1)]
        dates = np.array([day_of(*ymd) for ymd in zip(*(column.tolist() for column in date), strict=True)])
        table = np.column_stack([at[rows], seconds, np.where(has_fix, dates, np.nan), np.full(len(rows), _OF_ZDA)])
        self._incomplete("ZDA", int((~np.isfinite(seconds)).sum()))
        self._add_times(table[np.isfinite(seconds)])

    def _add_times(self, rows: Array) -> None:
        for column, values in zip(self._timed, rows.T, strict=True):
            column.append(values)

    def finish(self) -> None:
        """Adds the positions and depths, with their times, to the content."""
        content = self._content
        arrival, of_day, day, rank = (np.concatenate([np.empty(0), *column]) for column in self._timed)
        order = np.argsort(arrival, kind="stable")
        arrival, of_day, day, rank = arrival[order], of_day[order], day[order], rank[order]
        if not len(arrival):
            content.clock, self._clock = Clock.NONE, (np.empty(0), np.empty(0))
        else:
            is_dated = np.isfinite(day)
            best = rank[is_dated].max(initial=_OF_LOGGER)
            day = np.where(rank == best, day, np.nan)
            content.clock = Clock.UTC if is_dated.any() else Clock.DAY
            if is_dated.any() and best == _OF_LOGGER:
                content.notes.append("the date is that of the times before the sentences")
            self._clock = arrival, _absolute(of_day, day)
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
        self._content.add_positions(source, np.column_stack([times, rows[:, 2:]]))

    def _add_depths(self, source: str, rows: Array, epochs: tuple[Array, Array]) -> None:
        content = self._content
        offset_m = float(np.median(rows[:, 2]))
        reference = _REFERENCES.get(source[2:], Reference.KEEL)
        if source.endswith("DPT") and offset_m > 0.0:
            reference = Reference.SURFACE
            content.notes.append(f"{source} depths plus the transducer's depth that they state, {offset_m:g} m")
        if np.ptp(offsets := np.maximum(rows[:, 2], 0.0)) > _SAME_OFFSET_M:
            content.notes.append(
                f"{source} states a transducer's depth that changes from {offsets.min():g} to {offsets.max():g} m; "
                "each depth counts with its own"
            )
        stated_m = offset_m if reference is Reference.SURFACE and source.endswith("DPT") else 0.0
        content.sounders[source] = Sounder(reference=reference, offset_m=stated_m)
        stamps, before = rows[:, 0], np.zeros(len(rows), dtype=bool)
        if len(epochs[0]):
            stamps, before = _spread(rows[:, 0], *epochs)
        content.left_out["depths before the first time"] += int(before.sum())
        depths = rows[:, 1] + np.where(rows[:, 1] > 0.0, np.maximum(rows[:, 2], 0.0), 0.0)
        table = np.column_stack([stamps, depths, np.full(len(rows), np.nan)])[~before]
        content.add_depths(source, table)
        content.lag_std_s = SOUNDER_LAG_STD_S


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
    """Arrivals and times at which the clock advances. A clock a little behind another one does not count."""
    kept: list[int] = []
    last = -np.inf
    for i, stamp in enumerate(stamps.tolist()):
        if stamp > last or stamp < last - _BACK_S:
            kept.append(i)
            last = stamp
    return arrivals[kept], stamps[kept]


def _spread(arrivals: Array, epochs: Array, stamps: Array) -> tuple[Array, Mask]:
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


def _is_fix(found: Sentences, rows: Ints, kind: str) -> Mask:
    """Whether sentences of a kind have a measured position."""
    is_fix: Mask
    if kind == "GGA":
        is_fix = ~np.isin(found.cells(rows, 5), _NO_GGA)
    elif kind == "RMC":
        is_fix = (found.cells(rows, 1) == b"A") & ~np.isin(found.cells(rows, 11, 1), _NO_MODE)
    elif kind == "GNS":
        is_fix = np.char.lstrip(found.cells(rows, 5), _NO_GNS) != b""
    else:
        status, mode = found.cells(rows, 5, 1), found.cells(rows, 6, 1)
        is_fix = (found.counts[rows] < 6) | ((status == b"A") & ~np.isin(mode, _NO_MODE))
    return is_fix


def _factors(letters: NDArray[np.bytes_], own: bytes) -> Array:
    """Metres per unit by the letters after numbers; NaN for an ambiguous one.

    F where f belongs, or f where F does, may be either unit.
    """
    unique, where = np.unique(np.char.strip(letters), return_inverse=True)
    is_either = [{letter, own} == {b"f", b"F"} for letter in unique.tolist()]
    factors = [_UNITS_M.get(letter or own, math.nan) for letter in unique.tolist()]
    return np.where(is_either, math.nan, factors)[where]


def _leading_numbers(cells: NDArray[np.bytes_]) -> Array:
    """The numbers at the beginning of fields, such as -1 of -1.-1; 0 without one."""
    unique, where = np.unique(cells, return_inverse=True)
    matches = [_NUMBER.match(cell) for cell in unique.tolist()]
    return np.array([float(match[0]) if match else 0.0 for match in matches])[where]
