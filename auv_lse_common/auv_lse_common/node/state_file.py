"""A node's state file: the few values that must survive a restart, written in place so that it works on a full disk.

Theory of operation
-------------------
The file is allocated in full before the mission: two slots of `SLOT_BYTES`, filled with zeros. A write replaces the
older slot and waits for the disk. A slot carries a sequence number and a checksum:

    magic (8 bytes) | sequence (8) | length (4) | CRC-32 of sequence, length and text (4) | text: JSON

A node writes its state before it publishes the result, so the state in a torn slot was never published. The file is
still not trusted, because a disk that tears one write may have damaged another. A file is trusted if its size is right
and each slot is blank or whole. Two blank slots mean a first start.

A file that cannot be written is invalidated in place, or removed if that fails. `lost` gives the reason why the state
of an earlier process is not trusted. The node then holds instead of restarting the mission.

On a vehicle, each state is first copied to memory (`/dev/shm`), which survives the process but no reboot. A restarted
node continues from this copy, also if the disk fails or is slow. An empty copy marks the file as out of date. Without a
copy, as after a reboot, a file is trusted only if a slot can be rewritten: a failing card may still open and read it.

The clock may be wrong after a reboot, so this module compares no times. `START_VARIABLE` reveals a reboot: its value
changes with each start of the vehicle's programs, but not when a single node restarts.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import struct
import weakref
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from auv_lse_common.node.latest_writer import LatestWriter

#: The environment variable that names this start of a vehicle's programs.
START_VARIABLE = "AUV_LSE_START"
#: The nodes of a vehicle that keep a state file.
NODES = ("safety_node", "planner_node", "modem_node")
#: Size of a slot, and of a file: two slots.
SLOT_BYTES = 16384
FILE_BYTES = 2 * SLOT_BYTES
#: The folder of the copies in memory; without it none is made.
MEMORY = Path("/dev/shm")
_MAGIC, _INVALID = b"AUVLSE1\n", b"INVALID\n"
_HEAD = struct.Struct("<8sQLL")


class StateFile:
    """State of a node that survives a restart of its process or its computer.

    Attributes:
        values: Values that an earlier process wrote last; empty at a first start or if they are not trusted.
        lost: Reason why the state of an earlier process is not trusted; "" if it is trusted or missing. It stays set.
        problem: Reason why the state cannot be written; "" if it can.
        rebooted: Whether all of the vehicle's programs were restarted since `values` were written.
        written_s: Modification time of the file (s since 1970); 0 if it was missing.
    """

    def __init__(
        self, path: Path | None, identity: Mapping[str, Any], *, start: str = "", expected: bool = False
    ) -> None:
        """Reads or allocates the file. An unusable file sets `problem` and raises no error.

        Args:
            path: The file; a missing folder is created. None: no state is stored.
            identity: JSON values that identify the mission. State with a different identity is not trusted.
            start: Value of `START_VARIABLE`; "": no copy is made in memory.
            expected: Whether an earlier process left other files, so that a missing file is not a first start.
        """
        self.values: dict[str, Any] = {}
        self.lost = self.problem = ""
        self.rebooted = False
        self.written_s = 0.0
        self._path, self._file, self._sequence, self._text = path, -1, 0, b""
        self._start = start
        self._identity = hashlib.sha256(json.dumps(identity, sort_keys=True, default=str).encode()).hexdigest()[:16]
        save = weakref.WeakMethod(self._save)  # a strong reference would keep the file open after its last use
        self._writer = LatestWriter(lambda text: None if (write := save()) is None else write(text))
        if path is None:
            return
        self._memory = _MemoryCopy(path) if start else None
        try:
            if expected and not path.exists():
                self._set_lost("is missing")
                path.parent.mkdir(parents=True, exist_ok=True)
                path.touch()
            elif not path.exists():
                allocate(path)
            self._file = os.open(path, os.O_RDWR | os.O_CLOEXEC)
            self.written_s = os.fstat(self._file).st_mtime
            self._read(os.pread(self._file, FILE_BYTES + 1, 0))
            if self._memory is not None:
                self._verify(self._memory.text)
        except OSError as error:
            self._set_lost(f"cannot be used: {error.strerror or error}")
            self._recall()
            self._give_up(error)
            return
        self._recall()
        if self.lost and not self.values:
            self._repair()

    @property
    def status(self) -> str:
        """The problem, for diagnostics; "" without one."""
        slow = f"state file {self._path}: the disk is slow; a reboot now would lose the last state"
        return "; ".join(filter(None, (self.lost, self.problem, slow * self._writer.is_late)))

    @property
    def kept(self) -> bool:
        """Whether the state is being written."""
        return self._file >= 0

    def write(self, values: Mapping[str, Any], wait_s: float = math.inf) -> bool:
        """Replaces the state and waits until it is on the disk. An unchanged state is not written again.

        After a failure the next changed state is written into a new file.

        Args:
            values: The state.
            wait_s: How long (s) to wait for the disk if the copy in memory is written; a thread goes on after it.

        Returns:
            Whether the state is on the disk, or none is stored. If False, `problem` may give the reason.
        """
        if self._path is None:
            return True
        document = {"identity": self._identity, "start": self._start, "lost": self.lost, "values": dict(values)}
        text = json.dumps(document, separators=(",", ":")).encode()
        if text == self._text:
            return self._file >= 0 and not self._writer.is_busy
        self._text = text
        is_copied = self._memory is not None and self._memory.write(text)
        if not self._writer.put(text, wait_s if is_copied else math.inf):
            return False
        return self._file >= 0

    def __del__(self) -> None:
        """Closes the file."""
        if hasattr(self, "_file"):
            self.close()

    def close(self) -> None:
        """Closes the file."""
        if self._file >= 0:
            with contextlib.suppress(OSError):
                os.close(self._file)
            self._file = -1

    def _read(self, data: bytes) -> None:
        if self.lost:
            return
        try:
            self._sequence, self._text = _newest(data)
        except ValueError as error:
            self._set_lost(str(error))
            return
        if self._text:
            self._restore(self._text)

    def _restore(self, text: bytes) -> None:
        document = json.loads(text)
        if document["identity"] != self._identity:
            self._set_lost("belongs to a mission with other parameters")
            return
        self.values, self.lost = document["values"], document["lost"]
        self.rebooted = bool(self._start) and document["start"] != self._start

    def _verify(self, copy: bytes | None) -> None:
        """Rewrites the state of an earlier start, and reads it back from the disk; raises OSError."""
        if self.lost or not self._text or copy is not None:
            return
        self._put(self._text)
        if hasattr(os, "posix_fadvise"):  # not on macOS
            os.posix_fadvise(self._file, 0, 0, os.POSIX_FADV_DONTNEED)
        if _newest(os.pread(self._file, FILE_BYTES + 1, 0)) != (self._sequence, self._text):
            raise OSError("it reads other bytes than were written")

    def _recall(self) -> None:
        """Continues from the copy in memory: it is newer than the file, or as new."""
        text = None if self._memory is None else self._memory.text
        if text == b"":
            self._set_lost("an earlier process could not write it")
        elif text is not None and (not self.lost or json.loads(text)["start"] == self._start):
            self._text = b""  # the disk may have an older state
            if self.lost:
                self.close()  # the next write makes a new file
            self._restore(text)

    def _save(self, text: bytes) -> None:
        """Writes a state to the disk, or sets `problem`."""
        try:
            if self._file < 0:
                self._replace(text)
            else:
                self._put(text)
        except OSError as error:
            self._give_up(error)

    def _put(self, text: bytes) -> None:
        """Writes a slot; raises OSError."""
        if len(text) > SLOT_BYTES - _HEAD.size:
            raise OSError(f"state of {len(text)} bytes; expected at most {SLOT_BYTES - _HEAD.size}")
        number = self._sequence + 1
        _write(self._file, _head(number, text) + text, number % 2 * SLOT_BYTES)
        self._sequence = number

    def _replace(self, text: bytes) -> None:
        """Makes a new file with this state after writing the last file failed; raises OSError."""
        assert self._path is not None
        if len(text) > SLOT_BYTES - _HEAD.size:
            raise OSError(f"state of {len(text)} bytes; expected at most {SLOT_BYTES - _HEAD.size}")
        allocate(self._path, bytes(SLOT_BYTES) + _head(1, text) + text)
        self._file = os.open(self._path, os.O_RDWR | os.O_CLOEXEC)
        self._sequence, self.problem = 1, ""

    def _repair(self) -> None:
        """Repairs an untrusted file and stores the reason in it; it stays untrusted if the process dies meanwhile."""
        document = {"identity": self._identity, "start": self._start, "lost": self.lost, "values": {}}
        try:
            _write(self._file, _INVALID, 0)
            _write(self._file, bytes(SLOT_BYTES), SLOT_BYTES)
            os.ftruncate(self._file, FILE_BYTES)
            self._sequence = 0
            self._text = json.dumps(document).encode()
            self._put(self._text)  # slot 1
            _write(self._file, bytes(SLOT_BYTES), 0)
            os.fsync(self._file)
        except OSError as error:
            self._give_up(error)

    def _set_lost(self, why: str) -> None:
        self.lost = f"state file {self._path}: {why}; the state of an earlier process is not trusted"
        self.values = {}

    def _give_up(self, error: OSError) -> None:
        assert self._path is not None
        is_copied = self._memory is not None and bool(self._memory.text)
        self.problem = (
            f"state file {self._path}: cannot be written: {error.strerror or error}; "
            f"{'after a reboot the vehicle' if is_copied else 'a restarted node'} would hold"
        )
        if self._memory is not None and not is_copied:
            self._memory.distrust()
        try:
            invalidate(self._path)
        except OSError:
            try:
                self._path.unlink(missing_ok=True)
            except OSError as last:
                self.problem += f"; it could not be invalidated either: {last.strerror or last}"
        self.close()


def allocate(path: Path, content: bytes = b"") -> None:
    """Creates a state file of full size on the disk, and its folder.

    Args:
        path: The file; an existing one is replaced.
        content: Its first bytes; zeros follow.

    Raises:
        OSError: if there is no room for it, or no permission.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(path.name + ".new")
    try:
        _create(beside, content.ljust(FILE_BYTES, b"\0"))
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


