"""What a vehicle does after its safety node, or its whole computer, was restarted."""

from __future__ import annotations

import json
from typing import Any

import pytest

from auv_lse_common.safety.watch import AutopilotReport
from auv_lse_common.vocabulary.mission_run import Action, Command, RunState
from auv_lse_planner.safety import Safety

AREA = {"area": {"polygon_m": [0.0, 0.0, 100.0, 0.0, 100.0, 100.0, 0.0, 100.0]}}


def safety(start: str = "at_once", **limits: Any) -> Safety:
    return Safety.of({**AREA, "safety": limits, "vehicle": {"start": start}}, "test", 1)


def steps(one: Safety, depth_m: float, seconds: float, now_s: float = 1000.0) -> Safety:
    for tick in range(round(seconds * 10)):
        then_s = now_s + 0.1 * tick
        one.watch.odometry(then_s, 0.0, 50.0 + 0.1 * tick, 50.0, depth_m, 1.0)
        one.step(then_s)
    return one


def restarted(one: Safety, *, rebooted: bool, **limits: Any) -> Safety:
    again = safety(**limits)
    again.recover(json.loads(json.dumps(one.snapshot())), "", rebooted)
    return again


def test_a_restarted_node_continues() -> None:
    again = restarted(steps(safety(), 5.0, 5.0), rebooted=False)
    assert again.run.status.state is RunState.RUNNING


@pytest.mark.parametrize("clock_s", [0.0, 500.0, 1e6])
def test_after_a_reboot_under_water_it_surfaces_or_resumes_whatever_the_clock_says(clock_s: float) -> None:
    before = steps(safety(), 5.0, 5.0)
    surfaces = restarted(before, rebooted=True)
    assert surfaces.run.status.stop is not None, "holds until it knows its depth"
    assert steps(surfaces, 5.0, 5.0, clock_s).run.status.stop.action is Action.SURFACE
    assert "reboot" in surfaces.run.limits
    resumes = steps(restarted(before, rebooted=True, after_reboot="resume"), 5.0, 5.0, clock_s)
    assert resumes.run.status.state is RunState.RUNNING


def test_after_a_reboot_at_the_surface_it_waits_for_go() -> None:
    again = steps(restarted(steps(safety(), 5.0, 5.0), rebooted=True, after_reboot="resume"), 0.3, 5.0)
    assert again.run.status.state is RunState.HOLDING
    assert again.run.status.stop.action is Action.SURFACE
    assert again.run.command(Command.GO, "test") == ""


def test_single_wrong_depths_do_not_decide_where_it_is() -> None:
    again = restarted(steps(safety(), 5.0, 5.0), rebooted=True, after_reboot="resume")
    for tick in range(50):
        again.watch.odometry(0.1 * tick, 0.0, 50.0 + 0.1 * tick, 50.0, 0.0 if tick % 3 == 0 else 5.0, 1.0)
        again.step(0.1 * tick)
    assert again.run.status.state is RunState.RUNNING


def test_a_node_that_is_killed_before_the_depth_is_known_still_answers_the_reboot() -> None:
    once = restarted(steps(safety(), 5.0, 5.0), rebooted=True)
    twice = steps(restarted(once, rebooted=False), 5.0, 5.0)
    assert "reboot" in twice.run.limits


def test_an_abort_outlives_any_restart() -> None:
    one = steps(safety(), 5.0, 5.0)
    one.run.command(Command.ABORT, "test")
    for rebooted in (False, True):
        for depth_m in (0.2, 5.0):
            again = steps(restarted(one, rebooted=rebooted, after_reboot="resume"), depth_m, 5.0)
            assert again.run.status.state is RunState.ABORTED


def test_a_vehicle_under_water_does_not_wait_for_a_go_that_cannot_reach_it() -> None:
    assert steps(safety("on_call"), 0.3, 60.0).run.status.state is RunState.WAITING
    sunk = steps(safety("on_call"), 5.0, 5.0)
    assert sunk.run.status.stop.action is Action.SURFACE
    assert "waiting" in sunk.run.limits
    assert steps(safety("on_call"), 5.0, 2.0).run.limits == {}, "not before safety.patience_s"


def test_a_lost_state_surfaces_and_holds_until_reset() -> None:
    again = safety()
    again.recover({}, "state file x: is damaged", False)
    assert again.run.status.stop.action is Action.SURFACE
    assert again.run.command(Command.GO, "test") != ""


def test_a_vehicle_with_an_autopilot_waits_for_go_whatever_its_mission_file_says() -> None:
    parameters = {**AREA, "vehicle": {"start": "at_once"}, "link": {"kind": "mavlink"}}
    assert Safety.of(parameters, "test", 1).run.status.state is RunState.WAITING
    assert Safety.of({**parameters, "sim": {}}, "test", 1).run.status.state is RunState.RUNNING, "in a simulation"


def test_reset_is_refused_while_a_limit_is_exceeded_and_names_it_with_its_value() -> None:
    one = steps(safety(), 5.0, 5.0)
    deep = steps(one, 30.0, 5.0, 1005.0)
    assert "depth" in deep.run.limits
    refusal = deep.command(Command.RESET, "test")
    assert refusal.startswith("RESET: a limit is still exceeded and would trip again (depth: depth 30.0 m, deeper")
    assert "depth" in deep.run.limits, "nothing was cleared"
    up = steps(deep, 1.0, 1.0, 1010.0)
    assert up.command(Command.RESET, "test") == ""
    assert steps(up, 1.0, 20.0, 1011.0).run.limits == {}


def test_reset_outside_of_the_fence_lets_the_vehicle_return() -> None:
    one = steps(safety(fence_margin_m=5.0), 5.0, 2.0)
    for tick in range(100):
        one.watch.odometry(1002.0 + 0.1 * tick, 0.0, 50.0 + 5.0 * tick, 50.0, 5.0, 1.0)
        one.step(1002.0 + 0.1 * tick)
    assert "fence" in one.run.limits
    assert one.command(Command.RESET, "test") == ""
    assert one.command(Command.GO, "test") == ""


def test_an_operator_sees_what_is_missing_once_the_instruments_had_time_to_start() -> None:
    one = Safety.of({**AREA, "link": {"kind": "mavlink"}, "vehicle": {"start": "on_call"}}, "test", 1)
    one.watch.autopilot(AutopilotReport(heard=True, armed=False, depth_problem="no pressure"))
    shown = []
    for now_s in range(100, 115):
        one.step(float(now_s))
        shown.append("pressure" in one.news(float(now_s)))
    assert "pressure" in one.problems()
    assert shown == [False] * 10 + [True] * 5, "nothing in the first 10 s of waiting"

    again = Safety.of({**AREA, "link": {"kind": "mavlink"}, "vehicle": {"start": "on_call"}}, "test", 1)
    again.watch.autopilot(AutopilotReport(heard=True, armed=True, depth_problem="no pressure"))
    again.step(100.0)
    again.step(102.0)
    again.distrust("a lost state")
    assert set(again.news(102.0)) == {"tripped state_lost", "pressure"}, "it does not wait, and everything is seen"
