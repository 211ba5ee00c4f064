"""A vehicle goes to its recovery position while its battery suffices for the way, and GO compares both."""

from __future__ import annotations

import math
from typing import Any

import pytest

from auv_lse_common.safety.watch import AutopilotReport
from auv_lse_common.vocabulary.health import BATTERY_LASTS, LEGS_LEFT
from auv_lse_common.vocabulary.mission_run import Action, Command, RunState
from auv_lse_planner.safety import Safety


def safety(at_end: str = "go_to", min_battery: float = 0.2, steps: int = 100, **vehicle: Any) -> Safety:
    return Safety.of(
        {
            "area": {"polygon_m": [0.0, 0.0, 400.0, 0.0, 400.0, 60.0, 0.0, 60.0]},
            "vehicle": {"at_end": at_end, "recovery_north_m": 0.0, "recovery_east_m": 30.0, **vehicle},
            "link": {"kind": "mavlink"},
            "safety": {"min_battery": min_battery},
            "mission": {"steps": steps},
        },
        "test",
        1,
    )


def report(charge: float, now_s: float) -> AutopilotReport:
    return AutopilotReport(heard=True, armed=True, battery=charge, stamp_s=now_s)


def dive(per_m: float, reported: bool = True, **values: Any) -> tuple[Safety, float]:
    """Mows lanes away from the recovery position; returns the safety and the true charge when the mission ended."""
    one = safety(**values)
    one.command(Command.GO, "test")
    charge = 0.9
    for second in range(1400):
        charge -= per_m
        one.watch.autopilot(report(round(charge, 2) if reported else math.nan, float(second)))
        lane, along = divmod(second, 80)
        east_m = min(along, 60) if lane % 2 == 0 else 60 - min(along, 60)
        north_m = 20.0 * lane + max(along - 60, 0)
        one.watch.odometry(float(second), 0.0, north_m, east_m + 0.01 * (second % 7), 4.0, 1.0)
        one.step(float(second))
        if one.run.status.state is RunState.ENDED:
            break
    return one, charge


@pytest.mark.parametrize(("per_m", "lasts_km"), [(0.0005, None), (0.001, None), (0.001, 1.1)])
def test_it_comes_home_above_the_reserve_and_does_not_turn_early(per_m: float, lasts_km: float | None) -> None:
    one, charge = dive(per_m, **({} if lasts_km is None else {"battery_km": lasts_km, "steps": 20}))
    assert one.run.status.state is RunState.ENDED
    assert one.run.status.stop is not None
    assert one.run.status.stop.action is Action.GO_TO
    assert "suffices for the" in one.run.status.reason
    assert one.watch.way is not None
    at_home = charge - per_m * math.dist(one.watch.way[2:], (0.0, 30.0))
    assert 0.2 <= at_home <= 0.3
    assert not one.run.limits
    assert LEGS_LEFT not in one.health().values, "no leg follows"
    values = one.battery.values(*one.watch.way[2:])
    assert int(values[LEGS_LEFT]) <= 1
    assert abs(float(values[BATTERY_LASTS].split()[0]) - 0.001 / per_m) < 0.2


def test_a_battery_whose_charge_does_not_fall_tells_nothing_of_how_far_it_lasts() -> None:
    """The report would propose thousands of kilometres for vehicle.battery_km."""
    one, _ = dive(0.0)
    assert one.watch.way is not None
    values = one.battery.values(*one.watch.way[2:])
    assert LEGS_LEFT in values
    assert BATTERY_LASTS not in values


@pytest.mark.parametrize(
    "values", [{"reported": False}, {"min_battery": 0.0}, {"at_end": "hold"}], ids=["silent", "not watched", "no home"]
)
def test_otherwise_the_mission_goes_on(values: dict) -> None:
    one, _ = dive(0.0004, **values)
    assert one.run.status.state is RunState.RUNNING
    assert (LEGS_LEFT in one.health().values) == ("at_end" in values)
    assert ("charge" in one.warnings) == ("reported" in values), "missing data warns, and the mission goes on"


@pytest.mark.parametrize(
    ("battery_km", "charge", "refused", "warned"),
    [
        (5.0, 1.0, "", ""),
        (5.0, 0.62, "", "mission: the battery (62%) lasts for about 72 of 100 legs and up to 401 m to the recovery"),
        (5.0, 0.4, "GO: the battery (40%) lasts for about 25 of 100 legs", ""),
        (0.3, 1.0, "GO: the battery (100%) lasts for about 0 of 100 legs", ""),
        (5.0, math.nan, "", "mission: the autopilot reports no charge"),
        (None, 0.3, "", ""),
    ],
)
def test_go_compares_the_mission_with_the_battery(
    battery_km: float | None, charge: float, refused: str, warned: str
) -> None:
    one = safety(**({} if battery_km is None else {"battery_km": battery_km}))
    one.watch.autopilot(report(charge, 0.0))
    one.watch.odometry(0.0, 0.0, 0.0, 30.0, 0.0, 0.0)
    one.step(0.0)
    answer = one.command(Command.GO, "test")
    assert answer.startswith(refused)
    assert bool(answer) == bool(refused)
    assert one.run.waits_for_go == bool(refused)
    assert "; ".join(one.problems().values()).startswith(warned)
    assert bool(one.problems()) == bool(warned)
    if refused:
        one.watch.autopilot(report(1.0, 1.0))
        one.step(1.0)
        assert one.command(Command.GO, "test").startswith("GO" if battery_km == 0.3 else ""), "a charged one may go"
        assert one.run.waits_for_go == (battery_km == 0.3)


def test_go_resumes_a_hold_whatever_the_battery() -> None:
    one = safety(battery_km=5.0)
    one.watch.autopilot(report(1.0, 0.0))
    one.watch.odometry(0.0, 0.0, 0.0, 30.0, 0.0, 0.0)
    one.step(0.0)
    assert not one.command(Command.GO, "test")
    assert not one.command(Command.HOLD, "test")
    one.watch.autopilot(report(0.4, 1.0))
    one.step(1.0)
    assert not one.command(Command.GO, "test")


def test_a_hold_before_the_first_go_changes_no_answer() -> None:
    one = safety(battery_km=5.0)
    one.watch.autopilot(report(0.4, 0.0))  # before the first position
    one.step(0.0)
    assert one.command(Command.GO, "test").startswith("GO: the battery (40%)")
    one.command(Command.HOLD, "test")
    assert one.command(Command.GO, "test").startswith("GO: the battery (40%)")


def test_a_restarted_node_goes_on_with_the_mission() -> None:
    one, second = safety(), 0
    one.command(Command.GO, "test")
    for second in range(600):
        one.watch.autopilot(report(0.9 - 0.0002 * second, float(second)))
        one.watch.odometry(float(second), 0.0, float(second % 380), 30.0, 4.0, 1.0)
        one.step(float(second))
    assert one.run.status.state is RunState.RUNNING
    again = safety()
    again.recover(one.snapshot(), "", rebooted=False)
    for later in range(second, second + 40):
        again.watch.autopilot(report(0.9 - 0.0002 * later, float(later)))
        again.watch.odometry(float(later), 0.0, float(later % 380), 30.0, 4.0, 1.0)
        again.step(float(later))
        assert again.run.status.state is RunState.RUNNING, again.run.status.reason