def forget_copy(path: Path) -> None:
    """Removes the copy in memory of a state file."""
    with contextlib.suppress(OSError):
        _copy_path(path).unlink()


def invalidate(path: Path) -> None:
    """Marks a state file in place, so that no later process trusts it.

    Raises:
        OSError: if that fails.
    """
    file = os.open(path, os.O_WRONLY)
    try:
        for slot in (0, SLOT_BYTES):
            _write(file, _INVALID, slot)
    finally:
        os.close(file)


def read_state(path: Path) -> dict[str, Any] | None:
    """Reads the values in a state file without changing it.

    Returns:
        The values; empty if nothing was written yet; None if the file is not trusted, or cannot be read.

    Raises:
        FileNotFoundError: if there is no such file.
    """
    try:
        _, text = _newest(path.read_bytes())
    except FileNotFoundError:
        raise
    except (OSError, ValueError):
        return None
    copy = _MemoryCopy(path).text
    if copy == b"":
        return None
    text = copy or text
    if not text:
        return {}
    document = json.loads(text)
    values: dict[str, Any] = document["values"]
    return values if values or not document["lost"] else None


class _MemoryCopy:
    """The copy of a state file in memory, which tells a restarted process more than a disk that fails or is slow.

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
                slots = (_slot(data[:SLOT_BYTES]), _slot(data[SLOT_BYTES:]))
                # The state in a torn slot was never published, and memory tears no other one.
                self._sequence, self.text = max((slot for slot in slots if slot), default=(0, b""))
        finally:
            os.close(file)

    def write(self, text: bytes) -> bool:
        """Replaces the state; returns whether it is in memory. If not, the copy is removed: the file alone counts."""
        number = self._sequence + 1
        data = _head(number, text) + text
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


def _copy_path(path: Path) -> Path:
    key = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:16]
    return MEMORY / f"auv_lse_{os.getuid()}_{key}.state"


def _newest(data: bytes) -> tuple[int, bytes]:
    """Sequence and text of the newest slot; 0 and b"" if both are blank. Raises ValueError if a file is not trusted."""
    if len(data) != FILE_BYTES:
        raise ValueError(f"has {len(data)} bytes; expected {FILE_BYTES}")
    slots = [_slot(data[:SLOT_BYTES]), _slot(data[SLOT_BYTES:])]
    whole = sorted((slot for slot in slots if slot), key=lambda slot: slot[0])
    numbers = [number for number, _ in whole]
    if None in slots or (len(whole) == 1 and numbers != [1]) or (len(whole) == 2 and numbers[0] + 1 != numbers[1]):
        raise ValueError("is damaged, or could not be written")
    return whole[-1] if whole else (0, b"")


def _create(path: Path, content: bytes) -> None:
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    try:
        _write(file, content, 0)
        os.fsync(file)
    finally:
        os.close(file)


def _write(file: int, data: bytes, offset: int) -> None:
    written = os.pwrite(file, data, offset)
    if written != len(data):
        raise OSError(f"{written} of {len(data)} bytes written")
    getattr(os, "fdatasync", os.fsync)(file)  # macOS has no fdatasync


def _head(number: int, text: bytes) -> bytes:
    return _HEAD.pack(_MAGIC, number, len(text), zlib.crc32(struct.pack("<QL", number, len(text)) + text))


def _slot(data: bytes) -> tuple[int, bytes] | tuple[()] | None:
    """Sequence and text of a slot; empty if it is blank, None if it is neither blank nor whole."""
    if not any(data):
        return ()
    magic, number, length, _ = _HEAD.unpack_from(data)
    text = data[_HEAD.size : _HEAD.size + length]
    if magic != _MAGIC or data[: _HEAD.size] != _head(number, text):
        return None
    return number, text
