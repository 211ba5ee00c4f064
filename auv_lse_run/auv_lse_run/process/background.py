"""Runs a function in a forked process on another core, in parallel to this process."""

import os
import pickle
import signal
import warnings
from collections.abc import Callable
from typing import TypeVar

from auv_lse_run.process.processes import die_with_parent

T = TypeVar("T")


def run_in_background(work: Callable[[], T]) -> Callable[[], T]:
    """Starts `work` in a forked process; on a machine with one core it runs when its result is requested.

    Args:
        work: Function with a picklable result. Its changes to memory are lost; files that it writes remain.

    Returns:
        A function that waits for the work and returns its result, or raises its error.
    """
    if not hasattr(os, "fork") or (os.cpu_count() or 1) < 2:
        return work
    reader, writer = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # about other threads, which only wait
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
            raise RuntimeError(f"the background process ended with exit code {status} and without a result")
        succeeded, value = pickle.loads(data)
        if not succeeded:
            raise value
        found: T = value
        return found

    return result


def _work(work: Callable[[], object], writer: int) -> None:
    """In the forked process: sends the result or the error through the pipe, and does not return."""
    try:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # on Ctrl-C this process just ends; the parent reports it
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
