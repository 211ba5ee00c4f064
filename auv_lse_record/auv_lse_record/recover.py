"""scripts/recover: makes a recording whole that was cut off, by a power failure or a recorder that was killed.

Such a file of messages (MCAP) ends in the middle of a record and lacks its index. Every record up to there is copied
into a new file, which gets one. The torn file stays beside it, as `.torn`.
"""

from __future__ import annotations

import argparse
import struct
import sys
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from auv_lse_common.support.missing_packages import missing
from auv_lse_record.recording import STORAGES, Recording, RecordingError, recording_in

_KEPT = ".torn"


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovered:
    """What was saved.

    Attributes:
        file: The file of messages, now whole.
        messages: Messages in it.
        lost_bytes: Bytes at the torn end that hold no whole record.
    """

    file: Path
    messages: int
    lost_bytes: int


def recover(path: Path) -> Recovered:
    """Makes a recording whole.

    Args:
        path: A run folder, a rosbag2 directory, or its file of messages.

    Raises:
        RecordingError: if there is none, it is no MCAP, it is whole already, or nothing in it can be read.
    """
    found = recording_in(path)
    if found.is_dir():
        raise RecordingError(f"{found}: is whole (it has its metadata.yaml); nothing to recover")
    if found.suffix != ".mcap":
        raise RecordingError(f"{found}: expected an .mcap; of {' and '.join(STORAGES)} only that can be recovered")
    with suppress(RecordingError), Recording(found):
        raise _Whole(f"{found}: is whole; nothing to recover")
    torn, new = found.with_name(found.name + _KEPT), found.with_name(found.name + ".new")
    with found.open("rb") as source, new.open("wb") as target:
        messages, end = _copy(source, target)
    if not messages:
        new.unlink()
        raise RecordingError(f"{found}: no message in it can be read; it is left as it is")
    lost = found.stat().st_size - end
    found.replace(torn)
    new.replace(found)
    return Recovered(file=found, messages=messages, lost_bytes=lost)


class _Whole(Exception):
    """The recording needs no help."""


def _copy(source: BinaryIO, target: BinaryIO) -> tuple[int, int]:
    """Copies what is whole; returns the number of messages and the offset where the source tears."""
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
    """The records of a file, those in chunks one by one, each with the offset behind it, until it tears."""
    from mcap.exceptions import McapError
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    try:
        for record in StreamReader(source, emit_chunks=True).records:
            for part in breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]:
                yield part, source.tell()
    except (McapError, EOFError, ValueError, struct.error, zlib.error, OverflowError, MemoryError):
        return  # here it tears


def parser() -> argparse.ArgumentParser:
    """The command line of scripts/recover."""
    p = argparse.ArgumentParser(
        prog="scripts/recover",
        description="Makes a recording whole that was cut off: by a power failure, or a recorder that was killed.",
        epilog="Exit codes: 0 recovered, or whole already; 1 it cannot be; 2 a wrong command line; 130 Ctrl-C.",
    )
    p.add_argument("path", type=Path, metavar="RUN", help="run folder, rosbag2 directory, or its .mcap")
    return p


def main(arguments: Sequence[str] | None = None) -> int:
    """Recovers a recording. Returns 0, 1 if it cannot be, 2 for a wrong command line, 130 after Ctrl-C."""
    path = parser().parse_args(arguments).path
    try:
        done = recover(path)
    except _Whole as whole:
        print(whole)
        return 0
    except (RecordingError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    print(f"{done.file}: {done.messages} messages recovered, {done.lost_bytes} bytes at its end could not be read; ")
    print(f"the torn file is {done.file}{_KEPT}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
