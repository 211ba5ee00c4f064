"""Ends a recording when the disk is nearly full or fails, so that the mission continues without it."""

import shlex
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from auv_lse_record.bag_writer import BagWriter

_MB = 1e6


def free_mb(folder: Path) -> float:
    """Free space on a folder's disk (MB)."""
    return shutil.disk_usage(folder).free / _MB


class GuardedWriter:
    """Writes messages to a recording until the disk is nearly full.

    Attributes:
        problem: Why the recording has ended; "" while it runs.
        dropped: Number of messages since its end.
    """

    def __init__(
        self, writer: BagWriter, folder: Path, least_free_mb: float, free: Callable[[Path], float] = free_mb
    ) -> None:
        """Guards a recording.

        Args:
            least_free_mb: Free space (MB) at which the recording ends.
        """
        self.problem = ""
        self.dropped = 0
        self._writer, self._folder, self._least_free_mb, self._free = writer, folder, least_free_mb, free

    def check_space(self) -> None:
        """Ends and closes the recording if the disk is nearly full."""
        if self.problem:
            return
        try:
            left_mb = self._free(self._folder)
        except OSError as error:
            self._end(f"{self._folder}: {error}")
            return
        if left_mb < self._least_free_mb:
            self._end(
                f"{self._folder}: {left_mb:.0f} MB of free space are left, less than record.least_free_mb "
                f"({self._least_free_mb:g} MB)"
            )

    def add_topic(self, topic: str, kind: str, latched: bool = False) -> None:
        """Like `BagWriter.add_topic`."""
        if not self.problem:
            try:
                self._writer.add_topic(topic, kind, latched)
            except OSError as error:
                self._end(f"{self._folder}: {error}")

    def use_definitions(self, folders: list[Path]) -> None:
        """Like `BagWriter.use_definitions`."""
        self._writer.use_definitions(folders)

    def write(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Writes one message unless the recording has ended."""
        if self.problem:
            self.dropped += 1
            return
        try:
            self._writer.write(topic, stamp_ns, data)
        except OSError as error:
            self._end(f"{self._folder}: {error}")

    def close(self) -> None:
        """Ends the recording; sets `problem` if it cannot be completed."""
        if self.problem:
            return
        try:
            self._writer.close()
        except OSError as error:
            self.problem = (
                f"the recording could not be completed: {self._folder}: {error}. Free space, then: auv_lse recover "
                f"{shlex.quote(str(self._folder))}"
            )

    def _end(self, problem: str) -> None:
        self.problem = f"the recording has ended; the mission continues: {problem}"
        with suppress(OSError, ValueError):  # a full disk may not even hold the index
            self._writer.close()
