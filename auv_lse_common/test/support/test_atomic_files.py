"""Files that are written completely or not at all."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from auv_lse_common.support import atomic_files
from auv_lse_common.support.atomic_files import check_folder, written_whole


def _begin_and_raise(path: Path, error: BaseException) -> None:
    path.write_text("new")
    raise error


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")])
def test_an_interrupted_folder_stays_as_it_was(tmp_path: Path, error: BaseException) -> None:
    (tmp_path / "old").write_text("old")
    with pytest.raises(type(error)), written_whole(tmp_path) as part:
        _begin_and_raise(part / "old", error)
    assert [path.name for path in tmp_path.iterdir()] == ["old"]
    assert (tmp_path / "old").read_text() == "old"


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")])
def test_an_interrupted_folder_that_was_missing_is_missing(tmp_path: Path, error: BaseException) -> None:
    with pytest.raises(type(error)), written_whole(tmp_path / "a" / "b") as part:
        _begin_and_raise(part / "file", error)
    assert not list(tmp_path.iterdir())


def test_an_error_names_the_folder_that_the_user_knows(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No such file") as caught, written_whole(tmp_path / "a") as part:
        (part / "nowhere" / "file").write_text("new")
    assert caught.value.filename == str(tmp_path / "a")


@pytest.mark.parametrize("name", ["file", "file/below", "file/below/it", "broken"])
def test_a_file_in_the_way_of_a_folder_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "broken").symlink_to(tmp_path / "nowhere")
    with pytest.raises(NotADirectoryError) as caught:
        check_folder(tmp_path / name)
    assert caught.value.filename == str(tmp_path / name.split("/", maxsplit=1)[0])


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(atomic_files.os, "access", lambda path, mode: False)  # the tests may run as root
    with pytest.raises(PermissionError) as caught:
        check_folder(tmp_path / "new")
    assert caught.value.filename == str(tmp_path)


@pytest.mark.parametrize("name", ["", "new", "new/newer", "link", "link/new", "with space/ü"])
def test_folders_that_can_be_written_pass_and_are_not_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there")
    before = sorted(tmp_path.rglob("*"))
    check_folder(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    check_folder(Path(name))
    assert sorted(tmp_path.rglob("*")) == before
