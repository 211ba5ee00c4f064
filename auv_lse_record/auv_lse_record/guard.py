"""A recording that ends when the disk is nearly full, or fails: the mission goes on without it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

_MB = 1e6


def free_mb(folder: Path) -> float:
    """Space that is left where a folder is (MB)."""
    return shutil.disk_usage(folder).free / _MB


class GuardedWriter:
    """Passes messages on to a recording until there is no room for more.

    Attributes:
        problem: Why nothing is recorded any more; "" while it is.
        dropped: Messages that came since.
    """

    def __init__(
        self, writer: Any, folder: Path, least_free_mb: float, free: Callable[[Path], float] = free_mb
    ) -> None:
        """Guards a recording.

        Args:
            writer: A recording, as `make_writer` gives it.
            folder: Where it is.
            least_free_mb: Space (MB) that is left to others.
            free: Gives the space that is left (MB).
        """
        self.problem = ""
        self.dropped = 0
        self._writer, self._folder, self._least_free_mb, self._free = writer, folder, least_free_mb, free

    def look(self) -> None:
        """Looks whether there is still room; ends the recording, whole, if there is not."""
        if self.problem:
            return
        try:
            left_mb = self._free(self._folder)
        except OSError as error:
            self._end(f"{self._folder}: {error}")
            return
        if left_mb < self._least_free_mb:
            self._end(
                f"{self._folder}: {left_mb:.0f} MB are left; expected at least record.least_free_mb = "
                f"{self._least_free_mb:g} MB"
            )

    def add_topic(self, topic: str, kind: str, latched: bool = False) -> None:
        """Announces a topic; as `BagWriter.add_topic`."""
        if not self.problem:
            try:
                self._writer.add_topic(topic, kind, latched)
            except OSError as error:
                self._end(f"{self._folder}: {error}")

    def learn(self, folders: list[Path]) -> None:
        """As `BagWriter.learn`."""
        self._writer.learn(folders)

    def write(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Writes one message, as long as there is room."""
        if self.problem:
            self.dropped += 1
            return
        try:
            self._writer.write(topic, stamp_ns, data)
        except (OSError, RuntimeError) as error:  # rosbag2's own writer raises the latter
            self._end(f"{self._folder}: {error}")

    def close(self) -> None:
        """Ends the recording."""
        if not self.problem:
            self._writer.close()

    def _end(self, problem: str) -> None:
        self.problem = f"the recording has ended, the mission goes on: {problem}"
        with suppress(OSError, ValueError, RuntimeError):  # a disk that is full may not even take the index
            self._writer.close()
