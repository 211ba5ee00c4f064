"""The whole parts of a damaged MCAP file: it may end within a record, and any of its bits may be flipped.

A chunk is whole if it decompresses to the stated size, fits its checksum, and holds nothing but complete messages from
its own time span. Other records have no checksum: they count if they fill their length and a record or the file's end
follows. After a damaged part the next whole chunk is looked for byte by byte.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from typing import Any

import numpy as np

#: First and last bytes of an MCAP file.
MAGIC = b"\x89MCAP0\r\n"
#: Bytes before a record's content: its kind and its length.
_HEAD = 9
_CHUNK = 6
#: Bytes of a chunk's content before the name of its compression, and lengths of these names: none, lz4, zstd.
_BEFORE_NAME, _NAMES = 28, (0, 3, 4)
_KINDS = range(1, 16)
#: Bytes that are searched at a time.
_WINDOW = 2**22


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """A whole part of a file.

    Attributes:
        start: Its first byte.
        end: The first byte after it.
        records: Its records, those of a chunk in their order; indexes and statistics are left out.
    """

    start: int
    end: int
    records: list[Any]


def whole_pieces(data: bytes) -> Iterator[Piece]:
    """The whole records of a file, in their order."""
    at = len(MAGIC)
    while at < len(data):
        piece = _piece(data, at)
        end = _after_damaged(data, at) if piece is None else piece.end
        # The length of a record without a checksum may be damaged: it must not reach over whole chunks.
        if (piece is None or data[at] != _CHUNK) and (inside := _whole_chunk(data, at + 1, end)) is not None:
            at = inside
        elif piece is None:
            at = _next_chunk(data, end)
        else:
            yield piece
            at = end


def _piece(data: bytes, at: int) -> Piece | None:
    """The record at an offset; None if it is not whole."""
    end = _end(data, at)
    if end is None:
        return None
    content = data[at + _HEAD : end]
    if data[at] == _CHUNK:
        records = _chunk_records(content)
        return None if records is None else Piece(start=at, end=end, records=records)
    if not _is_followed(data, end):
        return None
    records = _single(data[at], content)
    return None if records is None else Piece(start=at, end=end, records=records)


def _end(data: bytes, at: int) -> int | None:
    """The end of the record at an offset by its length; None if that does not fit."""
    if at + _HEAD > len(data) or data[at] not in _KINDS:
        return None
    end = at + _HEAD + int.from_bytes(data[at + 1 : at + _HEAD], "little")
    return end if end <= len(data) else None


def _is_followed(data: bytes, end: int) -> bool:
    """Whether a record, or the file's end, follows."""
    left = data[end : end + len(MAGIC) + 1]
    return left in (b"", MAGIC) or _end(data, end) is not None


def _after_damaged(data: bytes, at: int) -> int:
    """Where to resume after a damaged record: behind it, if its length is plausible."""
    end = _end(data, at)
    return end if end is not None and data[at] == _CHUNK and _is_followed(data, end) else at + 1


def _single(kind: int, content: bytes) -> list[Any] | None:
    """The record of a kind with this content, in a list; empty for kinds without use, None if it is damaged."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Footer, Header, Message, Metadata, Schema

    stream = ReadDataStream(BytesIO(content))
    readers = {1: Header.read, 2: Footer.read, 3: Schema.read, 4: Channel.read, 12: Metadata.read}
    try:
        if kind == 5:
            return [Message.read(stream, len(content))]
        if kind not in readers:
            return []
        record = readers[kind](stream)
    except Exception:  # the reader raises errors of many kinds for damaged bytes
        return None
    return [record] if stream.count == len(content) else None


def _chunk_records(content: bytes) -> list[Any] | None:
    """The records of a chunk; None if it is damaged."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Chunk, Message, Schema
    from mcap.stream_reader import breakup_chunk, get_chunk_data_stream

    try:
        stream = ReadDataStream(BytesIO(content))
        chunk = Chunk.read(stream)
        at = _BEFORE_NAME + 4 + len(chunk.compression)
        size = int.from_bytes(content[at : at + 8], "little")  # the reader accepts less data than stated
        if at + 8 + size != len(content) or chunk.uncompressed_size > _largest(chunk.compression, len(content)):
            return None
        inner, size = get_chunk_data_stream(chunk, validate_crc=True)
        if size != chunk.uncompressed_size:
            return None
        records = breakup_chunk(replace(chunk, compression="", data=inner.read(size)))
    except Exception:  # also errors of the decompression libraries, and a lack of memory
        return None
    times = [record.log_time for record in records if isinstance(record, Message)]
    if not all(isinstance(record, Channel | Message | Schema) for record in records):
        return None
    within = all(chunk.message_start_time <= time <= chunk.message_end_time for time in times)
    return records if within else None


def _largest(compression: str, size: int) -> int:
    """Largest plausible size (bytes) of a decompressed chunk: a damaged one must not ask for all memory."""
    return size if not compression else max(2**28, 300 * size)


def _next_chunk(data: bytes, at: int) -> int:
    """Where the next record begins whose lengths are those of a chunk, at or after an offset; else the data's end.

    A record of another kind at this very offset counts, too.
    """
    if at < len(data) and data[at] != _CHUNK and (end := _end(data, at)) is not None and _is_followed(data, end):
        return at
    while at < len(data):
        window = np.frombuffer(data[at : at + _WINDOW], np.uint8)
        for offset in np.flatnonzero(window == _CHUNK) + at:
            if _looks_like_chunk(data, int(offset)):
                return int(offset)
        at += len(window)
    return len(data)


def _whole_chunk(data: bytes, at: int, end: int) -> int | None:
    """Where the first whole chunk begins in a part of the file; None without one."""
    offsets = np.flatnonzero(np.frombuffer(data[at:end], np.uint8) == _CHUNK) + at
    found = (int(p) for p in offsets if _looks_like_chunk(data, int(p)) and _piece(data, int(p)) is not None)
    return next(found, None)


def _looks_like_chunk(data: bytes, at: int) -> bool:
    end = _end(data, at)
    name = at + _HEAD + _BEFORE_NAME
    if end is None or end < name + 12:
        return False
    length = int.from_bytes(data[name : name + 4], "little")
    size = name + 4 + length
    return length in _NAMES and size + 8 + int.from_bytes(data[size : size + 8], "little") == end
