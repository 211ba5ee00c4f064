"""The folder that a run leaves."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path


class RunFolderError(ValueError):
    """A run folder that cannot be made."""


def run_folder(wanted: Path | None, root: Path) -> Path:
    """Makes the run folder.

    Raises:
        RunFolderError: if it exists and holds something, or cannot be made.
    """
    folder = wanted
    if folder is None:
        base = root / "runs" / datetime.now().strftime("%Y-%m-%d-%H%M%S")
        folder, again = base, 1
        while folder.exists():
            again += 1
            folder = base.with_name(f"{base.name}-{again}")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise RunFolderError(
            f"--out {folder}: exists and is not empty; expected a new or empty folder (nothing was changed)"
        )
    try:
        (folder / "logs").mkdir(parents=True)
    except OSError as error:
        raise RunFolderError(f"--out {folder}: cannot be made: {error.strerror or error}") from error
    return folder.resolve()
