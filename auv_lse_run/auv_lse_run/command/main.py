"""The command `auv_lse`: runs the verb of an installed package.

The parsers of the verbs are argparse's, which imports in a third of the time of click and a fifth of typer's.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import io
import os
import re
import resource
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from types import FrameType, ModuleType
from typing import TYPE_CHECKING

from auv_lse_common.support.confinement import ConfinementError
from auv_lse_common.support.ending_signals import SIGNALS
from auv_lse_common.support.installed_copy import copy_of, mixed_versions
from auv_lse_common.support.missing_packages import MissingPackageError, install_command, is_installed
from auv_lse_common.support.user_error import error_text
from auv_lse_common.support.verb import NODES, Verb
from auv_lse_run.command.find_verbs import PACKAGE_OF, find_verbs
from auv_lse_run.command.help_text import help_text, version_text
from auv_lse_run.command.tolerant_stream import FULL, ignoring_closed_reader, tolerant
from auv_lse_run.process.death import shared_memory_problem
from auv_lse_run.process.interrupt import first_signal, note_signal, signals_raised

if TYPE_CHECKING:
    import argparse


#: All packages of the stack.
PACKAGES = tuple(
    sorted({*PACKAGE_OF.values(), "auv_lse_common", "auv_lse_gp", "auv_lse_msgs", "auv_lse_planner", "auv_lse_sim"})
)


#: Exit code of a verb that has handled a terminating signal itself.
_INTERRUPTED = 130


class CommandError(ValueError):
    """A verb cannot be run."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a verb; returns its exit code, 2 if it cannot be run, 128 plus the signal's number after a terminating one.

    Args:
        arguments: The command line; None: that of this process, which ends afterwards.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if arguments is None and isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a character that the terminal lacks is no error
    if arguments is None:
        sys.stderr = tolerant(sys.stderr, drops_if_full=True)  # lost error text changes no exit code
        atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)  # runs last; afterwards Python has no handlers
    report_dropped, sys.unraisablehook = sys.unraisablehook, _interrupt_again
    try:
        with signals_raised(), _restored_interrupts():
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # scripts/auv_lse blocks it until now
            code = _run_and_flush(words)
        return 128 + first_signal() if code == _INTERRUPTED else code
    except KeyboardInterrupt as interrupt:
        if arguments is None:
            _end_quietly()
        _complain(str(interrupt) or "interrupted")
        return 128 + first_signal()
    except (CommandError, MissingPackageError) as error:
        _complain(f"error: {error}")
        return 2
    except BrokenPipeError:  # the output's reader, such as `head`, has ended
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        if not (problem := _output_problem(error)):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = _report_first(error)
        _complain(f"error: standard output: {problem}. Send it elsewhere, or free space")
        return code
    finally:
        sys.unraisablehook = report_dropped
        if arguments is None:
            _end_quietly()
        exec("")  # Ctrl-C within an evaluated string, caught or not, would make Python end by SIGINT; this clears it


def _run_and_flush(words: Sequence[str]) -> int:
    """Runs the command line, then writes all output, also after a verb's help; raises OSError if that fails."""
    try:
        return _run(words)
    finally:
        if sys.stdout is not None:  # it was closed before the start
            sys.stdout.flush()


def _report_first(problem: BaseException) -> int:
    """Reports how a verb ended before its output could not be written; returns the exit code, 1 if all went well."""
    error = problem.__context__
    while error is not None:
        if isinstance(error, (CommandError, MissingPackageError)):
            _complain(f"error: {error}")
            return 2
        if isinstance(error, KeyboardInterrupt):
            _complain(str(error) or "interrupted")
            return 128 + first_signal()
        if isinstance(error, SystemExit) and isinstance(error.code, int) and error.code:
            return error.code
        error = error.__context__
    return 1


@contextlib.contextmanager
def _restored_interrupts() -> Iterator[None]:
    """Restores a KeyboardInterrupt that a library has turned into another error, as compiled modules do on import."""
    try:
        yield
    except Exception as error:
        cause: BaseException | None = error
        while cause is not None and not isinstance(cause, KeyboardInterrupt):
            cause = cause.__cause__
        if cause is None:
            raise
        raise KeyboardInterrupt from error


