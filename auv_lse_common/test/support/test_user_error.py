"""Errors in words."""

from pathlib import Path

import pytest

from auv_lse_common.support.user_error import brief, error_text


def test_unopened_file_is_named_without_an_error_number(tmp_path: Path) -> None:
    missing = tmp_path / "no such file"
    with pytest.raises(OSError) as caught:  # noqa: PT011  # any of its kinds
        missing.read_bytes()
    assert error_text(caught.value) == f"{missing}: No such file or directory"


def test_file_instead_of_a_folder_is_reported(tmp_path: Path) -> None:
    file = tmp_path / "a file"
    file.write_text("")
    with pytest.raises(FileExistsError) as caught:
        file.mkdir()
    assert error_text(caught.value) == f"{file} is a file, not a folder; choose another name"
    assert error_text(FileExistsError("there already")) == "there already"


def test_error_text_is_the_message_or_the_class_name() -> None:
    assert error_text(ValueError("--rate must be above 0")) == "--rate must be above 0"
    assert error_text(OSError("the disk is full")) == "the disk is full"
    assert error_text(RuntimeError()) == "RuntimeError"


def test_an_error_that_quotes_a_file_is_cut() -> None:
    assert brief(ValueError("two\nlines.")) == "two lines"
    assert len(brief(ValueError("x" * 3000))) < 250
