"""State files: written on a full disk, whole after power loss at any byte, and never trusted when out of date."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from full_disk import full_disk

from auv_lse_common.node import latest_writer, state_memory, state_slots
from auv_lse_common.node.state_file import StateFile, begin_state, read_state
from auv_lse_common.node.state_slots import FILE_BYTES, SLOT_BYTES, create, invalidate

MISSION = {"vehicle": 2, "steps": 100}


def test_the_last_state_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "a folder" / "safety.state"
    first = StateFile(path, MISSION)
    assert (first.values, first.lost, first.problem) == ({}, "", "")
    for number in range(5):
        assert first.write({"number": number, "name": "Zürich"})
        assert StateFile(path, MISSION).values == {"number": number, "name": "Zürich"}
    assert path.stat().st_size == FILE_BYTES


def test_a_file_cut_or_torn_at_any_byte_is_not_trusted_or_whole(tmp_path: Path) -> None:
    path = tmp_path / "safety.state"
    file = StateFile(path, MISSION)
    file.write({"state": "running"})
    before = path.read_bytes()
    file.write({"state": "aborted"})
    after = path.read_bytes()
    slot = next(i for i in range(FILE_BYTES) if before[i] != after[i])
    slot -= slot % SLOT_BYTES
    last = max(i for i in range(FILE_BYTES) if before[i] != after[i])
    for torn in range(slot, last + 2):  # the write of "aborted" has got so far
        path.write_bytes(after[:torn] + before[torn:])
        read = StateFile(path, MISSION)
        if before[torn:] == after[torn:]:
            assert read.values == {"state": "aborted"}
        elif before[:torn] == after[:torn]:
            assert read.values == {"state": "running"}  # it has not begun
        else:
            assert read.values == {}
            assert "not trusted" in read.lost
    for cut in [*range(200), *range(SLOT_BYTES - 9, SLOT_BYTES + 200), FILE_BYTES - 1]:
        path.write_bytes(after[:cut])
        read = StateFile(path, MISSION)
        assert read.values == {}
        assert "not trusted" in read.lost


def test_a_file_that_is_not_trusted_stays_so_and_is_written_again(tmp_path: Path) -> None:
    path = tmp_path / "safety.state"
    StateFile(path, MISSION).write({"state": "running"})
    invalidate(path)
    second = StateFile(path, MISSION)
    assert second.values == {}
    assert StateFile(path, MISSION).lost == second.lost, "also if the second process died at once"
    assert second.write({"state": "holding"})
    third = StateFile(path, MISSION)
    assert third.values == {"state": "holding"}
    assert third.lost == second.lost


def test_a_process_that_dies_while_it_repairs_leaves_the_file_untrusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "safety.state"
    for calls in range(5):
        StateFile(path, MISSION).write({"state": "running"})
        path.write_bytes(path.read_bytes()[:-1])
        left = [calls]

        def dies(file: int, data: bytes, offset: int, left: list[int] = left) -> None:
            if not left[0]:
                raise KeyboardInterrupt
            left[0] -= 1
            os.pwrite(file, data, offset)

        with monkeypatch.context() as patch:
            patch.setattr(state_slots, "write", dies)
            if calls < 4:
                with pytest.raises(KeyboardInterrupt):
                    StateFile(path, MISSION)
            else:
                StateFile(path, MISSION)
        assert StateFile(path, MISSION).lost
        path.unlink()


def test_a_node_knows_whether_another_one_has_lost_its_state(tmp_path: Path, memory: Path) -> None:
    for node in ("safety_node", "planner_node"):
        begin_state(tmp_path / f"auv2.{node}.state", "a dive")

    def opened(node: str) -> StateFile:
        return StateFile(tmp_path / f"auv2.{node}.state", {}, start="a", dive="a dive")

    safety, planner = opened("safety_node"), opened("planner_node")
    assert safety.loss_of("planner_node") == "", "it has planned nothing yet"
    planner.write({"decided": 3})
    assert safety.loss_of("planner_node") == ""
    (tmp_path / "auv2.planner_node.state").unlink()
    assert safety.loss_of("planner_node") == "", "it goes on from memory"
    planner.close()
    for copy in memory.iterdir():
        copy.unlink()
    assert "is missing" in opened("planner_node").lost
    assert "is missing" in safety.loss_of("planner_node")


def test_other_parameters_are_not_this_mission(tmp_path: Path) -> None:
    path = tmp_path / "safety.state"
    StateFile(path, MISSION).write({"state": "running"})
    other = StateFile(path, {**MISSION, "steps": 101})
    assert other.values == {}
    assert "other parameters" in other.lost


def test_a_missing_file_is_a_first_start_only_if_nothing_ran_before(tmp_path: Path) -> None:
    assert not StateFile(tmp_path / "one.state", MISSION).lost
    missing = StateFile(tmp_path / "two.state", MISSION, expected=True)
    assert "is missing" in missing.lost
    assert StateFile(tmp_path / "two.state", MISSION).lost


def test_a_reboot_is_told_from_a_restart(tmp_path: Path) -> None:
    path = tmp_path / "safety.state"
    first = StateFile(path, MISSION, start="a")
    assert not first.rebooted
    first.write({"state": "running"})
    assert not StateFile(path, MISSION, start="a").rebooted
    again = StateFile(path, MISSION, start="b")
    assert again.rebooted
    again.write({"state": "running"})
    assert not StateFile(path, MISSION, start="b").rebooted


def test_a_folder_that_cannot_be_written_is_not_a_first_start(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    state = StateFile(tmp_path / "file" / "safety.state", MISSION)
    assert "cannot be used" in state.lost
    assert "cannot be written" in state.problem
    assert not state.write({"state": "running"})


def test_a_file_that_fails_is_invalidated_in_place(tmp_path: Path) -> None:
    path = tmp_path / "safety.state"
    state = StateFile(path, MISSION)
    state.write({"state": "running"})
    number = os.open("/dev/full", os.O_WRONLY)
    os.dup2(number, state._main.file)
    os.close(number)
    assert not state.write({"state": "aborted"})
    assert "cannot be written" in state.problem
    data = path.read_bytes()
    after = StateFile(path, MISSION)
    assert after.values == {}
    assert after.lost
    path.write_bytes(data)
    assert not state.write({"state": "aborted"}), "an unchanged state is not tried again"
    assert state.write({"state": "holding"}), "there is space again"
    assert state.problem == ""
    assert StateFile(path, MISSION).values == {"state": "holding"}
    assert state.write({"state": "running"})
    assert StateFile(path, MISSION).values == {"state": "running"}


def test_a_state_that_is_too_large_is_a_problem_and_no_error(tmp_path: Path) -> None:
    state = StateFile(tmp_path / "safety.state", MISSION)
    assert not state.write({"text": "x" * SLOT_BYTES})
    assert "a slot holds" in state.problem


def test_without_a_path_nothing_is_kept() -> None:
    none = StateFile(None, MISSION)
    assert none.write({"state": "running"})
    assert (none.values, none.kept, none.status) == ({}, False, "")


def test_a_full_disk_stops_the_allocation_but_no_write(tmp_path: Path) -> None:
    """A limit on the size of files stands in for the disk: files that have their size can be written."""
    path = tmp_path / "safety.state"
    state = StateFile(path, MISSION)
    with full_disk(FILE_BYTES):
        for number in range(3):
            assert state.write({"number": number})
    with full_disk(1000), pytest.raises(OSError, match=r"bytes written|too large"):
        create(tmp_path / "other.state", b"{}")
    assert list(tmp_path.iterdir()) == [path]
    assert StateFile(path, MISSION).values == {"number": 2}


def test_a_killed_process_leaves_a_whole_file(tmp_path: Path) -> None:
    writer = (
        "import sys; from pathlib import Path; from auv_lse_common.node.state_file import StateFile\n"
        "s = StateFile(Path(sys.argv[1]), {})\n"
        "for n in range(10**9): s.write({'n': n, 'x': 'x' * 2000})\n"
    )
    path = tmp_path / "safety.state"
    for _ in range(3):
        process = subprocess.Popen([sys.executable, "-c", writer, str(path)])
        until, before = time.monotonic() + 20.0, path.read_bytes() if path.exists() else bytes(100)
        while not path.exists() or path.read_bytes()[:100] == before[:100]:
            assert time.monotonic() < until
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert StateFile(path, {}).values


@pytest.fixture
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "memory"
    folder.mkdir()
    monkeypatch.setattr(state_memory, "MEMORY", folder)
    return folder


def _fail(*_arguments: object, **_options: object) -> None:
    """A card whose writes fail, and that still opens and reads."""
    raise OSError(5, "Input/output error")


def test_a_card_that_only_reads_is_noticed_after_a_reboot(
    tmp_path: Path, memory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "safety.state"
    StateFile(path, MISSION, start="a").write({"state": "running"})
    for copy in memory.iterdir():
        copy.unlink()  # as a reboot does
    whole = StateFile(path, MISSION, start="b")
    assert (whole.values, whole.rebooted, whole.lost) == ({"state": "running"}, True, "")
    monkeypatch.setattr(state_slots, "write", _fail)
    after = StateFile(path, MISSION, start="c")
    assert after.values == {}
    assert "Input/output error; the state of an earlier process is not trusted" in after.lost
    monkeypatch.undo()
    monkeypatch.setattr(state_memory, "MEMORY", memory)
    assert StateFile(path, MISSION, start="c").lost, "also by a node that restarts when the card writes again"


def test_a_card_that_writes_other_bytes_is_noticed_after_a_reboot(
    tmp_path: Path, memory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "safety.state"
    StateFile(path, MISSION, start="a").write({"state": "running"})
    for copy in memory.iterdir():
        copy.unlink()
    monkeypatch.setattr(state_slots, "write", lambda file, data, offset: None)
    assert "it reads other bytes than were written" in StateFile(path, MISSION, start="b").lost


def test_a_node_restarts_with_its_last_state_while_the_card_fails(
    tmp_path: Path, memory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "safety.state"
    first = StateFile(path, MISSION, start="a")
    first.write({"state": "running"})
    before = path.read_bytes()
    monkeypatch.setattr(state_slots, "write", _fail)
    monkeypatch.setattr(Path, "unlink", _fail)
    assert not first.write({"state": "aborted"})
    assert "after a reboot the vehicle would hold" in first.status
    assert path.read_bytes() == before, "it could not be invalidated"
    assert read_state(path, "") == ({"state": "aborted"}, "")
    again = StateFile(path, MISSION, start="a")
    assert (again.values, again.rebooted, again.lost) == ({"state": "aborted"}, False, "")
    later = StateFile(path, MISSION, start="b")
    assert (later.values, later.rebooted) == ({"state": "aborted"}, True)
    monkeypatch.undo()
    monkeypatch.setattr(state_memory, "MEMORY", memory)
    assert later.write({"state": "holding"}), "the card writes again"
    for copy in memory.iterdir():
        copy.unlink()
    assert StateFile(path, MISSION, start="c").values == {"state": "holding"}


def test_without_memory_and_card_an_old_state_is_not_trusted(
    tmp_path: Path, memory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "safety.state"
    first = StateFile(path, MISSION, start="a")
    first.write({"state": "running"})
    before = path.read_bytes()
    monkeypatch.setattr(os, "pwrite", lambda *_: 0)
    assert not first.write({"state": "aborted"})
    monkeypatch.undo()
    monkeypatch.setattr(state_memory, "MEMORY", memory)
    path.write_bytes(before)  # the card did not take the mark either
    assert read_state(path, "")[1]
    again = StateFile(path, MISSION, start="a")
    assert again.values == {}
    assert "an earlier process could not write it" in again.lost


def test_a_copy_of_another_state_or_user_does_not_count(tmp_path: Path, memory: Path) -> None:
    path = tmp_path / "safety.state"
    StateFile(path, MISSION, start="a").write({"state": "running"})
    (copy,) = memory.iterdir()
    path.write_bytes(path.read_bytes()[:-1])
    assert StateFile(path, MISSION, start="b").lost, "a damaged file after a reboot"
    copy.unlink()
    copy.symlink_to(path)
    assert StateFile(path, MISSION, start="b").lost
    assert path.stat().st_size == FILE_BYTES


def test_a_slow_disk_does_not_stop_the_caller(tmp_path: Path, memory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "safety.state"
    state = StateFile(path, MISSION, start="a")
    assert state.write({"number": 0}, 20.0)
    is_synced, sync = threading.Event(), state_slots.write

    def slow(file: int, data: bytes, offset: int) -> None:
        is_synced.wait(60.0)
        sync(file, data, offset)

    monkeypatch.setattr(state_slots, "write", slow)
    monkeypatch.setattr(latest_writer, "_LATE_S", 0.0)
    for number in (1, 2, 3):
        assert not state.write({"number": number}, 0.0)
        assert read_state(path, "") == ({"number": number}, ""), "what a restarted node would know"
    assert "the disk is slow" in state.status
    is_synced.set()
    assert state.write({"number": 4}), "without a limit it waits for the disk"
    for copy in memory.iterdir():
        copy.unlink()
    assert read_state(path, "") == ({"number": 4}, "")
    assert state.status == ""


def test_a_dropped_state_file_is_closed(tmp_path: Path) -> None:
    before = len(os.listdir("/proc/self/fd"))
    for number in range(20):
        StateFile(tmp_path / f"{number}.state", MISSION).write({"state": "running"})
    assert len(os.listdir("/proc/self/fd")) <= before + 1
