"""Signals that ask a process to end."""

import signal

#: Ctrl-C; SIGTERM, as of `timeout` and `systemctl stop`; SIGHUP, as of a closed terminal or SSH session.
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def accepted_signals() -> list[signal.Signals]:
    """`SIGNALS` for a process that ends in order; without SIGHUP if it is ignored, as under nohup."""
    return [n for n in SIGNALS if n != signal.SIGHUP or signal.getsignal(n) != signal.SIG_IGN]
