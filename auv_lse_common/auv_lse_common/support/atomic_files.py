"""Files that are written whole or not at all, whatever the disk does."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def written_whole(folder: Path) -> Iterator[Path]:
    """A context that gives an empty folder beside what is in `folder`; its files are moved there at the end.

    If anything goes wrong `folder` stays as it was. It is made if needed.

    Raises:
        OSError: naming `folder`, or the file that the system names.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".part-", dir=folder) as name:
            part = Path(name)
            yield part
            for path in sorted(part.iterdir()):
                path.replace(folder / path.name)
    except OSError as error:
        if error.filename is None:  # a write that fails does not say where
            raise OSError(error.errno, error.strerror or str(error), str(folder)) from error
        raise


def write_whole(path: Path, text: str) -> None:
    """Writes a text file, in place of one that is there.

    Raises:
        OSError: naming the file, which is then as it was.
    """
    try:
        with tempfile.TemporaryDirectory(prefix=".part-", dir=path.parent) as name:
            part = Path(name) / "text"
            part.write_text(text, newline="")
            part.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
