"""Recordings of the wire of a real ArduPilot in its simulator, for tests; they are not part of the checkout.

Looked for in the folder that AUV_LSE_RECORDINGS names, else in `shared/data/autopilot` beside the checkout or above it.
"""

import gzip
import os
import struct
from functools import cache
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

#: Longest time between two messages (us).
MOST_GAP_US = 3600e6
CHECKOUT = Path(__file__).resolve().parents[2]


def folder():
    """The folder with the recordings; None: there is none."""
    named = os.environ.get("AUV_LSE_RECORDINGS", "")
    folders = [Path(named)] if named else [parent / "shared/data/autopilot" for parent in CHECKOUT.parents]
    return next((folder for folder in folders if folder.is_dir()), None)


@cache
def recording(name, direction="from_ap"):
    """The messages of a recording: time (s since its begin), message. Skips the test without it."""
    recordings = folder()
    path = None if recordings is None else recordings / f"{name}.{direction}.tlog.gz"
    if path is None or not path.is_file():
        pytest.skip(f"needs the recording {name}.{direction}.tlog.gz (AUV_LSE_RECORDINGS)")
    data = gzip.decompress(path.read_bytes())
    reader = mavlink.MAVLink(None)
    reader.robust_parsing = True
    (began_us,) = (last_us,) = struct.unpack(">Q", data[:8])
    found, at = [], 0
    while at + 11 < len(data):
        (us,) = struct.unpack(">Q", data[at : at + 8])
        marker, size, flags = data[at + 8 : at + 11]
        if marker not in (mavlink.PROTOCOL_MARKER_V1, mavlink.PROTOCOL_MARKER_V2) or abs(us - last_us) > MOST_GAP_US:
            at += 1  # bytes that are no message
            continue
        length = size + (12 + 13 * (flags & 1) if marker == mavlink.PROTOCOL_MARKER_V2 else 8)
        packet, last_us = data[at + 8 : at + 8 + length], us
        at += 8 + length
        for message in reader.parse_buffer(packet) or ():
            if message.get_type() != "BAD_DATA":
                found.append(((us - began_us) * 1e-6, us * 1e-6, packet, message))
    return found
