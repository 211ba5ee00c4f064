"""The files in a vehicle's folder: mission files that a laptop sends, and recordings that it fetches."""

import contextlib
import errno
import hashlib
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any

from auv_lse_common.support.atomic_files import write_whole
from auv_lse_run.remote.dive_process import DIVES, MISSION
from auv_lse_run.remote.order_store import sync_folder, write_durably

_NAME = re.compile(r"[A-Za-z0-9][\w.-]{0,99}")
_SHA256 = re.compile(r"[0-9a-f]{64}")
_BLOCK = 1 << 20
#: Largest file that is sent to a vehicle (bytes).
MAX_SENT = 200_000_000
#: Folders that no recording or log is in.
_OWN = "fleet"


class FolderError(ValueError):
    """A file that is not allowed, missing or different."""


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal.

    Raises:
        OSError: if it cannot be read.
    """
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


class VehicleFolder:
    """The folder of one vehicle."""

    def __init__(self, folder: Path) -> None:
        """Reads nothing yet."""
        self.folder = folder
        self._incoming = folder / _OWN / "incoming"

    def problem(self) -> str:
        """Why files cannot be written here; "" if they can."""
        if not self.folder.is_dir():
            return f"{self.folder} does not exist on the vehicle; make it there: mkdir -p {self.folder}"
        if not os.access(self.folder, os.W_OK | os.X_OK):
            owner = self.folder.stat().st_uid
            return (
                f"{self.folder} belongs to user {owner} and cannot be written by user {os.geteuid()}; log in as its "
                f"owner (user: in the fleet file), or on the vehicle: sudo chown -R {os.geteuid()} {self.folder}"
            )
        return ""

    def hashes(self, names: Iterable[str]) -> dict[str, str]:
        """SHA-256 of files of the folder, by name; "" for those that are missing."""
        found = {}
        for name in names:
            path = self.folder / _checked_name(name)
            found[name] = sha256_of(path) if path.is_file() else ""
        return found

    def receive(self, name: str, digest: str, data: bytes) -> None:
        """Keeps a sent file beside the others, until `install`.

        Raises:
            FolderError: if the bytes are not those of the hash, or the disk is full.
            OSError: if it cannot be written for another reason.
        """
        _checked_name(name)
        if not _SHA256.fullmatch(digest) or hashlib.sha256(data).hexdigest() != digest:
            raise FolderError(f"{name} arrived damaged. Send it again.")
        try:
            self._incoming.mkdir(parents=True, exist_ok=True)
            write_durably(self._incoming / digest, data, 0o600)
        except OSError as error:
            if error.errno != errno.ENOSPC:
                raise
            raise FolderError(
                f"Its disk has no room for {name} ({len(data) / 1e6:.1f} MB). Fetch its recordings and remove them: "
                "auv_lse fleet FILE fetch --delete"
            ) from error

    def owner(self) -> str:
        """The vehicle that this folder was first used for; "" if it is new."""
        try:
            return (self.folder / _OWN / "owner").read_text().strip()
        except OSError:
            return ""

    def install(self, files: Mapping[str, str], vehicle: str) -> None:
        """Puts sent files in their places, the mission file last.

        Args:
            files: SHA-256 of each file, by name.
            vehicle: The vehicle; the folder of another one is refused.

        Raises:
            FolderError: if one was not sent; nothing is changed then.
            OSError: if one cannot be written.
        """
        if (owner := self.owner() or vehicle) != vehicle:
            raise FolderError(f"{self.folder} is the folder of {owner}, not of {vehicle}. Correct the fleet file.")
        has = self.hashes(files)
        wanted = {name: digest for name, digest in files.items() if has[name] != digest}
        for name, digest in wanted.items():
            path = self._incoming / digest
            if not _SHA256.fullmatch(digest) or not path.is_file() or sha256_of(path) != digest:
                raise FolderError(f"{name} was not sent completely. Send it again.")
        if not self.owner():
            (self.folder / _OWN).mkdir(exist_ok=True)
            write_whole(self.folder / _OWN / "owner", f"{vehicle}\n")
        for name in sorted(wanted, key=lambda name: name == MISSION):
            (self._incoming / wanted[name]).replace(self.folder / name)
        sync_folder(self.folder)
        with contextlib.suppress(OSError):
            for path in self._incoming.iterdir():
                path.unlink()

    def recordings(self, running: str) -> list[dict[str, Any]]:
        """The files of all dives that do not run: path below the folder of dives, and size (bytes).

        Args:
            running: Folder of the dive that runs; "": none does.
        """
        dives = self.folder / DIVES
        found = []
        for path in sorted(dives.rglob("*")) if dives.is_dir() else ():
            if path.is_file() and not path.is_symlink() and not (running and path.is_relative_to(running)):
                found.append({"path": path.relative_to(dives).as_posix(), "size": path.stat().st_size})
        return found

    def dive(self, name: str) -> Path | None:
        """The folder of a dive; None if there is none of that name."""
        found = self.folder / DIVES / name
        return found if _NAME.fullmatch(name) and found.is_dir() else None

    def recording(self, path: str) -> Path:
        """The file of a recording.

        Raises:
            FolderError: if there is no such recording.
        """
        dives = (self.folder / DIVES).resolve()
        found = (dives / path).resolve()
        if not found.is_relative_to(dives) or not found.is_file():
            raise FolderError(f"There is no recording {path} on the vehicle.")
        return found

    def remove(self, path: str, digest: str) -> None:
        """Removes a file of a recording, if it is still the one that was copied.

        Raises:
            FolderError: if it has another hash, or is not part of a recording.
            OSError: if it cannot be removed.
        """
        found = self.recording(path)
        if sha256_of(found) != digest:
            raise FolderError(f"{path} is not the file that was copied. Fetch it again; it was not removed.")
        found.unlink()
        for folder in found.parents:
            if folder == (self.folder / DIVES).resolve():
                return
            try:
                folder.rmdir()
            except OSError:  # not empty
                return


def blocks(file: IO[bytes], size: int) -> Iterator[bytes]:
    """The next `size` bytes of a file, in blocks.

    Raises:
        FolderError: if it is shorter.
    """
    while size:
        block = file.read(min(size, _BLOCK))
        if not block:
            raise FolderError("A file became shorter while it was copied.")
        size -= len(block)
        yield block


def _checked_name(name: str) -> str:
    if not isinstance(name, str) or not _NAME.fullmatch(name) or name in (DIVES, _OWN):
        raise FolderError(f"{name!r} cannot name a sent file.")
    return name
