"""The run folder of a mission without --out."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from auv_lse_shore.mission.run_folder import RunFolderError, run_folder


def test_missions_that_start_in_the_same_second_have_a_folder_each(tmp_path: Path) -> None:
    together = Barrier(8)

    def started(_: int) -> Path:
        together.wait()
        return run_folder(None, tmp_path)

    with ThreadPoolExecutor(8) as pool:
        folders = list(pool.map(started, range(8)))
    assert len({*folders}) == 8
    assert all((folder / "logs").is_dir() for folder in folders)


def test_a_file_is_no_run_folder(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(RunFolderError, match=r"notes.txt is a file. Choose a new or empty folder"):
        run_folder(tmp_path / "notes.txt", tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_folder_of_runs_that_leads_nowhere_is_refused(tmp_path: Path) -> None:
    (tmp_path / "runs").symlink_to(tmp_path / "disk that is not mounted")
    with pytest.raises(RunFolderError, match=r"runs cannot be created: File exists. Choose another with --out"):
        run_folder(None, tmp_path)
