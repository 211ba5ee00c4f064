"""WIBL loggers' binary logs: NMEA 2000 packets and NMEA 0183 sentences with the time of their arrival."""

import struct

import numpy as np

from auv_lse_shore.survey_import.log_content import NO_FIX, Clock, LogContent, Reference, Sounder
from auv_lse_shore.survey_import.log_file import LogFile, ReadOptions
from auv_lse_shore.survey_import.parsing.sentences import SentenceReader

_VERSION, _SYSTEM_TIME, _DEPTH, _GNSS, _SENTENCE = 0, 1, 3, 5, 10
_KINDS = range(64)
_DAY_S = 86_400.0
_LONGEST = 100_000
#: Packets between two reports of progress.
_PIECE = 20_000


def recognizes(file: LogFile) -> bool:
    """Whether it begins with the version of a WIBL logger."""
    if len(file.head) < 24:
        return False
    kind, length, major, minor = struct.unpack_from("<IIHH", file.head)
    return kind == _VERSION and length in (16, 22) and 1 <= major <= 9 and minor <= 99


def read(file: LogFile, options: ReadOptions) -> list[LogContent]:
    """Reads a log; a damaged one as far as its packets follow each other.

    Raises:
        LogError: if the file is too large.
        OSError: if it cannot be read.
    """
    data, content = file.data, LogContent(file.path.name)
    sentences: list[bytes] = []
    edges, elapsed_s = [0], []
    at, count = 0, 0
    while at + 8 <= len(data):
        kind, length = struct.unpack_from("<II", data, at)
        body = data[at + 8 : at + 8 + length]
        if kind not in _KINDS or length > _LONGEST or len(body) < length:
            content.left_out["bytes after the log is damaged or cut off"] += len(data) - at
            break
        at += 8 + length
        count += 1
        try:
            if kind == _SENTENCE:
                elapsed_s.append(1e-3 * struct.unpack_from("<I", body)[0])
                sentences.append(body[4:].strip(b"\0\r\n") + b"\r\n")
                edges.append(edges[-1] + len(sentences[-1]))
            elif kind == _DEPTH:
                _take_depth(content, body)
            elif kind == _GNSS:
                _take_gnss(content, body)
        except struct.error:
            content.left_out["packets that are incomplete"] += 1
        if count % _PIECE == 0:
            file.progress(at / len(data))
    if sentences:
        options.used.add("accept_checksums")
        reader = SentenceReader(content, options.accept_checksums)
        arrived = np.array(elapsed_s)
        by_time = (lambda at: arrived[np.searchsorted(edges, at, side="right") - 1]) if elapsed_s[-1] else None
        reader.take(b"".join(sentences), by_time)
        clock = content.clock
        reader.finish()
        content.clock = clock if content.clock is Clock.NONE and content.positions else content.clock
    content.lag_std_s = max(content.lag_std_s, 0.3)
    return [content]


def _take_depth(content: LogContent, body: bytes) -> None:
    """An NMEA 2000 depth: below the transducer, with a positive offset to the surface or a negative one to the keel."""
    day, of_day_s, _, depth_m, offset_m, _ = struct.unpack("<HdIddd", body)
    name = "NMEA 2000"
    if name not in content.sounders:
        content.sounders[name] = Sounder(reference=Reference.SURFACE if offset_m > 0.0 else Reference.TRANSDUCER)
    if not 0.0 <= of_day_s < 2.0 * _DAY_S or not depth_m < 1e6:
        content.left_out["packets that are out of range"] += 1
        return
    content.depth(name, day * _DAY_S + of_day_s, depth_m + max(offset_m, 0.0) * (depth_m > 0.0))


def _take_gnss(content: LogContent, body: bytes) -> None:
    values = struct.unpack("<HdIHddddBBBdddBBHd", body)
    day, of_day_s, lat_deg, lon_deg, method = values[3], values[4], values[5], values[6], values[9]
    if method == 0:
        content.left_out[NO_FIX] += 1
    elif 0.0 <= of_day_s < 2.0 * _DAY_S:
        content.position("NMEA 2000", day * _DAY_S + of_day_s, lat_deg, lon_deg)
