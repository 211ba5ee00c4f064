"""Journals: what a killed process wrote is read back; a torn line, another mission and a full disk do no harm."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
import zlib
from pathlib import Path

import numpy as np
import pytest

from auv_lse_common.node.journal import Journal

MISSION = {"vehicle": 2, "steps": 100}


def test_records_are_read_back_exactly(tmp_path: Path) -> None:
    path = tmp_path / "a folder" / "gp é.journal"
    values = [0.1 + 0.2, 1e-300, -0.0, math.inf, "Zürich", None, True, 2**100, [1, [2.5]], {"a": [1]}]
    first = Journal(path, MISSION)
    assert first.records == []
    first.write("step", values)
    first.write("plan")
    again = Journal(path, MISSION)
    assert again.records == [["step", values], ["plan"]]
    again.write("more", 1)
    assert len(Journal(path, MISSION).records) == 3
    assert again.status == "2 records read back"


def test_journal_of_another_mission_is_set_aside(tmp_path: Path) -> None:
    path = tmp_path / "gp.journal"
    Journal(path, MISSION).write("step", 1)
    other = Journal(path, {**MISSION, "steps": 101})
    assert other.records == []
    other.write("step", 2)
    assert Journal(path, {**MISSION, "steps": 101}).records == [["step", 2]]
    assert b'["step",1]' in (tmp_path / "gp.journal.old").read_bytes()


def test_truncated_file_yields_its_complete_lines(tmp_path: Path) -> None:
    path = tmp_path / "gp.journal"
    journal = Journal(path, MISSION)
    for number in range(3):
        journal.write("step", number)
    data = path.read_bytes()
    ends = [i for i, byte in enumerate(data) if byte == ord("\n")]
    for cut in range(ends[0] + 1, len(data) + 1):
        path.write_bytes(data[:cut])
        read = Journal(path, MISSION)
        whole = sum(end <= cut for end in ends[1:])  # a line without its end is whole, too
        assert read.records == [["step", number] for number in range(whole)]
        read.write("after")
        assert Journal(path, MISSION).records[whole:] == [["after"]]


def test_damaged_bytes_are_skipped(tmp_path: Path) -> None:
    path, rng = tmp_path / "gp.journal", np.random.default_rng(1)
    for _ in range(100):
        path.unlink(missing_ok=True)
        journal = Journal(path, MISSION)
        journal.write("step", 1)
        data = bytearray(path.read_bytes())
        for position in rng.integers(len(data), size=3):
            data[position] = rng.integers(256)
        path.write_bytes(bytes(data) + rng.bytes(20))
        assert Journal(path, MISSION).records in ([], [["step", 1]])


def test_unwritable_journal_is_reported_without_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    journal = Journal(tmp_path / "file" / "gp.journal", MISSION)
    journal.write("step", 1)
    assert not journal.kept
    assert "cannot be written: " in journal.status
    assert "a restart would lose the node's state" in journal.status
    if Path("/dev/full").exists():
        full = Journal(tmp_path / "gp.journal", MISSION)
        number = os.open("/dev/full", os.O_WRONLY)
        os.dup2(number, full._file)
        os.close(number)
        full.write("step", 1)
        full.write("step", 2)
        assert "No space left on device" in full.problem
    none = Journal(None, MISSION)
    none.write("step", 1)
    assert (none.status, none.kept, none.records) == ("", False, [])


@pytest.mark.skipif(sys.platform != "linux", reason="sends SIGKILL")
def test_killed_process_leaves_complete_records(tmp_path: Path) -> None:
    path = tmp_path / "gp.journal"
    writer = (
        "import sys; from pathlib import Path; from auv_lse_common.node.journal import Journal\n"
        "j = Journal(Path(sys.argv[1]), {})\n"
        "for n in range(10**9): j.write('step', n, 'x' * 300)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", writer, str(path)])
    until = time.monotonic() + 20.0
    while not (path.exists() and path.stat().st_size > 100_000):
        assert time.monotonic() < until
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    read = Journal(path, {})
    assert read.damaged == 0
    assert [record[1] for record in read.records] == list(range(len(read.records)))


def fill_the_disk(journal: Journal) -> None:
    """Further writes fail, as on a full disk."""
    number = os.open("/dev/full", os.O_WRONLY)
    os.dup2(number, journal._file)
    os.close(number)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_journal_that_could_not_be_continued_is_not_restored(tmp_path: Path) -> None:
    """An aborted vehicle once came back without its abort, and dived again: its journal ended before the abort."""
    path = tmp_path / "safety.journal"
    journal = Journal(path, MISSION)
    journal.write("standing", "running")
    fill_the_disk(journal)
    journal.write("standing", "aborted")
    assert "cannot be written" in journal.problem

    after = Journal(path, MISSION)
    assert after.records == []
    assert "is out of date" in after.stale
    assert after.stale in after.status
    assert os.path.getsize(path) < 100  # the old records are gone, which also frees space

    after.write("standing", "holding")  # there is space again
    last = Journal(path, MISSION)
    assert last.records == [["standing", "holding"]]
    assert last.stale


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_journal_that_fails_again_is_stale_again(tmp_path: Path) -> None:
    path = tmp_path / "safety.journal"
    for text in ("first", "second"):
        journal = Journal(path, MISSION)
        journal.write("standing", text)
        fill_the_disk(journal)
        journal.write("standing", "lost")
    after = Journal(path, MISSION)
    assert after.stale
    assert after.records == []


def test_journal_with_which_a_node_fails_is_repeated_once(tmp_path: Path) -> None:
    path = tmp_path / "gp.journal"
    Journal(path, MISSION).write("step", "bad")
    journal = Journal(path, MISSION)
    with pytest.raises(OverflowError), journal.restoring():
        raise OverflowError("cannot convert float infinity to integer")
    after = Journal(path, MISSION)
    assert (after.records, after.damaged) == ([], 0)
    assert "failed when it repeated it" in after.stale
    with after.restoring():
        after.write("step", "good")
    assert Journal(path, MISSION).records == [["step", "good"]]


@pytest.mark.parametrize("mark", [b"?", b"!"])
def test_process_killed_while_marking_leaves_a_stale_journal(tmp_path: Path, mark: bytes) -> None:
    path = tmp_path / "safety.journal"
    journal = Journal(path, MISSION)
    journal.write("standing", "running")
    data = path.read_bytes()
    path.write_bytes(mark + data[1:])
    after = Journal(path, MISSION)
    assert after.stale
    assert after.records == ([] if mark == b"?" else [["standing", "running"]])
    assert Journal(path, MISSION).stale


def test_journal_of_another_mission_is_not_stale(tmp_path: Path) -> None:
    path = tmp_path / "safety.journal"
    Journal(path, MISSION).write("standing", "running")
    path.write_bytes(b"!" + path.read_bytes()[1:])
    assert not Journal(path, {**MISSION, "steps": 101}).stale


def test_unreadable_journal_is_stale(tmp_path: Path) -> None:
    path = tmp_path / "safety.journal"
    path.mkdir()
    journal = Journal(path, MISSION)
    assert journal.stale
    assert journal.problem


def test_journal_that_cannot_be_continued_is_stale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a disk that has become read-only the mark cannot be written either."""
    path = tmp_path / "safety.journal"
    Journal(path, MISSION).write("standing", "running")

    def read_only(*_: object) -> int:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(os, "open", read_only)
    journal = Journal(path, MISSION)
    assert journal.records == []
    assert "Read-only file system" in journal.stale


