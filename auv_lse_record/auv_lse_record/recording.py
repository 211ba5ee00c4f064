"""Reads a recording (rosbag2: MCAP or sqlite3), without ROS.

Reading goes by the message definitions kept in the recording, so a recording made elsewhere, or by an older version of
the messages, is read as long as the fields that the caller uses are there. A recording without definitions (an old
sqlite3 one) is read with those of ROS 2 Jazzy and of this project.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

#: Latched texts that the recorder writes into every recording: the mission file as flown, the software's version.
MISSION_FILE, SOFTWARE = "/recorder/mission_file", "/recorder/software"
TEXT = "std_msgs/msg/String"

#: Files of messages, by their ending.
STORAGES = (".mcap", ".db3")
#: Messages that a writer of unknown depth keeps, as `ros2 bag play` has it.
_DEPTH = 10


class RecordingError(ValueError):
    """A recording that cannot be read: missing, broken, or without what a mission records."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedTopic:
    """One topic of a recording.

    Attributes:
        name: Full name.
        kind: Message type, "std_msgs/msg/String".
        count: Number of its messages.
        reliable: Whether all its writers were reliable.
        latched: Whether its writers kept the last messages for late readers (transient local).
        depth: How many messages its writers kept.
    """

    name: str
    kind: str
    count: int
    reliable: bool
    latched: bool
    depth: int


def recording_in(path: Path) -> Path:
    """The recording that a user names: a run folder, a rosbag2 directory, or one of its files.

    Returns:
        The rosbag2 directory, or the file of messages where there is no `metadata.yaml` beside it.

    Raises:
        RecordingError: if there is none.
    """
    try:
        there = path.exists()
    except OSError as error:  # a name that is too long
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not there:
        raise RecordingError(
            f"{path}: does not exist; expected a run folder, a rosbag2 directory, or its .mcap or .db3"
        )
    if path.is_file():
        if path.suffix not in STORAGES:
            raise RecordingError(f"{path}: expected a run folder, a rosbag2 directory, or its {' or '.join(STORAGES)}")
        return path
    for folder in (path, path / "bag"):
        if (folder / "metadata.yaml").is_file():
            return folder
        files = sorted(file for ending in STORAGES for file in folder.glob(f"*{ending}"))
        if len(files) == 1:
            return files[0]
    raise RecordingError(
        f"{path}: has no metadata.yaml, nor has its folder bag; expected a run folder or a rosbag2 directory "
        f"(was the recorder killed?)"
    )


def message_folder() -> Path:
    """The folder with this project's `.msg` files: in the source tree, else in an installed ROS workspace.

    Raises:
        RecordingError: if they are in neither.
    """
    places = [
        Path(__file__).resolve().parents[2] / "auv_lse_msgs",
        *(Path(p) / "share" / "auv_lse_msgs" for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p),
    ]
    for place in places:
        if (place / "msg" / "Plan.msg").is_file():
            return place / "msg"
    raise RecordingError(
        f"Plan.msg: not found in {', '.join(map(str, places))}; expected the package auv_lse_msgs there"
    )


class Recording:
    """A recording, open for reading; a context manager.

    Attributes:
        path: The rosbag2 directory, or its file of messages.
        topics: Its topics, by name.
        start_ns: Stamp of its first message (ns).
        end_ns: Stamp of its last message (ns).
    """

    def __init__(self, path: Path) -> None:
        """Args: path: as `recording_in` gives it."""
        self.path = path
        self.topics: dict[str, RecordedTopic] = {}
        self.start_ns = self.end_ns = 0

    def __enter__(self) -> Recording:
        """Opens it.

        Raises:
            RecordingError: if it cannot be read, or rosbags is not installed.
        """
        try:
            from rosbags.highlevel import AnyReader
        except ImportError:
            raise RecordingError(
                f"{self.path}: reading recordings needs the package rosbags: pip install rosbags"
            ) from None
        try:
            self._reader = AnyReader([self.path], default_typestore=_known_types())
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
        """The messages of some topics as they were serialized (CDR), in the order of their stamps.

        Args:
            topics: Their names.
            start_ns: Stamp from which on (ns).
            stop_ns: Stamp before which (ns).

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

    def messages(self, topics: re.Pattern[str]) -> Iterator[tuple[str, int, Any]]:
        """The messages of some topics, read, in the order of their stamps.

        Args:
            topics: The topics; full names are matched as a whole.

        Yields:
            Topic, stamp (ns), message.

        Raises:
            RecordingError: where the recording is damaged.
        """
        for topic, stamp_ns, data in self.raw([name for name in self.topics if topics.fullmatch(name)]):
            try:
                message = self._reader.deserialize(data, self.topics[topic].kind)
            except Exception as error:  # as above
                raise self._broken(error) from error
            yield topic, stamp_ns, message

    def text(self, topic: str) -> str | None:
        """The last text on a topic (`MISSION_FILE`, `SOFTWARE`); None if there is none."""
        found = None
        if topic in self.topics and self.topics[topic].kind == TEXT:
            for _, _, message in self.messages(re.compile(re.escape(topic))):
                found = str(message.data)
        return found

    def _broken(self, error: Exception) -> RecordingError:
        return RecordingError(
            f"{self.path}: cannot be read as a rosbag2 recording: {error}; fix, if the recorder was killed: "
            f"scripts/recover {self.path}"
        )


def read_messages(bag: Path, topics: re.Pattern[str]) -> Iterator[tuple[str, Any]]:
    """The messages of some topics, in the order of the recording.

    Args:
        bag: A run folder, a rosbag2 directory, or its file of messages.
        topics: The topics; full names are matched as a whole.

    Yields:
        Topic and message.

    Raises:
        RecordingError: if there is no recording, it cannot be read, or rosbags is not installed.
    """
    with Recording(recording_in(bag)) as recording:
        for topic, _, message in recording.messages(topics):
            yield topic, message


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


def _known_types() -> Any:
    """The types of ROS 2 Jazzy, with this project's where they are found."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    try:
        files: Mapping[str, Path] = {file.stem: file for file in sorted(message_folder().glob("*.msg"))}
    except RecordingError:
        files = {}
    for name, file in files.items():
        types.update(get_types_from_msg(file.read_text(), f"auv_lse_msgs/msg/{name}"))
    store.register(types)
    return store
