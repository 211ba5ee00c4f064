"""auv_lse fleet fetch: copies recordings and logs, resumed after each drop, verified by hash, into one run folder."""

import errno
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from auv_lse_common.support.plurals import counted
from auv_lse_common.support.user_error import error_text
from auv_lse_run.remote.vehicle_folder import sha256_of
from auv_lse_shore.remote.contacts import with_each
from auv_lse_shore.remote.fleet_file import FleetFile, RemoteVehicle
from auv_lse_shore.remote.ssh import LinkError, RemoteSession, VehicleError, session

#: Time (s) without a byte after which a link is dead; time for a list, and for the hash of a large file.
_BYTES_S, _LIST_S, _HASH_S = 20.0, 60.0, 600.0
_RETRY_S = 1.0
#: Size (bytes) from which a file gets a line of its own.
_LARGE = 5_000_000


@dataclass(kw_only=True)
class Fetched:
    """The files fetched from one vehicle.

    Attributes:
        trouble: Why it is incomplete; "" if all is there and verified.
        runs: Folders of the dives with a recording.
        files, size: Number of verified files, and their bytes.
        resumed: How often a file was continued.
        removed: Number of files removed on the vehicle.
    """

    trouble: str = ""
    runs: list[Path] = field(default_factory=list)
    files: int = 0
    size: int = 0
    resumed: int = 0
    removed: int = 0


def fetch(
    fleet: FleetFile, vehicles: Sequence[RemoteVehicle], out: Path, wait_s: float, delete: bool, all_dives: bool
) -> dict[str, Fetched]:
    """Fetches the dives of vehicles at the same time; returns what there is, by vehicle.

    Args:
        out: Folder for the copies: OUT/auv1/DIVE.
        wait_s: Longest time (s) without progress.
        delete: Whether verified files are removed on the vehicle.
        all_dives: Whether all dives are fetched, and not only the newest.
    """
    return with_each(vehicles, lambda vehicle: _Fetcher(fleet, vehicle, out, wait_s, delete).run(all_dives))


class _Fetcher:
    """Fetches the dives of one vehicle."""

    def __init__(self, fleet: FleetFile, vehicle: RemoteVehicle, out: Path, wait_s: float, delete: bool) -> None:
        self._fleet, self._vehicle, self._folder = fleet, vehicle, out / vehicle.name
        self._wait_s, self._delete = wait_s, delete
        self._progress_s = time.monotonic()
        self._found = Fetched()
        self._done: set[str] = set()

    def run(self, all_dives: bool) -> Fetched:
        """Copies until all is there, or nothing came for `wait_s`."""
        while True:
            try:
                with session(self._vehicle, self._fleet.ssh_config) as found:
                    self._copy_all(found, all_dives)
                return self._found
            except VehicleError as error:
                self._found.trouble = str(error)
                return self._found
            except OSError as error:
                cure = " Make room on this laptop; the same command continues." if error.errno == errno.ENOSPC else ""
                self._found.trouble = f"{error_text(error)}.{cure}"
                return self._found
            except LinkError as error:
                if time.monotonic() - self._progress_s > self._wait_s:
                    self._found.trouble = f"{error} What is there is kept; the same command continues."
                    return self._found
            time.sleep(_RETRY_S)

    def _copy_all(self, found: RemoteSession, all_dives: bool) -> None:
        files = found.ask("list", _LIST_S)["files"]
        dives = sorted({PurePosixPath(file["path"]).parts[0] for file in files if "/" in file["path"]})
        wanted = set(dives if all_dives else dives[-1:])
        if not dives:
            raise VehicleError("it has no dive that has ended")
        for file in files:
            if PurePosixPath(file["path"]).parts[0] in wanted and file["path"] not in self._done:
                self._copy(found, str(file["path"]), int(file["size"]))
                self._done.add(file["path"])
        self._found.runs = [self._folder / dive for dive in sorted(wanted) if any((self._folder / dive).glob("bag*"))]

    def _copy(self, found: RemoteSession, path: str, size: int) -> None:
        """Copies a file, and verifies it; a copy that is damaged is made again, once."""
        target = self._folder / path
        if not target.resolve().is_relative_to(self._folder.resolve()):
            raise VehicleError(f"it names a file outside of its folder: {path}")
        target.parent.mkdir(parents=True, exist_ok=True)
        digest = found.ask("hash", _HASH_S, path=path)["sha256"]
        for attempt in range(2):
            if not target.is_file() or sha256_of(target) != digest:
                self._receive(found, path, size, target)
            if sha256_of(target) == digest:
                break
            target.unlink()
            if attempt:
                raise VehicleError(f"{path} arrives damaged, or still changes. Fetch it again later.")
        self._found.files += 1
        self._found.size += size
        if self._delete:
            found.ask("remove", _HASH_S, path=path, sha256=digest)
            self._found.removed += 1

    def _receive(self, found: RemoteSession, path: str, size: int, target: Path) -> None:
        part = target.with_name(f"{target.name}.part")
        has = part.stat().st_size if part.exists() else 0
        if has > size:
            part.unlink()
            has = 0
        if has:
            self._found.resumed += 1
        if size >= _LARGE:
            self._say(f"{path}: {size / 1e6:.0f} MB" + (f", from {has / 1e6:.0f} MB on" if has else ""))
        with part.open("ab") as file:
            for block in found.bytes_of(path, has, _BYTES_S):
                file.write(block)
                self._progress_s = time.monotonic()
        part.replace(target)

    def _say(self, text: str) -> None:
        print(f"{self._vehicle.name}: {text}", file=sys.stderr, flush=True)


def summary(name: str, found: Fetched) -> str:
    """A sentence on the files fetched from a vehicle."""
    text = f"{name}: {counted(found.files, 'file')}, {found.size / 1e6:.1f} MB, verified by hash"
    text += f"; continued {counted(found.resumed, 'time')}" if found.resumed else ""
    text += f"; {found.removed} removed on the vehicle" if found.removed else ""
    return f"{text}; incomplete: {found.trouble}" if found.trouble else text


def results(runs: Sequence[Path], out: Path) -> int:
    """Adjusts, reports and certifies the dives of a team; returns the worst exit code of these commands."""
    from auv_lse_run.command.find_verbs import find_verbs
    from auv_lse_run.command.main import run_verb

    verbs: dict[str, Any] = find_verbs()[0]
    paths = [str(run) for run in runs]
    for run in paths:
        run_verb(verbs["recover"], [run])
    adjusted = run_verb(verbs["adjust"], [*paths, "--report", "--out", str(out / "adjusted")])
    return max(adjusted, run_verb(verbs["certify"], [*paths, "--out", str(out / "certificate")]))
