"""Work done beside other work, on another core: in a forked process, which has all that this one has."""

from __future__ import annotations

import os
import pickle
import signal
import warnings
from collections.abc import Callable
from typing import TypeVar

from auv_lse_common.process.processes import die_with_parent

T = TypeVar("T")


def beside(work: Callable[[], T]) -> Callable[[], T]:
    """Begins some work in a process of its own.

    Args:
        work: The work; what it changes here is lost, files that it writes stay. Its result must be picklable.

    Returns:
        Waits for the work and gives its result, or raises its error. On a machine with one core it does the work then.
    """
    if not hasattr(os, "fork") or (os.cpu_count() or 1) < 2:
        return work
    reader, writer = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads, which all only wait
        pid = os.fork()
    if pid == 0:
        os.close(reader)
        _work(work, writer)
    os.close(writer)

    def result() -> T:
        with os.fdopen(reader, "rb") as pipe:
            data = pipe.read()
        status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        if not data:
            raise RuntimeError(f"the process that worked beside this one ended with {status} and without a result")
        done, value = pickle.loads(data)
        if not done:
            raise value
        found: T = value
        return found

    return result


def _work(work: Callable[[], object], writer: int) -> None:
    """In the forked process: works, tells the result or the error, and does not return."""
    try:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C: this process ends, the other one says so
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        die_with_parent()
        try:
            answer = pickle.dumps((True, work()))
        except Exception as error:
            answer = pickle.dumps((False, error))
        with os.fdopen(writer, "wb") as pipe:
            pipe.write(answer)
    finally:
        os._exit(0)
