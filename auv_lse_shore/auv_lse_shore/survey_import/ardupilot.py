"""Reads ArduPilot's logs with pymavlink: dataflash (.bin) and telemetry (.tlog)."""

from __future__ import annotations

import contextlib
import io
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from auv_lse_common.support.missing_packages import missing
from auv_lse_shore.survey_import.survey_log import LogError, Progress, Sources, SurveyLog

#: First bytes of a dataflash log: the definition of a message.
DATAFLASH = b"\xa3\x95\x80"
#: First bytes of MAVLink 1 and 2 messages, in telemetry logs after 8 bytes of time.
_MAVLINK_1, _MAVLINK_2 = 0xFE, 0xFD
_DOWN = 25  # orientation of a range finder
_GOOD = 4  # status of a range finder: no more and no less than its range
_FIX_3D = 3
_KINDS = ["GPS", "POS", "RFND", "DPTH", "BARO", "MSG"]
#: Messages between two reports of progress.
_MESSAGES = 5000
#: Times (s since 1970) outside of 2000 to 2100 are no times of a telemetry log.
_TIMES_S = (946_684_800.0, 4_102_444_800.0)

_OUT_OF_RANGE = "depths out of the range finder's range"


def is_telemetry(data: bytes) -> bool:
    """Whether the beginning of a file looks like a telemetry log."""
    return len(data) > 8 and data[8] in (_MAVLINK_1, _MAVLINK_2) and _is_time(data)


# dataflash ------------------------------------------------------------------------------------------------------------


def read_dataflash(path: Path, density_kgpm3: float, progress: Progress) -> SurveyLog:
    """Reads a dataflash log; a truncated one up to its end.

    Raises:
        LogError: if it is no such log, or has no positions or no depths.
        MissingPackageError: if pymavlink is missing.
        OSError: if it cannot be read.
    """
    try:
        from pymavlink.DFReader import DFReader_binary
    except ImportError as error:
        raise missing(error, "ArduPilot's logs") from error
    sources, count = Sources(), 0
    with _complaints() as complaints:
        try:
            reader: Any = DFReader_binary(str(path), progress_callback=lambda percent: progress(percent / 200.0))
            total = max(reader.data_len, 1)
            while (message := reader.recv_match(type=_KINDS)) is not None:
                _take_dataflash(sources, message)
                count += 1
                if count % _MESSAGES == 0:
                    progress(0.5 + 0.5 * reader.offset / total)
        except Exception as error:  # pymavlink raises errors of many kinds for a damaged log
            raise LogError(f"{path}: got a damaged dataflash log ({error}); expected an ArduPilot .bin") from error
        complaints.seek(0)
        sources.left_out["bytes that are no message"] += sum(1 for _ in complaints)
    return sources.log(path, ("POS", "GPS"), ("DPTH", "RFND"), density_kgpm3)


@contextlib.contextmanager
def _complaints() -> Iterator[IO[bytes]]:
    """A file that takes what is written to stderr: pymavlink, partly in C, writes a line for each bad byte."""
    sys.stderr.flush()
    with tempfile.TemporaryFile() as file:
        before = os.dup(2)
        os.dup2(file.fileno(), 2)
        try:
            with io.TextIOWrapper(os.fdopen(os.dup(2), "wb")) as text, contextlib.redirect_stderr(text):
                yield file
        finally:
            os.dup2(before, 2)
            os.close(before)


def _take_dataflash(sources: Sources, m: Any) -> None:
    kind, stamp_s = m.get_type(), m._timestamp
    if kind == "MSG":
        sources.is_submarine = sources.is_submarine or str(m.Message).startswith("ArduSub")
    elif kind == "POS":
        sources.position(kind, stamp_s, m.Lat, m.Lng)
    elif kind == "GPS":
        if getattr(m, "I", 0) != 0:
            return
        if m.Status < _FIX_3D:
            sources.refuse(kind, "positions without a fix")
        else:
            sources.position(kind, stamp_s, m.Lat, m.Lng)
    elif kind == "DPTH":
        sources.depth(kind, stamp_s, m.Depth)
    elif kind == "BARO":
        sources.pressure(f"BARO {getattr(m, 'I', 0)}", stamp_s, m.Press)
    elif kind == "RFND" and getattr(m, "Orient", _DOWN) == _DOWN:
        if getattr(m, "Stat", _GOOD) != _GOOD:
            sources.refuse(kind, _OUT_OF_RANGE)
        else:
            sources.depth(kind, stamp_s, m.Dist)


