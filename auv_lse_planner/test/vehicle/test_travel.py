"""When a decision is due, from where it plans, and when a leg begins: worked on straight legs of 30 m at 1.5 m/s."""

import math

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_planner.vehicle.travel import EstimatedState, Travel

PLANNER = PlannerConfig(replan_lead_s=4.0, reanchor_m=10.0, odometry_timeout_s=10.0)  # a lead of 6 m


def _leg(step):
    """Leg `step` of a path straight to the north."""
    return Leg(
        step=step, heading_rad=0.0, north_m=30.0 * step, east_m=0.0, action_rad=0.0, radius_m=15.0, straight_m=30.0
    )


def _at(now_s, north_m, east_m=0.0, heading_rad=0.0):
    return EstimatedState(now_s, heading_rad, north_m, east_m)


def _travel(steps=3, **vehicle):
    return Travel(VehicleConfig(speed_mps=1.5, **vehicle), steps)


def _on_the_first_leg(steps=3):
    travel = _travel(steps)
    travel.move(_at(0.0, 0.0))
    travel.take(_leg(0), 0.0, at_once=False)
    return travel


def test_the_first_decision_waits_for_odometry_and_the_start_delay():
    travel = _travel(start_delay_s=5.0)
    assert not travel.due(6.0, PLANNER)
    travel.move(_at(1.0, 0.0))
    assert not travel.due(4.9, PLANNER)
    assert travel.due(5.0, PLANNER)
    assert not travel.due(11.1, PLANNER), "the odometry is more than 10 s old"


def test_the_next_decision_is_due_when_six_metres_are_left():
    travel = _on_the_first_leg()
    assert (travel.leg, travel.leg_started_s, travel.decided) == (_leg(0), 0.0, 1)
    for north_m, due in ((23.9, False), (24.1, True), (31.0, True)):
        travel.move(_at(16.0, north_m))
        assert travel.due(16.0, PLANNER) is due
    travel.take(_leg(1), 16.0, at_once=False)
    assert not travel.due(16.0, PLANNER), "a decided leg waits"


def test_decided_leg_begins_at_the_end_of_the_current_one():
    travel = _on_the_first_leg()
    travel.take(_leg(1), 16.0, at_once=False)
    travel.move(_at(19.0, 29.9))
    assert travel.leg == _leg(0)
    travel.move(_at(20.0, 30.0))
    assert (travel.leg, travel.leg_started_s) == (_leg(1), 20.0)


def test_leg_from_odometry_begins_at_once():
    travel = _on_the_first_leg()
    travel.take(_leg(1), 7.0, at_once=True)
    assert (travel.leg, travel.leg_started_s, travel.decided) == (_leg(1), 7.0, 2)


def test_leg_whose_end_is_never_passed_times_out():
    travel = _on_the_first_leg(steps=2)
    travel.take(_leg(1), 16.0, at_once=False)
    travel.move(_at(89.0, 29.9))  # as an autopilot that holds just before the end: overdue after 4 x 20 s + 10 s
    assert travel.leg == _leg(0)
    travel.move(_at(91.0, 29.9))
    assert (travel.leg, travel.leg_started_s) == (_leg(1), 91.0)
    assert travel.timed_out == 1
    travel.move(_at(180.0, 59.0))
    assert not travel.finished
    travel.move(_at(182.0, 59.0))
    assert travel.finished, "the last leg's time is up: the mission ends"
    assert travel.timed_out == 2


def test_hold_pauses_the_legs_timeout():
    travel = _on_the_first_leg(steps=1)
    travel.set_running(10.0, False)
    travel.move(_at(500.0, 10.0))
    travel.set_running(500.0, True)
    travel.move(_at(501.0, 10.0))
    assert not travel.finished


def test_travel_is_finished_at_the_end_of_the_last_leg_and_stays_finished():
    travel = _on_the_first_leg(steps=1)
    travel.move(_at(19.0, 29.0))
    assert not travel.finished
    travel.move(_at(20.0, 30.5))
    assert travel.finished
    travel.move(_at(40.0, 10.0))  # it circles
    assert travel.finished
    assert not travel.due(40.0, PLANNER)


def test_leg_is_overdue_after_four_times_its_duration_plus_ten_seconds():
    assert not _travel().overdue(1e6)
    travel = _on_the_first_leg()
    assert not travel.overdue(90.0)  # 30 m at 1.5 m/s: 20 s; 4 x 20 s + 10 s
    assert travel.overdue(90.1)
    travel.move(_at(90.1, 5.0))
    assert travel.due(90.1, PLANNER)
    state, from_odometry = travel.anchor(PLANNER)
    assert from_odometry
    assert state == pytest.approx([0.0, 5.0 + 6.0, 0.0])


