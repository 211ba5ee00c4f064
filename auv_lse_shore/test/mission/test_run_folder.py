"""The run folder of a mission without --out."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

from auv_lse_shore.mission.run_folder import run_folder


def test_missions_that_start_in_the_same_second_have_a_folder_each(tmp_path: Path) -> None:
    together = Barrier(8)

    def started(_: int) -> Path:
        together.wait()
        return run_folder(None, tmp_path)

    with ThreadPoolExecutor(8) as pool:
        folders = list(pool.map(started, range(8)))
    assert len({*folders}) == 8
    assert all((folder / "logs").is_dir() for folder in folders)
