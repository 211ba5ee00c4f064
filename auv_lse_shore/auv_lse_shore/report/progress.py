"""Shows what a long evaluation is doing, in one line of the terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable

#: Shows a step of the work.
Show = Callable[[str], None]


def show_step(text: str) -> None:
    """Replaces the last line shown on the terminal by `text`; "" removes it. Elsewhere it shows nothing."""
    if sys.stderr.isatty():
        print(text, end="\x1b[K\r", file=sys.stderr, flush=True)


def show_nothing(text: str) -> None:
    """Shows nothing."""
