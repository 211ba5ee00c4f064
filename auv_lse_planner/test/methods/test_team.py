import numpy as np
import pytest

from auv_lse_common.vocabulary.plan import Plan
from auv_lse_planner.methods.team import Team
from auv_lse_planner.paths.rollout import PlannedPath


def _plan(step, north=0.0):
    return Plan(step=step, heading_rad=0.0, north_m=north, east_m=0.0, actions=(5,), naive_path=0xFF)


def _follow(plan):
    """Ten legs straight on, 10 m each."""
    states = np.zeros((11, 3))
    states[:, 1] = plan.north_m + 10.0 * np.arange(11)
    return PlannedPath(plan.step, states, np.full(10, 5), 1, states[1:, None, 1:])


def _team(vehicle=3, expiry=600.0):
    return Team(vehicle, 4, 20.0, expiry, _follow)


def test_vehicles_with_lower_numbers_plan_before():
    assert _team().before == [1, 2]
    assert _team(vehicle=1).before == []


def test_passed_locations_are_dropped_and_old_plans_expire():
    team = _team()
    team.receive_plan(100.0, 1, _plan(4))
    assert len(team.locations_ahead(100.0, 1)) == 10
    locations = team.locations_ahead(165.0, 1)  # 65 s at 20 s a leg
    assert locations[:, 0].tolist() == [40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0]
    assert len(team.locations_ahead(101.0, 2)) == 0
    assert team.age_s(701.0) == {1: 601.0}


def test_expired_plan_has_no_locations_ahead():
    team = _team(expiry=100.0)
    team.receive_plan(100.0, 1, _plan(4))
    assert len(team.locations_ahead(199.0, 1)) == 6
    assert len(team.in_time_order(199.0)) == 1
    assert len(team.locations_ahead(200.0, 1)) == 0
    assert team.in_time_order(200.0) == []


def test_locations_ahead_have_arrival_times_in_legs():
    """65 s at 20 s a leg: it is a quarter into its eighth leg, whose end comes in three quarters of a leg."""
    team = _team()
    team.receive_plan(100.0, 1, _plan(4))
    ((legs, locations),) = team.in_time_order(165.0)
    assert legs == pytest.approx(0.75 + np.arange(7))
    assert locations[:, 0].tolist() == [40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0]


def test_repeated_plan_keeps_its_schedule_but_stays_fresh():
    team = _team()
    team.receive_plan(100.0, 1, _plan(4))
    team.receive_plan(160.0, 1, _plan(4))
    assert len(team.locations_ahead(160.0, 1)) == 7
    assert team.age_s(750.0) == {1: 590.0}


def test_newer_plan_replaces_and_late_older_plan_does_not():
    team = _team()
    team.receive_plan(100.0, 1, _plan(4))
    team.receive_plan(110.0, 1, _plan(5, north=50.0))
    assert team.locations_ahead(110.0, 1)[0, 0] == 60.0
    team.receive_plan(120.0, 1, _plan(3, north=-99.0))
    assert team.locations_ahead(120.0, 1)[0, 0] == 60.0


def test_plan_with_high_step_does_not_silence_its_mate():
    team = _team()
    team.receive_plan(100.0, 1, _plan(4))
    team.receive_plan(110.0, 1, _plan(60, north=500.0))  # forged
    team.receive_plan(120.0, 1, _plan(6, north=20.0))
    assert team.locations_ahead(120.0, 1)[0, 0] == 30.0


def test_plans_that_are_a_little_lower_correct_a_forged_one_at_last():
    team = _team()
    taken = []
    for cycle in range(9):
        team.receive_plan(30.0 * cycle, 1, _plan(6 + 3 * cycle, north=5000.0))  # forged
        team.receive_plan(30.0 * cycle + 3.0, 1, _plan(3 * cycle, north=100.0))
        taken.append(team.locations_ahead(30.0 * cycle + 3.0, 1)[0, 0] < 1000.0)
    assert sum(taken) == 3


def test_own_plans_are_ignored():
    team = _team()
    team.receive_plan(0.0, 3, _plan(0))
    assert team.age_s(0.0) == {}
