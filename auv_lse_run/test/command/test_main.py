"""The command auv_lse: its help, its verbs, and how it ends."""

from __future__ import annotations

import argparse
import importlib
import os
import resource
import signal
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from auv_lse_common.support.verb import GROUPS, Verb
from auv_lse_run.command import find_verbs as finding
from auv_lse_run.command import main as command
from auv_lse_run.command.parsing import parsed

ROOT = Path(__file__).resolve().parents[3]
TABLES = sorted(path.parent.name for path in ROOT.glob("auv_lse_*/auv_lse_*/verbs.py"))


def verbs_of(package: str) -> tuple[Verb, ...]:
    table: tuple[Verb, ...] = importlib.import_module(f"{package}.verbs").VERBS
    return table


def use_tables(monkeypatch: pytest.MonkeyPatch, *entries: str) -> None:
    found = [EntryPoint(value.partition(".")[0], value, "auv_lse.verbs") for value in entries]
    monkeypatch.setattr(finding, "entry_points", lambda group: found)


def test_every_verb_is_known_with_its_package() -> None:
    declared = {verb.name: package for package in TABLES for verb in verbs_of(package)}
    assert declared == finding.PACKAGE_OF


@pytest.mark.parametrize("package", TABLES)
def test_a_table_imports_nothing_else_and_reads_well(package: str) -> None:
    source = (ROOT / package / package / "verbs.py").read_text()
    imports = [line for line in source.splitlines() if line.startswith(("import", "from"))]
    assert [line.split()[1] for line in imports] == ["auv_lse_common.support.verb"]
    for verb in verbs_of(package):
        assert verb.group in GROUPS
        assert 10 < len(verb.text) <= 75
        assert not verb.text.endswith(".")


def test_help_shows_every_verb_in_its_group(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    use_tables(monkeypatch, *(f"{package}.verbs:VERBS" for package in TABLES))
    assert command.main(["--help"]) == 0
    text = capsys.readouterr().out
    parts = {part.partition(":\n")[0]: part for part in text.split("\n\n")}
    for verb in (verb for package in TABLES for verb in verbs_of(package)):
        assert f"\n  {verb.name} " in parts[GROUPS[verb.group]]


def test_a_verb_of_a_missing_package_names_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    use_tables(monkeypatch, "auv_lse_run.verbs:VERBS")
    assert command.main(["live"]) == 2
    assert capsys.readouterr().err.startswith("error: auv_lse live needs the package auv_lse_shore, which is not ")


@pytest.mark.parametrize(
    ("word", "words"),
    [
        ("exprot", "error: auv_lse has no verb exprot. Did you mean export?\n"),
        ("report", "error: auv_lse has no verb report. See replay, or list the verbs: auv_lse --help\n"),
        ("start", "error: auv_lse has no verb start. See go, or list the verbs: auv_lse --help\n"),
        ("zzz", "error: auv_lse has no verb zzz. List the verbs: auv_lse --help\n"),
        ("--verison", "error: auv_lse has no option --verison. List the verbs: auv_lse --help\n"),
    ],
)
def test_a_wrong_verb_gets_a_hint(word: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main([word]) == 2
    assert capsys.readouterr().err == words


def test_help_and_version_need_no_dashes(capsys: pytest.CaptureFixture[str]) -> None:
    for word in ("help", "version"):
        assert command.main([word]) == 0
        plain = capsys.readouterr().out
        assert command.main([f"--{word}"]) == 0
        assert capsys.readouterr().out == plain != ""


def test_a_broken_table_leaves_the_other_verbs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    use_tables(monkeypatch, "nobody_has_this.verbs:VERBS", "auv_lse_record.verbs:VERBS")
    assert command.main(["--help"]) == 0
    out, err = capsys.readouterr()
    assert "recover" in out
    assert err.startswith("warning: the verbs of nobody_has_this cannot be loaded (nobody_has_this.verbs:VERBS): ")


def test_another_packages_verb_is_called_with_the_users_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "their_verbs.py").write_text(
        "from auv_lse_common.support.verb import Verb\n"
        "VERBS = (Verb('greet', 'Greetings', 'greet somebody', 'their_greeting'),\n"
        "         Verb('recover', 'Greetings', 'not ours', 'their_greeting'))\n"
    )
    (tmp_path / "their_greeting.py").write_text(
        "import argparse\n"
        "ERRORS = (LookupError,)\n"
        "INTERRUPTED = 'nobody was greeted'\n"
        "def parser():\n    p = argparse.ArgumentParser(prog='auv_lse greet')\n"
        "    p.add_argument('name')\n    return p\n"
        "def run(options):\n"
        "    if options.name == 'nobody': raise LookupError('there is nobody')\n"
        "    if options.name == 'late': raise KeyboardInterrupt\n"
        "    print('hello', options.name)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    use_tables(monkeypatch, "their_verbs:VERBS", "auv_lse_record.verbs:VERBS")
    assert command.main(["greet", "Ada"]) == 0
    assert capsys.readouterr().out == "hello Ada\n"
    assert command.main(["greet", "nobody"]) == 2
    assert capsys.readouterr().err == "error: there is nobody\n"
    assert command.main(["greet", "late"]) == 130
    assert capsys.readouterr().err == "nobody was greeted\n"
    assert command.main(["--help"]) == 0
    text = capsys.readouterr().out
    assert "Greetings:\n  greet " in text
    assert "not ours" not in text


@pytest.mark.parametrize(
    "how", ["raise MemoryError", "raise ImportError('x.so: failed to map segment from shared object')"]
)
def test_a_limit_of_memory_that_is_too_small_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], how: str
) -> None:
    (tmp_path / "large_verbs.py").write_text(
        "from auv_lse_common.support.verb import Verb\nVERBS = (Verb('load', 'Large', 'load it', 'large_library'),)\n"
    )
    (tmp_path / "large_library.py").write_text(how)
    monkeypatch.syspath_prepend(tmp_path)
    use_tables(monkeypatch, "large_verbs:VERBS")
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (900 * 2**20, resource.RLIM_INFINITY))
    assert command.main(["load"]) == 2
    assert capsys.readouterr().err == (
        "error: auv_lse load: the memory that it may use (ulimit -v) is too small: 900 MB. Raise the limit: "
        "ulimit -v unlimited\n"
    )
    monkeypatch.undo()
    monkeypatch.syspath_prepend(tmp_path)
    use_tables(monkeypatch, "large_verbs:VERBS")
    with pytest.raises((MemoryError, ImportError)):  # without a limit it is another fault
        command.main(["load"])


