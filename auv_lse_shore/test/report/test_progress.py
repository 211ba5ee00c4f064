"""Lines that show what a long work is doing."""

import io

from auv_lse_shore.report.progress import can_rewrite


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_line_is_replaced_on_a_terminal_that_can_do_so(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    assert can_rewrite(Terminal())
    assert not can_rewrite(io.StringIO())
    assert not can_rewrite(None), "standard output that is closed"
    monkeypatch.setenv("TERM", "dumb")
    assert not can_rewrite(Terminal())
