"""How a verb ends: Ctrl-C, exit codes, packages that are missing."""

from __future__ import annotations

import fcntl
import os
import pty
import shutil
import signal
import subprocess
import sys
import termios
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
    sys.argv[1:1] = ["slow"]
    sys.exit(main.main())
"""
PARSER = "import argparse\ndef parser():\n    p = argparse.ArgumentParser()\n    p.add_argument('words', nargs='*')\n"
PARSER += "    return p\n"


#: What asks a command to end, and its exit code then.
ENDS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}


def default_interrupt() -> None:
    for number in ENDS:
        signal.signal(number, signal.SIG_DFL)  # tests in the background ignore some


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


def answer(process: subprocess.Popen[str], number: signal.Signals) -> tuple[int, str, str]:
    """Sends a signal to a process that has printed "there"; its exit code and what it prints then."""
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == "there\n"
        process.send_signal(number)
        output, errors = process.communicate(timeout=30)
    return process.returncode, output, errors


@pytest.mark.parametrize("text", [SLOW.format(""), run_of(SLOW.format(""))], ids=["import", "run"])
@pytest.mark.parametrize(("number", "code"), ENDS.items())
def test_a_signal_to_end_prints_one_word_and_returns_its_code(
    tmp_path: Path, text: str, number: signal.Signals, code: int
) -> None:
    """Ctrl-C; SIGTERM, as of `timeout` and `systemctl stop`; SIGHUP, as of a closed SSH session."""
    assert answer(start(tmp_path, text), number) == (code, "", "interrupted\n")


INTERRUPTED_START = """\
import runpy, signal, sys
class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == "auv_lse_run.command.help_text":
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Interrupt())
runpy.run_module("auv_lse_run", run_name="__main__")
"""


def test_ctrl_c_while_the_command_loads_prints_one_word() -> None:
    """As of an installed auv_lse, which no script holds interrupts for."""
    command = [sys.executable, "-c", INTERRUPTED_START]
    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=default_interrupt)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")


@pytest.mark.parametrize(("number", "code"), ENDS.items())
def test_a_verb_cleans_up_after_any_of_the_signals(tmp_path: Path, number: signal.Signals, code: int) -> None:
    text = "try:\n    print('there', flush=True)\n    time.sleep(60)\nfinally:\n    print('cleaned up')"
    assert answer(start(tmp_path, run_of(text)), number) == (code, "cleaned up\n", "interrupted\n")


@pytest.mark.parametrize(("number", "code"), ENDS.items())
def test_the_code_is_the_signals_also_if_the_verb_reports_it(tmp_path: Path, number: signal.Signals, code: int) -> None:
    text = "try:\n    print('there', flush=True)\n    time.sleep(60)\nexcept KeyboardInterrupt:\n    return 130"
    assert answer(start(tmp_path, run_of(text)), number) == (code, "", "")


@pytest.mark.parametrize("number", ENDS)
@pytest.mark.parametrize(("first", "code"), ENDS.items())
def test_a_second_signal_while_python_ends_leaves_the_code_of_the_first(
    tmp_path: Path, first: signal.Signals, code: int, number: signal.Signals
) -> None:
    """As a batch system sends them: SIGTERM to the process, then to its group."""
    again = f"import atexit, os\natexit.register(os.kill, os.getpid(), {int(number)})\n"
    assert answer(start(tmp_path, run_of(again + SLOW.format(""))), first) == (code, "", "interrupted\n")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 3), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_first_signal_while_python_ends_prints_nothing(tmp_path: Path, number: signal.Signals, code: int) -> None:
    text = f"import atexit, os\natexit.register(os.kill, os.getpid(), {int(number)})\nprint('done')\nreturn 3"
    with start(tmp_path, run_of(text)) as process:
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (code, "done\n", "")


@pytest.mark.parametrize("number", ENDS)
def test_a_second_signal_while_the_word_is_printed_leaves_one_word(tmp_path: Path, number: signal.Signals) -> None:
    """As on a slow terminal."""
    text = "import os\nclass Slow:\n    def write(self, text):\n"
    text += f"        os.kill(os.getpid(), {int(number)})\n        return sys.__stderr__.write(text)\n"
    text += "    def flush(self):\n        pass\nsys.stderr = Slow()\n"
    words = {signal.SIGINT: "interrupted\n"}.get(number, "")  # the others end it at once
    assert answer(start(tmp_path, run_of(text + SLOW.format(""))), signal.SIGINT) == (130, "", words)


@pytest.mark.parametrize("number", ENDS)
def test_a_signal_that_the_parent_ignores_stays_ignored_while_python_ends(
    tmp_path: Path, number: signal.Signals
) -> None:
    text = f"import atexit, os\natexit.register(os.kill, os.getpid(), {int(number)})\nreturn 3"
    with start(tmp_path, run_of(text), prepare=lambda: signal.signal(number, signal.SIG_IGN)) as process:
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (3, "", "")


@pytest.mark.parametrize("number", ENDS)
def test_a_signal_that_the_parent_ignores_stays_ignored(tmp_path: Path, number: signal.Signals) -> None:
    """As nohup ignores SIGHUP."""
    text = f"import signal\nsignal.raise_signal({int(number)})\nprint('a line')"
    with start(tmp_path, run_of(text), prepare=lambda: signal.signal(number, signal.SIG_IGN)) as process:
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (0, "a line\n", "")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_process_that_a_verb_forks_ends_at_once(tmp_path: Path, number: signal.Signals) -> None:
    """As worker processes, which libraries end by SIGTERM."""
    text = f"import os, signal\npid = os.fork()\nif not pid:\n    signal.raise_signal({int(number)})\n    os._exit(0)\n"
    text += "print(os.waitpid(pid, 0)[1])"
    with start(tmp_path, run_of(text)) as process:
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (0, f"{int(number)}\n", "")


def test_a_verb_ends_in_order_when_its_terminal_is_closed(tmp_path: Path) -> None:
    """Text to a closed terminal is an error, which must not keep a verb from cleaning up."""
    text = "try:\n    print('there', flush=True)\n    time.sleep(60)\nfinally:\n    print('ended', flush=True)\n"
    text += f"    open({str(tmp_path / 'cleaned up')!r}, 'w').close()"
    terminal, inner = pty.openpty()

    def on_terminal() -> None:
        default_interrupt()
        os.setsid()
        fcntl.ioctl(inner, termios.TIOCSCTTY, 0)
        for descriptor in (0, 1, 2):
            os.dup2(inner, descriptor)
        os.close(terminal)

    with start(tmp_path, run_of(text), prepare=on_terminal) as process:
        os.close(inner)
        assert os.read(terminal, 100).startswith(b"there")
        os.close(terminal)
        assert process.wait(timeout=30) == 129
    assert (tmp_path / "cleaned up").exists()


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


def test_the_command_of_a_workspace_holds_ctrl_c_until_python_can_answer(tmp_path: Path) -> None:
    """As scripts/auv_lse does."""
    for folder in ("bin", "lib/auv_lse_run"):
        (tmp_path / folder).mkdir(parents=True)
    shutil.copy(Path(__file__).parents[2] / "bin" / "auv_lse", tmp_path / "bin" / "auv_lse")
    installed = tmp_path / "lib" / "auv_lse_run" / "auv_lse"
    installed.write_text(
        f"#!{sys.executable}\nimport signal, sys\nprint(signal.pthread_sigmask(0, []), sys.argv[1:])\n"
    )
    installed.chmod(0o755)
    command = [str(tmp_path / "bin" / "auv_lse"), "a", "b c"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, preexec_fn=default_interrupt)
    assert done.stdout == f"{ {signal.SIGINT} } {['a', 'b c']}\n"


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
            "raise missing(ModuleNotFoundError('gone', name='jinja2'), 'reports')",
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


def test_a_ctrl_c_while_python_ends_changes_nothing(tmp_path: Path) -> None:
    """The verb has succeeded; Python would print a traceback and end by SIGINT."""
    text = "import atexit, signal\natexit.register(signal.raise_signal, signal.SIGINT)\nprint('a line')"
    with start(tmp_path, run_of(text)) as process:
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (0, "a line\n", "")


def test_a_ctrl_c_while_python_removes_its_modules_changes_nothing(tmp_path: Path) -> None:
    """By then Python has removed its handlers. That takes 0.25 s with large libraries."""
    text = "import os, sys\nclass Last:\n    def __del__(self, kill=os.kill, pid=os.getpid()): kill(pid, 2)\n"
    with start(tmp_path, run_of(f"{text}sys.last = Last()\nprint('a line')")) as process:
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (0, "a line\n", "")


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
    ("encoding", "expected"),
    [("ascii", b"2 ? 3 ? 4\n"), ("latin-1", b"2 \xd7 3 ? 4\n"), ("utf-8", "2 × 3 – 4\n".encode())],
)
def test_letters_that_the_terminal_lacks_are_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, encoding: str, expected: bytes
) -> None:
    """As with LANG=en_US, whose encoding is Latin-1."""
    monkeypatch.setenv("PYTHONIOENCODING", encoding)
    text = "ERRORS = (ValueError,)\n" + run_of("print('2 \\u00d7 3 \\u2013 4')")
    with start(tmp_path, text) as process:
        assert process.stdout is not None
        assert process.stdout.buffer.read() == expected
    assert process.returncode == 0


@pytest.mark.parametrize("text", ["print('a line')", "print('a line', flush=True)", "while True: print('a line')"])
@pytest.mark.parametrize("errors", ["", "ERRORS = (OSError,)\n"])
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_disk_behind_standard_output_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, errors: str, unbuffered: str
) -> None:
    """As `auv_lse check mission.yaml > report.txt` on a full disk."""
    monkeypatch.setenv("PYTHONUNBUFFERED", unbuffered)

    def full_output() -> None:
        os.dup2(os.open("/dev/full", os.O_WRONLY), 1)

    with start(tmp_path, errors + run_of(text), prepare=full_output) as process:
        _, words = process.communicate(timeout=30)
    assert words == "error: standard output: No space left on device. Send it elsewhere, or free space\n"
    assert process.returncode == 1


@pytest.mark.parametrize(
    ("end", "words", "code"),
    [
        ("raise ValueError('a.csv: 3 is wrong')", "error: a.csv: 3 is wrong\n", 2),
        ("raise OSError(2, 'No such file', 'b.csv')", "error: b.csv: No such file\n", 2),
        ("raise KeyboardInterrupt", "interrupted\n", 130),
        ("raise SystemExit(2)", "", 2),
    ],
)
def test_an_error_before_a_full_disk_behind_standard_output_is_reported_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str, words: str, code: int
) -> None:
    monkeypatch.setenv("PYTHONUNBUFFERED", "")

    def full_output() -> None:
        os.dup2(os.open("/dev/full", os.O_WRONLY), 1)

    text = f"ERRORS = (ValueError, OSError)\n{run_of(f'print(1){chr(10)}{end}')}"
    with start(tmp_path, text, prepare=full_output) as process:
        _, found = process.communicate(timeout=30)
    assert found == words + "error: standard output: No space left on device. Send it elsewhere, or free space\n"
    assert process.returncode == code


def test_a_loop_of_symbolic_links_is_an_error_of_one_line(tmp_path: Path) -> None:
    (tmp_path / "a.csv").symlink_to("a.csv")
    text = f"import pathlib\npathlib.Path({str(tmp_path / 'a.csv')!r}).resolve().read_text()"
    with start(tmp_path, "ERRORS = (OSError,)\n" + run_of(text)) as process:
        _, found = process.communicate(timeout=30)
    assert len(found.splitlines()) == 1
    assert str(tmp_path / "a.csv") in found
    assert process.returncode == 2


def test_another_full_disk_is_not_standard_outputs(tmp_path: Path) -> None:
    text = "print('a line')\nraise OSError(28, 'No space left on device', 'map.tif')"
    with start(tmp_path, "ERRORS = (OSError,)\n" + run_of(text)) as process:
        output, words = process.communicate(timeout=30)
    assert (process.returncode, output, words) == (2, "a line\n", "error: map.tif: No space left on device\n")


@pytest.mark.parametrize(
    "text",
    [
        "while True: print('a line')",
        "from rich.console import Console\nconsole = Console()\nwhile True: console.print('a line')",
    ],
    ids=["print", "rich"],
)
def test_a_reader_that_ends_early_ends_what_only_prints(tmp_path: Path, text: str) -> None:
    """As `auv_lse topics echo ... | head` does, although a broken pipe is an OSError, which the verb may report."""
    with start(tmp_path, "ERRORS = (OSError,)\nENDS_WITH_READER = True\n" + run_of(text)) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == "a line\n"
        process.stdout.close()
        assert (process.wait(timeout=30), process.stderr.read()) == (0, "")


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("printer", ["", "from rich.console import Console\nprint = Console().print\n"])
def test_a_reader_that_ends_early_ends_no_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, printer: str, unbuffered: str
) -> None:
    """As `auv_lse mission 2>&1 | less`, of which only the first page is read."""
    monkeypatch.setenv("PYTHONUNBUFFERED", unbuffered)
    text = (
        f"{printer}import pathlib, sys\nfor _ in range(9999): print('a line')\nsys.stdout.flush()\n"
        f"sys.stderr.write('words')\nsys.stderr.flush()\npathlib.Path({str(tmp_path / 'done')!r}).touch()\nreturn 3"
    )
    with start(tmp_path, run_of(text)) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stderr.close()
        assert process.stdout.readline() == "a line\n"
        process.stdout.close()
        assert process.wait(timeout=30) == 3
    assert (tmp_path / "done").exists()


INTERRUPTED_WRITE = """\
import sys
from auv_lse_run.command.tolerant_stream import ignoring_closed_reader
def interrupt(frame, event, called):
    if event == "c_return" and frame.f_code.co_filename.endswith("stream.py") and frame.f_code.co_name == "write":
        sys.setprofile(None)
        raise KeyboardInterrupt
try:
    with ignoring_closed_reader():
        sys.setprofile(interrupt)
        print("a line", flush=True)
except KeyboardInterrupt:
    print("interrupted")
"""


def test_a_signal_between_a_write_and_its_return_prints_nothing_twice() -> None:
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    command = [sys.executable, "-c", INTERRUPTED_WRITE]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=buffered)
    assert done.stdout.replace("\n", "") == "a lineinterrupted"
