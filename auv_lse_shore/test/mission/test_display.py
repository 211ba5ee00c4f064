"""What a person sees while a mission runs."""

from __future__ import annotations

import io
import math

import pytest
from rich.console import Console

from auv_lse_common.mission_file.sections.mission import UntilConfig
from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_run.mission.display import MAP_REWARD, PATH_REWARD, Display, MissionProgress, clock, reward_shown


def displayed(progress: MissionProgress, terminal: bool) -> str:
    console = Console(force_terminal=terminal, width=120, record=True, file=io.StringIO())
    with Display(progress, console) as display:
        display.refresh()
    return console.export_text()


def test_of_the_maps_reward_the_team_has_the_vehicles_mean() -> None:
    """Each vehicle counts the whole map, what its mates bring included."""
    progress = MissionProgress(
        phase="running",
        vehicles=2,
        steps_total=9,
        steps=[3, 4],
        rewards={1: 10.0, 2: 20.0},
        expected={1: 50.0, 2: 60.0},
        bounds={1: 70.0, 2: 71.0},
    )
    assert "map reward: so far 15, expected 55  " in progress.line, "the bound is of the map of all soundings"
    text = displayed(progress, terminal=True)
    assert "3/9" in text
    assert "map reward: so far 15, expected 55 (drop of Bayes risk)" in text


def test_a_risk_that_rises_with_the_first_soundings_does_not_read_as_a_failure() -> None:
    progress = MissionProgress(
        phase="running", vehicles=2, steps_total=9, rewards={1: -30.0, 2: 2.0}, expected={1: 50.0, 2: 60.0}
    )
    assert "map reward: expected 55  " in progress.line
    text = displayed(progress, terminal=True)
    assert "map reward: expected 55 (drop of Bayes risk)" in text
    assert "-30" not in text
    assert MissionProgress(phase="running", vehicles=1, steps_total=9, rewards={1: -3.0}).line.endswith(
        "0 lost  0 x real time"
    )


def test_the_papers_reward_adds_up_over_vehicles() -> None:
    progress = MissionProgress(
        phase="running",
        vehicles=2,
        steps_total=9,
        rewards={1: 10.0, 2: 5.25},
        bounds={1: 40.5, 2: 30.25},
        reward=PATH_REWARD,
    )
    assert "path reward: so far 15, bound 71  " in progress.line
    assert "40.5" in displayed(progress, terminal=True)


def test_the_worst_map_is_shown_beside_the_quality_that_ends_the_mission() -> None:
    progress = MissionProgress(
        phase="running",
        vehicles=2,
        steps_total=9,
        until=UntilConfig(found=0.9, undiscovered_m=200.0),
        qualities={1: (0.62, 410.0, 8.0), 2: (0.71, 380.0, math.nan)},
    )
    text = "quality: 62 % found (required 90 %), at most 410 m undiscovered (required 200 m)"
    assert text in progress.line
    assert text in displayed(progress, terminal=True)
    unjudged = MissionProgress(
        phase="running", vehicles=1, steps_total=9, until=UntilConfig(found=0.9), qualities={1: (math.nan,) * 3}
    )
    assert "quality" not in unjudged.line
    unasked = MissionProgress(phase="running", vehicles=1, steps_total=9, qualities={1: (0.5, 1.0, 1.0)})
    assert "quality" not in unasked.line


def test_a_method_without_a_bound_shows_none_and_one_that_maximizes_neither_shows_no_reward() -> None:
    without = MissionProgress(phase="running", vehicles=1, steps_total=9, rewards={1: 10.0})
    assert "map reward: so far 10  " in without.line
    neither = MissionProgress(
        phase="running", vehicles=1, steps_total=9, rewards={1: 10.0}, bounds={1: 12.0}, reward=""
    )
    assert "10" not in neither.line
    assert "12" not in displayed(neither, terminal=True)


@pytest.mark.parametrize(
    ("method", "shown"),
    [("tour", MAP_REWARD), ("fixed_tour", MAP_REWARD), ("augmented", PATH_REWARD), ("lawnmower", "")],
)
def test_whose_reward_is_shown_follows_the_method(method: str, shown: str) -> None:
    assert reward_shown(PlannerConfig(method=method)) == shown


def test_where_there_is_no_terminal_lines_come_now_and_then() -> None:
    assert "legs - of 9" in displayed(MissionProgress(vehicles=1, steps_total=9, phase="running"), terminal=False)


@pytest.mark.parametrize("terminal", [False, True])
def test_a_start_is_reported_as_such(terminal: bool) -> None:
    text = displayed(MissionProgress(vehicles=1, steps_total=9, started_s=12.3), terminal)
    assert text.strip().startswith("starting: loading the nodes, 12 s")
    assert "real time" not in text


def test_a_complete_bar_differs_from_an_empty_one_in_a_terminal_of_few_colors() -> None:
    """rich's own style of complete bars becomes the grey of the empty ones."""
    console = Console(force_terminal=True, color_system="standard", width=120, file=io.StringIO())
    with console.capture() as empty:
        console.print(MissionProgress(phase="running", vehicles=1, steps_total=9, steps=[0]).table())
    with console.capture() as complete:
        console.print(MissionProgress(phase="running", vehicles=1, steps_total=9, steps=[9]).table())
    assert complete.get() != empty.get().replace("0/9", "9/9")


def test_clock() -> None:
    assert [clock(s) for s in (0.0, 61.9, 3661.0)] == ["0:00", "1:01", "1:01:01"]


@pytest.mark.parametrize("terminal", [True, False])
def test_a_hold_is_shown_with_its_reason(terminal: bool) -> None:
    held = "auv1 HOLDING (the autopilot is in mode 9, in which it follows no targets)"
    progress = MissionProgress(phase="running", vehicles=1, steps_total=5, steps=[4], held=held)
    assert f"held: {held}" in " ".join(displayed(progress, terminal).split())


def test_legs_left_by_battery_stand_beside_those_planned() -> None:
    progress = MissionProgress(vehicles=2, steps_total=90, phase="running", steps=[45, 40], battery_legs={1: 31})
    text = displayed(progress, terminal=True)
    assert "legs left by battery" in text
    assert "31 (45 planned)" in text
    assert "legs left by battery 31 -" in progress.line
    assert "battery" not in MissionProgress(vehicles=2, steps_total=90, phase="running").line


@pytest.mark.parametrize(("terminal", "term"), [(False, "xterm"), (True, "dumb")])
def test_lines_are_shown_on_the_way_where_no_table_can_be_renewed(
    monkeypatch: pytest.MonkeyPatch, terminal: bool, term: str
) -> None:
    """As in a shell of Emacs, in which a mission in real time showed nothing for hours."""
    monkeypatch.setenv("TERM", term)
    shown = io.StringIO()
    progress = MissionProgress(phase="running", vehicles=1, steps_total=9)
    with Display(progress, Console(force_terminal=terminal, file=shown)) as display:
        display.refresh()
        assert "legs - of 9" in shown.getvalue()
