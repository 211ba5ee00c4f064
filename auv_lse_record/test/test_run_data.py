"""What a mission leaves behind."""

import numpy as np
import pytest

from auv_lse_common.topics.records import HealthReport, RunReport
from auv_lse_common.vocabulary.health import BATTERY_LASTS, LEGS_LEFT, LEGS_PLANNED
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import RunState, RunStatus
from auv_lse_record.run_data import VehicleRun
from auv_lse_record.run_reader import battery_of, unfinished_legs, why_ended_early

LAST = "the last leg is complete"


def test_wrong_columns_are_rejected():
    with pytest.raises(ValueError, match=r"auv3 truth must have the shape \(n, 4\), not \(2, 3\)"):
        VehicleRun(vehicle=3, truth=np.zeros((2, 3)))


def test_of_the_battery_the_last_values_count_while_the_mission_ran():
    def health(stamp_s, **values):
        return [HealthReport(stamp_s=stamp_s, name="n", level=0, text="ok", values=values)]

    battery = {LEGS_LEFT: "9", BATTERY_LASTS: "2.50 km (standard deviation 0.10 km)"}
    messages = [
        health(30.0, state="ENDED", **{LEGS_LEFT: "3"}),
        health(20.0, state="RUNNING", **battery),
        health(21.0, **{LEGS_PLANNED: "40"}),
        health(10.0, state="RUNNING", **{LEGS_LEFT: "30"}),
    ]
    assert battery_of(messages) == {**battery, LEGS_PLANNED: "40"}
    assert battery_of([health(10.0, state="RUNNING"), health(11.0, **{LEGS_PLANNED: "40"})]) == {}


@pytest.mark.parametrize(
    ("states", "reason", "is_on_a_leg"),
    [
        ([(RunState.RUNNING, "GO"), (RunState.ENDED, LAST)], "", False),
        (
            [(RunState.RUNNING, "GO"), (RunState.ENDED, "the battery suffices for the way")],
            "the battery suffices",
            True,
        ),
        ([(RunState.RUNNING, "GO"), (RunState.ABORTED, "running for 104 s")], "running for 104 s", True),
        ([(RunState.ABORTED, "a leak"), (RunState.ABORTED, "ABORT by auv2")], "a leak", True),
        ([(RunState.ENDED, LAST), (RunState.ABORTED, "ABORT by auv2")], "", False),
        ([(RunState.ABORTED, "a leak"), (RunState.RUNNING, "GO"), (RunState.ENDED, LAST)], "", False),
        ([(RunState.ENDED, LAST), (RunState.RUNNING, "GO")], "", True),
        ([(RunState.RUNNING, "GO"), (RunState.HOLDING, "HOLD by test")], "", True),
        ([], "", False),
    ],
)
def test_what_ended_a_mission_decides_whether_it_ended_early_and_on_a_leg(states, reason, is_on_a_leg):
    reports = [
        RunReport(stamp_s=float(i), revision=i, status=RunStatus(state=state, stop=None, reason=text))
        for i, (state, text) in enumerate(states)
    ]
    assert why_ended_early(reports).startswith(reason)
    assert bool(why_ended_early(reports)) == bool(reason)
    assert unfinished_legs(reports, [], np.empty((0, 4))) == is_on_a_leg


@pytest.mark.parametrize(("at_m", "unfinished"), [(19.0, 2), (21.0, 1)])
@pytest.mark.parametrize("ends", [None, RunState.ABORTED])
def test_a_leg_that_was_decided_before_it_began_is_unfinished_beside_the_one_before(ends, at_m, unfinished):
    """Ctrl-C, or an abort, between a decision and the start of its leg: one leg too many counted as travelled."""
    states = [(0.0, RunState.RUNNING), *([] if ends is None else [(2.0, ends)])]
    reports = [
        RunReport(stamp_s=t, revision=i, status=RunStatus(state=state, stop=None, reason="a leak"))
        for i, (t, state) in enumerate(states)
    ]
    legs = [
        Leg(step=step, heading_rad=0.0, north_m=20.0 * step, east_m=0.0, action_rad=0.0, straight_m=20.0, radius_m=15.0)
        for step in (0, 1)
    ]
    odometry = np.array([[1.0, 10.0, 0.0, 0.0], [2.0, at_m, 0.0, 0.0], [9.0, 90.0, 0.0, 0.0]])
    assert unfinished_legs(reports, legs, odometry[: 2 if ends is None else 3]) == unfinished


@pytest.mark.parametrize(
    ("unfinished", "decided", "travelled"), [(0, 3, 3), (1, 3, 2), (2, 3, 1), (1, 1, 0), (2, 1, 0), (1, 0, 0)]
)
def test_a_leg_that_was_decided_but_not_completed_is_not_travelled(synthetic_run, unfinished, decided, travelled):
    decisions = synthetic_run(steps=4).vehicles[0].decisions[:decided]
    vehicle = VehicleRun(vehicle=1, decisions=decisions, unfinished_legs=unfinished)
    assert (vehicle.steps, len(vehicle.travelled)) == (travelled, travelled)
