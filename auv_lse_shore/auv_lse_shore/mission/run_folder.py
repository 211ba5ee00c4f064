"""The run folder."""

import contextlib
import shutil
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

from auv_lse_common.support.installed_copy import note_software


class RunFolderError(ValueError):
    """A run folder that cannot be created."""


def run_folder(wanted: Path | None, root: Path) -> Path:
    """Creates the run folder.

    Raises:
        RunFolderError: if it exists and is not empty, or cannot be created.
    """
    try:
        folder = wanted or _new_folder(root / "runs" / datetime.now().strftime("%Y-%m-%d-%H%M%S"))
        if folder.exists() and not folder.is_dir():
            raise RunFolderError(f"--out {folder} is a file. Choose a new or empty folder")
        if folder.exists() and any(folder.iterdir()):
            raise RunFolderError(f"--out {folder} is not empty, and was left as it is. Choose a new or empty folder")
        (folder / "logs").mkdir(parents=True)
    except OSError as error:
        where = f"--out {wanted}" if wanted else str(root / "runs")
        raise RunFolderError(
            f"{where} cannot be created: {error.strerror or error}. Choose another with --out"
        ) from error
    note_software(folder)
    return folder.resolve()


def _new_folder(base: Path) -> Path:
    """Creates `base`, or if another mission has it, the first free one of base-2, base-3 ..."""
    base.parent.mkdir(parents=True, exist_ok=True)
    folder, again = base, 1
    while True:
        with contextlib.suppress(FileExistsError):
            folder.mkdir()
            return folder
        again += 1
        folder = base.with_name(f"{base.name}-{again}")


@contextlib.contextmanager
def removed_on_error(folder: Path) -> Iterator[None]:
    """A context for writing the first files of a run: if it fails, the folder is removed.

    Raises:
        RunFolderError: if a file cannot be written, or the disk lacks room for the recording.
    """
    try:
        yield
    except RunFolderError:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    except OSError as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise RunFolderError(f"--out {folder}: cannot be written: {error.strerror or error}") from error
