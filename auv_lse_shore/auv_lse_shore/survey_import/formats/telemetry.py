"""MAVLink telemetry logs (.tlog): GLOBAL_POSITION_INT with DISTANCE_SENSOR, WATER_DEPTH or RANGEFINDER."""

import re
from collections import Counter, defaultdict
from typing import Any

from auv_lse_common.support.missing_packages import MissingPackageError, missing
from auv_lse_shore.survey_import.log_content import NO_FIX, LogContent, Sounder
from auv_lse_shore.survey_import.log_file import LogFile, ReadOptions

_AUTOPILOT, _OF = 1, " of component "  # its number, and how the names of other components' data go on
_DOWN = 25  # orientation of a range finder
_FIX_3D = 3
_SUBMARINE = 12  # type of vehicle
_POSITIONS = ("GLOBAL_POSITION_INT", "GPS_RAW_INT")
_KINDS = (
    *_POSITIONS, "HEARTBEAT", "DISTANCE_SENSOR", "RANGEFINDER", "WATER_DEPTH", "SCALED_PRESSURE", "SCALED_PRESSURE2",
    "SCALED_PRESSURE3",
)  # fmt: skip
_TIME = re.compile(rb"\0[\x03-\x0e].{6}[\xfd\xfe]", re.DOTALL)  # of 2000 to 2100, and a message's first byte
_OUT_OF_RANGE = "depths out of the range finder's range"
#: Standard deviation (s) of the delay of a ping on its way to the ground station.
_LAG_STD_S = 0.2


def recognizes(file: LogFile) -> bool:
    """Whether it begins with times and MAVLink messages, or within one."""
    return _TIME.search(file.head[:600]) is not None and bool(_flight_logs().is_telemetry(file.head))


def read(file: LogFile, options: ReadOptions) -> list[LogContent]:
    """Reads a log, each vehicle with positions and depths as a log of its own; a truncated one up to its end.

    Raises:
        LogError: if the file is too large.
        MissingPackageError: if pymavlink is missing.
        OSError: if it cannot be read.
    """
    damaged: Counter[str] = Counter()
    vehicles: dict[int, LogContent] = defaultdict(lambda: LogContent(file.path.name))
    messages: Counter[int] = Counter()
    with file.unpacked() as path:
        for stamp_s, message in _flight_logs().telemetry_messages(path, _KINDS, damaged, file.progress):
            sender = message.get_srcSystem()
            messages[sender] += message.get_type() != "HEARTBEAT"
            _take(vehicles[sender], message, stamp_s)
    for content in vehicles.values():
        _mark_unchecked(content)
    used = {n: v for n, v in vehicles.items() if v.positions and _has_depths(v)}
    if not used:  # what is missing is reported of the one that has most
        fullest = sorted(vehicles.items(), key=lambda item: (not item[1].positions, not item[1].sounders))
        used = dict(fullest[:1]) or {0: LogContent(file.path.name)}
    for number, content in used.items():
        content.lag_std_s = _LAG_STD_S
        content.name += f" (vehicle {number})" if len(used) > 1 else ""
    first = next(iter(used.values()))
    first.left_out += damaged
    for number in messages.keys() - used.keys():
        what = "depths" if vehicles[number].positions else "positions"
        first.left_out[f"messages of vehicle {number}, which has no {what}"] += messages[number]
    return list(used.values())


def _mark_unchecked(content: LogContent) -> None:
    """Marks a component's RANGEFINDER, which has no range, if the component also sends messages that have it."""
    for name, sounder in content.sounders.items():
        kind, _, component = name.partition(_OF)
        others = [other for other in content.sounders if other != name and other.partition(_OF)[2] == component]
        sounder.is_unchecked = kind == "RANGEFINDER" and bool(others)


def _has_depths(content: LogContent) -> bool:
    return any(len(sounder.pings) and not sounder.is_unchecked for sounder in content.sounders.values())


def _flight_logs() -> Any:
    try:
        from auv_lse_mavlink import flight_logs
    except MissingPackageError:
        raise
    except ImportError as error:
        raise missing(error, "ArduPilot's logs") from error
    return flight_logs


def _take(content: LogContent, m: Any, stamp_s: float) -> None:
    kind, component = m.get_type(), m.get_srcComponent()
    of = "" if component == _AUTOPILOT else f"{_OF}{component}"
    if kind == "HEARTBEAT":
        content.is_submarine = content.is_submarine or m.type == _SUBMARINE
    elif kind == "GLOBAL_POSITION_INT":
        content.position(kind + of, stamp_s, m.lat * 1e-7, m.lon * 1e-7)
    elif kind == "GPS_RAW_INT":
        if m.fix_type < _FIX_3D:
            content.left_out[NO_FIX] += 1
        else:
            content.position(kind + of, stamp_s, m.lat * 1e-7, m.lon * 1e-7)
    elif kind.startswith("SCALED_PRESSURE"):
        content.pressure(kind + of, stamp_s, 100.0 * m.press_abs)
    elif kind == "RANGEFINDER":
        content.depth(kind + of, stamp_s, m.distance)
    elif kind == "DISTANCE_SENSOR" and m.orientation != _DOWN:
        content.left_out[f"ranges of {kind} {m.id}{of}, which does not look down"] += 1
    else:
        _take_range(content, f"{kind} {m.id}{of}", m, stamp_s)


def _take_range(content: LogContent, name: str, m: Any, stamp_s: float) -> None:
    """A depth that is stated to be in the range or not."""
    content.sounders.setdefault(name, Sounder())
    if m.get_type() == "WATER_DEPTH":
        is_good, depth_m, quality = m.healthy, m.distance, float("nan")
    else:
        is_good = m.min_distance < m.current_distance < m.max_distance and m.signal_quality != 1  # invalid
        depth_m, quality = 0.01 * m.current_distance, float(m.signal_quality)
    if is_good:
        content.depth(name, stamp_s, depth_m, quality)
    else:
        content.left_out[_OUT_OF_RANGE] += 1
