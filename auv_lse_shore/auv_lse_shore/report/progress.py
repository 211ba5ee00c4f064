"""Shows what a long evaluation is doing."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable
from typing import TextIO

#: Shows a step of the work.
Show = Callable[[str], None]


def can_rewrite(stream: TextIO | None) -> bool:
    """Whether a stream is a terminal on which a line can be replaced (None: a stream that is closed)."""
    return stream is not None and stream.isatty() and os.environ.get("TERM") != "dumb"


def show_step(text: str) -> None:
    """Replaces the last line shown on the terminal by `text`; "" removes it. Elsewhere it shows nothing."""
    if can_rewrite(sys.stderr):
        print(text, end="\x1b[K\r", file=sys.stderr, flush=True)


def show_nothing(text: str) -> None:
    """Shows nothing."""


def print_lines(lines: Iterable[str]) -> None:
    """Prints the lines of a work as they come. A reader that ends early, as a pager does, does not end the work."""
    for line in lines:
        try:
            print(line, flush=True)
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
