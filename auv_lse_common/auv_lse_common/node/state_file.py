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

The clock may be wrong after a reboot, so this module compares no times. `START_VARIABLE` reveals a reboot: its value
changes with each start of the vehicle's programs, but not when a single node restarts.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

#: The environment variable that names this start of a vehicle's programs.
START_VARIABLE = "AUV_LSE_START"
#: The nodes of a vehicle that keep a state file.
NODES = ("safety_node", "planner_node", "modem_node")
#: Size of a slot, and of a file: two slots.
SLOT_BYTES = 16384
FILE_BYTES = 2 * SLOT_BYTES
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
            start: Value of `START_VARIABLE`.
            expected: Whether an earlier process left other files, so that a missing file is not a first start.
        """
        self.values: dict[str, Any] = {}
        self.lost = self.problem = ""
        self.rebooted = False
        self.written_s = 0.0
        self._path, self._file, self._sequence, self._text = path, -1, 0, b""
        self._start = start
        self._identity = hashlib.sha256(json.dumps(identity, sort_keys=True, default=str).encode()).hexdigest()[:16]
        if path is None:
            return
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
        except OSError as error:
            self._set_lost(f"cannot be used: {error.strerror or error}")
            self._give_up(error)
            return
        if self.lost and not self.values:
            self._repair()

    @property
    def status(self) -> str:
        """The problem, for diagnostics; "" without one."""
        return "; ".join(filter(None, (self.lost, self.problem)))

    @property
    def kept(self) -> bool:
        """Whether the state is being written."""
        return self._file >= 0

    def write(self, values: Mapping[str, Any]) -> bool:
        """Replaces the state and waits until it is on the disk. An unchanged state is not written again.

        After a failure the next changed state is written into a new file.

        Returns:
            Whether the state is on the disk, or none is stored. If False, `problem` gives the reason.
        """
        if self._path is None:
            return True
        document = {"identity": self._identity, "start": self._start, "lost": self.lost, "values": dict(values)}
        text = json.dumps(document, separators=(",", ":")).encode()
        if text == self._text:
            return self._file >= 0
        try:
            if self._file < 0:
                self._replace(text)
            else:
                self._put(text)
        except OSError as error:
            self._give_up(error)
            self._text = text
            return False
        return True

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
        if not self._text:
            return
        document = json.loads(self._text)
        if document["identity"] != self._identity:
            self._set_lost("belongs to a mission with other parameters")
            return
        self.values, self.lost = document["values"], document["lost"]
        self.rebooted = bool(self._start) and document["start"] != self._start

    def _put(self, text: bytes) -> None:
        """Writes a slot; raises OSError."""
        if len(text) > SLOT_BYTES - _HEAD.size:
            raise OSError(f"state of {len(text)} bytes; expected at most {SLOT_BYTES - _HEAD.size}")
        number = self._sequence + 1
        _write(self._file, _head(number, text) + text, number % 2 * SLOT_BYTES)
        self._sequence, self._text = number, text

    def _replace(self, text: bytes) -> None:
        """Makes a new file with this state after writing the last file failed; raises OSError."""
        assert self._path is not None
        if len(text) > SLOT_BYTES - _HEAD.size:
            raise OSError(f"state of {len(text)} bytes; expected at most {SLOT_BYTES - _HEAD.size}")
        allocate(self._path, bytes(SLOT_BYTES) + _head(1, text) + text)
        self._file = os.open(self._path, os.O_RDWR | os.O_CLOEXEC)
        self._sequence, self._text, self.problem = 1, text, ""

    def _repair(self) -> None:
        """Repairs an untrusted file and stores the reason in it; it stays untrusted if the process dies meanwhile."""
        document = {"identity": self._identity, "start": self._start, "lost": self.lost, "values": {}}
        try:
            _write(self._file, _INVALID, 0)
            _write(self._file, bytes(SLOT_BYTES), SLOT_BYTES)
            os.ftruncate(self._file, FILE_BYTES)
            self._sequence = 0
            self._put(json.dumps(document).encode())  # slot 1
            _write(self._file, bytes(SLOT_BYTES), 0)
            os.fsync(self._file)
        except OSError as error:
            self._give_up(error)

    def _set_lost(self, why: str) -> None:
        self.lost = f"state file {self._path}: {why}; the state of an earlier process is not trusted"
        self.values = {}

    def _give_up(self, error: OSError) -> None:
        assert self._path is not None
        self.problem = (
            f"state file {self._path}: cannot be written: {error.strerror or error}; a restarted node would hold"
        )
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
    if not text:
        return {}
    document = json.loads(text)
    values: dict[str, Any] = document["values"]
    return values if values or not document["lost"] else None


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
