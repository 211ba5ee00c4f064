"""Signals that ask a command to end: as KeyboardInterrupt, or as a flag, so that processes can be ended in order."""

import contextlib
import os
import signal
from collections.abc import Iterator
from types import FrameType

from auv_lse_common.support.ending_signals import SIGNALS, accepted_signals

_first: signal.Signals | None = None


@contextlib.contextmanager
def signals_raised() -> Iterator[None]:
    """Raises KeyboardInterrupt for each of `SIGNALS` while the context lasts.

    A signal that the parent process ignores stays ignored, as SIGHUP under nohup. Forked processes end by SIGTERM and
    SIGHUP at once.
    """
    global _first
    _first = None
    before = {}
    with contextlib.suppress(ValueError):  # not in the main thread, which alone answers signals
        for number in SIGNALS:
            if signal.getsignal(number) != signal.SIG_IGN:
                before[number] = signal.signal(number, _raise)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def first_signal() -> signal.Signals:
    """The first of `SIGNALS` that this process received; SIGINT if none is known."""
    return _first or signal.SIGINT


@contextlib.contextmanager
def interrupts_postponed() -> Iterator[None]:
    """Postpones Ctrl-C to the end of the context; threads and processes started in it never receive it, nor SIGHUP.

    A terminal sends both to every process. Workers would answer with a traceback, but this process ends them anyway.
    """
    from multiprocessing import resource_tracker  # few commands start such workers

    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
    resource_tracker.ensure_running()  # would unblock Ctrl-C, which it ignores, if the first worker started it
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Interrupt:
    """Takes over `SIGNALS`; SIGHUP only if the parent process does not ignore it.

    Attributes:
        signal: The first received signal; None before.
    """

    def __init__(self) -> None:
        self.signal: signal.Signals | None = None
        for number in accepted_signals():
            signal.signal(number, self._note)

    @property
    def came(self) -> bool:
        """Whether one of the signals was received."""
        return self.signal is not None

    def release(self) -> None:
        """Restores KeyboardInterrupt for the signals."""
        for number in accepted_signals():
            signal.signal(number, _raise)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.signal = self.signal or signal.Signals(number)
        note_signal(number)


def note_signal(number: int) -> None:
    """Keeps the first signal, and silences a terminal that is closed, since text to it raises OSError."""
    global _first
    _first = _first or signal.Signals(number)
    if number == signal.SIGHUP:
        for descriptor in (1, 2):
            try:
                os.write(descriptor, b"")
            except OSError:
                os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)


def _raise(number: int, frame: FrameType | None) -> None:
    note_signal(number)
    raise KeyboardInterrupt


def _end_at_once() -> None:
    """In a forked process, whose parent ends it by a signal."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is _raise:
            signal.signal(number, signal.SIG_DFL)


os.register_at_fork(after_in_child=_end_at_once)
