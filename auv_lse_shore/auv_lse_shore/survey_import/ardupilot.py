"""Finds positions, depths and pressures in ArduPilot's logs: dataflash (.bin) and telemetry (.tlog)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from auv_lse_common.support.missing_packages import MissingPackageError, missing
from auv_lse_shore.survey_import.survey_log import Progress, Sources, SurveyLog

try:
    from auv_lse_mavlink.flight_logs import DATAFLASH, dataflash_messages, is_telemetry, telemetry_messages
except MissingPackageError:
    raise
except ImportError as error:
    raise missing(error, "ArduPilot's logs") from error

__all__ = ["DATAFLASH", "is_telemetry", "read_dataflash", "read_telemetry"]

_DOWN = 25  # orientation of a range finder
_GOOD = 4  # status of a range finder: no more and no less than its range
_FIX_3D = 3
_SUBMARINE = 12  # type of vehicle
_DATAFLASH_KINDS = ("GPS", "POS", "RFND", "DPTH", "BARO", "MSG")
_POSITIONS = ("GLOBAL_POSITION_INT", "GPS_RAW_INT")
_TELEMETRY_KINDS = (
    *_POSITIONS,
    "HEARTBEAT",
    "DISTANCE_SENSOR",
    "RANGEFINDER",
    "WATER_DEPTH",
    "SCALED_PRESSURE",
    "SCALED_PRESSURE2",
    "SCALED_PRESSURE3",
)
_OUT_OF_RANGE = "depths out of the range finder's range"
_NO_FIX = "positions without a fix"


def read_dataflash(path: Path, density_kgpm3: float, progress: Progress) -> SurveyLog:
    """Reads a dataflash log; a truncated one up to its end.

    Raises:
        LogError: if it has no positions or no depths.
        FlightLogError: if it is damaged.
        MissingPackageError: if pymavlink is missing.
        OSError: if it cannot be read.
    """
    sources = Sources()
    for stamp_s, message in dataflash_messages(path, _DATAFLASH_KINDS, sources.left_out, progress):
        _take_dataflash(sources, message, stamp_s)
    return sources.log(path, ("POS", "GPS"), ("DPTH", "RFND"), density_kgpm3)


def read_telemetry(path: Path, density_kgpm3: float, progress: Progress) -> SurveyLog:
    """Reads a telemetry log; a truncated one up to its end.

    Raises:
        LogError: if it has no positions or no depths.
        MissingPackageError: if pymavlink is missing.
        OSError: if it cannot be read.
    """
    sources, system = Sources(), None
    for stamp_s, message in telemetry_messages(path, _TELEMETRY_KINDS, sources.left_out, progress):
        sender, kind = message.get_srcSystem(), message.get_type()
        if system is None and kind in _POSITIONS:
            system = sender  # a ground station sends none
        if system in (None, sender):
            _take_telemetry(sources, message, stamp_s)
        elif kind != "HEARTBEAT":
            sources.left_out["messages of other vehicles"] += 1
    depths = ("WATER_DEPTH", "DISTANCE_SENSOR", "RANGEFINDER")
    return sources.log(path, _POSITIONS, depths, density_kgpm3)


def _take_dataflash(sources: Sources, m: Any, stamp_s: float) -> None:
    kind = m.get_type()
    if kind == "MSG":
        sources.is_submarine = sources.is_submarine or str(m.Message).startswith("ArduSub")
    elif kind == "POS":
        sources.position(kind, stamp_s, m.Lat, m.Lng)
    elif kind == "GPS":
        if getattr(m, "I", 0) != 0:
            return
        if m.Status < _FIX_3D:
            sources.refuse(kind, _NO_FIX)
        else:
            sources.position(kind, stamp_s, m.Lat, m.Lng)
    elif kind == "DPTH":
        sources.depth(kind, stamp_s, m.Depth)
    elif kind == "BARO":
        sources.pressure(f"BARO {getattr(m, 'I', 0)}", stamp_s, m.Press)
    elif kind == "RFND":
        for number in ("", "1", "2"):  # before ArduPilot 4.1: two range finders in a message
            if not hasattr(m, f"Dist{number}") or getattr(m, f"Orient{number}", _DOWN) != _DOWN:
                continue
            if getattr(m, f"Stat{number}", _GOOD) != _GOOD:
                sources.refuse(kind, _OUT_OF_RANGE)
            else:
                sources.depth(kind, stamp_s, getattr(m, f"Dist{number}"))


def _take_telemetry(sources: Sources, m: Any, stamp_s: float) -> None:
    kind = m.get_type()
    if kind == "HEARTBEAT":
        sources.is_submarine = sources.is_submarine or m.type == _SUBMARINE
    elif kind == "GLOBAL_POSITION_INT":
        sources.position(kind, stamp_s, m.lat * 1e-7, m.lon * 1e-7)
    elif kind == "GPS_RAW_INT":
        if m.fix_type < _FIX_3D:
            sources.refuse(kind, _NO_FIX)
        else:
            sources.position(kind, stamp_s, m.lat * 1e-7, m.lon * 1e-7)
    elif kind.startswith("SCALED_PRESSURE"):
        sources.pressure(kind, stamp_s, 100.0 * m.press_abs)
    elif kind == "WATER_DEPTH":
        if m.healthy:
            sources.depth(kind, stamp_s, m.distance)
        else:
            sources.refuse(kind, _OUT_OF_RANGE)
    elif kind == "RANGEFINDER":
        sources.depth(kind, stamp_s, m.distance)
    elif kind == "DISTANCE_SENSOR" and m.orientation == _DOWN:
        # signal_quality 1: invalid; 0: unknown
        if m.min_distance < m.current_distance < m.max_distance and m.signal_quality != 1:
            sources.depth(kind, stamp_s, 0.01 * m.current_distance)
        else:
            sources.refuse(kind, _OUT_OF_RANGE)
