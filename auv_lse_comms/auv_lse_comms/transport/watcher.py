"""Wakes a port's owner when bytes have arrived."""

import os
import select
import threading
from collections.abc import Callable
from typing import Protocol


class Readable(Protocol):
    """Something with a file descriptor that becomes readable."""

    def fileno(self) -> int:
        """The file descriptor."""
        ...


class PortWatcher:
    """A thread that waits for bytes on a port and then calls `wake` (from that thread).

    The owner reads the bytes and calls `handled`; the thread then waits again. `stop` ends it.
    """

    def __init__(self, transport: Readable, wake: Callable[[], None]) -> None:
        self._transport = transport
        self._wake = wake
        self._handled = threading.Event()
        self._stopped = False
        self._stop_read, self._stop_write = os.pipe()
        self._thread = threading.Thread(target=self._watch, name="port watcher", daemon=True)
        self._thread.start()

    def handled(self) -> None:
        """The bytes have been read."""
        self._handled.set()

    def stop(self) -> None:
        """Ends the thread and waits for it; call it before closing the port."""
        if self._stopped:
            return
        self._stopped = True
        os.write(self._stop_write, b"x")
        self._handled.set()
        self._thread.join()
        os.close(self._stop_read)
        os.close(self._stop_write)

    def _watch(self) -> None:
        while True:
            try:
                readable, _, _ = select.select([self._transport.fileno(), self._stop_read], [], [])
            except (OSError, ValueError):
                return  # the port was closed
            if self._stop_read in readable:
                return
            self._handled.clear()
            if self._stopped:  # since select returned: `stop` had set `_handled`, which is now cleared
                return
            self._wake()
            self._handled.wait()
