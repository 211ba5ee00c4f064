"""`auv_lse fleet watch` on terminals and without one."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest
from rich.table import Table

from auv_lse_shore.remote import watching


@pytest.mark.parametrize(("terminal", "term"), [(False, "xterm"), (True, "dumb"), (True, "xterm")])
def test_the_table_is_shown_on_the_way(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], terminal: bool, term: str
) -> None:
    """Also into a pipe, as `auv_lse fleet watch | tee watch.log`."""
    monkeypatch.setenv("TERM", term)
    monkeypatch.setenv("FORCE_COLOR" if terminal else "NO_COLOR", "1")
    now_s, shown = 0.0, []

    def sleep(seconds: float) -> None:
        nonlocal now_s
        now_s += seconds
        shown.append(capsys.readouterr().out.count("auv2 is silent"))
        if now_s > 11.0:
            raise KeyboardInterrupt

    monkeypatch.setattr(watching, "time", SimpleNamespace(sleep=sleep, monotonic=lambda: now_s))
    monkeypatch.setattr(watching, "Watch", lambda *_: nullcontext(SimpleNamespace()))
    monkeypatch.setattr(watching, "_shown", lambda *_: (Table(), ["auv2 is silent"]))
    fleet: Any = None
    with pytest.raises(KeyboardInterrupt):
        watching.watch(fleet, [], 2.0, once=False)
    renewed = terminal and term != "dumb"
    assert sum(shown) == (len(shown) if renewed else 3), "every second, or every 5 s"
