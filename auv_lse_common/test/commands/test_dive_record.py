"""Which starts of a vehicle continue its dive, and which begin a new one."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from auv_lse_common.commands import dive_record
from auv_lse_common.commands.dive_record import DiveRecord, StateFolderError
from auv_lse_common.node.journal import FOLDER_VARIABLE
from auv_lse_common.node.state_file import NODES, START_VARIABLE, StateFile
from auv_lse_common.process.dive import DIVE_VARIABLE
from auv_lse_common.vocabulary.mission_run import RunState


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    file = tmp_path / "vehicles.yaml"
    file.write_text("mission")
    return file


def begun(folder: Path, mission: Path, state: RunState | None = None, under_water: bool = False) -> Any:
    """A dive that has begun, with the last state of its safety node; returns record and environment."""
    record = DiveRecord(folder, 2, mission)
    environment = record.begin(folder / "dive", "auv2-1123-184534-3f2a")
    if state is not None:
        file = StateFile(Path(environment[FOLDER_VARIABLE]) / "auv2.safety_node.state", {"node": "safety"})
        assert not file.lost
        file.write({"run": {"state": int(state)}, "under_water": under_water})
    return record, environment


def test_a_dive_under_water_is_continued_with_a_start_of_its_own(tmp_path: Path, mission: Path) -> None:
    _, first = begun(tmp_path, mission, RunState.RUNNING, True)
    again = DiveRecord(tmp_path, 2, mission)
    assert again.continued == tmp_path / "dive"
    second = again.begin(tmp_path / "other", "auv2-1123-999999-3f2a")
    assert {k for k in first if first[k] != second[k]} == {START_VARIABLE}
    assert second[DIVE_VARIABLE] == "auv2-1123-184534-3f2a"


@pytest.mark.parametrize(
    ("state", "under_water", "continued"),
    [
        (None, False, False),
        (RunState.WAITING, False, False),
        (RunState.WAITING, True, True),
        (RunState.RUNNING, False, True),
        (RunState.HOLDING, False, True),
        (RunState.ABORTED, False, True),
        (RunState.ENDED, False, False),
        (RunState.ENDED, True, True),
    ],
)
@pytest.mark.parametrize("ended", [False, True])
def test_what_continues(
    tmp_path: Path, mission: Path, state: RunState | None, under_water: bool, continued: bool, ended: bool
) -> None:
    record, _ = begun(tmp_path, mission, state, under_water)
    if ended:  # by SIGTERM, as when the operator or the computer stops it
        record.end()
        continued = under_water
    assert (DiveRecord(tmp_path, 2, mission).continued is not None) is continued


def test_another_mission_file_or_vehicle_is_a_new_dive(tmp_path: Path, mission: Path) -> None:
    begun(tmp_path, mission, RunState.RUNNING, True)
    assert DiveRecord(tmp_path, 3, mission).continued is None
    mission.write_text("another")
    assert DiveRecord(tmp_path, 2, mission).continued is None


def test_a_dive_whose_safety_state_is_torn_is_continued(tmp_path: Path, mission: Path) -> None:
    record, environment = begun(tmp_path, mission, RunState.RUNNING, True)
    path = Path(environment[FOLDER_VARIABLE]) / "auv2.safety_node.state"
    path.write_bytes(path.read_bytes()[:-1])
    assert DiveRecord(tmp_path, 2, mission).continued is not None
    record.end()
    assert DiveRecord(tmp_path, 2, mission).continued is not None


def test_with_a_damaged_record_the_nodes_trust_nothing(tmp_path: Path, mission: Path) -> None:
    begun(tmp_path, mission, RunState.RUNNING, True)
    path = tmp_path / "auv2.dive"
    path.write_bytes(path.read_bytes()[:100])
    again = DiveRecord(tmp_path, 2, mission)
    assert again.continued is None
    folder = Path(again.begin(tmp_path / "new", "auv2-1123-184534-ffff")[FOLDER_VARIABLE])
    for node in NODES:
        assert StateFile(folder / f"auv2.{node}.state", {}).lost


def test_no_mission_starts_without_room_for_its_state(
    tmp_path: Path, mission: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(dive_record, "allocate", full)
    with pytest.raises(StateFolderError, match=r"No space left on device\. No mission starts"):
        DiveRecord(tmp_path, 2, mission).begin(tmp_path / "dive", "auv2-1123-184534-3f2a")
    monkeypatch.undo()
    begun(tmp_path, mission, RunState.RUNNING, True)
    monkeypatch.setattr(dive_record, "allocate", full)
    assert DiveRecord(tmp_path, 2, mission).begin(tmp_path / "dive", ""), "a dive continues on a full disk"
