"""Helpers for benchmarks with a command line of their own: `python -m benchmarks.NAME`."""

import argparse
import contextlib
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from auv_lse_run.command.parsing import name_numbers


def existing_file(text: str) -> Path:
    """The file of an option that must name one, as argparse's `type`."""
    if not Path(text).is_file():
        raise argparse.ArgumentTypeError(f"{text}: there is no such file")
    return Path(text)


def parser_of(module: str, about: str | None) -> argparse.ArgumentParser:
    """The command line of `python -m MODULE`; `about` is its docstring, printed line by line."""
    formatter = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=about, formatter_class=formatter)
    name_numbers(parser)
    return parser


def end_with(main: Callable[[], int | None]) -> NoReturn:
    """Runs `main` and ends the process: with its return value (None: 0), or after Ctrl-C with 130 and one word."""
    try:
        code = main()
    except KeyboardInterrupt:
        with contextlib.suppress(BrokenPipeError):
            print("interrupted", file=sys.stderr)
        code = 130
    sys.exit(code or 0)


def call_as_root(needed_by: str, *command: str) -> None:
    """Runs a program of the system, such as ip or mount.

    Args:
        needed_by: The command or option that needs it, for the errors.
        command: The program and its arguments.

    Raises:
        RuntimeError: if it is missing, or fails.
    """
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        raise RuntimeError(f"{needed_by} needs the program {command[0]}, which is not installed.") from error
    if done.returncode:
        raise RuntimeError(f"{needed_by} needs root: {' '.join(command)}: {done.stderr.strip()}")