def test_the_first_decision_plans_from_the_configured_start_unless_the_vehicle_is_elsewhere():
    travel = _travel(start_north_m=100.0, start_east_m=50.0, start_heading_rad=1.0)
    with pytest.raises(ValueError, match="there is no odometry yet"):
        travel.anchor(PLANNER)
    for off_m, from_odometry in ((9.0, False), (11.0, True)):
        travel.move(_at(0.0, 100.0 + off_m, 50.0, 0.5))
        state, reanchored = travel.anchor(PLANNER)
        assert reanchored is from_odometry
        assert state.tolist() == ([0.5, 111.0, 50.0] if from_odometry else [1.0, 100.0, 50.0])


def test_later_decisions_plan_from_the_legs_end_unless_off_the_leg():
    travel = _on_the_first_leg()
    travel.move(_at(16.0, 24.0, 9.0))  # 9 m to starboard of the leg
    state, from_odometry = travel.anchor(PLANNER)
    assert not from_odometry
    assert state == pytest.approx([0.0, 30.0, 0.0])
    travel.move(_at(16.0, 27.0, 11.0, math.pi / 2.0))  # 11 m off; 3 m are left, which it goes on to the east
    state, from_odometry = travel.anchor(PLANNER)
    assert from_odometry
    assert state == pytest.approx([math.pi / 2.0, 27.0, 14.0])
    travel.move(_at(16.0, 32.0))  # a tick late
    assert not travel.anchor(PLANNER)[1]
    travel.move(_at(16.0, 41.0))  # on the line, but 11 m beyond the leg's end
    state, from_odometry = travel.anchor(PLANNER)
    assert from_odometry
    assert np.array_equal(state, [0.0, 41.0, 0.0])
    travel.move(_at(16.0, 34.0))
    state, from_odometry = travel.anchor(PLANNER)
    assert from_odometry, "late by more: it may circle by now"
    assert np.array_equal(state, [0.0, 34.0, 0.0])


@pytest.mark.parametrize(("heading_rad", "from_odometry"), [(0.7, False), (-0.9, True)])
def test_vehicle_with_a_heading_error_plans_from_its_predicted_location(heading_rad, from_odometry):
    travel = _on_the_first_leg()
    travel.move(_at(16.0, 24.0, 1.0, heading_rad))
    state, reanchored = travel.anchor(PLANNER)
    assert reanchored is from_odometry
    expected = [-0.9, 24.0 + 6.0 * math.cos(0.9), 1.0 - 6.0 * math.sin(0.9)] if from_odometry else [0.0, 30.0, 0.0]
    assert state == pytest.approx(expected)


def test_hold_counts_no_step_and_pauses_the_legs_timer():
    waiting = _travel()
    waiting.set_running(0.0, False)
    waiting.move(_at(0.0, 0.0))
    assert not waiting.due(500.0, PLANNER), "on deck, with odometry"
    travel = _on_the_first_leg()
    travel.take(_leg(1), 16.0, at_once=False)
    travel.set_running(17.0, False)
    for now_s in range(17, 1017, 5):
        travel.move(_at(float(now_s), 45.0, 20.0))  # it circles, past the end of its leg
        assert not travel.due(float(now_s), PLANNER)
        assert not travel.overdue(float(now_s))
    assert travel.leg == _leg(0)
    travel.set_running(1017.0, True)
    assert travel.leg_started_s == 1000.0
    assert not travel.overdue(1017.0)
    travel.move(_at(1018.0, 30.5, 1.0))
    assert travel.leg == _leg(1)


def test_unreachable_location_is_rejected_and_a_lasting_fix_accepted():
    travel = _on_the_first_leg()
    travel.move(_at(1.0, 1.5))
    travel.move(_at(2.0, 500.0))
    travel.move(_at(3.0, 4.5))
    assert (travel.estimate.north_m, travel.gate.jumps) == (4.5, 1)
    for i in range(4, 8):  # a fix after a long dive
        assert travel.estimate.north_m == 4.5
        travel.move(_at(float(i), 1.5 * i, 80.0))
    assert travel.estimate.east_m == 80.0
    travel.move(_at(1000.0, 1500.0))
    assert travel.estimate.north_m == 1500.0, "after a long silence it may be anywhere near"
