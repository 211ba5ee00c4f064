"""The key's file: made once, readable by its owner alone, and never shown."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from full_disk import full_disk
from verb_main import verb_main

from auv_lse_comms.packet.key import KeyFileError, make_key, read_key

main = verb_main("key")

KEY = bytes(range(32))


def write(path: Path, text: str, mode: int = 0o600) -> Path:
    path.write_text(text)
    path.chmod(mode)
    return path


def test_key_from_a_file(tmp_path: Path) -> None:
    assert read_key(write(tmp_path / "key", KEY.hex() + "\n")) == KEY
    assert read_key(write(tmp_path / "short", "00" * 16, 0o400)) == bytes(16)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o644, 0o601])
def test_key_file_open_to_others_is_refused(tmp_path: Path, mode: int) -> None:
    path = write(tmp_path / "key", KEY.hex(), mode)
    with pytest.raises(KeyFileError, match=f"mode 0{mode:o} gives others access to the key. Restrict it: chmod 600"):
        read_key(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("not hexadecimal at all", "not hexadecimal; name a file made by auv_lse key"),
        ("\xff\xfe", "not hexadecimal"),
        ("00" * 15, "15 bytes; a key has 16 to 32"),
        ("00" * 33, "33 bytes; a key has 16 to 32"),
        ("", "0 bytes; a key has 16 to 32"),
    ],
)
def test_key_file_without_a_key_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(KeyFileError, match=message) as caught:
        read_key(write(tmp_path / "key", text))
    assert not text or text not in str(caught.value)


def test_key_file_that_is_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(KeyFileError, match="missing: cannot be read: No such file"):
        read_key(tmp_path / "missing")
    with pytest.raises(KeyFileError, match="cannot be read: Is a directory"):
        read_key(tmp_path)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")
def test_key_file_of_another_user_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "key", KEY.hex())
    os.chown(path, 12345, -1)
    with pytest.raises(KeyFileError, match="belongs to user 12345"):
        read_key(path)


def test_a_key_is_made_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "a key of the team \u00e9"
    before = os.umask(0)
    try:
        assert main([str(file)]) == 0
    finally:
        os.umask(before)
    key = read_key(file)
    assert len(key) == 32
    assert file.stat().st_mode & 0o777 == 0o600
    assert main([str(file)]) == 2
    assert "exists already. Choose a new file" in capsys.readouterr().err
    assert read_key(file) == key
    make_key(tmp_path / "other")
    assert read_key(tmp_path / "other") != key


def test_a_key_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(KeyFileError, match="cannot be created: No such file or directory"):
        make_key(tmp_path / "no" / "key")
    with full_disk(10), pytest.raises(KeyFileError, match="cannot be written: File too large"):
        make_key(tmp_path / "key")
    assert not (tmp_path / "key").exists()
