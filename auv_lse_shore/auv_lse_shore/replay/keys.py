"""Single keys from a terminal, read without waiting."""

from __future__ import annotations

import contextlib
import os
import select
import sys
from typing import Any

#: Keys of a replay.
MEANINGS = {" ": "pause", "\x1b[C": "next", "\x1b[A": "faster", "\x1b[B": "slower"}
HELP = "space: pause, right: next message, up/down: rate, Ctrl-C: stop"


class Keys:
    """Keys pressed on the terminal; a context manager that restores the terminal. Without a terminal there are none.

    Attributes:
        available: Whether there is a terminal.
    """

    def __init__(self) -> None:
        self.available = sys.stdin is not None and sys.stdin.isatty()
        self._before: list[Any] = []

    def __enter__(self) -> Keys:
        """Reads keys at once and without echo; Ctrl-C still interrupts."""
        if self.available:
            import termios
            import tty

            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(self, *_: object) -> None:
        """Restores the terminal."""
        if self.available:
            import termios

            with contextlib.suppress(termios.error):  # it is closed
                termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def wait(self, seconds: float) -> list[str]:
        """Waits at most `seconds`; returns the meanings of the keys pressed."""
        if not self.available:
            select.select([], [], [], seconds)
            return []
        ready, _, _ = select.select([sys.stdin], [], [], seconds)
        return meanings(os.read(sys.stdin.fileno(), 64).decode(errors="replace")) if ready else []


def meanings(text: str) -> list[str]:
    """Meanings of a terminal's characters; unknown ones are ignored."""
    found = []
    while text:
        key = next((k for k in MEANINGS if text.startswith(k)), text[0])
        found += [MEANINGS[key]] if key in MEANINGS else []
        text = text[len(key) :]
    return found
