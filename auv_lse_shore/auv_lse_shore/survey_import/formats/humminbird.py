"""Humminbird recordings: a .DAT file with the folder of .SON files of the same name beside it."""

import struct
from pathlib import Path

import numpy as np

from auv_lse_shore.survey_import.log_content import Clock, LogContent
from auv_lse_shore.survey_import.log_file import LogFile, ReadOptions
from auv_lse_shore.survey_import.parsing.times import UTC_FROM_S
from auv_lse_shore.survey_import.survey_log import LogError

#: Sizes of a .DAT file, and the order of its bytes.
_ORDERS = {64: ">", 96: "<", 100: "<"}
_TIME_AT, _NAME_AT = 20, 32
#: First bytes of a ping, and the tag of its last value.
_PING, _LAST_TAG = b"\xc0\xde\xab\x21", 0x21
#: Tags of a ping's values: time (ms), Mercator east and north (m), depth (dm), number of echoes.
_TIME, _EAST, _NORTH, _DEPTH, _ECHOES = 0x81, 0x82, 0x83, 0x87, 0xA0
#: The logs' Mercator coordinates: radius (m) of the ellipsoid of 1924, and the squared ratio of its axes.
_RADIUS_M, _AXES = 6_378_388.0, 1.0067642927
_LONGEST = 300


def recognizes(file: LogFile) -> bool:
    """Whether it is a .DAT file with a known size and a recording's name, or a .SON file."""
    if file.head.startswith(_PING):
        return True
    if len(file.head) not in _ORDERS:
        return False
    name = file.head[_NAME_AT : _NAME_AT + 8]
    has_name = name[:1].isalpha() and name.upper().find(b".SON") > 0
    return has_name or (file.path.suffix.lower() == ".dat" and b"\0" in file.head)


def read(file: LogFile, options: ReadOptions) -> list[LogContent]:
    """Reads a recording: the pings of each .SON file are a sounder.

    Raises:
        LogError: if the folder of .SON files is missing.
        OSError: if a file cannot be read.
    """
    content = LogContent(file.path.name)
    if file.head.startswith(_PING):
        sounds, start_s = [file.path], _start_of(file.path.parent)
    else:
        order = _ORDERS[len(file.head)]
        start_s = float(struct.unpack_from(f"{order}I", file.head, _TIME_AT)[0])
        folder = file.path.with_suffix("")
        sounds = sorted(p for p in folder.glob("*") if p.suffix.upper() == ".SON") if folder.is_dir() else []
        if not sounds:
            raise LogError(f"{file.path} is a Humminbird recording without its pings. Copy the folder {folder} too.")
    if not start_s > UTC_FROM_S:
        start_s, content.clock = 0.0, Clock.ELAPSED
    for number, path in enumerate(sounds):
        _read_pings(content, path, LogFile(path).data, start_s)
        file.progress((number + 1) / len(sounds))
    content.lag_std_s = 0.3
    return [content]


def _start_of(folder: Path) -> float:
    """The start (s since 1970) in the .DAT file beside a folder of .SON files; 0 if there is none."""
    for path in (folder.with_suffix(".DAT"), folder.with_suffix(".dat")):
        if path.is_file() and (size := path.stat().st_size) in _ORDERS:
            return float(struct.unpack_from(f"{_ORDERS[size]}I", path.read_bytes(), _TIME_AT)[0])
    return 0.0


def _read_pings(content: LogContent, path: Path, data: bytes, start_s: float) -> None:
    at, name = 0, path.stem
    while 0 <= at < len(data):
        if data[at : at + 4] != _PING:
            at = data.find(_PING, at)
            content.left_out["damaged pieces"] += 1
            continue
        values, end = _values(data, at + 4)
        if not {_TIME, _EAST, _NORTH, _DEPTH} <= values.keys():
            content.left_out["pings that are incomplete"] += 1
            at = data.find(_PING, at + 4)
            continue
        stamp_s = start_s + 1e-3 * values[_TIME]
        x_m, y_m = (struct.unpack(">i", struct.pack(">I", values[tag]))[0] for tag in (_EAST, _NORTH))
        if x_m or y_m:
            geocentric = 2.0 * np.arctan(np.exp(np.clip(y_m / _RADIUS_M, -10.0, 10.0))) - 0.5 * np.pi
            lat_deg = float(np.degrees(np.arctan(np.tan(geocentric) * _AXES)))
            content.position(name, stamp_s, lat_deg, float(np.degrees(x_m / _RADIUS_M)))
        else:
            content.position(name, stamp_s, 0.0, 0.0)
        content.depth(name, stamp_s, 0.1 * values[_DEPTH])
        at = end + values.get(_ECHOES, 0)
        if at != len(data) and data[at : at + 4] != _PING:  # the number of echoes may be wrong
            at = end


def _values(data: bytes, at: int) -> tuple[dict[int, int], int]:
    """The values of a ping by tag, and where its echoes begin."""
    values: dict[int, int] = {}
    limit = min(at + _LONGEST, len(data))
    while at < limit:
        tag = data[at]
        if tag == _LAST_TAG:
            return values, at + 1
        size = 4 if tag >= 0x80 else 1
        values[tag] = int.from_bytes(data[at + 1 : at + 1 + size], "big")
        at += 1 + size
    return {}, at
