"""Writes a recording with rosbag2_py if it is installed, else with `bag_writer.BagWriter`."""

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from auv_lse_record.bag_writer import RecorderError

#: Settings of rosbag2's MCAP storage: small chunks, so that little is lost in a power failure.
_STORAGE = 'chunkSize: 65536\ncompression: "Zstd"\n'

_QOS = """\
- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: automatic
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false
"""
_METADATA_VERSION = 9


class Rosbag2Writer:
    """One recording, written by rosbag2_py."""

    def __init__(self, folder: Path, snapshot: Mapping[str, str]) -> None:
        """Starts the recording.

        Raises:
            RecorderError: if the folder exists or cannot be created.
        """
        import rosbag2_py

        self._rosbag2 = rosbag2_py
        self.count = 0
        if folder.exists():
            raise RecorderError(f"record.folder: {str(folder)!r} exists. Name a new folder.")
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as settings:
            settings.write(_STORAGE)
            settings.flush()
            options = rosbag2_py.StorageOptions(
                uri=str(folder), storage_id="mcap", storage_config_uri=settings.name, custom_data=dict(snapshot)
            )
            self._writer = rosbag2_py.SequentialWriter()
            try:
                folder.parent.mkdir(parents=True, exist_ok=True)
                self._writer.open(options, rosbag2_py.ConverterOptions("cdr", "cdr"))
            except (RuntimeError, OSError) as error:
                problem = f"record.folder = {str(folder)!r}: cannot start a recording there: {error}"
                raise RecorderError(problem) from error
        self._topics: set[str] = set()

    def use_definitions(self, folders: Sequence[Path]) -> None:
        """Does nothing: rosbag2 finds message definitions itself."""

    def add_topic(self, topic: str, kind: str, latched: bool = False) -> None:
        """Adds a topic; arguments are those of `BagWriter.add_topic`.

        Raises:
            RecorderError: if the type is unknown.
        """
        qos = _QOS.format(depth=1 if latched else 1000, durability="transient_local" if latched else "volatile")
        metadata = self._rosbag2.TopicMetadata(
            id=len(self._topics),
            name=topic,
            type=kind,
            serialization_format="cdr",
            offered_qos_profiles=self._rosbag2.to_rclcpp_qos_vector(qos, _METADATA_VERSION),
        )
        try:
            self._writer.create_topic(metadata)
        except RuntimeError as error:
            raise RecorderError(f"topic {topic}: type {kind} cannot be recorded: {error}") from error
        self._topics.add(topic)

    def write(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Writes one message's CDR bytes, stamped `stamp_ns`."""
        self._writer.write(topic, bytes(data), stamp_ns)
        self.count += 1

    def close(self) -> None:
        """Closes the recording: writes the index and metadata.yaml."""
        self._writer.close()


def make_writer(folder: Path, message_folders: Sequence[Path], snapshot: Mapping[str, str], flush_s: float) -> Any:
    """Starts a recording with rosbag2_py if it is installed, else with `BagWriter`; arguments as there.

    Args:
        message_folders: Folders with message definitions (each ".../share/PACKAGE/msg").
        flush_s: See `BagWriter`.

    Raises:
        RecorderError: if the recording cannot be made, or neither rosbag2_py nor rosbags is installed.
    """
    try:
        return Rosbag2Writer(folder, snapshot)
    except ImportError:
        pass  # ROS 2 from PyPI has no rosbag2_py
    from auv_lse_record.bag_writer import BagWriter, message_types

    writer = BagWriter(folder, message_types(message_folders), snapshot, flush_s)
    writer.use_definitions(message_folders)
    return writer
