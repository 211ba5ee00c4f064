"""How far the battery lasts, from the charge over the way travelled."""

import json
import math

import pytest

from auv_lse_common.safety.battery_use import LEAST, STRETCH_M, BatteryUse

COST = 0.01  # of the charge, per stretch
STRETCH_S = 20.0


def travelled(stretches, charge_at, lasts_m=None, use=None, readings=8):
    """Travels in a circle of 12 stretches around (0, 0), so that every course is seen."""
    use = use or BatteryUse(0.2, lasts_m)
    for stretch in range(stretches):
        for part in range(readings):
            way = stretch + part / readings
            use.take(way * STRETCH_S, round(charge_at(way), 2), way * STRETCH_M, *position(way))
    return use


def position(way):
    radius_m, turned = 12.0 * STRETCH_M / (2.0 * math.pi), 2.0 * math.pi * way / 12.0
    return radius_m * math.sin(turned), -radius_m * math.cos(turned)


def steady(way):
    return 0.95 - COST * way


def home(stretches, towards_deg=0.0):
    """A way home (north, east)."""
    towards = math.radians(towards_deg)
    return stretches * STRETCH_M * math.cos(towards), stretches * STRETCH_M * math.sin(towards)


@pytest.mark.parametrize("lasts_m", [None, 2500.0])
def test_a_steady_battery_lasts_as_far_as_its_charge_does(lasts_m):
    use = travelled(40, steady, lasts_m)
    true = (0.95 - 40 * COST - 0.2) / COST - 4.0  # with four stretches home
    assert true - 8.0 <= use.left_m(home(4)) / STRETCH_M <= true
    assert not use.must_turn(home(20))
    assert use.must_turn(home(36))
    lasts, std = use.lasts_m
    assert abs(lasts - STRETCH_M / COST) < 2.0 * std < 600.0


def test_a_way_home_against_the_current_costs_more():
    north_mps = 0.3  # a current, as a share of the vehicle's speed: what northward stretches save

    def drifting(way):
        return steady(way) + COST * north_mps * position(way)[0] / STRETCH_M

    use = travelled(40, drifting)
    against, along = use.surplus(0.0, home(10, 180.0)), use.surplus(0.0, home(10, 0.0))
    assert along - against == pytest.approx(2.0 * 10 * COST * north_mps, rel=0.35)


def test_a_way_home_on_a_course_that_was_not_travelled_may_be_against_a_current():
    straight = BatteryUse(0.2)
    for part in range(40 * 8):
        way = part / 8
        straight.take(way * STRETCH_S, round(steady(way), 2), way * STRETCH_M, way * STRETCH_M, 0.0)
    assert straight.surplus(0.0, home(10, 180.0)) < travelled(40, steady).surplus(0.0, home(10, 180.0)) - 0.01


def test_a_reading_that_jumps_does_not_end_a_mission():
    def jumping(way):
        return steady(way) - 0.3 * (38 <= way < 40)

    assert not travelled(40, jumping).must_turn(home(15))
    assert not travelled(42, jumping).must_turn(home(15))
    assert travelled(48, lambda way: steady(way) - 0.3 * (way >= 38)).must_turn(home(4)), "it stays"


def test_old_cells_shorten_the_way():
    old = travelled(50, lambda way: steady(way) - 0.01 * max(way - 35.0, 0.0))
    assert old.left_m((0.0, 0.0)) < 0.6 * travelled(50, steady).left_m((0.0, 0.0))


def test_a_wrong_expectation_is_learned_anew():
    use = travelled(30, steady, lasts_m=2.0 * STRETCH_M / COST)
    assert use.lasts_m[0] == pytest.approx(STRETCH_M / COST, rel=0.15)
    assert travelled(60, steady, lasts_m=2.0 * STRETCH_M / COST).must_turn(home(15))


def test_a_long_stay_counts():
    use = travelled(20, steady)
    for minute in range(40):
        use.take(20.0 * STRETCH_S + 60.0 * minute, 0.75 - 0.01 * minute, 20.0 * STRETCH_M, *position(20.0))
    assert 0.34 < use.charge < 0.42


def test_what_is_learned_survives_a_restart():
    use = travelled(40, steady)
    again = BatteryUse(0.2)
    again.restore(json.loads(json.dumps(use.snapshot())))
    travelled(4, lambda way: steady(40.0 + way), use=again)
    assert again.charge == pytest.approx(use.charge - 4 * COST, abs=0.02)
    assert again.left_m(home(4)) == pytest.approx(use.left_m(home(4)) - 4 * STRETCH_M, abs=6.0 * STRETCH_M)
    BatteryUse(0.2).restore({})


def test_after_a_restart_nothing_is_concluded_before_the_charge_is_known():
    again = BatteryUse(0.2)
    again.restore(json.loads(json.dumps(travelled(40, steady).snapshot())))
    again.take(0.0, steady(40.0), 40.0 * STRETCH_M, *position(40.0))
    assert not again.must_turn(home(4))
    assert again.snapshot(), "what was learned outlives a second restart"


def test_the_way_goes_on_without_readings():
    use = travelled(30, steady)
    for way in range(31, 200):
        use.take(way * STRETCH_S, math.nan, way * STRETCH_M, *position(way))
        if use.must_turn(home(4)):
            break
    assert use.charge == pytest.approx(steady(float(way)), abs=0.03)
    assert 0.2 < use.charge < 0.5


def test_a_charge_that_rises_under_way_is_ignored():
    use = travelled(40, steady)
    travelled(30, lambda way: 1.0, use=use)  # the autopilot rebooted, and counts from a full battery
    assert use.charge < steady(40.0)


@pytest.mark.parametrize("charge", [math.nan, -1.0, 2.0])
def test_without_readings_nothing_is_predicted(charge):
    use = BatteryUse(0.2)
    for way in range(60):
        use.take(way * STRETCH_S, charge, way * STRETCH_M, 0.0, 0.0)
    assert not use.is_known
    assert not use.must_turn(home(1e5))
    assert math.isnan(use.left_m((0.0, 0.0)))
    assert math.isnan(use.charge)
    assert not travelled(LEAST - 1, lambda way: 0.5).is_known
