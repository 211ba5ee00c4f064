"""A node's state file: the few values that must survive a restart, written in place so that it works on a full disk.

Theory of operation
-------------------
A dive begins with a first record in each state file (`begin_state`), before any node runs. From then on a file that is
missing, blank, short, damaged, another node's or another dive's is not trusted. `lost` gives the reason. The node then
holds instead of restarting the mission.

A node writes its state before it publishes the result, so the state in a torn slot was never published. The file is
still not trusted, because a disk that tears one write may have damaged another. A file that cannot be written is
invalidated in place, or removed if that fails.

Each state has a number. A second copy of the file, on another medium if there is one, has the same state, or the one
before it if the power failed between the two writes. Any other difference means that one of them is old.

On a vehicle, each state is first copied to memory (`MemoryCopy`), which survives the process but no reboot. A restarted
node continues from this copy, also if the disk fails or is slow, or if the file is gone. An empty copy marks the file
as out of date. Without a copy, as after a reboot, a file is trusted only if a slot can be rewritten: a failing card may
still open and read it.

The clock may be wrong after a reboot, so this module compares no times. `START_VARIABLE` reveals a reboot: its value
changes with each start of the vehicle's programs, but not when a single node restarts.
"""

import hashlib
import json
import math
import os
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from auv_lse_common.node import state_slots
from auv_lse_common.node.dive import DIVE_VARIABLE
from auv_lse_common.node.latest_writer import LatestWriter
from auv_lse_common.node.state_memory import MemoryCopy
from auv_lse_common.node.state_slots import SlotFile, create, invalidate

#: The environment variable that names this start of a vehicle's programs.
START_VARIABLE = "AUV_LSE_START"
#: The environment variable with the folder of the second copies; without it there are none.
SECOND_VARIABLE = "AUV_LSE_SECOND_COPIES"
#: The environment variable that gives the reason why a dive that continues after a reboot is not trusted.
DOUBT_VARIABLE = "AUV_LSE_DOUBT"
#: The nodes of a vehicle that keep a state file.
NODES = ("safety_node", "planner_node", "modem_node")
#: The exceptions with which reading a record can fail.
_UNREADABLE = (OSError, ValueError, KeyError, TypeError, RecursionError)


