"""The command line of the verbs that talk to running nodes."""

from __future__ import annotations

import argparse

import pytest

from auv_lse_run.command.main import main
from auv_lse_run.command.parsing import parsed
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


@pytest.mark.parametrize(
    ("words", "verb", "problem"),
    [
        (["state", "auv1"], "state", "unrecognized arguments: auv1"),
        (
            ["topics", "hz", "/clock", "--duration", "1", "--nosuch"],
            "topics hz",
            "unrecognized arguments: --nosuch",
        ),
        (
            ["topics", "hz", "/clock", "--window", "x"],
            "topics hz",
            "--window: 'x' is not a whole number",
        ),
        (
            ["topics", "hz", "/clock", "--window", "0"],
            "topics hz",
            "--window: '0' is not a whole number",
        ),
        (["topics", "hz", "/clock", "--duration", "-1"], "topics hz", "'-1' is not a number above 0"),
        (["topics", "echo", "/clock", "-l", "x"], "topics echo", "'x' is not a whole number"),
    ],
)
def test_an_error_is_one_of_the_verb_that_was_called(
    words: list[str], verb: str, problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(words)
    text = capsys.readouterr().err
    assert text.startswith(f"usage: auv_lse {verb} ")
    assert problem in text


def test_numbers_that_python_reads_stay_numbers() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--whole", type=int, default="7")
    parser.add_argument("--number", type=float)
    assert vars(parsed(parser, ["--number", "-0.001"])) == {"whole": 7, "number": -0.001}
    assert parsed(parser, ["--whole", "-2"]).whole == -2
