"""How far the battery lasts, from the charge over the way travelled."""

import math

import pytest

from auv_lse_common.safety.battery_use import LEAST, STRETCH_M, BatteryUse

COST = 0.01  # of the charge, per stretch


def travelled(stretches, charge_at, readings=8):
    use = BatteryUse(0.2)
    for stretch in range(stretches):
        for part in range(readings):
            way = stretch + part / readings
            use.take(round(charge_at(way), 2), way * STRETCH_M)
    return use


def test_a_steady_battery_lasts_as_far_as_its_charge_does():
    use = travelled(40, lambda way: 0.95 - COST * way)
    true = (0.95 - 40 * COST - 0.2) / COST - 4.0  # with four stretches home
    assert use.left_m(4.0 * STRETCH_M) == pytest.approx(true * STRETCH_M, abs=6.0 * STRETCH_M)
    assert use.left_m(4.0 * STRETCH_M) <= true * STRETCH_M
    assert not use.must_turn(20.0 * STRETCH_M)
    assert use.must_turn(40.0 * STRETCH_M)


def test_one_reading_that_jumps_does_not_end_a_mission():
    def jumping(way):
        return 0.95 - COST * way - 0.3 * (38 <= way < 40)

    assert not travelled(40, jumping).must_turn(15.0 * STRETCH_M)
    assert not travelled(40, jumping).must_turn(15.0 * STRETCH_M)
    assert travelled(48, lambda way: 0.95 - COST * way - 0.3 * (way >= 38)).must_turn(4.0 * STRETCH_M), "it stays"


def test_old_cells_shorten_the_way():
    steady = travelled(50, lambda way: 0.95 - COST * way)
    old = travelled(50, lambda way: 0.95 - COST * way - 0.01 * max(way - 35.0, 0.0))
    assert old.left_m(0.0) < 0.6 * steady.left_m(0.0)


def test_a_long_stay_counts():
    use = travelled(20, lambda way: 0.95 - COST * way)
    for reading in range(400):
        use.take(0.75 - 0.001 * reading, 20.0 * STRETCH_M)
    assert use.charge < 0.45


@pytest.mark.parametrize("charge", [math.nan, -1.0, 2.0])
def test_without_readings_nothing_is_predicted(charge):
    use = travelled(40, lambda way: charge) if not math.isnan(charge) else BatteryUse(0.2)
    use.take(charge, 5000.0)
    assert not use.is_known
    assert not use.must_turn(1e6)
    assert math.isnan(use.left_m(0.0))
    assert not travelled(LEAST - 1, lambda way: 0.5).is_known
