"""Standard output and error of a verb that goes on when their reader ends, as a pager does that is left early."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Iterator
from typing import Any, TextIO


class _Outlet(io.FileIO):
    """A descriptor whose text goes nowhere once its reader has ended."""

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
            return super().write(data)


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """A context in which no write to standard output or error raises BrokenPipeError."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = map(_same, before)
    try:
        yield
    finally:
        streams, (sys.stdout, sys.stderr) = (sys.stdout, sys.stderr), before
        for stream in streams:
            if stream not in before:
                stream.flush()


def _same(stream: TextIO) -> TextIO:
    """The same as a stream of this process, with an `_Outlet`; other streams, such as those of tests, unchanged."""
    if type(stream) is not io.TextIOWrapper:  # None: it was closed before the start
        return stream
    stream.flush()
    outlet = _Outlet(stream.fileno(), "w", closefd=False)
    return io.TextIOWrapper(
        outlet if stream.write_through else io.BufferedWriter(outlet),  # as Python's own
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
