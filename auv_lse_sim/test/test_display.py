"""What a person sees while a mission runs."""

from __future__ import annotations

import io

from rich.console import Console

from auv_lse_sim.engine.display import Display, MissionProgress, clock


def displayed(progress: MissionProgress, terminal: bool) -> str:
    console = Console(force_terminal=terminal, width=120, record=True, file=io.StringIO())
    with Display(progress, console) as display:
        display.refresh()
    return console.export_text()


def test_a_method_without_a_bound_shows_none() -> None:
    progress = MissionProgress(vehicles=2, steps_total=9, steps=[3, 4], rewards={1: 10.0, 2: 5.25})
    assert "bound" not in progress.line
    assert "reward 15" in progress.line
    text = displayed(progress, terminal=True)
    assert "3/9" in text
    assert "lower bound" not in text


def test_a_method_with_a_bound_shows_it_per_vehicle_and_summed() -> None:
    progress = MissionProgress(vehicles=2, steps_total=9, steps=[3, 4], rewards={1: 10.0}, bounds={1: 40.5, 2: 30.25})
    assert "bound 71" in progress.line
    text = displayed(progress, terminal=True)
    assert "40.5" in text
    assert "lower bound 70.8" in text


def test_where_there_is_no_terminal_lines_come_now_and_then() -> None:
    assert "steps - of 9" in displayed(MissionProgress(vehicles=1, steps_total=9), terminal=False)


def test_clock() -> None:
    assert [clock(s) for s in (0.0, 61.9, 3661.0)] == ["0:00", "1:01", "1:01:01"]
