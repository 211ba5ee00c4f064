"""Ctrl-C and SIGTERM as a flag, so that processes can be ended in order."""

from __future__ import annotations

import signal
from types import FrameType


class Interrupt:
    """Takes over SIGINT and SIGTERM.

    Attributes:
        signal: The first received signal; None before.
    """

    def __init__(self) -> None:
        self.signal: signal.Signals | None = None
        for sign in (signal.SIGINT, signal.SIGTERM):
            signal.signal(sign, self._note)

    @property
    def came(self) -> bool:
        """Whether one of the signals was received."""
        return self.signal is not None

    def release(self) -> None:
        """Restores KeyboardInterrupt for both signals."""
        for sign in (signal.SIGINT, signal.SIGTERM):
            signal.signal(sign, signal.default_int_handler)

    def _note(self, sign: int, frame: FrameType | None) -> None:
        self.signal = self.signal or signal.Signals(sign)
