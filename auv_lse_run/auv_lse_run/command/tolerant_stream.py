"""Standard output and error for a verb that keeps running when their reader ends, such as a pager."""

import contextlib
import errno
import io
import os
import sys
from collections.abc import Iterator
from typing import TextIO

#: Errors of a write: full disk, full quota, largest file, defective disk.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


class _TolerantStream(io.TextIOWrapper):
    """A stream that discards text once its reader has ended and, if wanted, while its disk is full.

    The raw stream is Python's own: a signal handled within one of ours, between the write and its return, would make
    the buffer write the same text again.
    """

    def __init__(self, stream: io.TextIOWrapper, *, drops_if_full: bool) -> None:
        stream.flush()
        raw = io.FileIO(stream.fileno(), "w", closefd=False)
        super().__init__(
            raw if stream.write_through or drops_if_full else io.BufferedWriter(raw),
            encoding=stream.encoding,
            errors=stream.errors,
            line_buffering=stream.line_buffering,
            write_through=stream.write_through,
        )
        self._drops_if_full = drops_if_full

    def write(self, text: str, /) -> int:
        try:
            return super().write(text)
        except OSError as error:
            self._discard(error)
            return len(text)

    def flush(self) -> None:
        try:
            super().flush()
        except OSError as error:
            self._discard(error)

    def _discard(self, error: OSError) -> None:
        """Discards the text of a failed write, or raises the error if the verb must report it."""
        if isinstance(error, BrokenPipeError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
        elif not self._drops_if_full or error.errno not in FULL:
            raise error


@contextlib.contextmanager
def ignoring_closed_reader() -> Iterator[None]:
    """A context in which no write to standard output raises BrokenPipeError."""
    before, sys.stdout = sys.stdout, tolerant(sys.stdout)
    try:
        yield
    finally:
        stream, sys.stdout = sys.stdout, before
        if stream is not before:
            stream.flush()


def tolerant(stream: TextIO, *, drops_if_full: bool = False) -> TextIO:
    """A stream of this process, made to raise no BrokenPipeError; others, such as those of tests, are unchanged.

    Args:
        stream: Standard output or error.
        drops_if_full: Whether a full disk behind it is no error either.
    """
    if type(stream) is not io.TextIOWrapper:  # None: closed before the start
        return stream
    return _TolerantStream(stream, drops_if_full=drops_if_full)
