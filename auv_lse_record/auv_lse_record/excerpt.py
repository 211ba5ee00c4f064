"""Extracts from a dive's growing recordings what a chart on another computer needs: few bytes over a poor link.

An excerpt is a piece of an MCAP file without chunks: the pieces of one file, one after another behind `MAGIC`, are a
recording that `RecordingFile` reads. No state is kept between excerpts: the cursor has all that the next one needs.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from auv_lse_record.growing_file import CHANNEL, HEAD, MESSAGE, MESSAGE_HEAD, SCHEMA, GrowingFile
from auv_lse_record.recording import RecordingError, damaged

#: An excerpt ends after the block of records with which it reaches this size (bytes), or has taken this time (s).
MOST_BYTES, _MOST_S = 200_000, 0.5
_MOST_TOPICS = 100


@dataclass(slots=True)
class Cursor:
    """The end of the last excerpt, at which the next one begins.

    Attributes:
        dive: Name of the dive's folder.
        file: The recording's file below it.
        offset: Where the next record begins.
        channels: Names of the topics whose messages are wanted, by the number of their channel.
        kept_ns: When the last kept message of each channel was recorded.
    """

    dive: str = ""
    file: str = ""
    offset: int = 0
    channels: dict[str, str] = field(default_factory=dict)
    kept_ns: dict[str, int] = field(default_factory=dict)

    @classmethod
    def read(cls, values: Mapping[str, Any]) -> Cursor:
        """The cursor of a message.

        Raises:
            TypeError, ValueError: if the values are no cursor.
        """
        found = cls(**values)
        texts = (found.dive, found.file, *found.channels, *found.channels.values(), *found.kept_ns)
        numbers = (found.offset, *found.kept_ns.values())
        if not all(type(text) is str for text in texts) or not all(type(n) is int and n >= 0 for n in numbers):
            raise TypeError(f"{values!r} is no cursor")
        return found

    def values(self) -> dict[str, Any]:
        """The cursor as JSON can hold it."""
        return asdict(self)


def excerpt(dive: Path, cursor: Cursor, topics: Mapping[str, float]) -> tuple[bytes, Cursor, bool]:
    """The messages on some topics that were recorded in a dive since the last excerpt.

    Args:
        cursor: From the last excerpt; that of another dive, or a new one, starts over.
        topics: Shortest time (s) between two messages that are kept, by the topic's full name; 0: all are.

    Returns:
        The bytes of one file, the cursor behind them, and whether there may be more already. A cursor with another
        file than before means that these bytes begin a new file.

    Raises:
        OSError: if a file cannot be read.
        RecordingError: if the last file is not MCAP or is damaged; the rest of a damaged earlier file is left out.
    """
    if len(topics) > _MOST_TOPICS:
        raise RecordingError(f"{len(topics)} topics are too many for an excerpt.")
    files = _files(dive)
    if not files:
        return b"", Cursor(dive.name), False
    if cursor.dive != dive.name or cursor.file not in files:
        cursor = Cursor(dive.name, next(iter(files)))
    later = list(files)[list(files).index(cursor.file) + 1 :]
    found = _Excerpt(files[cursor.file], cursor, topics)
    try:
        data = found.read()
    except RecordingError:
        if not later:
            raise
        return excerpt(dive, Cursor(dive.name, later[0]), topics)
    if later and not data and not found.more:
        return excerpt(dive, Cursor(dive.name, later[0]), topics)
    return data, found.cursor, found.more or bool(later)


def _files(dive: Path) -> dict[str, Path]:
    """The files of a dive's recordings, in the order in which they were begun: bag, bag-2, ..."""
    paths = [path for path in dive.glob("bag*/*.mcap") if re.fullmatch(r"bag(-\d+)?", path.parent.name)]
    paths.sort(key=lambda path: (int(path.parent.name[4:] or 1), [int(n) for n in re.findall(r"\d+", path.name)]))
    return {path.relative_to(dive).as_posix(): path for path in paths}


def _records(block: bytes) -> Iterator[tuple[int, bytes]]:
    """Opcode and bytes of each record in a block, with its head."""
    at = 0
    while at < len(block):
        start, (opcode, length) = at, HEAD.unpack_from(block, at)
        at += HEAD.size + length
        yield opcode, block[start:at]


def _number(record: bytes, at: int = 0) -> int:
    """The two-byte number in a record, behind its head."""
    return int.from_bytes(record[HEAD.size + at : HEAD.size + at + 2], "little")


class _Excerpt:
    """One excerpt of one file."""

    def __init__(self, path: Path, cursor: Cursor, topics: Mapping[str, float]) -> None:
        self._path, self._topics = path, topics
        self.cursor = Cursor(cursor.dive, cursor.file, cursor.offset, dict(cursor.channels), dict(cursor.kept_ns))
        self.more = False
        self._schemas: dict[int, bytes] = {}
        self._sent: set[int] = set()
        self._kept = bytearray()

    def read(self) -> bytes:
        """Reads on, and returns the records to send.

        Raises:
            OSError: if the file cannot be read.
            RecordingError: if it is damaged.
        """
        file, end_s = GrowingFile(self._path, self.cursor.offset), time.monotonic() + _MOST_S
        try:
            for block in file.blocks():
                for opcode, record in _records(block):
                    self._take(opcode, record)
                if len(self._kept) >= MOST_BYTES or time.monotonic() > end_s:
                    self.more = True
                    break
        except (OSError, RecordingError):
            raise
        except Exception as error:  # mcap raises errors of many kinds for a damaged file
            raise RecordingError(damaged(self._path, file.offset, error)) from error
        self.cursor.offset = file.offset
        return bytes(self._kept)

    def _take(self, opcode: int, record: bytes) -> None:
        if opcode == MESSAGE:
            if self._is_wanted(record):
                self._kept += record
        elif opcode == SCHEMA:
            self._schemas[_number(record)] = record
        elif opcode == CHANNEL:
            self._declare(record)

    def _is_wanted(self, record: bytes) -> bool:
        number, _, logged_ns, _ = MESSAGE_HEAD.unpack_from(record, HEAD.size)
        channel = str(number)
        topic = self.cursor.channels.get(channel)
        if topic is None:
            return False
        last_ns = self.cursor.kept_ns.get(channel)
        if last_ns is not None and 0 <= logged_ns - last_ns < 1e9 * self._topics.get(topic, 0.0):
            return False
        self.cursor.kept_ns[channel] = logged_ns
        return True

    def _declare(self, record: bytes) -> None:
        """Handles the declaration of a topic; that of its type goes before it."""
        channel, schema = str(_number(record)), _number(record, 2)
        size = int.from_bytes(record[HEAD.size + 4 : HEAD.size + 8], "little")
        topic = record[HEAD.size + 8 : HEAD.size + 8 + size].decode(errors="replace")
        if topic not in self._topics or channel in self.cursor.channels:
            return
        self.cursor.channels[channel] = topic
        if schema not in self._sent:
            self._sent.add(schema)
            self._kept += self._schemas.get(schema) or self._earlier(schema)
        self._kept += record

    def _earlier(self, schema: int) -> bytes:
        """The declaration of a type that came before this excerpt."""
        for block in GrowingFile(self._path).blocks():
            for opcode, record in _records(block):
                if opcode == SCHEMA and _number(record) == schema:
                    return record
        return b""
