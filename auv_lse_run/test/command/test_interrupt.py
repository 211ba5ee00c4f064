"""How a verb ends: Ctrl-C, exit codes, packages that are missing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

SLOW = "import sys, time\nprint('there', flush=True)\n{}time.sleep(60)\n"
#: Runs `slow` as another package's verb.
CALL = """\
import sys
from auv_lse_common.support.verb import Verb
from auv_lse_run.command import main
main.find_verbs = lambda: ({"slow": Verb("slow", "Others", "wait", "slow")}, [])
if __name__ == "__main__":
    sys.exit(main.main(["slow", *sys.argv[1:]]))
"""
PARSER = "import argparse\ndef parser():\n    p = argparse.ArgumentParser()\n    p.add_argument('words', nargs='*')\n"
PARSER += "    return p\n"


def default_interrupt() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # tests in the background ignore it


def held_interrupt() -> None:
    """As scripts/environment.sh starts Python."""
    default_interrupt()
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def start(
    folder: Path, text: str, *arguments: str, prepare: Callable[[], None] = default_interrupt
) -> subprocess.Popen[str]:
    """A process of a verb whose module has this text."""
    (folder / "slow.py").write_text(text)
    (folder / "call.py").write_text(CALL)
    return subprocess.Popen(
        [sys.executable, str(folder / "call.py"), *arguments],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=prepare,
    )


def run_of(text: str) -> str:
    """A module whose verb does this."""
    return PARSER + "def run(options):\n    import sys, time\n" + "".join(f"    {line}\n" for line in text.splitlines())


@pytest.mark.parametrize("text", [SLOW.format(""), run_of(SLOW.format(""))], ids=["import", "run"])
def test_ctrl_c_prints_one_word_and_returns_130(tmp_path: Path, text: str) -> None:
    with start(tmp_path, text) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "there\n"
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (130, "", "interrupted\n")


@pytest.mark.parametrize("again", ["RuntimeError('__set_name__')", "ImportError('initialization failed')"])
@pytest.mark.parametrize("where", ["import", "run"])
def test_ctrl_c_that_a_library_turns_into_its_own_error_is_answered(tmp_path: Path, again: str, where: str) -> None:
    """As Python 3.11 does in a class body, and compiled modules while they load."""
    text = f"try:\n    raise KeyboardInterrupt\nexcept BaseException as error:\n    raise {again} from error"
    with start(tmp_path, text if where == "import" else run_of(text)) as process:
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (130, "", "interrupted\n")


def test_a_closed_standard_output_is_no_error(tmp_path: Path) -> None:
    """As with `>&-`."""
    with start(tmp_path, run_of("print('a line')"), prepare=lambda: os.close(1)) as process:
        _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors) == (0, "")


def test_ctrl_c_while_python_starts_is_answered_when_it_can_be(tmp_path: Path) -> None:
    with start(tmp_path, SLOW.format(""), prepare=held_interrupt) as process:
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (130, "", "interrupted\n")


@pytest.mark.parametrize(
    ("end", "code"), [("sys.exit(3)", 3), ("return 3", 3), ("return int(options.words != ['a', 'b c'])", 0)]
)
def test_exit_code_and_arguments_belong_to_the_verb(tmp_path: Path, end: str, code: int) -> None:
    with start(tmp_path, run_of(end), "a", "b c") as process:
        process.communicate(timeout=30)
    assert process.returncode == code


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "import tornado_of_nobody.web",
            "auv_lse slow needs the Python package tornado_of_nobody, which is not installed: pip",
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
    text = "try:\n    exec('raise KeyboardInterrupt')\nexcept KeyboardInterrupt:\n    return 7"
    with start(tmp_path, run_of(text)) as process:
        process.communicate(timeout=30)
    assert process.returncode == 7


def test_a_second_ctrl_c_after_the_answer_changes_nothing(tmp_path: Path) -> None:
    text = "import atexit, signal\natexit.register(signal.raise_signal, signal.SIGINT)\nraise KeyboardInterrupt"
    with start(tmp_path, run_of(text)) as process:
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (130, "", "interrupted\n")


#: Python drops an error of these with a warning, Ctrl-C's as well.
DROPPED = {
    "finalizer": "class A:\n    def __del__(self): signal.raise_signal(signal.SIGINT)\nA()\n",
    "garbage collection": "gc.callbacks.append(lambda phase, info: signal.raise_signal(signal.SIGINT))\ngc.collect()\n",
}


@pytest.mark.parametrize("begin", DROPPED.values(), ids=DROPPED)
def test_a_ctrl_c_that_python_drops_is_answered_all_the_same(tmp_path: Path, begin: str) -> None:
    text = f"import gc, signal\n{begin}gc.callbacks.clear()\ntime.sleep(60)"
    with start(tmp_path, run_of(text)) as process:
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (130, "", "interrupted\n")


@pytest.mark.parametrize(
    "text",
    [
        "while True: print('a line')",
        "from rich.console import Console\nconsole = Console()\nwhile True: console.print('a line')",
    ],
    ids=["print", "rich"],
)
def test_a_reader_that_ends_early_is_no_error(tmp_path: Path, text: str) -> None:
    """As `auv_lse import ... | head` does, although a broken pipe is an OSError, which the verb may report."""
    with start(tmp_path, "ERRORS = (OSError,)\n" + run_of(text)) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == "a line\n"
        process.stdout.close()
        assert (process.wait(timeout=30), process.stderr.read()) == (0, "")
