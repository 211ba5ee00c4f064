"""Standard output and error of a verb that goes on when their reader ends, as a pager does that is left early."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from collections.abc import Iterator
from typing import Any, TextIO

#: Errors of a write: full disk, full quota, largest file, defective disk.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


class _Outlet(io.FileIO):
    """A descriptor whose text goes nowhere once its reader has ended and, if wanted, while its disk is full."""

    def __init__(self, descriptor: int, *, drops_if_full: bool) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self._drops_if_full = drops_if_full

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
            return super().write(data)
        except OSError as error:
            if not self._drops_if_full or error.errno not in FULL:
                raise
            return len(data)


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """A context in which no write to standard output raises BrokenPipeError."""
    before, sys.stdout = sys.stdout, outlet(sys.stdout)
    try:
        yield
    finally:
        stream, sys.stdout = sys.stdout, before
        if stream is not before:
            stream.flush()


def outlet(stream: TextIO, *, drops_if_full: bool = False) -> TextIO:
    """The same as a stream of this process, without BrokenPipeError; other streams, such as those of tests, unchanged.

    Args:
        stream: Standard output or error.
        drops_if_full: Whether a full disk behind it is no error either.
    """
    if type(stream) is not io.TextIOWrapper:  # None: it was closed before the start
        return stream
    stream.flush()
    raw = _Outlet(stream.fileno(), drops_if_full=drops_if_full)
    return io.TextIOWrapper(
        raw if stream.write_through else io.BufferedWriter(raw),  # as Python's own
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
