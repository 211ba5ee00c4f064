"""The format of a state file: two slots of fixed size in a file that is allocated in full before the mission.

A write replaces the older slot and waits for the disk. A slot carries a sequence number and a checksum:

    magic (8 bytes) | sequence (8) | length (4) | CRC-32 of sequence, length and text (4) | text: JSON

A file is whole if its size is right, its newest slot is whole, and the other one is the whole slot before it; the other
slot of a file's first record is blank. A file with two blank slots is damaged: every file begins with a record.
"""

import contextlib
import os
import struct
import zlib
from pathlib import Path

#: Size of a slot, and of a file: two slots.
SLOT_BYTES = 16384
FILE_BYTES = 2 * SLOT_BYTES
_MAGIC, _INVALID = b"AUVLSE1\n", b"INVALID\n"
_HEAD = struct.Struct("<8sQLL")
#: Largest text (bytes) of a slot.
MAX_TEXT = SLOT_BYTES - _HEAD.size


class SlotFile:
    """A state file that is open for writing.

    Attributes:
        sequence: Number of the newest slot.
    """

    def __init__(self, path: Path) -> None:
        """Opens a file; `read` or `repair` comes next.

        Raises:
            OSError: if it is missing, no ordinary file, or cannot be written.
        """
        self.path, self.sequence, self.text = path, 0, b""
        self.file = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NONBLOCK)

    def read(self) -> None:
        """Reads the newest slot.

        Raises:
            OSError: if it cannot be read.
            ValueError: if the file is damaged.
        """
        self.sequence, self.text = newest(os.pread(self.file, FILE_BYTES + 1, 0))

    def put(self, text: bytes) -> None:
        """Writes the next slot, and waits for the disk; raises OSError."""
        check_length(text)
        number = self.sequence + 1
        write(self.file, head(number, text) + text, number % 2 * SLOT_BYTES)
        self.sequence, self.text = number, text

    def verify(self) -> None:
        """Writes the newest slot again and reads it back from the disk; raises OSError if the disk has another one."""
        self.put(self.text)
        if hasattr(os, "posix_fadvise"):  # not on macOS
            os.posix_fadvise(self.file, 0, 0, os.POSIX_FADV_DONTNEED)
        try:
            is_same = newest(os.pread(self.file, FILE_BYTES + 1, 0)) == (self.sequence, self.text)
        except ValueError:
            is_same = False
        if not is_same:
            raise OSError("it reads other bytes than were written")

    def repair(self, text: bytes) -> None:
        """Makes a damaged file whole again, with `text`; it stays damaged if the process dies meanwhile.

        Raises:
            OSError: if that fails.
        """
        write(self.file, _INVALID, 0)
        write(self.file, bytes(SLOT_BYTES), SLOT_BYTES)
        os.ftruncate(self.file, FILE_BYTES)
        self.sequence = 0
        self.put(text)  # slot 1
        write(self.file, bytes(SLOT_BYTES), 0)
        os.fsync(self.file)

    def close(self) -> None:
        """Closes the file."""
        if self.file >= 0:
            with contextlib.suppress(OSError):
                os.close(self.file)
            self.file = -1

    def __del__(self) -> None:
        """Closes the file."""
        if hasattr(self, "file"):
            self.close()


def create(path: Path, text: bytes) -> None:
    """Creates a state file with its first record, and its folder.

    Args:
        path: The file; an existing one is replaced.

    Raises:
        OSError: if there is no room for it, or no permission.
    """
    check_length(text)
    content = (bytes(SLOT_BYTES) + head(1, text) + text).ljust(FILE_BYTES, b"\0")
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(path.name + ".new")
    try:
        file = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        try:
            write(file, content, 0)
            os.fsync(file)
        finally:
            os.close(file)
        beside.rename(path)
    except OSError:
        with contextlib.suppress(OSError):
            beside.unlink()
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def invalidate(path: Path) -> None:
    """Marks a state file in place, so that no later process trusts it.

    Raises:
        OSError: if that fails.
    """
    file = os.open(path, os.O_WRONLY)
    try:
        for slot in (0, SLOT_BYTES):
            write(file, _INVALID, slot)
    finally:
        os.close(file)


def read_bytes(path: Path) -> bytes:
    """The first bytes of a file, one more than a state file has.

    Raises:
        OSError: if it is missing or cannot be read.
    """
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)  # a pipe must not stop the reader
    try:
        return os.pread(file, FILE_BYTES + 1, 0)
    finally:
        os.close(file)


def newest(data: bytes) -> tuple[int, bytes]:
    """Sequence and text of the newest slot.

    Raises:
        ValueError: naming the file's fault.
    """
    if len(data) != FILE_BYTES:
        raise ValueError(f"has {len(data)} bytes instead of {FILE_BYTES}")
    if not any(data):
        raise ValueError("is blank")
    slots = [slot(data[:SLOT_BYTES]), slot(data[SLOT_BYTES:])]
    whole = sorted((one for one in slots if one), key=lambda one: one[0])
    numbers = [number for number, _ in whole]
    if None in slots or (len(whole) == 1 and numbers != [1]) or (len(whole) == 2 and numbers[0] + 1 != numbers[1]):
        raise ValueError("is damaged, or could not be written")
    return whole[-1]


def slot(data: bytes) -> tuple[int, bytes] | tuple[()] | None:
    """Sequence and text of a slot (`SLOT_BYTES` bytes); empty if it is blank, None if it is neither blank nor whole."""
    if not any(data):
        return ()
    magic, number, length, _ = _HEAD.unpack_from(data)
    text = data[_HEAD.size : _HEAD.size + length]
    if magic != _MAGIC or data[: _HEAD.size] != head(number, text):
        return None
    return number, text


def head(number: int, text: bytes) -> bytes:
    """The bytes before the text of slot `number`."""
    return _HEAD.pack(_MAGIC, number, len(text), zlib.crc32(struct.pack("<QL", number, len(text)) + text))


def check_length(text: bytes) -> None:
    """Raises OSError if `text` does not fit into a slot."""
    if len(text) > MAX_TEXT:
        raise OSError(f"the state has {len(text)} bytes; a slot holds {MAX_TEXT}")


def write(file: int, data: bytes, offset: int) -> None:
    """Writes `data` at `offset` and waits for the disk; raises OSError also if only a part was written."""
    written = os.pwrite(file, data, offset)
    if written != len(data):
        raise OSError(f"{written} of {len(data)} bytes written")
    getattr(os, "fdatasync", os.fsync)(file)  # macOS has no fdatasync
