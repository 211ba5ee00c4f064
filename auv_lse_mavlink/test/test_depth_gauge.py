"""Depth from pressure: zero, drift, the offset to the autopilot's own depth, and what makes it untrustworthy."""

from collections import Counter

import pytest

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.vocabulary.water import gauge_pressure_pa
from auv_lse_mavlink.depth_gauge import SETTLING_S, DepthGauge
from auv_lse_mavlink.messages.events import Problem, Surfaced, Zeroed

AIR_PA = 96_000.0


class Water:
    """A gauge that gets pressure and the autopilot's own depth twice a second."""

    def __init__(self, **values):
        self.told, self.counts, self.now_s = [], Counter(), 1000.0
        self.gauge = DepthGauge(LinkConfig(kind="mavlink", **values), 46.5, self.told.append, self.counts)
        self.origin_m, self.air_pa, self.depth_m = 8.0, AIR_PA, 0.0

    def wait(self, seconds, disarmed=False, fix=False, stuck_m=None, pressure=True):
        for _ in range(round(2 * seconds)):
            self.now_s += 0.5
            if pressure:
                self.gauge.set_state(disarmed, fix)
                shown_m = self.depth_m if stuck_m is None else stuck_m
                self.gauge.pressure(self.now_s, self.air_pa + gauge_pressure_pa(shown_m, 1000.0, 46.5))
            self.gauge.own_depth(self.now_s, self.depth_m + self.origin_m)
        return self

    def dive(self, depth_m, **values):
        while abs(depth_m - self.depth_m) > 1e-6:
            self.depth_m += max(-0.15, min(0.15, depth_m - self.depth_m))
            self.wait(0.5, **values)
        return self

    @property
    def shown_m(self):
        return self.gauge.depth_m(self.now_s, self.depth_m + self.origin_m)

    @property
    def problem(self):
        return self.gauge.problem(self.now_s)

    def of(self, kind):
        return [event for event in self.told if isinstance(event, kind)]


def test_depth_counts_from_the_surface_wherever_the_origin_is():
    water = Water().wait(5, disarmed=True)
    assert [event.pressure_pa for event in water.of(Zeroed)] == pytest.approx([AIR_PA])
    water.dive(4.0).wait(5)
    assert water.shown_m == pytest.approx(4.0, abs=0.01)
    assert water.gauge.shift_m == pytest.approx(8.0, abs=0.01)
    assert water.problem == ""


@pytest.mark.parametrize(
    ("armed", "values", "off_m"),
    [
        (False, {}, -0.3),  # nobody knows that it floats
        (False, {"zero_afloat": True, "sensor_depth_m": 0.3}, 0.0),
        (False, {"sensor_depth_m": 0.3}, -0.3),  # the mission says that it is on deck
        (True, {"sensor_depth_m": 0.3}, 0.0),  # stopped with a GPS fix: it floats
    ],
)
def test_a_zero_taken_afloat_is_corrected_by_the_sensor_s_depth(armed, values, off_m):
    water = Water(**values)
    water.depth_m = 0.3  # of the sensor
    for _ in range(10):
        water.now_s += 0.5
        water.gauge.set_state(True, armed, armed)
        water.gauge.pressure(water.now_s, AIR_PA + gauge_pressure_pa(0.3, 1000.0, 46.5))
        water.gauge.own_depth(water.now_s, 0.3)
    water.dive(4.0).wait(5)
    assert water.shown_m == pytest.approx(4.0 + off_m, abs=0.01)
    (zeroed,) = water.of(Zeroed)
    assert ("set link.zero_afloat" in zeroed.text) == (off_m != 0.0)


def test_without_a_zero_depth_counts_from_standard_air_and_the_reason_is_named():
    water = Water().wait(5)
    assert water.shown_m == pytest.approx((AIR_PA - 101_325.0) / 9807.5, abs=1e-3)
    assert water.gauge.shift_m == pytest.approx(8.0 - water.shown_m, abs=1e-3)
    assert water.problem == "depth has no zero: disarm the vehicle at the surface or on deck"
    assert not water.gauge.is_ready


@pytest.mark.parametrize(
    ("depth_m", "reason"),
    [
        (4.0, r"1352 hPa is not the surface's, which is 550 to 1250 hPa. Is the vehicle under water"),
        (-5.0, r"470 hPa is not the surface's, which is 550 to 1250 hPa"),
    ],
)
def test_an_implausible_zero_is_refused_with_the_reason(depth_m, reason):
    water = Water()
    water.depth_m = depth_m
    water.wait(10, disarmed=True)
    assert water.of(Zeroed) == []
    (problem,) = water.of(Problem)  # once
    assert reason in problem.text
    assert water.problem == problem.text


