"""auv_lse recover: repairs a recording that a power failure or a killed recorder cut off, or that a disk damaged.

Such an MCAP file ends within a record and has no index, or some of its bits are wrong. Every whole record and chunk is
copied to a new file with an index. The damaged file is kept as `.torn`; after an earlier recovery, as `.torn2`, ...
"""

import argparse
import itertools
import mmap
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast

from auv_lse_common.support.missing_packages import missing
from auv_lse_common.support.plurals import counted
from auv_lse_record.recording import STORAGES, Recording, RecordingError, parts_of, recording_in
from auv_lse_record.salvage import MAGIC, whole_pieces

_KEPT = ".torn"
_METADATA = "metadata.yaml"


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovered:
    """A repaired recording.

    Attributes:
        file: The MCAP file, now complete.
        kept: The damaged file.
        lost_bytes: Bytes of the damaged file outside of whole records.
        nameless: Messages in whole chunks whose topic no whole chunk describes.
    """

    file: Path
    kept: Path
    messages: int
    lost_bytes: int
    nameless: int = 0


def recover(path: Path) -> Recovered:
    """Repairs a recording.

    Args:
        path: A run folder with one recording, a rosbag2 directory, or its file of messages.

    Raises:
        RecordingError: if it is missing, complete, unreadable or not an MCAP file.
    """
    recording = recording_in(path)
    files = sorted(recording.glob("*.mcap")) if recording.is_dir() else [recording]
    if not files or files[0].suffix != ".mcap":
        raise RecordingError(f"{recording} cannot be recovered; of {' and '.join(STORAGES)} only .mcap can")
    found = next((file for file in files if not _is_whole(file)), None)
    if found is None:
        return _without_index(recording, files)
    new = found.with_name(found.name + ".new")
    try:
        with _content(found) as data, new.open("wb") as target:
            messages, nameless, lost = _copy(data, target)
        if not messages:
            raise _Empty(f"{found}: no message can be read; the file is unchanged")
        kept = _put_aside(found)
        new.replace(found)
        if len(files) == 1 and recording.is_dir():  # the index beside it counts messages that are lost
            _put_aside(recording / _METADATA)
    except OSError as error:
        raise RecordingError(
            f"{new}: cannot be written: {error.strerror or error}. Free space, or copy the run folder to another disk "
            "and recover it there"
        ) from error
    finally:
        with suppress(OSError):  # the part for which there was room
            new.unlink()
    return Recovered(file=found, kept=kept, messages=messages, lost_bytes=lost, nameless=nameless)


def _without_index(recording: Path, files: list[Path]) -> Recovered:
    """Puts an index beside whole files aside if it is damaged: one file needs none.

    Raises:
        RecordingError: if the recording is complete, or several files need the index.
    """
    with Recording(files[0]) as whole:
        messages = sum(topic.count for topic in whole.topics.values())
    index = recording / _METADATA
    try:
        with Recording(recording):
            raise _Complete(f"{recording} is complete; nothing to recover")
    except _Complete:
        raise
    except RecordingError as error:
        if not recording.is_dir():
            raise
        if len(files) > 1:
            cure = f"its {len(files)} files need it: ros2 bag reindex {shlex.quote(str(recording))}"
            raise RecordingError(f"{index} is damaged, and {cure}") from error
    try:
        return Recovered(file=files[0], kept=_put_aside(index), messages=messages, lost_bytes=0)
    except OSError as error:
        raise RecordingError(
            f"{index} is damaged, and cannot be renamed: {error.strerror or error}. Copy the run folder to another "
            "disk and recover it there"
        ) from error


def _put_aside(file: Path) -> Path:
    """Renames a damaged file to the first of `.torn`, `.torn2`, ... that is free; returns its new path."""
    names = (f"{file.name}{_KEPT}{'' if number == 1 else number}" for number in itertools.count(1))
    return file.rename(next(path for name in names if not (path := file.with_name(name)).exists()))


class _Complete(RecordingError):
    """The recording is complete already."""


class _Empty(RecordingError):
    """No message can be read."""