def test_first_start_without_a_journal_folder_is_not_stale(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert not Journal(tmp_path / "file" / "safety.journal", MISSION).stale


@pytest.mark.parametrize("text", ["5", "[]", "{}", "null", "[1,2]", '"step"', "[[]]"])
def test_a_line_of_another_shape_counts_as_damaged_although_its_checksum_fits(tmp_path: Path, text: str) -> None:
    path = tmp_path / "gp.journal"
    Journal(path, MISSION).write("step", 1)
    with path.open("ab") as file:
        file.write(b"%08x %s\n" % (zlib.crc32(text.encode()), text.encode()))
    journal = Journal(path, MISSION)
    assert (journal.records, journal.damaged) == ([["step", 1]], 1)


def test_only_the_last_record_of_a_replaced_kind_is_read(tmp_path: Path) -> None:
    path = tmp_path / "planner.journal"
    journal = Journal(path, MISSION)
    for number in range(3):
        journal.write("decided", number)
        journal.write("heard", number)
    journal.write("judged", "well")
    journal.write("decidedly", "another kind")
    read = Journal(path, MISSION, replaced=("decided", "judged", "never"))
    assert [record for record in read.records if record[0] != "heard"] == [
        ["decided", 2],
        ["judged", "well"],
        ["decidedly", "another kind"],
    ]
    assert read.records.index(["decided", 2]) == 2  # where it was written: after the second "heard"
    assert read.status == "8 records read back"


def test_a_damaged_last_record_leaves_the_one_before_it(tmp_path: Path) -> None:
    path = tmp_path / "planner.journal"
    journal = Journal(path, MISSION)
    for number in range(3):
        journal.write("decided", number)
    path.write_bytes(path.read_bytes()[:-4])
    read = Journal(path, MISSION, replaced=("decided",))
    assert read.records == [["decided", 1]]
    assert read.status == "2 records read back, 1 damaged line skipped"


def test_dropped_records_are_still_counted(tmp_path: Path) -> None:
    path = tmp_path / "gp.journal"
    Journal(path, MISSION).write("step", 1)
    read = Journal(path, MISSION)
    read.drop_records()
    assert read.records == []
    assert read.status == "1 record read back"
    read.write("step", 2)
    assert Journal(path, MISSION).records == [["step", 1], ["step", 2]]
