"""The file of a vehicle's orders: locked while one is executed, written whole and to the disk before."""

import contextlib
import fcntl
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

from auv_lse_run.remote.orders import OrderBook, OrderError

_STEP_S = 0.05


class OrderStore:
    """The orders in a vehicle's folder."""

    def __init__(self, folder: Path) -> None:
        """Reads nothing yet."""
        self._folder = folder
        self._file = folder / "fleet" / "orders.json"

    @contextlib.contextmanager
    def opened(self, wait_s: float) -> Iterator[OrderBook]:
        """A context with the book, locked against other sessions.

        Args:
            wait_s: Longest wait for another session, which executes an order.

        Raises:
            OSError: if the folder is missing, or the lock is not free in time.
            OrderError: if the file is damaged.
        """
        descriptor = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY)  # a full or read-only disk still locks
        try:
            _lock(descriptor, wait_s, self._folder)
            yield self.read()
        finally:
            os.close(descriptor)

    def read(self) -> OrderBook:
        """Reads the book without a lock, to show it only.

        Raises:
            OSError: if the file cannot be read.
            OrderError: if it is damaged.
        """
        try:
            return OrderBook(json.loads(self._file.read_bytes()))
        except FileNotFoundError:
            return OrderBook()
        except ValueError as error:
            raise OrderError(f"{self._file} is damaged ({error}). Move it away, and repeat the order") from error

    def write(self, book: OrderBook) -> None:
        """Writes the book; it survives a power failure.

        Raises:
            OSError: naming the file, which is then unchanged.
        """
        self._file.parent.mkdir(exist_ok=True)
        write_durably(self._file, json.dumps(book.values()).encode())


def write_durably(file: Path, data: bytes, mode: int = 0o666) -> None:
    """Writes a file, completely or not at all; it survives a power failure.

    Raises:
        OSError: naming the file, which is then unchanged.
    """
    part = file.with_name(f".{file.name}.part")
    try:
        descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode)
        with os.fdopen(descriptor, "wb") as opened:
            opened.write(data)
            opened.flush()
            os.fsync(descriptor)
        part.replace(file)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror or str(error), str(file)) from error
    sync_folder(file.parent)


def sync_folder(folder: Path) -> None:
    """Writes a folder's entries to the disk, so that a file renamed into it survives a power failure.

    Raises:
        OSError: if the folder is missing.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _lock(descriptor: int, wait_s: float, folder: Path) -> None:
    end_s = time.monotonic() + wait_s
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError as error:
            if time.monotonic() >= end_s:
                raise OSError(error.errno, "another session executes an order", str(folder)) from error
            time.sleep(_STEP_S)