@contextmanager
def _content(file: Path) -> Iterator[bytes]:
    """The content of a file, which may be larger than the memory."""
    with file.open("rb") as source:
        if not file.stat().st_size:
            yield b""
            return
        with mmap.mmap(source.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
            yield cast(bytes, mapped)  # it is only sliced


def _is_whole(file: Path) -> bool:
    """Whether every record can be read, up to the marks at the end, and every message by the index.

    Topics and types are described again at the end, where readers look. A description must be the same both times.
    """
    try:
        from mcap.records import Channel, Footer, Message, Schema
    except ImportError as error:
        raise missing(error, "recovering recordings") from error
    end, last, messages = len(MAGIC), None, 0
    described: dict[tuple[type, int], Channel | Schema] = {}
    with _content(file) as data:
        for piece in whole_pieces(data):
            if piece.start != end:
                return False
            end, last = piece.end, piece.records[-1] if piece.records else None
            for record in piece.records:
                messages += isinstance(record, Message)
                is_description = isinstance(record, Channel | Schema)
                if is_description and described.setdefault((type(record), record.id), record) != record:
                    return False
        if not isinstance(last, Footer) or data[end:] != MAGIC:
            return False
    with suppress(RecordingError), Recording(file) as recording:
        return messages == sum(1 for _ in recording.raw(recording.topics))
    return False


def _copy(data: bytes, target: BinaryIO) -> tuple[int, int, int]:
    """Copies whole records; returns the numbers of messages, of those without a topic, and of the bytes left out."""
    try:
        from mcap.records import Channel, Message, Metadata, Schema
        from mcap.writer import Writer
    except ImportError as error:
        raise missing(error, "recovering recordings") from error
    # A chunk that describes a topic may be damaged; the description is repeated at the end of a file.
    described: dict[type, dict[int, Any]] = {Schema: {}, Channel: {}}
    for piece in whole_pieces(data):
        for record in piece.records:
            if type(record) in described:
                described[type(record)].setdefault(record.id, record)
    writer = Writer(target)
    writer.start(profile="ros2", library="auv_lse recover")
    schemas: dict[int, int] = {0: 0}
    for number, schema in described[Schema].items():
        schemas[number] = writer.register_schema(schema.name, schema.encoding, schema.data)
    channels = {
        number: writer.register_channel(
            channel.topic, channel.message_encoding, schemas[channel.schema_id], dict(channel.metadata)
        )
        for number, channel in described[Channel].items()
        if channel.schema_id in schemas
    }
    messages = nameless = 0
    lost = max(0, len(data) - 2 * len(MAGIC))
    for piece in whole_pieces(data):
        lost -= piece.end - piece.start
        for record in piece.records:
            match record:
                case Message() if record.channel_id in channels:
                    channel = channels[record.channel_id]
                    writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
                    messages += 1
                case Message():
                    nameless += 1
                case Metadata():
                    writer.add_metadata(record.name, record.metadata)
    writer.finish()
    return messages, nameless, max(0, lost)


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse recover."""
    p = argparse.ArgumentParser(
        prog="auv_lse recover",
        description="Repairs a recording that was cut off by a power failure or a killed recorder, or damaged by a "
        "disk.",
        epilog="Exit codes: 0 recovered, or already complete; 1 failed; 2 wrong command line; 130 Ctrl-C.",
    )
    p.add_argument("path", type=Path, metavar="RUN", help="run folder, rosbag2 directory, or its .mcap")
    return p


def run(options: argparse.Namespace) -> int:
    """Repairs all recordings of a dive. Returns 0, or 1 if that fails."""
    try:
        parts = parts_of(recording_in(options.path))
    except RecordingError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return max([_recover(part, others=len(parts) > 1) for part in parts])


def _recover(part: Path, others: bool) -> int:
    """Repairs one recording. One without a message is put aside if there are `others`, which can then be read."""
    try:
        done = recover(part)
    except _Complete as complete:
        print(complete)
        return 0
    except _Empty as empty:
        if not others or not part.is_file():
            print(f"error: {empty}", file=sys.stderr)
            return 1
        print(f"{part}: no message can be read; put aside as {_put_aside(part)}")
        return 0
    except (RecordingError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    nameless = f", {counted(done.nameless, 'message')} of topics without a description" if done.nameless else ""
    lost = f"{counted(done.lost_bytes, 'damaged byte')} left out"
    print(f"{done.file}: {counted(done.messages, 'message')} recovered; {lost}{nameless}")
    print(f"damaged file kept as {done.kept}")
    return 0
