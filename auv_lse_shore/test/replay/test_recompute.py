"""A mission's decisions computed again from its recording: the same, and where a parameter changed, named."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
from sim_helpers import TINY, other_bag
from verb_main import verb_main

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.topics.records import CentersReport, RunReport
from auv_lse_common.vocabulary.mission_run import RunState, RunStatus
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_planner.vehicle.intake import InputsUsed, PlannerIntake
from auv_lse_record.recording import Recording
from auv_lse_record.run_writer import write_run
from auv_lse_shore.replay.inputs import read_inputs, ticks_of
from auv_lse_shore.replay.recompute import table
from auv_lse_shore.replay.recompute_decisions import _plans_heard, recompute_decisions
from auv_lse_shore.replay.recompute_map import RecomputedMap
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of

main = verb_main("replay")

STEPS = 6


@pytest.fixture(scope="module", params=["augmented", None], ids=["augmented", "default"])
def flown(request, tmp_path_factory) -> Path:
    """A run folder of the fleet engine: two vehicles, some of their packets lost."""
    method = {} if request.param is None else {"planner.method": request.param}
    more = {"mission.steps": STEPS, "sim.channel.packet_loss": 0.2, "sim.ideal": False, **method}
    settings = Settings.load(None, TINY | more)
    folder = tmp_path_factory.mktemp("flown") / "a run"
    write_run(Fleet(settings, ground_of(settings)).run(), folder)
    return folder


def test_an_untouched_mission_is_decided_alike(flown: Path, capsys) -> None:
    assert main([str(flown), "--recompute", "planner", "--all"]) == 0
    out = capsys.readouterr().out
    assert f"planner: {2 * STEPS} decisions compared, 0 differ" in out
    assert len([line for line in out.splitlines() if line.startswith("auv")]) == 2 * STEPS, "--all lists every step"
    assert "recorded by" in out


def test_a_recording_of_another_recorder_is_computed_again(flown: Path, tmp_path, capsys) -> None:
    other_bag(flown / "bag", tmp_path / "other", StoragePlugin.SQLITE3)
    assert main([str(tmp_path / "other"), "--recompute", "planner"]) == 2
    assert "Copy the mission's file to" in capsys.readouterr().err
    mission = ["--mission", str(flown / "mission.yaml")]
    assert main([str(tmp_path / "other"), "--recompute", "planner", *mission]) == 0
    assert f"planner: {2 * STEPS} decisions compared, 0 differ" in capsys.readouterr().out


def test_a_changed_parameter_is_found_and_its_differences_are_named(flown: Path, tmp_path, capsys) -> None:
    file = tmp_path / "steps.csv"
    changed = ["--set", "level_set.level_m=13.0", "--csv", str(file)]
    assert main([str(flown), "--recompute", "planner", *changed]) == 1
    out = capsys.readouterr().out
    assert "changed: level_set.level_m: 15.0 -> 13.0" in out
    assert "0 differ" not in out
    with file.open() as stream:
        rows = list(csv.DictReader(stream))
    assert [int(row["step"]) for row in rows if row["vehicle"] == "auv1"] == list(range(STEPS))
    assert any(row["differs"] == "True" for row in rows)


def test_a_difference_of_the_value_alone_is_named(flown: Path, monkeypatch, capsys) -> None:
    inputs = read_inputs(flown)
    decisions = inputs.vehicles[1].decisions
    decisions[2] = dataclasses.replace(decisions[2], jbar=decisions[2].jbar + 1.0)
    monkeypatch.setattr("auv_lse_shore.replay.recompute.read_inputs", lambda *_: inputs)
    assert main([str(flown), "--recompute", "planner"]) == 1
    assert "decisions compared, 1 differ, only in value\n" in capsys.readouterr().out
    other = dataclasses.replace(decisions[2].plan, actions=(4,), tour=None, naive_path=0xF0)
    decisions[2] = dataclasses.replace(decisions[2], plan=other)
    assert main([str(flown), "--recompute", "planner"]) == 1
    assert "only in value" not in capsys.readouterr().out


def test_what_a_deadline_keeps_from_being_repeated_is_named(flown: Path, monkeypatch, capsys) -> None:
    inputs = read_inputs(flown)
    decisions = inputs.vehicles[1].decisions
    decisions[2] = dataclasses.replace(decisions[2], deadline_hit=True)
    other = dataclasses.replace(decisions[3].plan, actions=(4,), tour=None, naive_path=0xF0)
    decisions[3] = dataclasses.replace(decisions[3], plan=other)
    monkeypatch.setattr("auv_lse_shore.replay.recompute.read_inputs", lambda *_: inputs)
    assert main([str(flown), "--recompute", "planner"]) == 1
    out = capsys.readouterr().out
    assert " of them cannot be repeated: a deadline ended the search, or an earlier one" in out
    found = [line for line in out.splitlines() if line.startswith("auv1")]
    assert found[0].endswith("the deadline ended the recorded search")
    assert found[1].endswith("other random numbers, after a search ended by the deadline")


@pytest.mark.parametrize(
    ("changed", "measures_alike"),
    [
        ("planner.method=plain", False),
        ("planner.method=line", False),
        ("planner.method=max_variance", False),
        ("level_set.level_m=13.0", True),
    ],
)
def test_values_that_measure_something_else_have_no_difference(
    flown: Path, tmp_path, capsys, changed, measures_alike
) -> None:
    file = tmp_path / "steps.csv"
    main([str(flown), "--recompute", "planner", "--all", "--set", changed, "--csv", str(file)])
    out = capsys.readouterr().out
    assert ("the values measure different rewards, or horizons, and are not compared" in out) == (not measures_alike)
    with file.open() as stream:
        rows = list(csv.DictReader(stream))
    assert all(row["value"] and row["value now"] for row in rows)
    assert all(bool(row["difference"]) == measures_alike for row in rows)
    if not measures_alike:
        same = [row for row in rows if row["plan now"] == "same" and row["turn (deg)"] == row["turn now (deg)"]]
        assert all(row["differs"] == "False" or row["note"] for row in same), "the same decision"


def test_after_a_difference_the_planner_goes_on_from_what_was_flown(flown: Path) -> None:
    """One recorded plan is replaced: its step alone differs where nothing is drawn by chance."""
    inputs = read_inputs(flown)
    settings = Settings.from_patterns(inputs.parameters, "flown", {"planner.method": "lawnmower"})
    vehicle = inputs.vehicles[1]
    first = recompute_decisions(vehicle, settings, True, 1e-9, lambda share: None)
    anchors = [(row.step, row.now_s) for row in first]
    assert anchors == [(d.step, d.now_s) for d in vehicle.decisions], "each in the situation of the recorded one"
    other = dataclasses.replace(vehicle.decisions[2].plan, actions=(4,), tour=None, naive_path=0xF0)
    vehicle.decisions[2] = dataclasses.replace(vehicle.decisions[2], plan=other)
    again = recompute_decisions(vehicle, settings, True, 1e-9, lambda share: None)
    assert [row.values for row in again[:2]] == [row.values for row in first[:2]]
    assert again[2].plans[0] != first[2].plans[0]
    assert isinstance(other, Plan)


def test_what_the_planner_told_it_had_taken_goes_before_the_recorders_clock(flown: Path, monkeypatch) -> None:
    """As a paced mission's: the recorder heard each input at another time than the planner took it."""
    inputs = read_inputs(flown)
    settings = Settings.from_patterns(inputs.parameters, "flown")
    vehicle = inputs.vehicles[2]
    ours = RecomputedMap(vehicle, settings.planner_settings(2), settings.positions_in_force(2), True)
    for tick in ticks_of(
        vehicle
    ):  # nodes publish the map's centers, the position by it and the plans that came in; the engine does not
        ours.advance(tick)
        centers = {f.name: getattr(ours.map.centers, f.name) for f in dataclasses.fields(ours.map.centers)}
        vehicle.centers.append((tick, CentersReport(stamp_s=tick, revision=ours.map.revision, **centers)))
        if ours.position is not None:
            vehicle.corrected.append((tick, ours.position))
    vehicle.plans = _plans_heard(vehicle, settings)
    told: dict[float, InputsUsed] = {}
    take = PlannerIntake.take

    def noted(intake: PlannerIntake, now_s: float) -> bool:
        due = take(intake, now_s)
        told[now_s] = intake.inputs_used
        return due

    monkeypatch.setattr(PlannerIntake, "take", noted)
    assert not any(row.differs for row in recompute_decisions(vehicle, settings, True, 1e-9, lambda share: None))
    monkeypatch.undo()
    vehicle.decisions = [dataclasses.replace(d, taken=told[d.now_s]) for d in vehicle.decisions]
    late_s = np.random.default_rng(3).uniform(0.0, 3.0, 100_000).tolist()
    for name in ("odometry", "corrected", "plans", "centers"):
        entries = [(there_s + late_s.pop(), entry) for there_s, entry in getattr(vehicle, name)]
        setattr(vehicle, name, entries)
    assert vehicle.plans, "something was heard"
    assert not any(row.differs for row in recompute_decisions(vehicle, settings, False, 1e-9, lambda share: None))
    vehicle.decisions = [dataclasses.replace(d, taken=None) for d in vehicle.decisions]
    assert any(row.differs for row in recompute_decisions(vehicle, settings, False, 1e-9, lambda share: None))


