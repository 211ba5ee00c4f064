import math

import pytest

from auv_lse_planner.methods.account import Account


def test_the_paths_reward_is_credited_leg_by_leg():
    account = Account()
    assert account.reward_so_far == 0.0
    assert account.bound(30.0) == (30.0, 30.0)
    account.credit(5.0)
    account.credit(2.5)
    assert account.reward_so_far == 7.5
    assert account.bound(10.0) == (17.5, 30.0), "the bound may fall, its maximum stays"
    assert account.bound(40.0) == (47.5, 47.5)


def test_the_maps_reward_is_the_drop_of_risk_since_the_first_decision():
    account = Account()
    account.measure(100.0)
    assert account.reward_so_far == 0.0
    account.measure(80.0)
    assert account.reward_so_far == 20.0
    account.measure(90.0)  # new data may show that more is at risk
    assert account.reward_so_far == 10.0
    assert account.bound(5.0) == (15.0, 15.0)


def test_a_bound_that_is_below_zero_is_still_the_largest_so_far():
    account = Account()
    account.measure(10.0)
    account.measure(14.0)
    lower, largest = account.bound(1.0)
    assert lower == largest == pytest.approx(-3.0)
    assert math.isfinite(largest)
