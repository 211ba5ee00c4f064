"""Which fleet file auv_lse fleet reads and writes."""

from __future__ import annotations

from pathlib import Path

import pytest

from auv_lse_run.command.main import main


def test_a_folder_is_not_taken_for_the_file_in_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fleet", str(tmp_path), "check"]) == 2
    assert (
        f"{tmp_path} is a folder. Name the fleet file in it, such as {tmp_path}/fleet.yaml" in capsys.readouterr().err
    )
    assert main(["fleet", str(tmp_path), "init"]) == 2
    assert "is a folder" in capsys.readouterr().err


def test_the_fleet_file_may_be_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["fleet", "init", "auv@auv1.local", "auv2:2222"]) == 0
    assert "auv1.local" in Path("fleet.yaml").read_text()
    assert main(["fleet", "abort", "auv3"]) == 2
    assert "auv3 is not in fleet.yaml" in capsys.readouterr().err
    assert main(["fleet", "check", "init"]) == 0, "a file named as a verb"
    assert Path("check").is_file()
    assert main(["fleet", "check", "abort", "auv3"]) == 2
    assert "auv3 is not in check" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "wrong"), [("abrt auv2", "abrt"), ("fleet.yaml abrt auv2", "abrt"), ("lake.yaml auv2", "auv2")]
)
def test_a_misspelled_verb_is_named_and_not_the_vehicle(
    words: str, wrong: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["fleet", *words.split()])
    assert f"argument VERB: invalid choice: '{wrong}'" in capsys.readouterr().err
