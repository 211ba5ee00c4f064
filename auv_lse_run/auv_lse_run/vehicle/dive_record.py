"""Record of a vehicle's current dive, read at the next start so that the dive continues after a reboot.

Theory of operation
-------------------
`begin` writes a first record in the state file of each node, and then one of the dive, in the state file `auv2.dive`.
Each has a second copy in another folder, if one can be written. After the nodes have stopped, `end` marks the dive as
over unless the vehicle is under water.

The next start continues a dive that is not over and has the same mission file and positions. A dive is also over if the
vehicle was at the surface and the mission never ran or has ended. If any record or state file is missing, blank,
damaged, old or another dive's, `doubt` is set: the vehicle holds, and surfaces if it is under water. It also holds if
a dive with another mission file was not ended. Only without any trace of an earlier dive a first dive begins.

Nothing here stops the nodes from starting: a vehicle under water needs them even if its disk is gone.
"""

import contextlib
import copy
import hashlib
import json
import os
import pwd
import secrets
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from auv_lse_common.node.dive import DIVE_VARIABLE
from auv_lse_common.node.journal import FOLDER_VARIABLE
from auv_lse_common.node.state_file import (
    DOUBT_VARIABLE,
    NODES,
    SECOND_VARIABLE,
    START_VARIABLE,
    StateFile,
    begin_state,
    read_state,
)
from auv_lse_common.node.state_memory import forget_copy
from auv_lse_common.node.state_slots import create
from auv_lse_common.vocabulary.mission_run import RunState

#: Required keys of a record.
_KEYS = {"mission", "out", "journals", "second", "dive", "over"}

_START_AGAIN = "End the dive with Ctrl-C at the surface, and start again"


class StateFolderError(OSError):
    """The mission state cannot be stored."""


def copy_folders(chosen: str) -> list[Path]:
    """Folders for second copies of the state files; the first one that can be written is used.

    Args:
        chosen: Value of `safety.state_copies`; "": the folder that systemd gives the service, else one in the home.
    """
    if chosen:
        return [Path(chosen).absolute()]
    folders = [Path(given.split(":")[0]) for given in [os.environ.get("STATE_DIRECTORY", "")] if given]
    if state := os.environ.get("XDG_STATE_HOME", ""):
        folders.append(Path(state) / "auv_lse")
    else:
        with contextlib.suppress(KeyError):  # a user without an entry
            home = os.environ.get("HOME") or pwd.getpwuid(os.getuid()).pw_dir
            folders.append(Path(home) / ".local" / "state" / "auv_lse")
    return [folder for folder in folders if folder.is_absolute()]


