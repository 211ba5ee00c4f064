"""Soundings from odometry and altitudes."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from auv_lse_common.vocabulary.sounding import Sounding
from auv_lse_mavlink.messages.conversion import altitude_m
from auv_lse_mavlink.sounder import Sounder

EPOCH_S = 1.7e9


def travel(
    sounder: Sounder,
    seconds: float,
    *,
    odometry_s: float = 0.1,
    ping_s: float = 0.1,
    start_s: float = EPOCH_S,
    speed: float = 1.5,
) -> list[Sounding]:
    """North at `speed` m/s from 0 at EPOCH_S, diving 0.1 m/s, over ground of 20 m."""
    soundings: list[Sounding] = []
    events = [(start_s + i * odometry_s, 1) for i in range(round(seconds / odometry_s) + 1)]
    events += [(start_s + i * ping_s, 0) for i in range(round(seconds / ping_s) + 1)]
    for t, kind in sorted(events):
        since = t - EPOCH_S
        if kind:
            soundings += sounder.odometry(t, speed * since, -3.0, 2.0 + 0.1 * since)
        else:
            sounder.altitude(t, 18.0 - 0.1 * since)
    return soundings


def test_ten_pings_a_second_give_one_sounding_a_second_at_their_mean_position() -> None:
    soundings = travel(Sounder(1.0, 3), 5.5)
    # the ping at 0 s is alone in its period; that of 0.1 ... 1.0 s has its mean at 0.55 s
    assert [s.stamp_s - EPOCH_S for s in soundings] == pytest.approx([0.55, 1.55, 2.55, 3.55, 4.55], abs=1e-5)
    assert [s.north_m for s in soundings] == pytest.approx([1.5 * t for t in (0.55, 1.55, 2.55, 3.55, 4.55)], abs=1e-5)
    assert {s.east_m for s in soundings} == {-3.0}
    assert [s.depth_m for s in soundings] == pytest.approx([20.0] * 5)


@pytest.mark.parametrize("odometry_s", [0.033, 0.2, 1.0])
@pytest.mark.parametrize("ping_s", [0.05, 0.33, 1.0, 2.0])
def test_the_usual_rates_of_autopilots_give_soundings(odometry_s: float, ping_s: float) -> None:
    sounder = Sounder(1.0, 1)
    soundings = travel(sounder, 60.0, odometry_s=odometry_s, ping_s=ping_s, start_s=EPOCH_S + 0.37)
    assert len(soundings) >= 60.0 / max(1.0, ping_s) - 3
    assert sounder.counts["pings_unplaced"] <= 1 + 0.5 / ping_s  # before the first odometry at most
    for s in soundings:
        assert s.north_m == pytest.approx(1.5 * (s.stamp_s - EPOCH_S), abs=1e-5)
        assert s.depth_m == pytest.approx(20.0, abs=1e-5)


def test_the_median_rejects_an_outlier_and_few_pings_give_none() -> None:
    sounder = Sounder(1.0, 3)
    sounder.odometry(0.0, 0.0, 0.0, 2.0, (1.0, -1.0))
    for t, altitude in ((0.2, 10.0), (0.4, 3.0), (0.6, 10.2), (0.8, 10.4), (1.2, 10.0), (1.4, 10.0)):
        sounder.altitude(t, altitude)
    sounder.odometry(1.0, 0.0, 0.0, 2.0, (1.0, -1.0))
    soundings = sounder.odometry(2.0, 0.0, 0.0, 2.0, (1.0, -1.0))
    expected = Sounding(
        stamp_s=pytest.approx(0.5),
        north_m=0.0,
        east_m=0.0,
        depth_m=pytest.approx(12.1),
        raw_north_m=1.0,
        raw_east_m=-1.0,
    )
    assert soundings == [expected]
    assert sounder.odometry(2.3, 0.0, 0.0, 2.0) == []
    assert sounder.counts["periods_short"] == 1


def test_no_ground_gives_no_ping() -> None:
    sounder = Sounder(1.0, 1)
    sounder.odometry(0.0, 0.0, 0.0, 2.0)
    for altitude in (math.nan, math.inf, -math.inf, 0.0, -1.0):
        sounder.altitude(0.5, altitude)
    sounder.altitude(math.nan, 5.0)
    assert sounder.odometry(1.3, 0.0, 0.0, 2.0) == []
    assert sounder.counts["pings_blind"] == 6


def test_pings_in_a_gap_of_odometry_or_without_any_give_none() -> None:
    sounder = Sounder(1.0, 1)
    sounder.altitude(0.2, 10.0)
    sounder.odometry(0.5, 0.0, 0.0, 2.0)
    sounder.altitude(1.5, 10.0)
    sounder.altitude(4.9, 10.0)
    assert sounder.odometry(5.0, 9.0, 0.0, 2.0) == []
    sounder.altitude(5.5, 10.0)
    assert [s.north_m for s in sounder.odometry(6.5, 12.0, 0.0, 2.0)] == pytest.approx([10.0])
    assert sounder.counts["pings_unplaced"] == 3


def test_an_altitude_may_come_a_little_after_odometry_of_its_time() -> None:
    sounder = Sounder(1.0, 1)
    for t in (0.0, 0.5, 1.0, 1.2):
        assert sounder.odometry(t, t, 0.0, 2.0) == []
    sounder.altitude(0.9, 10.0)
    assert [s.north_m for s in sounder.odometry(1.3, 1.3, 0.0, 2.0)] == pytest.approx([0.9])
    sounder.altitude(0.9, 10.0)
    assert sounder.counts["pings_late"] == 1


def test_a_clock_that_is_set_back_resets_the_state() -> None:
    sounder = Sounder(1.0, 3)
    assert travel(sounder, 3.5)
    soundings = travel(sounder, 3.5, start_s=EPOCH_S - 100.0)
    assert [s.stamp_s - EPOCH_S for s in soundings] == pytest.approx([-99.45, -98.45, -97.45], abs=1e-5)
    assert sounder.counts["clock_steps"] == 1


@pytest.mark.parametrize("altitude_m", [1e9, 1e308, math.inf, math.nan, -1.0, 0.0])
def test_an_altitude_that_no_water_has_is_no_echo(altitude_m: float) -> None:
    sounder = Sounder(1.0, 1)
    sounder.altitude(EPOCH_S + 0.5, altitude_m)
    for stamp_s in (EPOCH_S, EPOCH_S + 1.0, EPOCH_S + 2.0):
        assert not sounder.odometry(stamp_s, 0.0, 0.0, 1.0)
    assert sounder.counts["pings_blind"] == 1


@pytest.mark.parametrize("odometry", [(1e7, 0.0, 1.0), (0.0, -1e308, 1.0), (0.0, 0.0, 1e308), (0.0, 0.0, math.nan)])
def test_a_position_that_no_vehicle_has_is_bad_odometry(odometry: tuple[float, float, float]) -> None:
    sounder = Sounder(1.0, 1)
    sounder.odometry(EPOCH_S, *odometry)
    assert sounder.counts["bad_odometry"] == 1


numbers = st.floats(-10.0, 10.0) | st.floats()


@given(st.lists(st.tuples(st.booleans(), numbers, numbers, numbers, numbers), max_size=60))
def test_no_input_makes_the_driver_raise(events: list[tuple[bool, float, float, float, float]]) -> None:
    sounder = Sounder(0.5, 1)
    for is_odometry, t, a, b, c in events:
        if is_odometry:
            sounder.odometry(t, a, b, c)
        else:
            sounder.altitude(t, a)


def test_a_frozen_altimeter_gives_no_soundings_though_the_vehicle_wobbles() -> None:
    sounder, soundings = Sounder(1.0, 1), 0
    for second in range(60):
        stamp_s, north_m = EPOCH_S + second, 1.5 * second
        altitude_m = 10.0 + 0.01 * (second % 3) if second < 20 else 10.0
        sounder.altitude(stamp_s, altitude_m)
        soundings += len(sounder.odometry(stamp_s, north_m, 0.0, 3.0 + 0.01 * (second % 5)))
    assert soundings == 31, "20, and those before it counts as frozen"
    assert sounder.counts["pings_frozen"] == 28


@pytest.mark.parametrize(("quality", "is_used"), [(0, True), (1, False), (24, False), (25, True), (100, True)])
def test_echoes_of_low_quality_are_left_out(quality, is_used):
    covariance, down = 255, 25
    echo = mavlink.MAVLink_distance_sensor_message(5000, 30, 5000, 700, 1, 0, down, covariance, signal_quality=quality)
    altitude = altitude_m(echo)
    assert altitude == pytest.approx(7.0) if is_used else math.isnan(altitude)
