"""Reads an MCAP file that may still be written, record by record.

The file is read from its beginning, by the MCAP format alone: an index, which a recording gets only at its end, is not
needed, and neither is `metadata.yaml`.
"""

import struct
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

from auv_lse_record.recording import RecordingError, damaged

#: Whether a message of a topic, serialized (CDR), is wanted; None: every message.
Wanted = Callable[[str, bytes], bool] | None

MAGIC = b"\x89MCAP0\r\n"
#: Head of a record: opcode, length.
HEAD = struct.Struct("<BQ")
#: Head of a message: channel, number, times (ns) of writing and publication.
MESSAGE_HEAD = struct.Struct("<HIQQ")
SCHEMA, CHANNEL, MESSAGE, CHUNK, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F
_READ = (SCHEMA, CHANNEL, MESSAGE, CHUNK)


class GrowingFile:
    """The records of one MCAP file as it grows.

    Attributes:
        offset: Where the next record begins.
        complete: True once the end has been read, so that nothing more will be written.
    """

    def __init__(self, path: Path, offset: int = 0) -> None:
        """Opens nothing yet.

        Args:
            offset: Where a record begins; 0: the file's beginning.
        """
        self.path, self.offset, self.complete = path, offset, False

    def blocks(self) -> Iterator[bytes]:
        """Records that hold messages or declare them, written since the last call: one, or a chunk of them.

        Raises:
            OSError: if the file cannot be read.
            RecordingError: if it is no MCAP file.
        """
        with self.path.open("rb") as file:
            if self.offset == 0:
                start = file.read(len(MAGIC))
                if not MAGIC.startswith(start):
                    raise RecordingError(f"{self.path} is not an MCAP file: it begins with {start!r}, not {MAGIC!r}")
                if len(start) < len(MAGIC):
                    return
                self.offset = len(MAGIC)
            file.seek(self.offset)
            while not self.complete and len(head := file.read(HEAD.size)) == HEAD.size:
                opcode, length = HEAD.unpack(head)
                content = file.read(length)
                if len(content) < length:
                    return
                self.offset += HEAD.size + length
                self.complete = opcode == _DATA_END
                if opcode in _READ:
                    yield _unpacked(content) if opcode == CHUNK else head + content


def _unpacked(chunk: bytes) -> bytes:
    """The records in a chunk."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk
    from mcap.stream_reader import get_chunk_data_stream

    stream, size = get_chunk_data_stream(Chunk.read(ReadDataStream(BytesIO(chunk))))
    return bytes(stream.read(size))


class RecordingFile:
    """Reads the messages of one MCAP file as it grows."""

    def __init__(self, path: Path) -> None:
        """Opens nothing yet."""
        from rosbags.typesys import Stores, get_typestore

        self.path = path
        self._file = GrowingFile(path)
        self._types: Any = get_typestore(Stores.ROS2_JAZZY)
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, tuple[str, str]] = {}

    @property
    def complete(self) -> bool:
        """True once its end has been read, so that nothing more will be written."""
        return self._file.complete

    def messages(self, topics: frozenset[str], wanted: Wanted = None) -> Iterator[tuple[str, Any]]:
        """The messages of some topics that have been written since the last call: topic and message.

        Args:
            topics: Full names.
            wanted: Chooses among their messages; the others are not decoded.

        Raises:
            RecordingError: if the file cannot be read, is no MCAP file, or holds a message that cannot be decoded.
        """
        try:
            for records in self._file.blocks():
                for topic, kind, data in self._contents(records, topics):
                    if wanted is None or wanted(topic, data):
                        yield topic, self._types.deserialize_cdr(data, kind)
        except RecordingError:
            raise
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be read: {error.strerror or error}") from error
        except Exception as error:  # mcap and rosbags raise errors of many kinds for a damaged file
            raise RecordingError(damaged(self.path, self._file.offset, error)) from error

    def _contents(self, records: bytes, topics: frozenset[str]) -> Iterator[tuple[str, str, bytes]]:
        """Topic, type and bytes of the messages in records. One loop: a long mission has half a million of them."""
        at = 0
        while at < len(records):
            inner, length = HEAD.unpack_from(records, at)
            at += HEAD.size + length
            if inner == MESSAGE:
                begin = at - length
                channel = self._channels.get(int.from_bytes(records[begin : begin + 2], "little"))
                if channel is not None:
                    yield *channel, records[begin + MESSAGE_HEAD.size : at]
            elif inner in (SCHEMA, CHANNEL):
                self._declare(inner, records[at - length : at], topics)

    def _declare(self, opcode: int, content: bytes, topics: frozenset[str]) -> None:
        """Handles the declaration of a type or of a topic."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel, Schema
        from rosbags.typesys import get_types_from_msg

        stream = ReadDataStream(BytesIO(content))
        if opcode == SCHEMA:
            declared = Schema.read(stream)
            self._schemas[declared.id] = declared
            return
        channel = Channel.read(stream)
        if channel.id in self._channels or channel.topic not in topics:
            return
        schema = self._schemas.get(channel.schema_id)
        if schema is None or channel.message_encoding != "cdr":
            raise RecordingError(
                f"{self.path}: {channel.topic}: encoding {channel.message_encoding!r} without a usable schema; "
                "only CDR with its message definition, as rosbag2 writes it, can be read"
            )
        found = get_types_from_msg(schema.data.decode(), schema.name)
        self._types.register({k: v for k, v in found.items() if k not in self._types.fielddefs})
        self._channels[channel.id] = (channel.topic, schema.name)