def _end_quietly() -> None:
    """Sets the signal handlers while this process ends: Ctrl-C, which would print a traceback, does nothing.

    The others end it at once, even if it hangs, with the exit code of the first one.
    """
    with contextlib.suppress(ValueError):  # not in the main thread
        for number in SIGNALS:
            if signal.getsignal(number) != signal.SIG_IGN:
                signal.signal(number, _leave)  # processes that end inherit no SIG_IGN of ours


def _leave(number: int, frame: FrameType | None) -> None:
    if number != signal.SIGINT:
        note_signal(number)
        os._exit(128 + first_signal())


def _interrupt_again(dropped: sys.UnraisableHookArgs) -> None:
    """Resends a signal that arrived in a finalizer or garbage-collection callback, where Python drops its error."""
    if isinstance(dropped.exc_value, KeyboardInterrupt):
        again = threading.Timer(0.05, signal.pthread_kill, (threading.main_thread().ident, first_signal()))
        again.daemon = True
        again.start()
    else:
        sys.__unraisablehook__(dropped)


def _output_problem(error: OSError) -> str:
    """Why text cannot be written to standard output, such as a full disk; "" if `error` has another cause."""
    if error.filename is not None or error.errno not in FULL or sys.stdout is None:
        return ""
    try:
        print(flush=True)  # fails again
    except OSError as problem:
        return problem.strerror or str(problem)
    return ""


def _complain(text: str) -> None:
    with contextlib.suppress(OSError):
        print(text, file=sys.stderr)


def _run(words: Sequence[str]) -> int:
    """Runs the command line."""
    first = words[0] if words else ""
    first = f"--{first}" if first in ("help", "version") else first
    if first == "--version":
        print(
            version_text(sorted({*PACKAGE_OF.values(), "auv_lse_run", "auv_lse_gp", "auv_lse_msgs", "auv_lse_planner"}))
        )
        return 0
    verbs, problems = find_verbs()
    for problem in problems:
        print(f"warning: {problem}", file=sys.stderr)
    if first in ("-h", "--help"):
        print(help_text(verbs.values()))
        return 0
    if not first:
        print(help_text(verbs.values()), file=sys.stderr)
        return 2
    if first not in verbs:
        raise CommandError(_unknown(first, verbs))
    return run_verb(verbs[first], words[1:])


def _unknown(word: str, verbs: Mapping[str, Verb]) -> str:
    """Why a verb does not exist here."""
    if package := PACKAGE_OF.get(word):
        return f"auv_lse {word} needs the package {package}, which is not installed: {install_command(package)}"
    if word.startswith("-"):
        return f"auv_lse has no option {word}. List the verbs: auv_lse --help"
    import difflib

    if about := [name for name, verb in verbs.items() if re.search(rf"\b{re.escape(word)}\b", verb.text)]:
        return f"auv_lse has no verb {word}. See {', '.join(about[:4])}, or list the verbs: auv_lse --help"
    near = difflib.get_close_matches(word, [*verbs, *PACKAGE_OF], n=1, cutoff=0.7)
    return f"auv_lse has no verb {word}. {f'Did you mean {near[0]}?' if near else 'List the verbs: auv_lse --help'}"


def run_verb(verb: Verb, arguments: Sequence[str]) -> int:
    """Runs a verb; returns its exit code.

    Raises:
        CommandError: if a package that it needs is not installed, or an argument is empty.
    """
    _check_arguments(verb, arguments)
    _check_needs(verb)
    from auv_lse_run.command.parsing import parsed  # loads argparse

    try:
        module = importlib.import_module(verb.module)
        return _call(module, parsed(module.parser(), [*verb.words, *arguments]))
    except ModuleNotFoundError as error:
        name = (error.name or "").split(".")[0]
        if not name or is_installed(name) or name in PACKAGE_OF.values():  # a wrong import in the stack
            raise
        raise CommandError(
            f"auv_lse {verb.name} needs the Python package {name}, which is not installed: {install_command(name)}"
        ) from error
    except (ImportError, MemoryError, OSError) as error:
        if _is_out_of_memory(error):
            raise CommandError(
                f"auv_lse {verb.name}: the memory that it may use (ulimit -v) is too small: "
                f"{resource.getrlimit(resource.RLIMIT_AS)[0] // 2**20} MB. Raise the limit: ulimit -v unlimited"
            ) from error
        raise


