"""Writes files atomically: completely or not at all."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def written_whole(folder: Path) -> Iterator[Path]:
    """A context that provides an empty folder; at the end its files are moved into `folder`, created if needed.

    After an error `folder` is unchanged.

    Raises:
        OSError: naming `folder` or the file.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".part-", dir=folder) as name:
            part = Path(name)
            yield part
            for path in sorted(part.iterdir()):
                path.replace(folder / path.name)
    except OSError as error:
        if error.filename is None:  # as after a failed write
            raise OSError(error.errno, error.strerror or str(error), str(folder)) from error
        raise


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
