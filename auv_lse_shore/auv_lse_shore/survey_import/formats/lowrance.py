"""Lowrance, Simrad and B&G sonar logs: SL2 and SL3."""

import struct

import numpy as np

from auv_lse_shore.survey_import.log_content import NO_FIX, Clock, LogContent
from auv_lse_shore.survey_import.log_file import LogFile, ReadOptions
from auv_lse_shore.survey_import.parsing.times import UTC_FROM_S

#: Radius (m) of the sphere of the logs' Mercator coordinates.
_RADIUS_M = 6_356_752.3142
_FEET_M = 0.3048
_HAS_POSITION = 0x0010
_CHANNELS = {0: "primary", 1: "secondary", 2: "downscan", 3: "left", 4: "right", 5: "sidescan", 9: "3D"}
#: Of each format, by its number in the file's header: length of a frame's header, and the offsets of its fields.
_LAYOUTS = {
    2: (144, {"size": 28, "channel": 32, "created": 60, "depth": 64, "lon": 108, "flags": 132, "time": 140}),
    3: (128, {"size": 8, "channel": 12, "created": 40, "depth": 48, "lon": 92, "flags": 116, "time": 124}),
}
#: Frames between two reports of progress.
_PIECE = 20_000


def recognizes(file: LogFile) -> bool:
    """Whether it begins with a header and a first frame that states its own position."""
    if len(file.head) < 8 + 144:
        return False
    kind, version = struct.unpack_from("<2H", file.head)
    return kind in _LAYOUTS and version <= 3 and struct.unpack_from("<I", file.head, 8)[0] == 8


def read(file: LogFile, options: ReadOptions) -> list[LogContent]:
    """Reads a log; one sounder for each channel.

    Raises:
        LogError: if the file is too large.
        OSError: if it cannot be read.
    """
    data, content = file.data, LogContent(file.path.name)
    length, at_of = _LAYOUTS[struct.unpack_from("<H", data)[0]]
    created_s = float(struct.unpack_from("<I", data, 8 + at_of["created"])[0])
    if not UTC_FROM_S < created_s < 0xFFFF_FFFF:
        created_s, content.clock = 0.0, Clock.ELAPSED
    at, after, count = 8, 8, 0
    while at != len(data):
        if at + length > len(data) or struct.unpack_from("<I", data, at)[0] != at:  # a frame begins with its position
            lost = len(data) - (at if at < len(data) else after)
            at = _next_frame(data, after - 1)  # the size of the last one may be wrong
            content.left_out["damaged pieces"] += 1
            if at < 0:
                content.left_out["bytes after the log is damaged or cut off"] += lost
                break
            after = at + 1
            continue
        size, channel = (struct.unpack_from("<H", data, at + at_of[name])[0] for name in ("size", "channel"))
        flags = struct.unpack_from("<H", data, at + at_of["flags"])[0]
        depth_ft = struct.unpack_from("<f", data, at + at_of["depth"])[0]
        # signed: the first pings may be older than the file
        stamp_s = created_s + 1e-3 * struct.unpack_from("<i", data, at + at_of["time"])[0]
        name = f"channel {_CHANNELS.get(channel, channel)}"
        if flags & _HAS_POSITION:  # a channel's positions may lag behind another's
            _add_position(content, name, stamp_s, *struct.unpack_from("<ii", data, at + at_of["lon"]))
        else:
            content.left_out[NO_FIX] += 1
        content.depth(name, stamp_s, _FEET_M * depth_ft)
        at, after = at + max(size, length), at + length
        count += 1
        if count % _PIECE == 0:
            file.progress(at / len(data))
    content.lag_std_s = 0.3
    return [content]


def _add_position(content: LogContent, name: str, stamp_s: float, x_m: int, y_m: int) -> None:
    if x_m == 0 and y_m == 0:
        content.position(name, stamp_s, 0.0, 0.0)
        return
    latitude = 2.0 * np.arctan(np.exp(np.clip(y_m / _RADIUS_M, -10.0, 10.0))) - 0.5 * np.pi
    content.position(name, stamp_s, float(np.degrees(latitude)), float(np.degrees(x_m / _RADIUS_M)))


def _next_frame(data: bytes, at: int) -> int:
    """Where the next frame begins after damage; -1 if there is none."""
    edge, looked_at = at + 1, 2_048  # most often it is near
    while edge + 4 <= len(data):
        looked_at = min(2 * looked_at, 4_000_000)
        values = np.frombuffer(data, np.uint8, min(len(data) - edge, looked_at), edge).astype(np.int64)
        words = values[:-3] + (values[1:-2] << 8) + (values[2:-1] << 16) + (values[3:] << 24)
        found = np.flatnonzero(words == edge + np.arange(len(words)))
        if len(found):
            return edge + int(found[0])
        edge += len(words)
    return -1
