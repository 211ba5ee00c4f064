"""A vehicle goes to its recovery position while its battery suffices for the way."""

from __future__ import annotations

import math

import pytest

from auv_lse_common.safety.watch import AutopilotReport
from auv_lse_common.vocabulary.mission_run import Action, Command, RunState
from auv_lse_planner.safety import Safety


def dive(per_m: float, at_end: str = "go_to", reported: bool = True, min_battery: float = 0.2) -> tuple[Safety, float]:
    """Travels away from the recovery position; returns the safety and the true charge when the mission ended."""
    one = Safety.of(
        {
            "area": {"polygon_m": [0.0, -10.0, 3000.0, -10.0, 3000.0, 10.0, 0.0, 10.0]},
            "vehicle": {"at_end": at_end, "recovery_north_m": 0.0, "recovery_east_m": 0.0},
            "link": {"kind": "mavlink"},
            "safety": {"min_battery": min_battery},
        },
        "test",
        1,
    )
    one.run.command(Command.GO, "test")
    charge = 0.9
    for second in range(1400):
        charge -= per_m
        shown = round(charge, 2) if reported else math.nan
        one.watch.autopilot(AutopilotReport(heard=True, armed=True, battery=shown, stamp_s=float(second)))
        one.watch.odometry(float(second), 0.0, float(second), 0.01 * (second % 7), 4.0, 1.0)
        one.step(float(second))
        if one.run.status.state is RunState.ENDED:
            break
    return one, charge


@pytest.mark.parametrize("per_m", [0.0004, 0.001])
def test_it_comes_home_above_the_reserve_and_does_not_turn_early(per_m: float) -> None:
    one, charge = dive(per_m)
    assert one.run.status.state is RunState.ENDED
    assert one.run.status.stop is not None
    assert one.run.status.stop.action is Action.GO_TO
    assert "suffices for the" in one.run.status.reason
    north_m = one.watch.way[2] if one.watch.way else math.nan
    at_home = charge - per_m * north_m
    assert 0.2 <= at_home <= 0.27
    assert not one.run.limits


@pytest.mark.parametrize(
    "values", [{"reported": False}, {"min_battery": 0.0}, {"at_end": "hold"}], ids=["silent", "not watched", "no home"]
)
def test_otherwise_the_mission_goes_on(values: dict) -> None:
    one, _ = dive(0.0004, **values)
    assert one.run.status.state is RunState.RUNNING
    assert ("battery lasts m" in one.health().values) == ("at_end" in values)
