"""The command line of the verbs that talk to running nodes."""

from __future__ import annotations

import pytest

from auv_lse_run.inspect import run


@pytest.mark.parametrize("given", ["-1", "0", "nan", "soon"])
def test_a_spin_time_that_is_no_time_is_refused(given: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        run.parser().parse_args(["state", "--spin-time", given])
    assert f"--spin-time: '{given}' is not a number above 0" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("verb", "description", "code"),
    [
        ("go", "Start the mission, or continue after a hold.", "every vehicle has accepted the command"),
        ("state", "Show the state of each vehicle's mission.", "every vehicle has reported its state"),
    ],
)
def test_the_help_of_a_verb_is_about_that_verb(
    verb: str, description: str, code: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="0"):
        run.parser().parse_args([verb, "--help"])
    text = " ".join(capsys.readouterr().out.split())
    assert description in text
    assert f"Exit codes: 0 {code}; 1 " in text