class DiveRecord:
    """The record of one vehicle's dives.

    Attributes:
        continued: Folder for logs and recording of the dive to continue; None: a new dive begins.
        doubt: Why the vehicle must hold; "" if everything that is left of earlier dives is trusted.
        cure: What to do then.
        records: The files in which the current dive is recorded, or would be.
        copies_problem: Why there are no second copies of a new dive's state files; "" if there are.
    """

    def __init__(
        self,
        folder: Path,
        vehicle: int,
        mission_file: Path,
        parameters: Mapping[str, Any] | None = None,
        *,
        copies: Sequence[Path] = (),
        simulated: bool = False,
    ) -> None:
        """Reads the record; writes nothing.

        Args:
            mission_file: Its mission file; a different one means a new dive.
            parameters: The parameters in it; different positions in its positions file mean a new dive, too.
            copies: Folders for second copies, see `copy_folders`.
            simulated: Whether this is a simulated vehicle, for which only the record itself is read.
        """
        self.copies_problem = ""
        self._name, self._path = f"auv{vehicle}", folder / f"auv{vehicle}.dive"
        self._copy_folders = () if simulated else tuple(copies)
        self.records = [self._path, *(folder / self._path.name for folder in self._copy_folders)]
        self._simulated = simulated
        content = mission_file.read_bytes() if mission_file.is_file() else b""
        values_text = json.dumps(parameters, sort_keys=True, default=str)
        self._mission = hashlib.sha256(f"{mission_file}\n{values_text}\n".encode() + content).hexdigest()[:16]
        self._judge()

    def _judge(self) -> None:
        """Reads the record, and decides what this start does."""
        self.continued: Path | None = None
        found, doubts = self._read()
        self._values = self._last = found
        self._is_lost = bool(doubts)  # the nodes of a new dive trust nothing; else only the mission is held
        if found and not found["over"] and not (not doubts and self._is_idle(found)):
            if found["mission"] == self._mission:
                self.continued = Path(found["out"])
                doubts += [reason for node in NODES if (reason := self._state(found, node)[1])]
            elif not self._simulated:
                doubts.append(f"dive {found['dive']} with another mission file was not ended")
        self.doubt = "; ".join(doubts)
        plans = not self._is_lost and not (self.continued and self._state(found, "planner_node")[1])
        self.cure = "RESET and GO continue" if plans else _START_AGAIN
        if self.continued is None:
            self._values = {}

    @property
    def is_current(self) -> bool:
        """Whether the record on the disk is still the one that was read, with the same decision."""
        again = copy.copy(self)
        again._judge()
        return (again._last, again.continued, again.doubt) == (self._last, self.continued, self.doubt)

    def begin(self, out: Path, dive: str) -> dict[str, str]:
        """Begins the dive, or continues the recorded one.

        Args:
            out: Folder for logs and recording of a new dive.
            dive: Id of a new dive.

        Returns:
            Environment variables for the nodes: folder of journals and state files, dive id, id of this start, folder
            of the second copies, and `doubt`.

        Raises:
            StateFolderError: if a simulated dive's state files cannot be written. A vehicle's nodes start, and hold.
        """
        if self.continued is None:
            # A new folder, so that no dive continues an earlier one.
            journals = out / "journal" / f"{datetime.now():%Y-%m-%d-%H%M%S}-{os.getpid()}-{secrets.token_hex(2)}"
            self._values = {
                "mission": self._mission,
                "out": str(out),
                "journals": str(journals),
                "second": "",
                "dive": dive,
                "over": False,
            }
            try:
                self._begin_files()
            except OSError as error:
                reason = (
                    f"{journals}: cannot store the state of the mission: {error.strerror or error}. No mission starts "
                    "whose state a restart would lose: free space, or name another folder by --out"
                )
                if self._simulated:
                    raise StateFolderError(reason) from error
                self.doubt, self.cure = "; ".join(filter(None, (self.doubt, reason))), _START_AGAIN
            else:
                if self._last:  # no start continues it
                    self._forget_copies(self._last)
        return {
            FOLDER_VARIABLE: self._values["journals"],
            DIVE_VARIABLE: self._values["dive"],
            START_VARIABLE: secrets.token_hex(4),
            SECOND_VARIABLE: self._values["second"],
            DOUBT_VARIABLE: self.doubt,
        }

    def end(self) -> None:
        """Marks the dive as over, unless the vehicle is under water or that is not known."""
        if not self._values:
            return
        safety, reason = self._state(self._values, "safety_node")
        if self._simulated:
            self._forget_copies(self._values)  # they outlive a failing disk, which is simulated nowhere
        if reason or safety.get("under_water"):
            return
        self._values["over"] = True
        file = StateFile(self._path, {}, dive=self._name, second=self._second(self._values, self._path.name))
        file.write(self._values)
        self._forget_copies(self._values)

    def _forget_copies(self, values: Mapping[str, Any]) -> None:
        """Removes the copies in memory of a dive's state files."""
        for node in NODES:
            forget_copy(self._state_path(values, node))

    def _read(self) -> tuple[dict[str, Any], list[str]]:
        """The values of the last record, empty without one, and the reasons why it is not trusted."""
        values, reason = read_state(self._path, self._name)
        if values and not set(values) >= _KEYS:
            values, reason = {}, f"{self._path} was written by another version"
        if not reason:
            return values, self._contradictions(values)
        if os.path.lexists(self._path):
            return {}, [reason]
        return {}, [] if self._simulated else self._traces()

    def _contradictions(self, values: dict[str, Any]) -> list[str]:
        """How the second copies contradict a valid record."""
        doubts = []
        own = self._second(values, self._path.name)
        if own is not None and not self._simulated:
            copy, reason = read_state(own, self._name)
            if reason and not os.path.lexists(own):
                doubts.append(reason)
            elif not reason and (not values["over"] or copy.get("dive") == values["dive"]):
                reason = read_state(self._path, self._name, own)[1]
                doubts += [reason] if reason else []
        return doubts + self._open_copies(values["dive"], own)

    def _open_copies(self, dive: str, own: Path | None = None) -> list[str]:
        """The second copies that record a dive other than `dive` that was not ended, or are not trusted.

        Args:
            own: The second copy of the record itself.
        """
        doubts = []
        for path in dict.fromkeys(filter(None, (own, *self.records[1:]))):
            if not os.path.lexists(path):
                continue
            copy, reason = read_state(path, self._name)
            if reason or not set(copy) >= _KEYS:
                doubts.append(reason or f"{path} was written by another version")
            elif not copy["over"] and copy["dive"] != dive:
                doubts.append(f"{path} has dive {copy['dive']} in {copy['out']}, which was not ended")
        return doubts

    def _traces(self) -> list[str]:
        """Traces of an earlier dive whose record is missing."""
        doubts = self._open_copies("")
        folder = self._path.parent
        runs = [folder]
        with contextlib.suppress(OSError):
            runs += sorted(run for run in folder.iterdir() if run.name != "journal")
        for run in runs:
            with contextlib.suppress(OSError):
                left = [*run.glob(f"journal/*/{self._name}.*"), *(run.glob("bag*") if run == folder else ())]
                own, _ = read_state(run / self._path.name, self._name)
                if left and not own.get("over"):
                    doubts.append(f"{self._path} is missing, but {left[0]} is there")
        return doubts[:3]

    def _begin_files(self) -> None:
        """Writes the first records; raises OSError."""
        values = self._values
        if (second := self._writable_second()) is not None:
            values["second"] = str(second)
        for node in NODES:
            path = self._state_path(values, node)
            is_lost = self._is_lost or (bool(self.doubt) and node == "safety_node")
            lost = f"{self.doubt}; the state of an earlier dive is not trusted" if is_lost else ""
            begin_state(path, values["dive"], second=self._second(values, path.name), lost=lost)
        begin_state(self._path, self._name, second=self._second(values, self._path.name), values=values)

    def _writable_second(self) -> Path | None:
        problems = []
        for folder in self._copy_folders:
            probe = folder / f"{self._name}.probe"
            try:
                create(probe, b"{}")
                probe.unlink()
            except OSError as error:
                problems.append(f"{folder}: {error.strerror or error}")
            else:
                return folder
        if problems:
            self.copies_problem = f"no second copies of the state files: {'; '.join(problems)} (safety.state_copies)"
        return None

    def _state_path(self, values: Mapping[str, Any], node: str) -> Path:
        return Path(values["journals"]) / f"{self._name}.{node}.state"

    @staticmethod
    def _second(values: Mapping[str, Any], name: str) -> Path | None:
        """The second copy of the file `name`; None if the dive has none."""
        return Path(values["second"]) / name if values["second"] else None

    def _state(self, values: Mapping[str, Any], node: str) -> tuple[dict[str, Any], str]:
        """The state of a node, and why it is not trusted."""
        path = self._state_path(values, node)
        return read_state(path, values["dive"], self._second(values, path.name))

    def _is_idle(self, values: Mapping[str, Any]) -> bool:
        """Whether a dive without an orderly end is over: its mission never ran, or ended, and at the surface."""
        found = {node: self._state(values, node) for node in NODES}
        if any(reason for _, reason in found.values()):
            return False
        safety = found["safety_node"][0]
        if not safety:
            return True
        try:
            return not safety["under_water"] and safety["run"]["state"] in (RunState.WAITING, RunState.ENDED)
        except (KeyError, TypeError):
            return False
