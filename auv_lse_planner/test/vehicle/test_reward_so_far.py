import math

import pytest

from auv_lse_planner.vehicle.reward_so_far import RewardSoFar


def test_path_reward_is_summed_leg_by_leg():
    reward = RewardSoFar()
    assert reward.value == 0.0
    assert reward.bound(30.0) == (30.0, 30.0)
    reward.add(5.0)
    reward.add(2.5)
    assert reward.value == 7.5
    assert reward.bound(10.0) == (17.5, 30.0), "the bound may fall, its maximum stays"
    reward.measure(math.nan)
    assert reward.bound(40.0) == (47.5, 47.5), "without a risk nothing is measured"


def test_map_reward_is_the_drop_of_risk_since_the_first_decision():
    reward = RewardSoFar()
    reward.measure(100.0)
    assert reward.value == 0.0
    reward.measure(80.0)
    assert reward.value == 20.0
    reward.measure(90.0)  # new data may show that more is at risk
    assert reward.value == 10.0
    assert reward.bound(5.0) == (15.0, 15.0)


def test_running_maximum_of_the_bound_may_be_negative():
    reward = RewardSoFar()
    reward.measure(10.0)
    reward.measure(14.0)
    lower, largest = reward.bound(1.0)
    assert lower == largest == pytest.approx(-3.0)
    assert math.isfinite(largest)


def test_reward_continues_when_other_cells_are_planned_with():
    reward = RewardSoFar()
    reward.measure(100.0)
    reward.measure(80.0)
    reward.continue_with_other_cells()
    reward.measure(30.0)
    assert reward.value == 20.0
    reward.measure(25.0)
    assert reward.value == 25.0
