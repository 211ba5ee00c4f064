"""The copy of a state file in memory, which survives the process but no reboot of the computer."""

import contextlib
import hashlib
import os
from pathlib import Path

from auv_lse_common.node.state_slots import FILE_BYTES, SLOT_BYTES, head, slot

#: The folder of the copies; without it none is made.
MEMORY = Path("/dev/shm")


class MemoryCopy:
    """The copy of a state file in memory, newer than the file itself if the disk fails or is slow.

    Attributes:
        text: The last state; None without a copy, b"" if the state file is out of date.
    """

    def __init__(self, path: Path) -> None:
        """Reads the copy of the state file `path`."""
        self._path, self._sequence = _copy_path(path), 0
        self.text: bytes | None = None
        try:
            file = os.open(self._path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
        except OSError:
            return
        try:
            if os.fstat(file).st_uid == os.getuid():
                data = os.pread(file, FILE_BYTES, 0).ljust(FILE_BYTES, b"\0")
                slots = (slot(data[:SLOT_BYTES]), slot(data[SLOT_BYTES:]))
                # The state in a torn slot was never published, and memory tears no other one.
                self._sequence, self.text = max((one for one in slots if one), default=(0, b""))
        finally:
            os.close(file)

    def write(self, text: bytes) -> bool:
        """Replaces the state; returns whether it is in memory. If not, the copy is removed: the file alone counts."""
        number = self._sequence + 1
        data = head(number, text) + text
        try:
            if len(data) > SLOT_BYTES or not MEMORY.is_dir():
                raise OSError
            file = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
            try:
                if os.fstat(file).st_uid != os.getuid() or os.pwrite(file, data, number % 2 * SLOT_BYTES) != len(data):
                    raise OSError
            finally:
                os.close(file)
        except OSError:
            self.text = None
            with contextlib.suppress(OSError):
                self._path.unlink()
            return False
        self._sequence, self.text = number, text
        return True

    def distrust(self) -> None:
        """Marks the state file as out of date, which needs no space."""
        with contextlib.suppress(OSError):
            os.close(os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600))
            self.text = b""


def forget_copy(path: Path) -> None:
    """Removes the copy in memory of a state file."""
    with contextlib.suppress(OSError, RuntimeError):
        _copy_path(path).unlink()


def _copy_path(path: Path) -> Path:
    key = hashlib.sha256(os.path.realpath(path).encode()).hexdigest()[:16]
    return MEMORY / f"auv_lse_{os.getuid()}_{key}.state"