def test_a_zero_above_the_pressure_of_air_is_doubted_once():
    """A new dive whose vehicle waits under water, or a sensor that is 200 hPa off."""
    water = Water()
    water.air_pa, water.depth_m = 101_325.0, 1.8
    for _ in range(5):
        water.wait(20, disarmed=True)
        water.depth_m += 0.03
    (warned,) = water.of(Problem)
    assert warned.text.startswith(
        "depth is zeroed at 1190 hPa, more than air ever has. If the vehicle is under water, it travels 1.8 m too deep"
    )
    water.depth_m = 0.0
    water.wait(30, disarmed=True)
    assert [problem for problem in water.of(Problem) if "more than air" in problem.text] == [warned]
    assert water.dive(4.0).wait(5).shown_m == pytest.approx(4.0, abs=0.01)


def test_a_vehicle_that_is_disarmed_under_water_keeps_its_zero():
    water = Water().wait(5, disarmed=True).dive(1.5).wait(20, disarmed=True)
    assert water.gauge.zero_pa == pytest.approx(AIR_PA)
    assert "147 hPa above the last zero, more than 50 hPa. Is the vehicle under water?" in water.told[-1].text
    assert water.shown_m == pytest.approx(1.5, abs=0.01)
    assert water.problem == ""


def test_a_zero_that_was_taken_too_deep_is_corrected_at_the_surface():
    water = Water()
    water.depth_m = 1.5
    water.wait(5, disarmed=True)
    water.depth_m = 0.0
    water.wait(20, disarmed=False).wait(5, disarmed=True)
    assert water.gauge.zero_pa == pytest.approx(AIR_PA)


def test_pressure_that_is_not_steady_gives_no_zero():
    water = Water()
    for i in range(20):
        water.depth_m = 0.9 * (i % 2)
        water.wait(0.5, disarmed=True)
    assert water.of(Zeroed) == []
    assert "pressures vary by 88 hPa, more than 50 hPa" in water.problem


def test_drift_is_reported_once_at_each_surfacing_and_not_corrected():
    water = Water().wait(5, disarmed=True)
    for drift_m in (0.1, 0.3):
        water.dive(3.0)
        water.air_pa = AIR_PA + gauge_pressure_pa(drift_m, 1000.0, 46.5)
        water.dive(0.0).wait(5).wait(20, fix=True)
    assert [event.drift_m for event in water.of(Surfaced)] == pytest.approx([0.1, 0.3], abs=0.01)
    assert water.gauge.values["pressure drift m"] == pytest.approx(0.3, abs=0.01)
    assert water.gauge.zero_pa == pytest.approx(AIR_PA)


def test_the_shift_follows_the_datum_slowly_and_no_farther_than_the_limit():
    water = Water(depth_difference_m=1.0).wait(5, disarmed=True).dive(4.0)
    water.origin_m = 8.5
    water.wait(30)
    assert water.gauge.shift_m == pytest.approx(8.5, abs=0.02)
    assert water.problem == ""
    for _ in range(70):
        water.origin_m += 0.05
        water.wait(0.5)
    water.wait(60)
    assert water.gauge.shift_m == pytest.approx(9.0)
    assert water.gauge.own_target_m(0.0) == pytest.approx(9.0)
    assert "the autopilot's own depth have diverged by +4.0 m, more than 1 m (link.depth_diff" in water.problem
    assert water.shown_m == pytest.approx(4.0, abs=0.01), "pressure is still the depth"


@pytest.mark.parametrize("step_m", [6.0, -6.0])
def test_a_step_of_the_autopilots_datum_is_followed_and_reported(step_m):
    water = Water().wait(5, disarmed=True).dive(4.0)
    water.origin_m += step_m
    water.wait(0.5)
    assert water.gauge.shift_m == pytest.approx(8.0 + step_m, abs=0.02), "at once: it would travel 6 m off"
    water.wait(5)
    assert water.gauge.shift_m == pytest.approx(8.0 + step_m, abs=0.02)
    assert f"have diverged by {step_m:+.1f} m" in water.problem


def test_a_gauge_that_is_stuck_does_not_keep_the_vehicle_down():
    water = Water().wait(5, disarmed=True).dive(4.0)
    for _ in range(100):
        water.depth_m += max(-0.15, min(0.15, water.gauge.own_target_m(0.0) - water.origin_m - water.depth_m))
        water.wait(0.5, stuck_m=4.0)
    assert water.depth_m <= 0.0


def test_a_datum_that_moves_at_the_surface_with_gps_is_taken_over():
    water = Water().wait(5, disarmed=True).dive(4.0).dive(0.0)
    water.origin_m = -3.0
    water.depth_m = 0.05
    for i in range(20):  # in waves
        water.depth_m = 0.05 * (i % 3)
        water.wait(1, fix=True)
    assert water.problem == ""
    assert water.dive(4.0).gauge.shift_m == pytest.approx(-3.0, abs=0.01)