# telemetry ------------------------------------------------------------------------------------------------------------


def read_telemetry(path: Path, density_kgpm3: float, progress: Progress) -> SurveyLog:
    """Reads a telemetry log; a truncated one up to its end.

    Raises:
        LogError: if it has no positions or no depths.
        MissingPackageError: if pymavlink is missing.
        OSError: if it cannot be read.
    """
    try:
        from pymavlink.dialects.v20 import ardupilotmega as dialect
    except ImportError as error:
        raise missing(error, "ArduPilot's logs") from error
    decoder: Any = dialect.MAVLink(None)
    wanted = {
        dialect.MAVLINK_MSG_ID_HEARTBEAT,
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        dialect.MAVLINK_MSG_ID_GPS_RAW_INT,
        dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR,
        dialect.MAVLINK_MSG_ID_RANGEFINDER,
        dialect.MAVLINK_MSG_ID_WATER_DEPTH,
        dialect.MAVLINK_MSG_ID_SCALED_PRESSURE,
        dialect.MAVLINK_MSG_ID_SCALED_PRESSURE2,
        dialect.MAVLINK_MSG_ID_SCALED_PRESSURE3,
    }
    sources = Sources()
    for number, (stamp_s, frame, share) in enumerate(_frames(path.read_bytes(), sources)):
        if number % _MESSAGES == 0:
            progress(share)
        if (int.from_bytes(frame[7:10], "little") if frame[0] == _MAVLINK_2 else frame[5]) not in wanted:
            continue
        try:
            message = decoder.decode(bytearray(frame))
        except dialect.MAVError:
            sources.left_out["messages with a wrong checksum"] += 1
            continue
        _take_telemetry(sources, message, stamp_s)
    depths = ("WATER_DEPTH", "DISTANCE_SENSOR", "RANGEFINDER")
    return sources.log(path, ("GLOBAL_POSITION_INT", "GPS_RAW_INT"), depths, density_kgpm3)


def _is_time(data: bytes) -> bool:
    return _TIMES_S[0] < int.from_bytes(data[:8], "big") * 1e-6 < _TIMES_S[1]


def _frames(data: bytes, sources: Sources) -> Iterator[tuple[float, bytes, float]]:
    """Time (s), bytes of each message, and the share of the log that has been read."""
    at, in_step = 0, True
    while at + 16 <= len(data):
        first, length = data[at + 8], data[at + 9]
        size = 0
        if first == _MAVLINK_2:
            size = 12 + length + (13 if data[at + 10] & 1 else 0)
        elif first == _MAVLINK_1:
            size = 8 + length
        if not size or not _is_time(data[at : at + 8]):
            if in_step:
                sources.left_out["places where the log is damaged"] += 1
            at, in_step = at + 1, False
            continue
        in_step = True
        if at + 8 + size > len(data):
            break
        yield int.from_bytes(data[at : at + 8], "big") * 1e-6, data[at + 8 : at + 8 + size], at / len(data)
        at += 8 + size


def _take_telemetry(sources: Sources, m: Any, stamp_s: float) -> None:
    kind = m.get_type()
    if kind == "HEARTBEAT":
        sources.is_submarine = sources.is_submarine or m.type == 12  # MAV_TYPE_SUBMARINE
    elif kind == "GLOBAL_POSITION_INT":
        sources.position(kind, stamp_s, m.lat * 1e-7, m.lon * 1e-7)
    elif kind == "GPS_RAW_INT":
        if m.fix_type < _FIX_3D:
            sources.refuse(kind, "positions without a fix")
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
