"""`auv_lse fleet watch` on terminals and without one."""

from __future__ import annotations

import os
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


@pytest.mark.parametrize("has_page", [False, True])
def test_it_ends_with_the_reader_of_its_lines_unless_it_has_a_page(
    monkeypatch: pytest.MonkeyPatch, has_page: bool
) -> None:
    """As `auv_lse fleet watch | head`."""
    reader, writer = os.pipe()
    shown = []

    def sleep(seconds: float) -> None:
        shown.append(seconds)
        if len(shown) == 3:
            os.close(reader)
        if len(shown) == 9:
            raise KeyboardInterrupt

    monkeypatch.setattr(watching, "time", SimpleNamespace(sleep=sleep, monotonic=lambda: 0.0))
    monkeypatch.setattr(watching, "Watch", lambda *_: nullcontext(SimpleNamespace()))
    monkeypatch.setattr(watching, "_shown", lambda *_: (Table(), []))
    chart = SimpleNamespace(timeline=SimpleNamespace(set_state=lambda **_: None))
    monkeypatch.setattr(watching, "TeamChart", lambda *_: nullcontext(chart))
    monkeypatch.setattr(watching, "served", lambda *_: nullcontext("a page"))
    monkeypatch.setattr(watching, "page_picture", lambda *_: {})
    fleet: Any = SimpleNamespace(path=SimpleNamespace(stem="fleet"))
    with open(writer, "w") as stream:
        monkeypatch.setattr("sys.stdout", stream)
        if has_page:
            with pytest.raises(KeyboardInterrupt):
                watching.watch(fleet, [], 2.0, once=False, page=0)
        else:
            assert watching.watch(fleet, [], 2.0, once=False) == 0
            assert len(shown) == 3
        monkeypatch.undo()
        os.dup2(os.open(os.devnull, os.O_WRONLY), writer)