def test_a_hold_is_not_time_under_way(flown: Path) -> None:
    """A vehicle that held for minutes within a leg did not travel that leg for minutes."""
    inputs = read_inputs(flown)
    settings = Settings.from_patterns(inputs.parameters, "flown", {"planner.plan_expiry_s": 1000.0})
    vehicle = inputs.vehicles[1]
    held_s = 0.5 * (vehicle.decisions[2].now_s + vehicle.decisions[3].now_s)
    go_s = held_s + 300.0

    def later(stamp_s: float) -> float:
        return stamp_s + go_s - held_s if stamp_s > held_s else stamp_s

    for field in dataclasses.fields(vehicle):
        entries = getattr(vehicle, field.name)
        if not isinstance(entries, list) or field.name in ("decisions", "maps"):
            continue
        delayed = [(later(at_s), _delayed(entry, later)) for at_s, entry in entries]
        setattr(vehicle, field.name, delayed)
    vehicle.decisions = [dataclasses.replace(d, now_s=later(d.now_s)) for d in vehicle.decisions]
    without = recompute_decisions(vehicle, settings, True, 1e-9, lambda share: None)
    assert without[3].differs, "the leg timed out"
    states = [(held_s, RunState.HOLDING, "HOLD by an operator"), (go_s, RunState.RUNNING, "GO by an operator")]
    vehicle.states = [
        (at_s, RunReport(stamp_s=at_s, revision=number, status=RunStatus(state=state, stop=None, reason=reason)))
        for number, (at_s, state, reason) in enumerate(states, 2)
    ]
    rows = recompute_decisions(vehicle, settings, True, 1e-9, lambda share: None)
    assert not any(row.differs for row in rows[:4]), "the hold's drift changes the map only later"


