"""Conversations recorded with a real ArduPilot in its own simulator, where they are at hand."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

_NAME = Path("shared") / "data" / "autopilot"
#: Folder of the recordings; None: they are not here.
FOLDER = next((parent / _NAME for parent in Path(__file__).parents if (parent / _NAME).is_dir()), None)
_MARKERS = (mavlink.PROTOCOL_MARKER_V1, mavlink.PROTOCOL_MARKER_V2)


@dataclass(frozen=True)
class Heard:
    """One recorded message.

    Attributes:
        time_s: Seconds since 1970.
        to_autopilot: Its direction.
    """

    time_s: float
    to_autopilot: bool
    message: Any


def read(name: str, suffix: str) -> list[tuple[float, Any]]:
    """Times (s) and messages of a recording; `suffix` is "from_ap" or "to_ap". Empty if there is none."""
    assert FOLDER is not None
    path = FOLDER / f"{name}.{suffix}.tlog.gz"
    if not path.exists():
        return []
    data, reader = gzip.decompress(path.read_bytes()), mavlink.MAVLink(None)
    reader.robust_parsing = True
    found, at = [], 0
    first_s = int.from_bytes(data[:8], "big") * 1e-6
    while at + 20 < len(data):
        time_s = int.from_bytes(data[at : at + 8], "big") * 1e-6
        if data[at + 8] not in _MARKERS or abs(time_s - first_s) > 3600.0:  # bytes that are no message
            at += 1
            continue
        at += 8
        size = data[at + 1] + (12 + 13 * (data[at + 2] & 1) if data[at] == mavlink.PROTOCOL_MARKER_V2 else 8)
        for message in reader.parse_buffer(data[at : at + size]) or ():
            if message.get_type() != "BAD_DATA" and not message.get_type().startswith("UNKNOWN"):
                found.append((time_s, message))
        at += size
    return found


def conversation(name: str) -> list[Heard]:
    """Both directions, by time."""
    both = [Heard(time_s, False, message) for time_s, message in read(name, "from_ap")]
    both += [Heard(time_s, True, message) for time_s, message in read(name, "to_ap")]
    return sorted(both, key=lambda heard: heard.time_s)