class StateFile:
    """State of a node that survives a restart of its process or its computer.

    Attributes:
        values: Values that an earlier process wrote last; empty at a first start or if they are not trusted.
        lost: Reason why the state of an earlier process is not trusted; "" if it is trusted. It stays set.
        problem: Reason why the state cannot be written; "" if it can.
        rebooted: Whether all of the vehicle's programs were restarted since `values` were written.
    """

    def __init__(
        self,
        path: Path | None,
        identity: Mapping[str, Any],
        *,
        start: str = "",
        dive: str = "",
        second: Path | None = None,
        expected: bool = False,
    ) -> None:
        """Reads the file. An unusable file sets `lost` or `problem` and raises no error.

        Args:
            path: The file; None: no state is stored.
            identity: JSON values that identify the mission. State with a different identity is not trusted.
            start: Value of `START_VARIABLE`; "": no copy is made in memory.
            dive: Id of the dive that has begun the file; "": a node that was started by hand begins its own file.
            second: The second copy of the file; None: there is none.
            expected: Whether a node that was started by hand has left other files, so that the file must exist.
        """
        self.values: dict[str, Any] = {}
        self.lost = self.problem = ""
        self.rebooted = False
        self._path, self._text, self._number = path, b"", 0
        self._second_path, self._second_problem = second, ""
        self._main: SlotFile | None = None
        self._second: SlotFile | None = None
        self._start, self._dive, self._identity = start, dive, _fingerprint(identity)
        save = weakref.WeakMethod(self._save)  # a strong reference would keep the file open after its last use
        self._writer = LatestWriter(lambda text: None if (write := save()) is None else write(text))
        if path is None:
            return
        self._memory = MemoryCopy(path) if start else None
        try:
            if not (dive or expected or os.path.lexists(path)):
                begin_state(path, dive, second=second)
            self._open(path)
        except (OSError, ValueError) as error:
            if not self.lost:
                self._set_lost(f"cannot be used: {_words(error)}")
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
        return "; ".join(filter(None, (self.lost, self.problem, self._second_problem, slow * self._writer.is_late)))

    @property
    def kept(self) -> bool:
        """Whether the state is being written."""
        return self._main is not None and self._main.file >= 0

    def write(self, values: Mapping[str, Any], wait_s: float = math.inf) -> bool:
        """Replaces the state and waits until it is on the disk. An unchanged state is not written again.

        After a failure the next changed state is written into a new file.

        Args:
            wait_s: Time (s) to wait for the disk if the copy in memory is written; then a thread continues.

        Returns:
            Whether the state is on the disk, or none is stored. If False, `problem` may give the reason.
        """
        if self._path is None:
            return True
        text = self._document(dict(values))
        if text == self._text:
            return self.kept and not self._writer.is_busy
        self._text = text
        is_copied = self._memory is not None and self._memory.write(text)
        if not self._writer.put(text, wait_s if is_copied else math.inf):
            return False
        return self.kept

    def loss_of(self, node: str) -> str:
        """Why another node of this dive does not trust its state, which does not change before the next dive; or ""."""
        if self._path is None or not self._start:
            return ""
        path = self._path.with_name(f"{self._path.name.partition('.')[0]}.{node}.state")
        text = MemoryCopy(path).text
        if not text and not os.path.lexists(path):
            return f"state file {path}: is missing"
        document, _ = parse(text, path.name, self._dive) if text else read_document(path, self._dive)
        return "" if document is None or document["values"] else str(document["lost"])

    def close(self) -> None:
        """Closes the file and its second copy."""
        for file in (self._main, self._second):
            if file is not None:
                file.close()

    def _document(self, values: dict[str, Any]) -> bytes:
        assert self._path is not None
        key = {"name": self._path.name, "dive": self._dive, "identity": self._identity, "start": self._start}
        return _encoded({**key, "lost": self.lost, "values": values})

    def _open(self, path: Path) -> None:
        """Reads the file and its second copy, and opens them for writing; raises OSError or ValueError."""
        document, reason = read_document(path, self._dive, self._identity)
        copy: dict[str, Any] | None = None
        if self._second_path is not None:
            copy, copy_reason = read_document(self._second_path, self._dive, self._identity)
            reason = reason or _difference(document, copy, f"its second copy {self._second_path} {copy_reason}")
        self._number = max([found["number"] for found in (document, copy) if found is not None], default=0)
        if reason:
            self._set_lost(reason)
        if reason and not os.path.lexists(path):
            return  # `_repair`, or the next write, makes a new one
        self._main = SlotFile(path)
        if document is None:
            return
        self._main.read()
        if reason:
            return
        self._restore(document)
        self._text = self._document(self.values) if document["start"] == self._start else b""
        if self._memory is not None and self._memory.text is None and not self.lost:
            self._main.verify()
        if self._second_path is not None:
            self._open_second(self._second_path)

    def _open_second(self, path: Path) -> None:
        try:
            self._second = SlotFile(path)
            self._second.read()
        except _UNREADABLE as error:
            self._lose_second(error)

    def _restore(self, document: dict[str, Any]) -> None:
        self.values, self.lost = document["values"], document["lost"]
        is_first = not document["identity"]
        self.rebooted = bool(self._start) and not is_first and document["start"] != self._start

    def _recall(self) -> None:
        """Continues from the copy in memory: it is newer than the file, or as new."""
        text = None if self._memory is None else self._memory.text
        if text == b"":
            self._set_lost("an earlier process could not write it")
        elif text is not None and self._path is not None:
            document, _ = parse(text, self._path.name, self._dive, self._identity)
            if document is not None and (not self.lost or document["start"] == self._start):
                self._text = b""  # the disk may have an older state
                if self.lost:
                    self.close()  # the next write makes new files
                self._restore(document)

    def _save(self, text: bytes) -> None:
        """Writes a state to the disk and to the second copy, or sets `problem`."""
        assert self._path is not None
        self._number += 1
        text = _numbered(text, self._number)
        try:
            self._main = _put(self._main, self._path, text)
            self.problem = ""
        except (OSError, ValueError) as error:
            self._give_up(error)
        if self._second_path is not None:
            try:
                self._second = _put(self._second, self._second_path, text)
                self._second_problem = ""
            except (OSError, ValueError) as error:
                self._lose_second(error)

    def _repair(self) -> None:
        """Repairs an untrusted file and stores the reason in it; it stays untrusted if the process dies meanwhile."""
        assert self._path is not None
        self._number += 1
        self._text = self._document({})
        text = _numbered(self._text, self._number)
        try:
            if self._main is None:
                self._main = _put(None, self._path, text)
            else:
                self._main.repair(text)
        except (OSError, ValueError) as error:
            self._give_up(error)
        if self._second_path is not None:
            try:
                self._second = _put(None, self._second_path, text)
            except (OSError, ValueError) as error:
                self._lose_second(error)

    def _set_lost(self, why: str) -> None:
        self.lost = f"state file {self._path}: {why}; the state of an earlier process is not trusted"
        self.values = {}

    def _lose_second(self, error: Exception) -> None:
        if self._second is not None:
            self._second.close()
        self._second_problem = (
            f"second copy {self._second_path} of the state: cannot be written: {_words(error)}; after a reboot the "
            "vehicle would hold"
        )

    def _give_up(self, error: Exception) -> None:
        assert self._path is not None
        is_copied = self._memory is not None and bool(self._memory.text)
        self.problem = (
            f"state file {self._path}: cannot be written: {_words(error)}; "
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
        if self._main is not None:
            self._main.close()


def open_state(
    path: Path | None, identity: Mapping[str, Any], environment: Mapping[str, str], *, expected: bool = False
) -> StateFile:
    """Opens the state file of a node.

    Args:
        path: As `StateFile` takes it.
        identity: As `StateFile` takes it.
        environment: The node's environment, with the variables of `auv_lse_run.vehicle.dive_record`.
        expected: As `StateFile` takes it.
    """
    start, second = environment.get(START_VARIABLE, ""), environment.get(SECOND_VARIABLE, "")
    return StateFile(
        path,
        identity,
        start=start,
        dive=environment.get(DIVE_VARIABLE, "") if start else "",
        second=Path(second) / path.name if second and path is not None else None,
        expected=expected,
    )


def begin_state(
    path: Path, dive: str, *, second: Path | None = None, lost: str = "", values: Mapping[str, Any] | None = None
) -> None:
    """Writes the first record of a state file, and of its second copy.

    Args:
        path: The file; an existing one is replaced.
        dive: Id of the dive, as `StateFile` takes it.
        second: The second copy; None: there is none.
        lost: Why the state of an earlier dive is not trusted, so that the node must hold; "" for a new dive.
        values: The first state.

    Raises:
        OSError: if there is no room for it, or no permission.
    """
    key = {"name": path.name, "dive": dive, "identity": "", "start": ""}
    text = _numbered(_encoded({**key, "lost": lost, "values": dict(values or {})}), 1)
    create(path, text)
    if second is not None:
        create(second, text)


def read_state(path: Path, dive: str, second: Path | None = None) -> tuple[dict[str, Any], str]:
    """Reads the values in a state file without changing it.

    Args:
        dive: As `StateFile` takes it.
        second: As `StateFile` takes it.

    Returns:
        The values, empty if nothing was written yet, and ""; or no values and why they are not trusted.
    """
    document, reason = read_document(path, dive)
    if second is not None and not reason:
        copy, copy_reason = read_document(second, dive)
        reason = _difference(document, copy, f"has a second copy {second} that {copy_reason}")
    text = MemoryCopy(path).text
    if text == b"":
        reason = reason or "could not be written"
    elif text is not None and not reason:
        document = parse(text, path.name, dive)[0] or document
    if document is None or reason:
        return {}, f"{path} {reason}"
    values: dict[str, Any] = document["values"]
    return values, "" if values else document["lost"]


def read_document(path: Path, dive: str, identity: str = "") -> tuple[dict[str, Any] | None, str]:
    """Reads the newest record of a state file.

    Args:
        dive: As `StateFile` takes it.
        identity: Fingerprint of the mission; "": any.

    Returns:
        The record and ""; or None and what is wrong with the file.
    """
    try:
        _, text = state_slots.newest(state_slots.read_bytes(path))
    except FileNotFoundError:
        return None, "is missing"
    except OSError as error:
        return None, f"cannot be read: {_words(error)}"
    except ValueError as error:
        return None, str(error)
    return parse(text, path.name, dive, identity)


def parse(text: bytes, name: str, dive: str, identity: str = "") -> tuple[dict[str, Any] | None, str]:
    """The record in a slot's text, and what is wrong with it; arguments as `read_document`, and the file's name."""
    try:
        document = json.loads(text)
        found = {key: str(document[key]) for key in ("name", "dive", "identity", "start", "lost")}
        if not isinstance(document.setdefault("number", 0), int) or not isinstance(document["values"], dict):
            return None, "is damaged"
    except _UNREADABLE:
        return None, "is of another version"
    if found["name"] != name:
        return None, f"is a copy of {found['name']}"
    if found["dive"] != dive:
        return None, f"belongs to another dive ({found['dive']})"
    if identity and found["identity"] not in ("", identity):
        return None, "belongs to a mission with other parameters"
    return document, ""


def _difference(document: dict[str, Any] | None, copy: dict[str, Any] | None, no_copy: str) -> str:
    """Why a record and its second copy contradict each other; "" if they do not.

    Args:
        no_copy: The reason if there is no copy.
    """
    if document is None:
        return ""
    if copy is None:
        return no_copy
    newer = document["number"] - copy["number"]
    if newer < 0:
        return f"is older than its second copy, by {-newer} states"
    if newer > 1:
        return f"is newer than its second copy, by {newer} states"
    return "" if newer or _encoded(document) == _encoded(copy) else "differs from its second copy"


def _put(file: SlotFile | None, path: Path, text: bytes) -> SlotFile:
    """Writes a state into an open file, or into a new one; returns the file. Raises OSError or ValueError."""
    if file is not None and file.file >= 0:
        file.put(text)
        return file
    create(path, text)
    fresh = SlotFile(path)
    fresh.read()
    return fresh


def _numbered(text: bytes, number: int) -> bytes:
    """Adds the number of its write to an encoded record."""
    return b'{"number":%d,%s' % (number, text[1:])


def _encoded(document: Mapping[str, Any]) -> bytes:
    return json.dumps(document, separators=(",", ":")).encode()


def _fingerprint(identity: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(identity, sort_keys=True, default=str).encode()).hexdigest()[:16]


def _words(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)