def _delayed(entry, later):
    """A recorded input with its stamp by the clock `later`."""
    stamp_s = getattr(entry, "stamp_s", None)
    if not isinstance(stamp_s, float):
        return entry
    replace = dataclasses.replace if dataclasses.is_dataclass(entry) else type(entry)._replace
    return replace(entry, stamp_s=later(stamp_s))


def test_a_parameter_that_had_no_value_before_it_was_changed_counts(flown: Path, monkeypatch) -> None:
    """ROS reports the first value of such a parameter as new; at its declaration it has none.

    A node that starts reports all of its parameters as new: those of the mission file, and retired ones.
    """

    messages = Recording.messages

    def events(self: Recording, topics: Any = None) -> Iterator[tuple[str, int, Any]]:
        if topics != {"/parameter_events"}:
            yield from messages(self, topics)
            return
        kinds = (
            (0.0, "new", 0, 0, "horizon"),
            (9.0, "new", 2, 7, "horizon"),
            (15.0, "new", 2, 3, "samples_per_leg"),
            (15.0, "new", 2, 3, "batch"),
            (20.0, "changed", 2, 9, "horizon"),
        )
        for at_s, kind, type_, number, name in kinds:
            value = SimpleNamespace(type=type_, integer_value=number)
            parameter = SimpleNamespace(name=f"planner.{name}", value=value)
            lists = {f"{which}_parameters": [parameter] if which == kind else [] for which in ("new", "changed")}
            yield "/parameter_events", round(at_s * 1e9), SimpleNamespace(node="/auv1/planner_node", **lists)

    monkeypatch.setattr(Recording, "messages", events)
    tuned = read_inputs(flown).vehicles[1].tuned
    assert tuned == [(9.0, {"planner.horizon": 7}), (20.0, {"planner.horizon": 9})]


def test_maps_that_cannot_be_compared_are_reported(flown: Path, tmp_path, capsys) -> None:
    assert main([str(flown), "--recompute", "gp"]) == 2
    assert "holds no maps (topic /auvN/field)" in capsys.readouterr().err, "the fleet engine publishes none"
    assert main([str(flown), "--recompute", "planner", "--set", "planner.horizn=5"]) == 2
    assert "did you mean 'horizon'" in capsys.readouterr().err
    with pytest.raises(SystemExit) as end:
        main([str(flown), "--recompute", "modem"])
    assert end.value.code == 2
    assert "'modem' is neither of gp, planner" in capsys.readouterr().err


def test_a_table_leaves_out_empty_columns() -> None:
    assert table(("a", "bb", "c"), [("1", "", "x"), ("22", "", "y")]) == ["a   c", "1   x", "22  y"]
    assert table(("a",), []) == []
