"""Writes files atomically: completely or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def written_whole(folder: Path) -> Iterator[Path]:
    """A context that provides an empty folder; at the end its files are moved into `folder`, created if needed.

    After an error `folder` is unchanged, or missing if it was.

    Raises:
        OSError: naming `folder` or the file.
    """
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".part-", dir=folder) as name:
            part = Path(name)
            yield part
            for path in sorted(part.iterdir()):
                path.replace(folder / path.name)
    except BaseException as error:
        for path in new:
            with contextlib.suppress(OSError):  # not made, or somebody else has files there
                path.rmdir()
        if isinstance(error, OSError) and (error.filename is None or ".part-" in str(error.filename)):
            raise OSError(error.errno, error.strerror or str(error), str(folder)) from error
        raise


def check_folder(folder: Path) -> None:
    """Checks before a long computation that `written_whole` can write into a folder; changes nothing.

    Raises:
        OSError: naming what is in the way: a file instead of a folder, or a folder that cannot be written.
    """
    found = next(path for path in (folder, *folder.parents) if os.path.lexists(path))
    if not found.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, "is not a folder; choose another name", str(found))
    if not os.access(found, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, "the folder cannot be written; choose another one with --out", str(found))


def write_whole(path: Path, text: str) -> None:
    """Writes a text file, and replaces an existing one.

    Raises:
        OSError: naming the file, which is then unchanged.
    """
    try:
        with tempfile.TemporaryDirectory(prefix=".part-", dir=path.parent) as name:
            part = Path(name) / "text"
            part.write_text(text, newline="")
            part.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
