"""ArduPilot dataflash logs (.bin, or .log as text): POS or GPS with DPTH or RFND, and a submarine's BARO."""

import re
from typing import Any

from auv_lse_common.support.missing_packages import MissingPackageError, missing
from auv_lse_shore.survey_import.log_content import NO_FIX, Clock, LogContent, Sounder
from auv_lse_shore.survey_import.log_file import LogFile, ReadOptions
from auv_lse_shore.survey_import.parsing.times import UTC_FROM_S

#: First bytes: the definition of a message. In text it may follow lines on the vehicle.
_SIGNATURE, _FIRST_LINE = b"\xa3\x95\x80", re.compile(rb"^(?:\xef\xbb\xbf)?FMT, ?128, ?89, ?FMT,", re.M)
_DOWN = 25  # orientation of a range finder
_GOOD = 4  # status of a range finder: no more and no less than its range
_FIX_3D = 3
_KINDS = ("GPS", "POS", "RFND", "DPTH", "BARO", "MSG")
#: Standard deviation (s) of the delay of a ping in a flight controller.
_LAG_STD_S = 0.1


def recognizes(file: LogFile) -> bool:
    """Whether it begins with the definition of a message."""
    return file.head.startswith(_SIGNATURE) or _FIRST_LINE.search(file.head) is not None


def read(file: LogFile, options: ReadOptions) -> list[LogContent]:
    """Reads a log; a truncated one up to its end.

    Raises:
        FlightLogError: if it is damaged.
        MissingPackageError: if pymavlink is missing.
        OSError: if it cannot be read.
    """
    try:
        from auv_lse_mavlink.flight_logs import dataflash_messages
    except MissingPackageError:
        raise
    except ImportError as error:
        raise missing(error, "ArduPilot's logs") from error
    content = LogContent(file.path.name)
    content.lag_std_s = _LAG_STD_S
    with file.unpacked() as path:
        for stamp_s, message in dataflash_messages(path, _KINDS, content.left_out, file.progress):
            try:
                _take(content, message, stamp_s)
            except (IndexError, ValueError, TypeError, AttributeError):  # pymavlink decodes when a field is read
                content.left_out["messages that are damaged"] += 1
    for name, sounder in content.sounders.items():
        sounder.is_unchecked = name.startswith("DPTH") and name.replace("DPTH", "RFND") in content.sounders
    if any(rows[0, 0] < UTC_FROM_S for rows in content.positions.values()):
        content.clock = Clock.ELAPSED
    return [content]


def _take(content: LogContent, m: Any, stamp_s: float) -> None:
    kind = m.get_type()
    if kind == "MSG":
        content.is_submarine = content.is_submarine or str(m.Message).startswith("ArduSub")
    elif kind == "POS":
        content.position(kind, stamp_s, m.Lat, m.Lng)
    elif kind == "GPS":
        number = getattr(m, "I", 0)
        if m.Status < _FIX_3D:
            content.left_out[NO_FIX] += 1
        else:
            content.position(f"GPS {number}" if number else "GPS", stamp_s, m.Lat, m.Lng)
    elif kind == "DPTH":
        content.depth(f"DPTH {getattr(m, 'Inst', 0)}", stamp_s, m.Depth)
    elif kind == "BARO":
        content.pressure(f"BARO {getattr(m, 'I', 0)}", stamp_s, m.Press)
    elif kind == "RFND":
        _take_range(content, m, stamp_s)


def _take_range(content: LogContent, m: Any, stamp_s: float) -> None:
    """A range finder's message: of one instance, or before ArduPilot 4.1 of two."""
    names = m.get_fieldnames()

    def value(name: str, default: float) -> Any:
        return getattr(m, name) if name in names else default

    for number in ("", "1", "2"):
        if f"Dist{number}" not in names:
            continue
        name = f"RFND {number or value('Instance', value('I', 0))}"
        content.sounders.setdefault(name, Sounder())
        if value(f"Orient{number}", _DOWN) != _DOWN:
            content.left_out[f"ranges of {name}, which does not look down"] += 1
        elif value(f"Stat{number}", _GOOD) != _GOOD:
            content.left_out["depths out of the range finder's range"] += 1
        else:
            quality = float(value("Quality", -1))  # -1: none
            content.depth(name, stamp_s, getattr(m, f"Dist{number}"), quality if quality >= 0.0 else float("nan"))
