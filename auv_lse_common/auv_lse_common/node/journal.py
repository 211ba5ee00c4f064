"""A node's journal: a file to which a node appends the data that it needs after a restart.

The first line of the file contains the format and the mission; each further line is a record with its checksum:

    {"format": 1, "mission": "9f0c..."}
    5d1c40a2 ["step", {...}]

A record is written by one call of the operating system, so a process that is killed at any moment leaves whole lines,
and at most the last one torn. Torn and damaged lines are skipped and counted. A journal of another mission, other
parameters or another format is set aside and not read. A power failure loses what the operating system had not yet
written: some seconds.

A journal that cannot be written, as on a full disk, would soon be out of date: an abort would be missing. So it is
marked in place, which needs no space: `?` overwrites its first byte, its records are dropped, and `!` takes the
position of `?`. A later process does not restore the dropped records and finds `stale` set; records after `!` are newer
than the mark and valid.
"""

import contextlib
import hashlib
import json
import os
import zlib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from auv_lse_common.support.plurals import counted

#: Format of the lines; a journal of another one is not read.
FORMAT = 1
#: Environment variable with the folder of the journals; without it no node keeps one.
FOLDER_VARIABLE = "AUV_LSE_JOURNAL"
#: First byte of a file whose records are out of date, and of one from which they were dropped.
_STALE_HERE, _STALE_BEFORE = b"?", b"!"


class Journal:
    """Records that survive a restart of the process.

    Attributes:
        records: Records of an earlier process of the same mission, in order: lists of JSON values. Call `drop_records`
            once they are restored; those of a day are tens of megabytes.
        damaged: Number of lines that could not be read.
        problem: Why records are not being written; "" if they are.
        stale: Why the state of an earlier process is out of date, so that none of it was restored; "" if it is not.
    """

    def __init__(self, path: Path | None, identity: Mapping[str, Any], replaced: Collection[str] = ()) -> None:
        """Reads an existing file and opens it for appending. An unusable file sets `problem` and raises no error.

        Args:
            path: The file; its folder is made if it is missing. None: no journal is kept.
            identity: JSON values that identify the mission. A journal of another identity is set aside.
            replaced: Kinds of records of which each replaces the one before; only the last of each is read.
        """
        self.records: list[list[Any]] = []
        self.damaged = 0
        self._read_back = 0
        self._replaced = tuple(f'["{kind}"'.encode() for kind in replaced)
        self.problem = self.stale = ""
        self._path, self._file = path, -1
        if path is None:
            return
        mission = hashlib.sha256(json.dumps(identity, sort_keys=True, default=str).encode()).hexdigest()[:16]
        self._head = head = json.dumps({"format": FORMAT, "mission": mission}).encode()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            whole = self._read(path, head)
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        except OSError as error:
            if os.path.lexists(path):  # an earlier process, which could not write or mark it either, left it behind
                self._set_stale(f"cannot be read or continued: {error.strerror or error}")
            self._give_up(error)
            return
        if whole is None:
            self._append(head + b"\n")
        elif not whole:  # new records must not be joined to a torn line
            self._append(b"\n")

    def _read(self, path: Path, head: bytes) -> bool | None:
        """Reads the records; returns whether the last line is whole, None if the file is new or was set aside."""
        try:
            data = path.read_bytes()
        except FileNotFoundError:
            return None
        first, *lines = data.split(b"\n")
        if first[:1] in (_STALE_HERE, _STALE_BEFORE) and first[1:] == head[1:]:
            self._set_stale("an earlier process could not write it (disk full?), or failed when it repeated it")
            if first[:1] == _STALE_HERE:
                self._mark_stale()
                return True
        elif first != head:
            path.replace(path.with_name(path.name + ".old"))
            return None
        texts = [self._intact(line) for line in lines if line]
        last = {kind: number for number, text in enumerate(texts) for kind in self._replaced if text.startswith(kind)}
        for number, text in enumerate(texts):
            if any(text.startswith(kind) and number < newest for kind, newest in last.items()):
                self._read_back += 1
            else:
                self._take(text)
        return data.endswith(b"\n")

    @staticmethod
    def _intact(line: bytes) -> bytes:
        """The text of a line; empty if its checksum is another's."""
        checksum, _, text = line.partition(b" ")
        return text if checksum == b"%08x" % zlib.crc32(text) else b""

    def _take(self, text: bytes) -> None:
        record = json.loads(text) if text else None
        if isinstance(record, list) and record and isinstance(record[0], str):
            self.records.append(record)
            self._read_back += 1
        else:
            self.damaged += 1

    @contextlib.contextmanager
    def restoring(self) -> Iterator[None]:
        """A context in which a node restores the records; if it fails, no later process repeats them.

        Otherwise a node that fails with its own journal would fail at every restart.
        """
        try:
            yield
        except Exception:
            if self._file >= 0:
                self.close()
                self._mark_stale()
            raise

    def drop_records(self) -> None:
        """Drops the records, which the node has restored."""
        self.records = []

    @property
    def kept(self) -> bool:
        """Whether records are being written."""
        return self._file >= 0

    @property
    def status(self) -> str:
        """One line for diagnostics; "" without a journal."""
        if self._path is None:
            return ""
        damaged = f", {counted(self.damaged, 'damaged line')} skipped" if self.damaged else ""
        found = self.problem or f"{counted(self._read_back, 'record')} read back{damaged}"
        return f"{self.stale}; {found}" if self.stale else found

    def write(self, kind: str, *values: Any) -> None:
        """Appends a record: the list of `kind` and `values`, which JSON must be able to hold."""
        if self._file < 0:
            return
        text = json.dumps([kind, *values], separators=(",", ":")).encode()
        self._append(b"%08x %s\n" % (zlib.crc32(text), text))

    def _append(self, line: bytes) -> None:
        try:
            written = os.write(self._file, line)
            if written != len(line):
                raise OSError(f"{written} of {len(line)} bytes written")
        except OSError as error:  # a full disk must not stop the node
            self.close()
            self._give_up(error)
            self._mark_stale()

    def _give_up(self, error: OSError) -> None:
        self.problem = (
            f"journal {self._path}: cannot be written: {error.strerror or error}; a restart would lose the node's state"
        )

    def _set_stale(self, reason: str) -> None:
        self.stale = f"journal {self._path}: {reason}; its state is out of date and was not restored"
        self.records = []
        self._read_back = 0

    def _mark_stale(self) -> None:
        """Marks the file in place, so that no later process restores its records; needs no space on the disk."""
        assert self._path is not None
        try:
            file = os.open(self._path, os.O_RDWR)
        except OSError:
            return
        try:
            os.pwrite(file, _STALE_HERE, 0)
            os.fsync(file)
            os.ftruncate(file, len(self._head) + 1)
            os.pwrite(file, _STALE_BEFORE, 0)
            os.fsync(file)
        except OSError as error:
            self.problem += f"; it could not be marked as out of date either: {error.strerror or error}"
        finally:
            os.close(file)

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
