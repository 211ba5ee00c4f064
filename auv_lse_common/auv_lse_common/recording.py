"""Reads the messages of a recording (rosbag2 directory), without ROS.

Reading goes by the message definitions kept in the recording, so a recording made elsewhere, or by an older version of
the messages, is read as long as the fields that the caller uses are there.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any


class RecordingError(ValueError):
    """A recording that cannot be read: missing, broken, or without what a mission records."""


def read_messages(bag: Path, topics: re.Pattern[str]) -> Iterator[tuple[str, Any]]:
    """The messages of some topics, in the order of the recording.

    Args:
        bag: The directory with `metadata.yaml`.
        topics: The topics; full names are matched as a whole.

    Yields:
        Topic and message.

    Raises:
        RecordingError: if there is no recording, it cannot be read, or rosbags is not installed.
    """
    if not (bag / "metadata.yaml").is_file():
        raise RecordingError(f"{bag}: has no metadata.yaml; expected a rosbag2 directory (was the recorder killed?)")
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise RecordingError(f"{bag}: reading recordings needs the package rosbags: pip install rosbags") from None
    try:
        with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            connections = [c for c in reader.connections if topics.fullmatch(c.topic)]
            for connection, _, data in reader.messages(connections=connections) if connections else ():
                message = reader.deserialize(data, connection.msgtype)
                yield connection.topic, message
    except Exception as error:  # rosbags raises errors of many kinds for a damaged recording
        raise RecordingError(f"{bag}: cannot be read as a rosbag2 recording: {error}") from error
