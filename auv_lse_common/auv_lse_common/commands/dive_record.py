"""Record of a vehicle's current dive, read at the next start so that the dive continues after a reboot.

Theory of operation
-------------------
`begin` allocates the nodes' state files and then records the dive in a separate state file, `auv2.dive`. After the
nodes have stopped, `end` marks the dive as over unless the vehicle is under water. The next start continues a dive that
is not over and has the same mission file and places. A dive is also over if the vehicle was at the surface and the
mission never ran or has ended. If the record cannot be trusted, the nodes start with invalid state files: the vehicle
surfaces and holds.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from auv_lse_common.node.journal import FOLDER_VARIABLE
from auv_lse_common.node.state_file import (
    NODES,
    START_VARIABLE,
    StateFile,
    allocate,
    forget_copy,
    invalidate,
    read_state,
)
from auv_lse_common.process.dive import DIVE_VARIABLE
from auv_lse_common.vocabulary.mission_run import RunState


class StateFolderError(OSError):
    """The mission state cannot be stored."""


class DiveRecord:
    """The record of one vehicle's dives.

    Attributes:
        continued: Folder for logs and recording of the dive to continue; None: a new dive begins.
    """

    def __init__(
        self, folder: Path, vehicle: int, mission_file: Path, parameters: Mapping[str, Any] | None = None
    ) -> None:
        """Reads the record; writes nothing.

        Args:
            folder: The folder of the record.
            vehicle: Number of the vehicle.
            mission_file: Its mission file; a different one means a new dive.
            parameters: The parameters in it; different places in its places file mean a new dive, too.
        """
        self.continued: Path | None = None
        self._path = folder / f"auv{vehicle}.dive"
        self._vehicle = vehicle
        content = mission_file.read_bytes() if mission_file.is_file() else b""
        values_text = json.dumps(parameters, sort_keys=True, default=str)
        self._mission = hashlib.sha256(f"{mission_file}\n{values_text}\n".encode() + content).hexdigest()[:16]
        self._values: dict[str, Any] = {}
        self._file: StateFile | None = None
        try:
            values = read_state(self._path)
        except FileNotFoundError:
            values = {}
        self._lost = values is None
        if values and values["mission"] == self._mission and not values["over"] and not self._is_over(values):
            self.continued, self._values = Path(values["out"]), values

    def begin(self, out: Path, dive: str) -> dict[str, str]:
        """Begins the dive, or continues the recorded one.

        Args:
            out: Folder for logs and recording of a new dive.
            dive: Id of a new dive.

        Returns:
            Environment variables for the nodes: folder of journals and state files, dive id, and id of this start.

        Raises:
            StateFolderError: if there is no room for the state files of a new dive, or no permission.
        """
        if self.continued is None:
            # A new folder, so that no dive continues an earlier one.
            journals = out / "journal" / f"{datetime.now():%Y-%m-%d-%H%M%S}-{os.getpid()}"
            self._values = {
                "mission": self._mission,
                "out": str(out),
                "journals": str(journals),
                "dive": dive,
                "over": False,
            }
            self._allocate(journals)
        return {
            FOLDER_VARIABLE: self._values["journals"],
            DIVE_VARIABLE: self._values["dive"],
            START_VARIABLE: secrets.token_hex(4),
        }

    def end(self) -> None:
        """Marks the dive as over, unless the vehicle is under water."""
        if not self._values or self._under_water(self._values) is not False:
            return
        self._values["over"] = True
        (self._file or StateFile(self._path, {})).write(self._values)
        for node in NODES:
            forget_copy(self._state_path(self._values["journals"], node))

    def _allocate(self, journals: Path) -> None:
        try:
            for node in NODES:
                path = self._state_path(str(journals), node)
                allocate(path)
                if self._lost:
                    invalidate(path)
            if not self._path.exists():
                allocate(self._path)
        except OSError as error:
            raise StateFolderError(
                f"{journals}: no place for the state of the mission: {error.strerror or error}. No mission starts "
                "whose state a restart would lose: free space, or name another folder by --out"
            ) from error
        self._file = StateFile(self._path, {})
        if not self._file.write(self._values):
            raise StateFolderError(f"{self._file.problem}. No mission starts whose state a restart would lose")

    def _state_path(self, journals: str, node: str) -> Path:
        return Path(journals) / f"auv{self._vehicle}.{node}.state"

    def _safety(self, values: dict[str, Any]) -> dict[str, Any] | None:
        return read_state(self._state_path(values["journals"], "safety_node"))

    def _under_water(self, values: dict[str, Any]) -> bool | None:
        """Whether the last known state of the vehicle is submerged; None if the state is not trusted."""
        try:
            safety = self._safety(values)
        except FileNotFoundError:
            return False
        return None if safety is None else bool(safety and safety["under_water"])

    def _is_over(self, values: dict[str, Any]) -> bool:
        """Whether a dive without an orderly end is over."""
        try:
            safety = self._safety(values)
        except FileNotFoundError:  # the folder was cleared
            return True
        if safety is None:
            return False
        idle = (RunState.WAITING, RunState.ENDED)
        return not safety or (not safety["under_water"] and safety["run"]["state"] in idle)
