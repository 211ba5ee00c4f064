"""Writes a run as a rosbag2 directory (MCAP, profile ros2) from raw CDR bytes, including its mission file.

Chunks are closed every few seconds, so that little is lost in a power failure. `close` adds the index and
`metadata.yaml`, so that `ros2 bag play` can play it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from auv_lse_record.message_types import definitions, types_of

#: Separator of the definitions of a type and of the types in it.
_RULE = 80 * "=" + "\n"


class RecorderError(ValueError):
    """A recording cannot be written: the folder exists, the disk is full, or a type is unknown."""


def unused_folder(folder: Path) -> Path:
    """`folder`, or the first of `folder`-2, -3, ... that does not exist."""
    number, unused = 1, folder
    while os.path.lexists(unused):
        number += 1
        unused = folder.with_name(f"{folder.name}-{number}")
    return unused


def message_types(folders: Sequence[Path]) -> Any:
    """The type store of ROS 2 Jazzy with the messages in `folders` (each ".../share/PACKAGE/msg") added.

    Raises:
        RecorderError: if rosbags is not installed.
    """
    try:
        return types_of(definitions(folders))
    except ImportError:
        raise RecorderError(
            "recording needs the Python package rosbags, which is not installed: pip install rosbags"
        ) from None


def message_texts(folders: Sequence[Path]) -> dict[str, str]:
    """The definitions that `message_types` adds, by type, with their comments (units and meanings).

    Definitions of ROS itself come from the store, because the installed ones may be of another version.
    """
    known = types_of({}).fielddefs
    return {name: text for name, text in definitions(folders).items() if name not in known}


class BagWriter:
    """One recording.

    Attributes:
        types: Type store with every type to record (`message_types`); may be replaced by a larger one.
        texts: Definitions with comments (`message_texts`); other definitions come from the store.
    """

    def __init__(self, folder: Path, types: Any, snapshot: Mapping[str, str], flush_s: float = 5.0) -> None:
        """Starts the recording.

        Args:
            snapshot: Texts for the recording's metadata: the mission file, the seed.
            flush_s: Longest time (s, by stamps) that messages wait in memory.

        Raises:
            RecorderError: if the folder exists or cannot be created.
        """
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer, WriterError

        self.types = types
        self.texts: Mapping[str, str] = {}
        self._flush_ns = flush_s * 1e9
        self._flushed_ns = 0
        self._connections: dict[str, Any] = {}
        self.count = 0
        try:
            self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
            self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)  # chunk by chunk
            for key, text in snapshot.items():
                self._writer.set_custom_data(key, text)
            self._writer.open()
            _add_checksums(self._writer.storage)
        except (WriterError, OSError) as error:
            raise RecorderError(f"record.folder = {str(folder)!r}: cannot start a recording there: {error}") from error

    def use_definitions(self, folders: Sequence[Path]) -> None:
        """Uses the message definitions of folders (each ".../share/PACKAGE/msg")."""
        self.types, self.texts = message_types(folders), message_texts(folders)

    def add_topic(self, topic: str, kind: str, latched: bool = False) -> None:
        """Adds a topic.

        Args:
            latched: Whether late readers receive the last message, also during playback.

        Raises:
            RecorderError: if the type is unknown.
        """
        from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
        from rosbags.rosbag2 import WriterError
        from rosbags.typesys import TypesysError

        forever = QosTime(9223372036, 854775807)
        qos = Qos(
            history=QosHistory.KEEP_LAST,
            depth=1 if latched else 1000,
            reliability=QosReliability.RELIABLE,
            durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
            deadline=forever,
            lifespan=forever,
            liveliness=QosLiveliness.AUTOMATIC,
            liveliness_lease_duration=forever,
            avoid_ros_namespace_conventions=False,
        )
        try:
            text, number = self._definition(kind), self.types.hash_rihs01(kind)
            connection = self._writer.add_connection(
                topic, kind, msgdef=text, rihs01=number, offered_qos_profiles=[qos]
            )
        except (KeyError, TypesysError, WriterError) as error:
            raise RecorderError(f"topic {topic} of type {kind}: cannot be recorded: {error!r}") from error
        self._connections[topic] = connection

    def _definition(self, kind: str) -> str:
        """The definition of a type and of all types in it, with comments where the text is known."""
        first, *others = self.types.generate_msgdef(kind, ros_version=2)[0].split(_RULE)
        parts = [self.texts.get(kind, first)]
        for other in others:
            name, _, made = other.removeprefix("MSG: ").partition("\n")
            package, _, leaf = name.partition("/")
            parts.append(f"MSG: {name}\n{self.texts.get(f'{package}/msg/{leaf}', made)}")
        return _RULE.join(part.rstrip("\n") + "\n" for part in parts)

    def write(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Writes one message's CDR bytes, stamped `stamp_ns`."""
        self._writer.write(self._connections[topic], stamp_ns, data)
        self.count += 1
        if stamp_ns - self._flushed_ns >= self._flush_ns:
            self._flushed_ns = stamp_ns
            storage: Any = self._writer.storage
            storage.close_chunk()
            storage.bio.flush()

    def close(self) -> None:
        """Closes the recording: writes the index and metadata.yaml."""
        self._writer.close()


def _add_checksums(storage: Any) -> None:
    """Gives every chunk a checksum, so that `recover` recognizes damaged ones; rosbags writes none."""
    zstd: Any = import_module("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")
    storage.compressor = partial(zstd.compress, options={zstd.CompressionParameter.checksum_flag: 1})
