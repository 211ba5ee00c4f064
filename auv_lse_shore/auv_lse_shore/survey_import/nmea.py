"""Reads NMEA 0183 logs: positions from GGA or RMC, depths from DPT, DBT, DBS or DBK.

Depth sentences have no time: they get that of the last position. Text before the `$` of a line is ignored.
"""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path

from auv_lse_shore.survey_import.survey_log import LogError, Progress, Sources, SurveyLog

_POSITIONS = ("GGA", "RMC")
_DEPTHS = ("DPT", "DBT", "DBS", "DBK")
_DAY_S = 86400.0
#: Metres in the units of depth sentences, in order of their accuracy: field of the number, and the factor.
_UNITS = ((3, 1.0), (1, 0.3048), (5, 1.8288))
#: Qualities of GGA that are no measurement: no fix, estimated.
_NO_FIX = ("0", "6", "")
#: Lines between two reports of progress.
_LINES = 5000


def is_nmea(data: bytes) -> bool:
    """Whether the beginning of a file looks like NMEA sentences."""
    return any(b"$" in line and b"," in line.partition(b"$")[2][:7] for line in data.splitlines()[:50])


def read(path: Path, density_kgpm3: float, progress: Progress) -> SurveyLog:
    """Reads a log.

    Raises:
        LogError: if it has no positions or no depths.
        OSError: if it cannot be read.
    """
    reader, size = _Reader(), max(path.stat().st_size, 1)
    with path.open("rb") as file:
        for number, line in enumerate(file):
            reader.line(line)
            if number % _LINES == 0:
                progress(file.tell() / size)
    if not reader.sentences:
        raise LogError(f"{path}: got no NMEA sentence; expected lines such as $GPGGA,... and $SDDBT,...")
    return reader.finish(path, density_kgpm3)


class _Reader:
    """Takes the lines of one log."""

    def __init__(self) -> None:
        self.sentences = 0
        self._sources = Sources()
        self._rows: list[tuple[str, float, float, float]] = []  # kind, time (s), latitude, longitude or depth, NaN
        self._day = 0
        self._time_s: float | None = None  # of day
        self._date_s = 0.0  # of day 0, since 1970

    def line(self, line: bytes) -> None:
        body, _, digits = line.partition(b"$")[2].strip().partition(b"*")
        fields = body.decode("ascii", errors="replace").split(",")
        if len(fields) < 2 or len(fields[0]) != 5:
            return
        self.sentences += 1
        kind = fields[0][2:]
        if kind not in (*_POSITIONS, *_DEPTHS, "ZDA"):
            return
        if digits and not _is_sum(body, digits):
            self._sources.left_out["sentences with a wrong checksum"] += 1
            return
        try:
            self._take(kind, fields)
        except (ValueError, IndexError):
            self._sources.left_out["sentences that are incomplete"] += 1

    def _take(self, kind: str, f: list[str]) -> None:
        if kind in _DEPTHS:
            depth_m = _dpt(f) if kind == "DPT" else _in_metres(f)
            if self._time_s is None:
                self._sources.refuse(kind, "depths before the first position")
            else:
                self._rows.append((kind, self._stamp_s, depth_m, math.nan))
            return
        self._set_time(f[1])
        if kind == "ZDA":
            self._set_date(int(f[4]), int(f[3]), int(f[2]))
            return
        if kind == "RMC" and len(f[9]) == 6:
            self._set_date(2000 + int(f[9][4:]), int(f[9][2:4]), int(f[9][:2]))
        has_fix = f[6] not in _NO_FIX if kind == "GGA" else f[2] == "A"
        if not has_fix:
            self._sources.refuse(kind, "positions without a fix")
            return
        at = 2 if kind == "GGA" else 3
        self._rows.append((kind, self._stamp_s, _degrees(*f[at : at + 2]), _degrees(*f[at + 2 : at + 4])))

    @property
    def _stamp_s(self) -> float:
        assert self._time_s is not None
        return self._day * _DAY_S + self._time_s

    def _set_time(self, text: str) -> None:
        time_s = 3600.0 * int(text[:2]) + 60.0 * int(text[2:4]) + float(text[4:])
        if self._time_s is not None and time_s < self._time_s - 0.5 * _DAY_S:
            self._day += 1
        self._time_s = time_s

    def _set_date(self, year: int, month: int, day: int) -> None:
        self._date_s = datetime(year, month, day, tzinfo=UTC).timestamp() - self._day * _DAY_S

    def finish(self, path: Path, density_kgpm3: float) -> SurveyLog:
        for kind, stamp_s, value, longitude in self._rows:
            if kind in _DEPTHS:
                self._sources.depth(kind, self._date_s + stamp_s, value)
            else:
                self._sources.position(kind, self._date_s + stamp_s, value, longitude)
        return self._sources.log(path, _POSITIONS, _DEPTHS, density_kgpm3)


def _is_sum(body: bytes, digits: bytes) -> bool:
    total = 0
    for byte in body:
        total ^= byte
    return digits[:2].upper() == b"%02X" % total


def _degrees(text: str, side: str) -> float:
    """Degrees from dddmm.mmmm and its hemisphere."""
    point = text.index(".") if "." in text else len(text)
    value = float(text[: point - 2]) + float(text[point - 2 :]) / 60.0
    return -value if side in ("S", "W") else value


def _in_metres(f: list[str]) -> float:
    """Depth (m) of DBT, DBS or DBK; 0 if the fields are empty: lost bottom."""
    for at, factor in _UNITS:
        if len(f) > at and f[at].strip():
            return factor * float(f[at])
    return 0.0


def _dpt(f: list[str]) -> float:
    """Depth (m) of DPT; a positive offset is the transducer's distance from the surface, a negative one the keel's."""
    depth_m = float(f[1]) if f[1].strip() else 0.0
    offset_m = float(f[2]) if len(f) > 2 and f[2].strip() else 0.0
    return depth_m + max(offset_m, 0.0) if depth_m > 0.0 else depth_m