def test_the_help_of_the_command_imports_no_library() -> None:
    code = "import sys, auv_lse_run.command.main as m; m.main(['--help']); print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    heavy = {"numpy", "scipy", "yaml", "rclpy", "argparse", "rich"} - {*_loaded_at_start()}
    assert not heavy & {*done.stderr.split()}


def _loaded_at_start() -> list[str]:
    code = "import sys; print(*sys.modules)"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()


def _block_interrupts() -> None:
    """As scripts/auv_lse does; a shell may have started these tests with interrupts ignored."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def test_ctrl_c_ends_a_verb_with_one_line(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "auv_lse_run", "fit", str(tmp_path)], stderr=subprocess.PIPE, text=True,
        preexec_fn=_block_interrupts,
    )  # fmt: skip
    process.send_signal(signal.SIGINT)  # waits until the command can answer it
    _, err = process.communicate(timeout=60.0)
    assert process.returncode == 130
    assert len(err.splitlines()) == 1


def test_a_closed_pipe_is_no_error() -> None:
    done = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {sys.executable} -m auv_lse_run --help | head -n 1 > /dev/null"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("topics", "--domain", ""), "error: --domain is empty."),
        (("topics", "--domain="), "error: --domain is empty."),
        (("nodes", ""), "error: auv_lse nodes: argument 1 is empty."),
    ],
)
def test_an_empty_argument_is_named(words: tuple[str, ...], expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(words) == 2
    assert expected in capsys.readouterr().err


@pytest.mark.parametrize(("words", "code"), [(["check", "nosuch"], 2), (["nosuch"], 2), (["--version"], 0)])
def test_a_full_disk_behind_standard_error_changes_no_exit_code(words: list[str], code: int) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([sys.executable, "-m", "auv_lse_run", *words], stderr=full, stdout=-1, check=False)
    assert done.returncode == code
    assert done.stdout.strip() or code


def test_errors_reach_standard_error() -> None:
    done = subprocess.run([sys.executable, "-m", "auv_lse_run", "nosuch"], capture_output=True, text=True, check=False)
    assert done.stderr.startswith("error: auv_lse has no verb nosuch")
    assert done.stderr.endswith("\n")


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("words", [["--help"], ["export", "--help"], ["params", "set", "--help"], ["--version"]])
def test_help_on_a_full_disk_is_an_error(words: list[str], unbuffered: str) -> None:
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "auv_lse_run", *words],
            stdout=full,
            stderr=-1,
            env=environment,
            check=False,
            text=True,
        )
    assert done.stderr == "error: standard output: No space left on device. Send it elsewhere, or free space\n"
    assert done.returncode == 1


@pytest.mark.parametrize("value", ["-,lat,lon,depth", "-,-", "-1.5", "-.5", "-"])
def test_a_value_may_begin_with_a_sign(value: str) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--columns")
    parser.add_argument("-v", action="store_true")
    assert parsed(parser, ["--columns", value, "-v"]) == argparse.Namespace(columns=value, v=True)
