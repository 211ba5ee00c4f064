"""How deep a vehicle may be over rising ground, by its echo sounder."""

import math

import pytest

from auv_lse_common.safety.altitude_keeper import LAG_S, REACH_M, SPARE_M, AltitudeKeeper


class Over:
    """A vehicle that travels north at 1 m/s and 10 m depth over ground given by a function of north (m)."""

    def __init__(self, ground, least_m=3.0, hz=2.0):
        self.keeper, self.ground, self.hz = AltitudeKeeper(least_m), ground, hz
        self.north_m = self.now_s = 0.0

    def travel(self, way_m, altitude_m=None):
        for _ in range(round(way_m * self.hz)):
            self.north_m += 1.0 / self.hz
            self.now_s += 1.0 / self.hz
            self.keeper.move(self.now_s, self.north_m, 0.0, 10.0, 1.0)
            self.keeper.ping(self.ground(self.north_m) - 10.0 if altitude_m is None else altitude_m)
        return self.keeper


def test_rising_ground_is_expected_to_go_on_and_falling_ground_to_be_flat():
    rising = Over(lambda north: 20.0 - 0.2 * north).travel(10.0)
    assert rising.ground_m(0.0) == pytest.approx(18.0 - 0.2 * LAG_S, abs=0.01)
    assert rising.ground_m(3.0) == pytest.approx(17.4 - 0.2 * LAG_S, abs=0.01)
    assert rising.ground_m(50.0) == rising.ground_m(REACH_M)
    falling = Over(lambda north: 20.0 + 0.2 * north).travel(10.0)
    assert falling.ground_m(50.0) == pytest.approx(22.0, abs=0.01)


def test_a_single_wrong_echo_does_not_count_and_a_step_does():
    over = Over(lambda north: 20.0)
    over.travel(5.0)
    over.travel(0.5, altitude_m=1.0)
    assert over.travel(2.0).ground_m() == pytest.approx(20.0)
    over.ground = lambda north: 17.0
    assert over.travel(1.0).ground_m() == pytest.approx(17.0)


def test_without_echoes_the_ground_seen_last_counts():
    """An echo sounder is silent over weed and steep ground, too: the vehicle must not sink then."""
    over = Over(lambda north: 14.0)
    assert over.keeper.deepest_m(0.0) == math.inf, "no ground has been seen"
    limit_m = over.travel(5.0).limited_m(10.0 + 1.0)
    assert limit_m == pytest.approx(14.0 - 3.0 - SPARE_M)
    for nothing in (math.nan, 0.0, -1.0, math.inf):
        over.travel(10.0, altitude_m=nothing)
        assert over.keeper.limited_m(11.0) == pytest.approx(limit_m)
    over.north_m += 50.0  # the estimate jumps
    over.travel(1.0, altitude_m=math.nan)
    assert over.keeper.limited_m(11.0) == pytest.approx(limit_m)
    over.ground = lambda north: 30.0
    assert over.travel(2.0).limited_m(11.0) == 11.0
    assert Over(lambda north: 14.0, least_m=0.0).travel(5.0).limited_m(12.0) == 12.0


def test_a_line_follows_the_slope_to_its_end():
    keeper = Over(lambda north: 20.0 - 0.2 * north).travel(32.0)  # 3.6 m above the ground
    end_m = keeper.line_end_m(10.0, 10.0, 20.0)
    assert keeper.is_low(10.0, 10.0, 20.0)
    assert not keeper.is_low(10.0, end_m, 20.0)
    assert 4.0 < end_m < 6.5  # the slope alone would take 4 m
    assert not keeper.must_climb_first(10.0, end_m, 20.0)
    assert keeper.must_climb_first(10.0, 8.0, 2.5), "too steep"


def test_a_vehicle_climbs_to_a_metre_below_the_surface_at_most():
    keeper = Over(lambda north: 12.5).travel(5.0)
    assert keeper.limited_m(10.0) == pytest.approx(12.5 - 3.0 - SPARE_M)
    assert Over(lambda north: 10.5).travel(5.0).limited_m(10.0) == pytest.approx(10.5 - 3.0 - SPARE_M)
    shoal = AltitudeKeeper(3.0)
    for second in range(5):
        shoal.move(float(second), float(second), 0.0, 1.0, 1.0)
        shoal.ping(0.8)
    assert shoal.limited_m(10.0) == 1.0
