"""Reads a recording (rosbag2: MCAP or sqlite3) without ROS.

Messages are read with the definitions in the recording, so that recordings of other systems or older versions can be
read if they have the needed fields. A recording without definitions (an old sqlite3 file) is read with those of ROS 2
Jazzy and of this project.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from auv_lse_common.support.plurals import counted
from auv_lse_common.support.user_error import brief
from auv_lse_common.topics.table import Topic, find_topic
from auv_lse_common.vocabulary.stamps import seconds
from auv_lse_record.earlier_versions import Translator
from auv_lse_record.message_types import project_types

#: Latched texts that the recorder writes into every recording: the mission file, the software's version.
MISSION_FILE, SOFTWARE = "/recorder/mission_file", "/recorder/software"
TEXT = "std_msgs/msg/String"

#: Suffixes of files of messages.
STORAGES = (".mcap", ".db3")
#: Queue depth of a writer whose depth is unknown, as in `ros2 bag play`.
_DEPTH = 10


class RecordingError(ValueError):
    """A recording is missing or damaged, or lacks data of a mission."""


def damaged(path: Path, at: int, error: Exception) -> str:
    """The text about a recording, perhaps still being written, that cannot be read near byte number `at`."""
    cure = f"When nothing writes to it, repair it: auv_lse recover {shlex.quote(str(path))}"
    return f"{path}: damaged near byte {at:,}: {brief(error)}. {cure}"


class RecordedValue(NamedTuple):
    """The content of one message.

    Attributes:
        topic: Its row in the table of topics.
        log_ns: Time of its reception by the recorder (ns).
        stamp_s: Stamp of its header (s).
        value: Its value, decoded by the row.
    """

    topic: Topic
    vehicle: int
    log_ns: int
    stamp_s: float
    value: Any


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedTopic:
    """One topic of a recording.

    Attributes:
        kind: Message type, "std_msgs/msg/String".
        reliable: Whether all its writers were reliable.
        latched: Whether its writers were latched (transient local).
        depth: Queue depth of its writers.
    """

    name: str
    kind: str
    count: int
    reliable: bool
    latched: bool
    depth: int


def recording_in(path: Path) -> Path:
    """The recording at a path: a run folder, a rosbag2 directory, or one of its files.

    Returns:
        The rosbag2 directory, or the file of messages if there is no `metadata.yaml`; the run folder of several
        (`parts_of`).

    Raises:
        RecordingError: if there is none.
    """
    try:
        there = path.exists()
    except OSError as error:  # such as a name that is too long
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not there:
        raise RecordingError(f"{path} does not exist. Name a run folder, a rosbag2 directory, or its .mcap or .db3")
    if path.is_file():
        if path.suffix not in STORAGES:
            raise RecordingError(
                f"{path} is not a recording. Name a run folder, a rosbag2 directory, or its {' or '.join(STORAGES)}"
            )
        return path
    if own := _bag_or_file(path):
        return own
    parts = parts_of(path)
    if parts != [path]:
        return path if len(parts) > 1 else parts[0]
    if inside := sorted(bag.parent for bag in path.glob("*/bag")):
        raise RecordingError(
            f"{path} has the recordings of {counted(len(inside), 'run folder')}; name one, such as {inside[0]}. "
            "auv_lse adjust and certify take several"
        )
    raise RecordingError(
        f"{path} is not a recording: neither it nor its folder bag has a metadata.yaml (was the recorder "
        "killed?). Name a run folder or a rosbag2 directory"
    )


def parts_of(recording: Path) -> list[Path]:
    """The parts of a recording: those in a run folder, in order, or the recording itself.

    A recorder that is restarted, as after a reboot in mid-dive, begins the next one: bag, bag-2, ... Empty ones
    are left out.
    """
    if recording.is_file() or _bag_or_file(recording):
        return [recording]
    folders = (folder for folder in recording.glob("bag*") if re.fullmatch(r"bag(-\d+)?", folder.name))
    ordered = sorted(folders, key=lambda folder: int(folder.name[4:] or 1))
    parts = [part for folder in ordered if (part := _bag_or_file(folder))]
    return [part for part in parts if part.is_dir() or part.stat().st_size] or parts or [recording]


def _bag_or_file(folder: Path) -> Path | None:
    """A folder with `metadata.yaml`, else its only file of messages; None if there is neither."""
    if (folder / "metadata.yaml").is_file():
        return folder
    files = [file for ending in STORAGES for file in folder.glob(f"*{ending}")]
    return files[0] if len(files) == 1 else None


@contextmanager
def _parse_definitions_once() -> Iterator[None]:
    """Lets rosbags parse each definition once, not for every topic that has it: a recording opens in half the time."""
    from rosbags.highlevel import anyreader

    parse = getattr(anyreader, "get_types_from_msg", None)
    if parse is None:  # a version of rosbags that parses elsewhere
        yield
        return
    anyreader.get_types_from_msg = cache(parse)
    try:
        yield
    finally:
        anyreader.get_types_from_msg = parse


class Recording:
    """A recording, open for reading; a context manager.

    Attributes:
        path: The rosbag2 directory, its file of messages, or the run folder of several.
        start_ns: Stamp of its first message (ns).
        end_ns: Stamp of its last message (ns).
    """

    def __init__(self, path: Path) -> None:
        """Args: path: result of `recording_in`."""
        self.path = path
        self.topics: dict[str, RecordedTopic] = {}
        self.start_ns = self.end_ns = 0

    def __enter__(self) -> Recording:
        """Opens it.

        Raises:
            RecordingError: if it cannot be read, or rosbags is not installed.
        """
        try:
            from rosbags.highlevel import AnyReader, AnyReaderError
        except ImportError:
            raise RecordingError(
                f"{self.path}: reading recordings needs the package rosbags: pip install rosbags"
            ) from None
        try:
            self._reader = AnyReader(parts_of(self.path))
            with _parse_definitions_once():
                try:
                    self._reader.open()
                except AnyReaderError:  # perhaps it has no definitions; these take a tenth of a second to load
                    self._reader.default_typestore = project_types()
                    self._reader.open()
        except Exception as error:  # rosbags raises errors of many kinds for a damaged recording
            raise self._broken(error) from error
        for name, found in self._reader.topics.items():
            self.topics[name] = _topic(name, found.connections)
        if self._reader.message_count:
            self.start_ns, self.end_ns = self._reader.start_time, self._reader.end_time - 1
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Closes it."""
        self._reader.close()

    def raw(
        self, topics: Collection[str], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[tuple[str, int, bytes]]:
        """The serialized messages (CDR) of some topics, in the order of their stamps.

        Args:
            start_ns: First stamp (ns).
            stop_ns: End of the stamps (ns), exclusive.

        Yields:
            Topic, stamp (ns), bytes.

        Raises:
            RecordingError: where the recording is damaged.
        """
        wanted = [c for c in self._reader.connections if c.topic in topics]
        if not wanted:
            return
        try:
            for connection, stamp_ns, data in self._reader.messages(wanted, start_ns, stop_ns):
                yield connection.topic, stamp_ns, bytes(data)
        except Exception as error:  # as above
            raise self._broken(error) from error

    def translated(
        self, topics: Collection[str], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[tuple[str, int, bytes]]:
        """Like `raw`, but messages of earlier versions are translated to what this version publishes."""
        translator = Translator(self._reader.typestore, project_types())
        for topic, stamp_ns, data in self.raw(topics, start_ns, stop_ns):
            yield topic, stamp_ns, translator.translated(self.topics[topic].kind, data)

    def messages(
        self, topics: Collection[str], wanted: Callable[[str, bytes], bool] | None = None
    ) -> Iterator[tuple[str, int, Any]]:
        """The messages of some topics, by their full names, in the order of their stamps.

        Args:
            topics: Full names.
            wanted: Chooses among their serialized messages; the others are not decoded. None: all.

        Yields:
            Topic, stamp (ns), message.

        Raises:
            RecordingError: where the recording is damaged.
        """
        for topic, stamp_ns, data in self.raw([name for name in self.topics if name in topics]):
            if wanted is not None and not wanted(topic, data):
                continue
            try:
                message = self._reader.deserialize(data, self.topics[topic].kind)
            except Exception as error:  # as above
                raise self._broken(error) from error
            yield topic, stamp_ns, message

    def values(self, topics: Collection[str], optional: Collection[str] = ()) -> Iterator[RecordedValue]:
        """The decoded messages of some of the stack's topics, in the order of their stamps.

        Args:
            topics: Names in the table of topics ("plan", "truth/odometry"), for all recorded vehicles.
            optional: Those whose messages are left out where they cannot be decoded.

        Raises:
            RecordingError: where the recording is damaged, or another message cannot be decoded.
        """
        found = {name: row for name in self.topics if (row := find_topic(name)) and row.topic.name in topics}
        for name, log_ns, message in self.messages(found):
            topic, vehicle = found[name]
            assert topic.decode is not None, f"{name}: the table of topics does not decode it"
            try:
                value = topic.decode(message)
            except (ValueError, AttributeError) as error:  # of another version, or damaged
                if topic.name in optional:
                    continue
                raise RecordingError(f"{self.path}: {name}: {error}") from error
            yield RecordedValue(topic, vehicle, log_ns, seconds(message.header.stamp), value)

    def text(self, topic: str) -> str | None:
        """The last text on a topic (`MISSION_FILE`, `SOFTWARE`); None if there is none."""
        found = None
        if topic in self.topics and self.topics[topic].kind == TEXT:
            for _, _, message in self.messages({topic}):
                found = str(message.data)
        return found

    def _broken(self, error: Exception) -> RecordingError:
        return RecordingError(
            f"{self.path}: cannot be read as a rosbag2 recording: {brief(error)}. If the recorder was killed "
            f"or a disk damaged it, repair it: auv_lse recover {shlex.quote(str(self.path))}"
        )


def _topic(name: str, connections: list[Any]) -> RecordedTopic:
    offered = [quality for c in connections for quality in c.ext.offered_qos_profiles]
    return RecordedTopic(
        name=name,
        kind=connections[0].msgtype,
        count=sum(c.msgcount for c in connections),
        reliable=all(quality.reliability.name != "BEST_EFFORT" for quality in offered),
        latched=any(quality.durability.name == "TRANSIENT_LOCAL" for quality in offered),
        depth=max([quality.depth for quality in offered if quality.depth > 0], default=_DEPTH),
    )
