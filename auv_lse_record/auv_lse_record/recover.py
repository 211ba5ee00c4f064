"""scripts/recover: repairs a recording that was cut off by a power failure or a killed recorder.

Such an MCAP file ends within a record and has no index. Every complete record is copied to a new file with an index.
The damaged file is kept as `.torn`.
"""

from __future__ import annotations

import argparse
import struct
import sys
import zlib
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

from auv_lse_common.support.missing_packages import missing
from auv_lse_record.recording import STORAGES, Recording, RecordingError, recording_in

_KEPT = ".torn"
_METADATA = "metadata.yaml"
#: First and last bytes of an MCAP file.
_MAGIC = b"\x89MCAP0\r\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovered:
    """A repaired recording.

    Attributes:
        file: The MCAP file, now complete.
        lost_bytes: Bytes at the end of the damaged file without a complete record.
    """

    file: Path
    messages: int
    lost_bytes: int


def recover(path: Path) -> Recovered:
    """Repairs a recording.

    Args:
        path: A run folder, a rosbag2 directory, or its file of messages.

    Raises:
        RecordingError: if it is missing, complete, unreadable or not an MCAP file.
    """
    recording = recording_in(path)
    files = sorted(recording.glob("*.mcap")) if recording.is_dir() else [recording]
    if not files or files[0].suffix != ".mcap":
        raise RecordingError(f"{recording}: expected an .mcap; of {' and '.join(STORAGES)} only that can be recovered")
    found = next((file for file in files if not _is_whole(file)), None)
    if found is None:
        raise _Complete(f"{recording}: is complete; nothing to recover")
    torn, new = found.with_name(found.name + _KEPT), found.with_name(found.name + ".new")
    with found.open("rb") as source, new.open("wb") as target:
        messages, end = _copy(source, target)
    if not messages:
        new.unlink()
        raise RecordingError(f"{found}: no message can be read; the file is unchanged")
    lost = found.stat().st_size - end
    found.replace(torn)
    new.replace(found)
    if len(files) == 1 and recording.is_dir():  # the index beside it counts messages that are lost
        (recording / _METADATA).replace(recording / (_METADATA + _KEPT))
    return Recovered(file=found, messages=messages, lost_bytes=lost)


class _Complete(RecordingError):
    """The recording is complete already."""


def _is_whole(file: Path) -> bool:
    """Whether every record can be read, up to the marks at the end, and the recording can be opened."""
    try:
        from mcap.records import Footer
    except ImportError as error:
        raise missing(error, "recovering recordings") from error
    with file.open("rb") as source:
        last, end = deque(chain([(None, 0)], _records(source)), maxlen=1).pop()
        source.seek(end)
        if not isinstance(last, Footer) or source.read(len(_MAGIC) + 1) != _MAGIC:
            return False
    with suppress(RecordingError), Recording(file):
        return True
    return False


def _copy(source: BinaryIO, target: BinaryIO) -> tuple[int, int]:
    """Copies complete records; returns the number of messages and the offset of their end in the source."""
    try:
        from mcap.records import Channel, Message, Metadata, Schema
        from mcap.writer import Writer
    except ImportError as error:
        raise missing(error, "recovering recordings") from error
    writer = Writer(target)
    writer.start(profile="ros2", library="auv_lse recover")
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    messages = end = 0
    for record, at in _records(source):
        end = at
        match record:
            case Schema():
                if record.id not in schemas:
                    schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            case Channel():
                if record.id not in channels:
                    channels[record.id] = writer.register_channel(
                        record.topic, record.message_encoding, schemas[record.schema_id], dict(record.metadata)
                    )
            case Message():
                channel = channels[record.channel_id]
                writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
                messages += 1
            case Metadata():
                writer.add_metadata(record.name, record.metadata)
    writer.finish()
    return messages, end


def _records(source: BinaryIO) -> Iterator[tuple[Any, int]]:
    """The complete records of a file, including those in chunks, each with the offset of its end."""
    from mcap.exceptions import McapError
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    try:
        for record in StreamReader(source, emit_chunks=True).records:
            for part in breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]:
                yield part, source.tell()
    except (McapError, EOFError, ValueError, struct.error, zlib.error, OverflowError, MemoryError):
        return  # the file is incomplete from here on


def parser() -> argparse.ArgumentParser:
    """The command line of scripts/recover."""
    p = argparse.ArgumentParser(
        prog="scripts/recover",
        description="Repairs a recording that was cut off by a power failure or a killed recorder.",
        epilog="Exit codes: 0 recovered, or already complete; 1 failed; 2 wrong command line; 130 Ctrl-C.",
    )
    p.add_argument("path", type=Path, metavar="RUN", help="run folder, rosbag2 directory, or its .mcap")
    return p


def main(arguments: Sequence[str] | None = None) -> int:
    """Repairs a recording. Returns 0, 1 if that fails, 2 for a wrong command line, 130 after Ctrl-C."""
    path = parser().parse_args(arguments).path
    try:
        done = recover(path)
    except _Complete as complete:
        print(complete)
        return 0
    except (RecordingError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    print(f"{done.file}: {done.messages} messages recovered, {done.lost_bytes} bytes at the end lost")
    print(f"damaged file kept as {done.file}{_KEPT}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
