"""Signals to end as a flag, which commands use that end other processes in order."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest

from auv_lse_common.support.ending_signals import SIGNALS
from auv_lse_run.process.interrupt import Interrupt, first_signal, signals_raised


@pytest.fixture(autouse=True)
def handlers_stay_as_they_were() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", SIGNALS)
def test_the_first_signal_is_kept_and_interrupts_nothing(number: signal.Signals) -> None:
    with signals_raised():
        interrupt = Interrupt()
        assert not interrupt.came
        signal.raise_signal(number)
        signal.raise_signal(signal.SIGINT)
        assert interrupt.came
        assert interrupt.signal == first_signal() == number
        interrupt.release()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)


def test_a_closed_terminal_that_nohup_ignores_stays_ignored() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    interrupt = Interrupt()
    signal.raise_signal(signal.SIGHUP)
    interrupt.release()
    signal.raise_signal(signal.SIGHUP)
    assert not interrupt.came
