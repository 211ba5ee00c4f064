"""Shows what a long evaluation is doing."""

import os
import sys
from collections.abc import Callable
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
