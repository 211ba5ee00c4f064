"""The command line of the verbs that talk to running nodes."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from auv_lse_run.command.main import main
from auv_lse_run.command.parsing import parsed
from auv_lse_run.inspect import domain_choice, run
from auv_lse_run.process import domain


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
            "unrecognized arguments: --nosuch\n",
        ),
        (
            ["topics", "hz", "/clock", "--durration=1"],
            "topics hz",
            "unrecognized arguments: --durration=1. Did you mean --duration?",
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


@pytest.mark.parametrize(("option", "problem"), [("--whole", "a whole number"), ("--number", "a number")])
def test_wrong_numbers_are_named_in_plain_words_by_verbs_within_a_verb(
    option: str, problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    outer = argparse.ArgumentParser()
    inner = outer.add_subparsers().add_parser("inner")
    inner.add_argument("--whole", type=int)
    inner.add_argument("--number", type=float)
    with pytest.raises(SystemExit, match="2"):
        parsed(outer, ["inner", option, "x"])
    assert f"'x' is not {problem}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "changes"),
    [
        ("params set /auv1/planner_node planner.iterations 40", True),
        ("params get /auv1/planner_node planner.iterations", False),
        ("params list", False),
        ("params dump /auv1/planner_node", False),
        ("abort all", True),
        ("reset auv1", True),
        ("state", False),
        ("nodes list", False),
        ("topics list", False),
    ],
)
def test_only_what_changes_running_nodes_refuses_another_users_simulation(
    words: str, changes: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """To look is harmless: it goes on to the ROS domain, which ends this test."""
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.setattr(domain.tempfile, "gettempdir", lambda: str(tmp_path))

    def stop(number: int) -> None:
        raise domain.DomainError(f"joins {number}")

    monkeypatch.setattr(domain_choice, "confine_to", stop)
    with domain.simulator_domain(None) as number:
        monkeypatch.setattr(domain.os, "geteuid", lambda: 54321)
        assert main(words.split()) == 2
    expected = f"To command it: --domain {number}" if changes else f"joins {number}"
    assert expected in capsys.readouterr().err
