"""Files reach a vehicle's folder whole or not at all; recordings leave it only when a verified copy exists."""

from __future__ import annotations

import errno
import hashlib
import os
from pathlib import Path

import pytest

from auv_lse_run.remote import facts
from auv_lse_run.remote.session import Session, Stream
from auv_lse_run.remote.vehicle_folder import FolderError, VehicleFolder
from auv_lse_run.remote.wire import WireError, decoded


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def test_files_are_installed_together_or_not_at_all(tmp_path: Path) -> None:
    folder = VehicleFolder(tmp_path)
    folder.receive("mission.yaml", digest(b"new"), b"new")
    (tmp_path / "mission.yaml").write_bytes(b"old")
    with pytest.raises(FolderError, match=r"team\.key was not sent completely"):
        folder.install({"mission.yaml": digest(b"new"), "team.key": digest(b"key")}, "auv1")
    assert (tmp_path / "mission.yaml").read_bytes() == b"old"
    folder.receive("team.key", digest(b"key"), b"key")
    folder.install({"mission.yaml": digest(b"new"), "team.key": digest(b"key")}, "auv1")
    assert (tmp_path / "mission.yaml").read_bytes() == b"new"
    assert (tmp_path / "team.key").stat().st_mode & 0o077 == 0
    with pytest.raises(FolderError, match="is the folder of auv1, not of auv2"):
        folder.install({"mission.yaml": digest(b"new")}, "auv2")


@pytest.mark.parametrize("name", ["../x", "a/b", "", ".ssh", "dives", "fleet"])
def test_a_sent_file_stays_in_the_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(FolderError):
        VehicleFolder(tmp_path).receive(name, digest(b"x"), b"x")


def test_damaged_bytes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FolderError, match="arrived damaged"):
        VehicleFolder(tmp_path).receive("mission.yaml", digest(b"x"), b"y")


def test_a_recording_is_removed_only_with_the_hash_of_its_copy(tmp_path: Path) -> None:
    bag = tmp_path / "dives" / "one" / "bag"
    bag.mkdir(parents=True)
    (bag / "bag.mcap").write_bytes(b"soundings")
    (tmp_path / "secret").write_text("")
    folder = VehicleFolder(tmp_path)
    assert folder.recordings("") == [{"path": "one/bag/bag.mcap", "size": 9}]
    assert folder.recordings(str(tmp_path / "dives" / "one")) == [], "its dive runs"
    with pytest.raises(FolderError, match="was not removed"):
        folder.remove("one/bag/bag.mcap", digest(b"others"))
    with pytest.raises(FolderError, match="no recording"):
        folder.remove("../secret", digest(b""))
    folder.remove("one/bag/bag.mcap", digest(b"soundings"))
    assert not (tmp_path / "dives" / "one").exists()


def test_nothing_is_installed_into_a_running_dive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("auv_lse_run.remote.session.vehicle_on", lambda domain, vehicle: ("", "dive", 1))
    answer = Session(tmp_path, 1, 230).answer({"ask": "install", "files": {}})
    assert "A dive is running" in answer["error"]


def test_a_request_that_makes_no_sense_is_answered(tmp_path: Path) -> None:
    session = Session(tmp_path, 1, 230)
    assert "does not know" in session.answer({"ask": "dance"})["error"]
    assert "incomplete" in session.answer({"ask": "install"})["error"]
    assert "is not an order" in session.answer({"ask": "order", "laptop": "a", "number": 1, "verb": "fly"})["error"]
    for line in (b"[1]", b"[" * 3000):
        with pytest.raises(WireError):
            decoded(line)


def test_findings_are_the_lines_of_a_check_that_matter() -> None:
    text = "mission.yaml\n  error    depth: too deep\n  warning  slots\nMISSING heartbeat\nok      GPS\n1 missing\n"
    found = [(finding["level"], finding["text"]) for finding in facts.findings_in("modem", text)]
    assert found == [("error", "depth: too deep"), ("warning", "slots"), ("error", "heartbeat")]


def test_lines_and_bytes_follow_each_other_until_the_other_side_closes() -> None:
    read, write = os.pipe()
    stream = Stream(read, write)
    stream.send(b'{"a":1}\n12345rest\n')
    assert (stream.line(1.0), stream.block(5, 1.0), stream.line(1.0)) == (b'{"a":1}', b"12345", b"rest")
    assert stream.line(0.01) == b"", "nothing comes"
    os.close(write)
    assert stream.block(5, 1.0) == b"", "the other side has closed"
    os.close(read)


def test_a_full_disk_is_named_with_the_cure_and_keeps_no_piece(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    asked = {"ask": "put", "name": "mission.yaml", "sha256": digest(b"x"), "data": b"x"}
    answer = Session(tmp_path, 1, 81).answer(asked)
    assert "has no room for mission.yaml" in answer["error"]
    assert "fetch --delete" in answer["error"]
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_the_folder_of_another_user_is_named_with_the_cure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    problem = VehicleFolder(tmp_path).problem()
    assert f"belongs to user {os.geteuid()}" in problem
    assert "sudo chown -R" in problem
    asked = {"ask": "put", "name": "mission.yaml", "sha256": digest(b"x"), "data": b"x"}
    assert Session(tmp_path, 1, 81).answer(asked) == {"error": problem}


def test_a_damaged_recording_ends_no_session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = tmp_path / "dives" / "one" / "bag"
    bag.mkdir(parents=True)
    session = Session(tmp_path, 1, 81)
    asked = {"ask": "excerpt", "cursor": {"dive": "one"}, "topics": {"/auv1/odometry": 2.0}}
    chunk = b"\x06" + (40).to_bytes(8, "little") + bytes(range(40))
    for data in (
        b"no MCAP at all",
        b"\x89MCAP0\r\n" + chunk,
        b"\x89MCAP0\r\n\x05" + (3).to_bytes(8, "little") + b"abc",
    ):
        (bag / "bag.mcap").write_bytes(data)
        assert "Its recording cannot be read: " in session.answer(asked)["error"]
    (bag / "bag.mcap").write_bytes(b"\x89MCAP0\r\n\x03\x00")  # the recorder is writing
    assert session.answer(asked)["data"] == b""
    assert session.answer({**asked, "cursor": {"dive": "../../etc"}}) == {"cursor": {}, "more": False}