@pytest.mark.parametrize("fix", [False, True], ids=["", "with GPS under water"])
def test_a_gauge_that_is_stuck_cannot_make_the_vehicle_dive_on(fix):
    """The autopilot goes to each target: with an unbounded shift it would be a metre deeper each time."""
    water = Water().wait(5, disarmed=True)
    for _ in range(200):
        wanted_m = 3.0 + water.gauge.shift_m - water.origin_m  # where it takes the vehicle
        water.depth_m += max(-0.15, min(0.15, wanted_m - water.depth_m))
        water.wait(0.5, stuck_m=0.0, fix=fix)
    assert water.depth_m <= 3.0 + 1.0 + 1e-6
    assert "diverged" in water.problem


def test_without_pressure_depth_goes_on_by_the_autopilots_own():
    water = Water().wait(5, disarmed=True).dive(4.0).wait(20)
    water.wait(10, pressure=False)
    water.dive(2.0, pressure=False)
    assert water.shown_m == pytest.approx(2.0, abs=0.02)
    assert water.problem.startswith("no SCALED_PRESSURE2 for ")
    water.wait(5)
    assert water.problem == ""


def test_pressures_that_cannot_be_are_counted_and_ignored():
    water = Water().wait(5, disarmed=True).dive(4.0)
    for pressure_pa in (float("nan"), float("inf"), 0.0, -5.0):
        water.gauge.pressure(water.now_s, pressure_pa)
    assert water.counts["bad_pressures"] == 4
    assert water.shown_m == pytest.approx(4.0, abs=0.01)


def test_after_a_reboot_of_the_autopilot_the_offset_is_learned_anew():
    water = Water().wait(5, disarmed=True).dive(4.0)
    water.origin_m = -4.0  # its estimator starts at the vehicle's depth
    water.gauge.forget()
    assert water.problem == "the autopilot's own depth is unknown: targets cannot be converted"
    water.wait(0.5)
    assert water.gauge.settling(water.now_s), "targets wait"
    water.wait(2)
    assert not water.gauge.settling(water.now_s)
    assert water.gauge.shift_m == pytest.approx(-4.0, abs=0.01)
    assert water.problem == ""


def test_a_new_zero_leaves_the_offset_until_there_is_a_new_one():
    water = Water().wait(5, disarmed=True)
    water.air_pa += 1000.0
    for _ in range(60):
        water.wait(0.5, disarmed=True)
        water.gauge.pressure(water.now_s, water.air_pa)  # the autopilot's own depth comes later
        assert water.problem == ""
    assert water.gauge.zero_pa == pytest.approx(AIR_PA + 1000.0)
    assert water.gauge.shift_m == pytest.approx(8.0, abs=0.01)


def test_a_restored_zero_serves_under_water():
    water = Water()
    water.gauge.restore(AIR_PA)
    water.depth_m = 4.0
    water.wait(5)
    assert water.shown_m == pytest.approx(4.0, abs=0.01)
    assert water.problem == ""


def test_a_restarted_link_has_time_to_learn_the_offset():
    water = Water()
    water.gauge.restore(AIR_PA, water.now_s)
    water.depth_m = 4.0
    assert (water.problem, water.gauge.is_known) == ("", False), "as yet no pressure has come"
    water.wait(1)
    assert (water.problem, water.gauge.is_known) == ("", False), "of two pressures"
    water.wait(1)
    assert (water.problem, water.gauge.is_known) == ("", True)
    water.wait(10, pressure=False)
    assert water.problem.startswith("no SCALED_PRESSURE2 for ")


def test_a_restarted_link_without_pressure_reports_it_after_a_while():
    water = Water()
    water.gauge.restore(AIR_PA, water.now_s)
    water.wait(SETTLING_S, pressure=False)
    assert water.problem == ""
    water.wait(0.5, pressure=False)
    assert water.problem == "no SCALED_PRESSURE2 from the autopilot (link.pressure)"


def test_a_vehicle_without_a_pressure_sensor_keeps_the_autopilots_depth():
    water = Water(pressure="none").wait(5, pressure=False)
    assert water.shown_m == 8.0
    assert (water.gauge.shift_m, water.problem, water.gauge.is_ready) == (0.0, "", True)


def test_a_boat_is_at_the_surface_whatever_its_autopilot_reports():
    def shown_m(pressure, is_afloat):
        gauge = DepthGauge(LinkConfig(kind="mavlink", pressure=pressure), None, print, Counter(), is_afloat)
        gauge.own_depth(0.0, 8.0)
        return gauge.depth_m(0.0, 8.0)

    assert (shown_m("none", True), shown_m("none", False), shown_m("SCALED_PRESSURE2", True)) == (0.0, 8.0, 8.0)
