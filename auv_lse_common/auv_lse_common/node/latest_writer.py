"""A thread that writes the latest of several texts, so that a slow disk does not stop its caller."""

import threading
import time
from collections.abc import Callable

#: A text that has waited longer than this (s) is late.
_LATE_S = 2.0


class LatestWriter:
    """Passes texts to a function. The caller may wait for it a limited time; texts that are overtaken are skipped."""

    def __init__(self, write: Callable[[bytes], None]) -> None:
        """Args: write: writes a text; raises no error."""
        self._write = write
        self._changed = threading.Condition()
        self._next: bytes | None = None
        self._busy_since_s: float | None = None
        self._thread: threading.Thread | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a text is not written yet."""
        return self._busy_since_s is not None

    @property
    def is_late(self) -> bool:
        """Whether the writer has been busy for more than 2 s."""
        since_s = self._busy_since_s
        return since_s is not None and time.monotonic() - since_s > _LATE_S

    def put(self, text: bytes, wait_s: float) -> bool:
        """Writes `text`. Returns False if that takes longer than `wait_s`, or an earlier text is still being written.

        Args:
            wait_s: Time to wait; infinite: the text is written by the caller's thread if no other one is busy.
        """
        with self._changed:
            if wait_s == float("inf"):
                self._changed.wait_for(lambda: not self.is_busy)
                self._write(text)
                return True
            was_busy, self._next = self.is_busy, text
            if not was_busy:
                self._busy_since_s = time.monotonic()
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, daemon=True)
                self._thread.start()
            self._changed.notify_all()
            return not was_busy and self._changed.wait_for(lambda: not self.is_busy, wait_s)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._next is not None)
                text, self._next = self._next, None
            assert text is not None
            self._write(text)
            with self._changed:
                self._busy_since_s = None if self._next is None else time.monotonic()
                self._changed.notify_all()
