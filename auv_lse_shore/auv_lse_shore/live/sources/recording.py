"""A recording as messages, whether it is complete or still being written.

The file is read from its beginning, record by record, by the MCAP format alone: an index, which a recording gets only
at its end, is not needed, and neither is `metadata.yaml`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.parameter_file import parse_parameters, read_parameter_file
from auv_lse_common.mission_file.retired import without_retired
from auv_lse_record.recording import MISSION_FILE, STORAGES, Recording, RecordingError

#: Whether a message of a topic, serialized (CDR), is wanted; None: every message.
Wanted = Callable[[str, bytes], bool] | None

_MAGIC = b"\x89MCAP0\r\n"
#: Head of a record: opcode, length; head of a message: channel (2 bytes), number, times of writing and publication.
_HEAD, _MESSAGE_HEAD_BYTES = struct.Struct("<BQ"), 22
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F
_READ = (_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK)


class RecordingFile:
    """Reads the messages of one MCAP file as it grows.

    Attributes:
        path: The file.
        complete: True once its end has been read, so that nothing more will be written.
    """

    def __init__(self, path: Path) -> None:
        """Opens nothing yet."""
        from rosbags.typesys import Stores, get_typestore

        self.path = path
        self.complete = False
        self._offset = 0
        self._types: Any = get_typestore(Stores.ROS2_JAZZY)
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, tuple[str, str]] = {}

    def messages(self, topics: frozenset[str], wanted: Wanted = None) -> Iterator[tuple[str, Any]]:
        """The messages of some topics that have been written since the last call: topic and message.

        Args:
            topics: Full names.
            wanted: Chooses among their messages; the others are not decoded.

        Raises:
            RecordingError: if the file cannot be read, is no MCAP file, or holds a message that cannot be decoded.
        """
        try:
            with self.path.open("rb") as file:
                for opcode, content in self._records(file):
                    for topic, kind, data in self._contents(opcode, content, topics):
                        if wanted is None or wanted(topic, data):
                            yield topic, self._types.deserialize_cdr(data, kind)
        except RecordingError:
            raise
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be read: {error.strerror or error}") from error
        except Exception as error:  # mcap and rosbags raise errors of many kinds for a damaged file
            raise RecordingError(f"{self.path}: damaged near byte {self._offset}: {error!r}") from error

    def _records(self, file: Any) -> Iterator[tuple[int, bytes]]:
        """The complete records that hold messages, or declare them."""
        if self._offset == 0:
            start = file.read(len(_MAGIC))
            if not _MAGIC.startswith(start):
                raise RecordingError(f"{self.path} is not an MCAP file: it begins with {start!r}, not {_MAGIC!r}")
            if len(start) < len(_MAGIC):
                return
            self._offset = len(_MAGIC)
        file.seek(self._offset)
        while not self.complete and len(head := file.read(9)) == 9:
            opcode, length = _HEAD.unpack(head)
            content = file.read(length)
            if len(content) < length:
                return
            self._offset += 9 + length
            self.complete = opcode == _DATA_END
            if opcode in _READ:
                yield opcode, content

    def _contents(self, opcode: int, content: bytes, topics: frozenset[str]) -> Iterator[tuple[str, str, bytes]]:
        """Topic, type and bytes of the messages in a record. One loop: a long mission has half a million of them."""
        records = _unpacked(content) if opcode == _CHUNK else _HEAD.pack(opcode, len(content)) + content
        at = 0
        while at < len(records):
            inner, length = _HEAD.unpack_from(records, at)
            at += _HEAD.size + length
            if inner == _MESSAGE:
                begin = at - length
                channel = self._channels.get(int.from_bytes(records[begin : begin + 2], "little"))
                if channel is not None:
                    yield *channel, records[begin + _MESSAGE_HEAD_BYTES : at]
            elif inner in (_SCHEMA, _CHANNEL):
                self._declare(inner, records[at - length : at], topics)

    def _declare(self, opcode: int, content: bytes, topics: frozenset[str]) -> None:
        """Takes the declaration of a type or of a topic."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel, Schema
        from rosbags.typesys import get_types_from_msg

        stream = ReadDataStream(BytesIO(content))
        if opcode == _SCHEMA:
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


def _unpacked(chunk: bytes) -> bytes:
    """The records in a chunk."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk
    from mcap.stream_reader import get_chunk_data_stream

    stream, size = get_chunk_data_stream(Chunk.read(ReadDataStream(BytesIO(chunk))))
    return bytes(stream.read(size))


class WholeRecording:
    """Reads the messages of a complete recording: several files, or sqlite3.

    Attributes:
        path: The path that `recording_in` returned.
        complete: True once it has been read.
    """

    def __init__(self, path: Path) -> None:
        """Opens nothing yet."""
        self.path = path
        self.complete = False

    def messages(self, topics: frozenset[str], wanted: Wanted = None) -> Iterator[tuple[str, Any]]:
        """The messages of some topics: topic and message; none at the second call. `wanted` as in `RecordingFile`.

        Raises:
            RecordingError: if it cannot be read.
        """
        if not self.complete:
            self.complete = True
            with Recording(self.path) as recording:
                for topic, _, message in recording.messages(topics, wanted):
                    yield topic, message


def open_recording(path: Path) -> RecordingFile | WholeRecording:
    """The reader for a path that `recording_in` returned."""
    files = [path] if path.is_file() else [file for file in path.iterdir() if file.suffix in STORAGES]
    alone = len(files) == 1 and files[0].suffix == ".mcap"
    return RecordingFile(files[0]) if alone else WholeRecording(path)


def find_parameters(recording: Path) -> tuple[dict[str, dict[str, Any]], str]:
    """The flown mission file and its source: inside the recording, else beside it or above it.

    Parameters and values of earlier versions are left out or replaced (`retired.py`).

    Raises:
        RecordingError: if there is none.
        ParameterError: if it is not a parameter file.
    """
    damaged: RecordingError | None = None
    try:
        for _, message in open_recording(recording).messages(frozenset({MISSION_FILE})):
            where = f"{recording} ({MISSION_FILE})"
            return without_retired(parse_parameters(str(message.data), where)), where
    except RecordingError as error:  # it is read with the mission file beside it
        damaged = error
    for folder in (recording, recording.parent, recording.parent.parent):
        if (path := folder / "mission.yaml").is_file():
            return without_retired(read_parameter_file(path)), str(path)
    if damaged is not None:
        raise damaged
    raise RecordingError(
        f"{recording}: there is no mission.yaml in it, beside it or above it. Name the mission file with --mission FILE"
    )