def _is_out_of_memory(error: BaseException | None) -> bool:
    """Whether an error, or the one that led to it, is that of a process with a limit of its memory."""
    if error is None or resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY:
        return False
    if isinstance(error, MemoryError) or re.search("failed to map segment|annot allocate memory", str(error)):
        return True
    return _is_out_of_memory(error.__cause__ or error.__context__)


def _check_arguments(verb: Verb, arguments: Sequence[str]) -> None:
    """Raises CommandError for an empty argument: as a path, it would mean the current folder.

    A parameter's value may be empty.
    """
    if verb.name == "params":
        return
    for number, argument in enumerate(arguments, 1):
        option = argument.removesuffix("=") if argument else arguments[number - 2] if number > 1 else ""
        if not argument or re.fullmatch(r"--[\w-]+=", argument):
            what = option if option.startswith("--") else f"auv_lse {verb.name}: argument {number}"
            raise CommandError(f"{what} is empty. Is a variable of the shell not set? Leave it out, or give a value")


def _call(module: ModuleType, options: argparse.Namespace) -> int:
    """Calls a verb's `run`.

    Raises:
        CommandError: for one of the module's `ERRORS`, and a loop of symbolic links.
        KeyboardInterrupt: with the module's text.
        BrokenPipeError: if the reader of the output has ended, and the module's `ENDS_WITH_READER` is true.
    """
    try:
        with contextlib.nullcontext() if getattr(module, "ENDS_WITH_READER", False) else ignoring_closed_reader():
            return _answered(module, options)
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # rich's console exits with 1
            raise end.__context__ from None
        raise


def _answered(module: ModuleType, options: argparse.Namespace) -> int:
    """What a verb's `run` returns; see `_call`."""
    try:
        return int(module.run(options) or 0)
    except BrokenPipeError:  # no error of the verb, though its `ERRORS` may have OSError
        raise
    except (ConfinementError, *getattr(module, "ERRORS", ())) as error:
        if isinstance(error, OSError) and _output_problem(error):
            raise
        raise CommandError(error_text(error)) from error
    except RuntimeError as error:
        if not (loop := re.fullmatch(r"Symlink loop from '(.*)'", str(error))):  # of Path.resolve() before Python 3.13
            raise
        raise CommandError(f"{loop[1]} is a symbolic link that leads to itself; choose another name") from error
    except KeyboardInterrupt as interrupt:
        raise KeyboardInterrupt(str(interrupt) or getattr(module, "INTERRUPTED", "")) from None


def _check_needs(verb: Verb) -> None:
    """Raises CommandError if a package that the verb needs is not installed, or it needs a checkout."""
    if verb.in_checkout:
        copy = copy_of("auv_lse_run")
        if copy is None or copy.kind != "checkout":
            raise CommandError(
                f"auv_lse {verb.name} needs a checkout of the project, because no package installs its files. "
                f"In the checkout: scripts/setup, then scripts/auv_lse {verb.name}"
            )
        sys.path.append(str(copy.folder))
        paths = (os.environ.get("PYTHONPATH"), str(copy.folder))  # for the processes that the verb starts
        os.environ["PYTHONPATH"] = os.pathsep.join(path for path in paths if path)
    if NODES[0] in verb.needs:
        if problem := mixed_versions(PACKAGES):
            raise CommandError(f"auv_lse {verb.name}: {problem}")
        if problem := shared_memory_problem():  # the kernel may end this process without a word
            _complain(f"warning: {problem}")
    missing = [package for package in verb.needs if not is_installed(package)]
    if missing:
        cures = "; ".join(f"{package}: {install_command(package)}" for package in missing)
        raise CommandError(f"auv_lse {verb.name} needs packages that are not installed. {cures}")
