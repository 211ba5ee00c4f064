"""The end of a mission: what is written about it."""

from __future__ import annotations

import json
from pathlib import Path

from full_disk import full_disk

from auv_lse_run.mission.conductor import write_times

MARKS = {"began": 1.0, "running": 3.0, "ended": 9.0}


def test_times_are_written_and_a_full_disk_is_no_reason_to_lose_the_report(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    phases = write_times(tmp_path, MARKS, {"auv1": 2.0}, {})
    assert json.loads((tmp_path / "logs" / "times.json").read_text())["wall_s"] == phases
    assert (phases["start"], phases["mission"]) == (2.0, 6.0)
    with full_disk(0):
        assert write_times(tmp_path, MARKS, {"auv1": 2.0}, {})["mission"] == 6.0
