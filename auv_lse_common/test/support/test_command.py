from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
SLOW = "import sys, time\nprint('there', flush=True)\n{}time.sleep(60)\n"


def default_interrupt() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # tests in the background ignore it


def held_interrupt() -> None:
    """As scripts/environment.sh starts Python."""
    default_interrupt()
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def start(
    folder: Path, text: str, *arguments: str, prepare: Callable[[], None] = default_interrupt
) -> subprocess.Popen[str]:
    (folder / "slow.py").write_text(text)
    paths = [str(folder), str(ROOT / "auv_lse_common"), os.environ.get("PYTHONPATH", "")]
    return subprocess.Popen(
        [sys.executable, "-m", "auv_lse_common.support.command", "slow", *arguments],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=prepare,
    )


def test_ctrl_c_during_an_import_prints_one_word_and_returns_130(tmp_path: Path) -> None:
    with start(tmp_path, SLOW.format("")) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "there\n"
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (130, "", "interrupted\n")


def test_ctrl_c_while_python_starts_is_answered_when_it_can_be(tmp_path: Path) -> None:
    with start(tmp_path, SLOW.format(""), prepare=held_interrupt) as process:
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (130, "", "interrupted\n")


@pytest.mark.parametrize(("end", "code"), [("sys.exit(3)\n", 3), ("sys.exit(int(len(sys.argv) != 3))\n", 0)])
def test_exit_code_and_arguments_belong_to_the_module(tmp_path: Path, end: str, code: int) -> None:
    with start(tmp_path, SLOW.format(end), "a", "b c") as process:
        process.communicate(timeout=30)
    assert process.returncode == code


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "import tornado_of_nobody.web",
            "slow needs the Python package tornado_of_nobody, which is not installed: pip",
        ),
        (
            "from auv_lse_common.support.missing_packages import missing\n"
            "raise missing(ImportError('gone', name='jinja2'), 'reports')",
            "reports need the Python package jinja2, which is not installed: sudo apt install python3-jinja2",
        ),
    ],
    ids=["imported", "reported"],
)
def test_a_missing_package_is_named_without_a_traceback(tmp_path: Path, text: str, expected: str) -> None:
    with start(tmp_path, text) as process:
        output, errors = process.communicate(timeout=30)
    assert errors.startswith(f"error: {expected}")
    assert "Traceback" not in errors
    assert (process.returncode, output) == (2, "")


@pytest.mark.parametrize("text", ["import auv_lse_common.nowhere", "from math import nothing"])
def test_a_wrong_import_of_the_stack_itself_keeps_its_traceback(tmp_path: Path, text: str) -> None:
    with start(tmp_path, text) as process:
        _, errors = process.communicate(timeout=30)
    assert process.returncode == 1
    assert "Traceback" in errors


def test_a_caught_interrupt_within_an_evaluated_string_keeps_the_exit_code(tmp_path: Path) -> None:
    """Python would end by SIGINT instead; libraries evaluate strings, rosbags for one."""
    text = "import sys\ntry:\n    exec('raise KeyboardInterrupt')\nexcept KeyboardInterrupt:\n    sys.exit(7)\n"
    with start(tmp_path, text) as process:
        process.communicate(timeout=30)
    assert process.returncode == 7


def test_every_python_script_uses_the_command_module() -> None:
    for script in sorted((ROOT / "scripts").iterdir()):
        assert "exec python -m" not in script.read_text() or script.name == "environment.sh", script.name
