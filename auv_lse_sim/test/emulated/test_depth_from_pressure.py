"""A simulated autopilot whose own depth means something else than the depth below the surface."""

import dataclasses
import math

import pytest
from bench_of_autopilot import FLAT_GROUND
from pymavlink.dialects.v20 import common as mavlink

from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.safety.fence import Fence
from auv_lse_common.safety.watch import SafetyWatch
from auv_lse_common.vocabulary.mission_run import MissionRun, RunState, Stop
from auv_lse_mavlink.messages.datum import Origin
from auv_lse_mavlink.messages.events import AutopilotEstimate, AutopilotState, Surfaced
from benchmarks.navigation.lone_vehicle import LoneVehicle

ORIGIN = Origin(lat_deg=46.5, lon_deg=6.6)


class Dive(LoneVehicle):
    """A vehicle under its safety watch.

    Its autopilot dives at once: these tests are about the gauge, and ArduSub sinks along its leg.
    """

    def __init__(self, **parameters):
        super().__init__(FLAT_GROUND, ORIGIN, {"sim.autopilot.firmware": "generic", **parameters})
        self.watch = SafetyWatch(SafetyConfig(), Fence((0.0, 0.0, 0.0, 1e4, 1e4, 1e4), 1e4), 8.0, has_autopilot=True)
        self.run = MissionRun(True, Stop(action=2))
        self.depths_m, self.warned_s = [], math.inf

    def fly(self, seconds: int) -> None:
        for _ in range(seconds):
            heard = len(self.events)
            self.depths_m.append(self.tick().truth.depth_m)
            for event in self.events[heard:]:
                if isinstance(event, AutopilotState):
                    self.watch.autopilot(event.report)
                elif isinstance(event, AutopilotEstimate):
                    e = event
                    self.watch.odometry(e.stamp_s, e.heading_rad, e.north_m, e.east_m, e.depth_m, e.speed_mps)
            self.watch.altitude(10.0)
            self.watch.step(self.now_s, self.run)
            self.link.stop(self.now_s, self.run.status.stop)
            if self.watch.warnings:
                self.warned_s = min(self.warned_s, self.now_s)

    def of(self, kind):
        return [event for event in self.events if isinstance(event, kind)]


@pytest.mark.parametrize(
    ("mode", "origin_height_m", "pressure"),
    [
        ("position_target", 8.0, "SCALED_PRESSURE2"),
        ("mission", 8.0, "SCALED_PRESSURE3"),
        ("mission", -8.0, "SCALED_PRESSURE"),
    ],
)
def test_with_an_origin_8_m_off_the_vehicle_travels_at_the_wanted_depth(mode, origin_height_m, pressure):
    values = {"sim.autopilot.origin_height_m": origin_height_m}
    dive = Dive(**values, **{"auv1.link.mode": mode, "auv1.link.pressure": pressure})
    dive.leg(0, 200.0)
    dive.fly(60)
    assert dive.depths_m[20:] == pytest.approx([3.0] * 40, abs=0.3)
    shown_m = [event.depth_m for event in dive.of(AutopilotEstimate)[20:]]
    assert shown_m == pytest.approx(dive.depths_m[20:], abs=0.15)
    assert dive.run.status.state is RunState.RUNNING


@pytest.mark.parametrize("origin_height_m", [8.0, -8.0])
@pytest.mark.parametrize("mode", ["position_target", "mission"])
def test_ardusub_with_an_origin_8_m_off_travels_at_the_wanted_depth(mode, origin_height_m):
    values = {"sim.autopilot.firmware": "ardupilot", "sim.autopilot.origin_height_m": origin_height_m}
    dive = Dive(**values, **{"auv1.link.mode": mode})
    dive.leg(0, 20.0)
    dive.leg(1, 200.0)
    dive.fly(90)
    assert dive.depths_m[-40:] == pytest.approx([3.0] * 40, abs=0.3)
    shown_m = [event.depth_m for event in dive.of(AutopilotEstimate)[-40:]]
    assert shown_m == pytest.approx(dive.depths_m[-40:], abs=0.15)
    assert dive.run.status.state is RunState.RUNNING


def test_air_pressure_a_drifting_barometer_and_salt_cost_centimetres():
    salt = {"sim.autopilot.water_density_kgpm3": 1025.0, "auv1.link.water_density_kgpm3": 1025.0}
    drift = {"sim.autopilot.barometer_drift_hpa_h": 200.0, "sim.autopilot.air_change_hpa_h": 20.0}
    dive = Dive(**salt, **drift, **{"auv1.vehicle.depth_m": 5.0})
    dive.leg(0, 120.0, surface=True)
    dive.leg(1, 60.0)
    dive.fly(200)
    assert max(dive.depths_m) == pytest.approx(5.0, abs=0.4)
    (surfaced,) = dive.of(Surfaced)
    assert surfaced.drift_m == pytest.approx(220.0 * 100.0 / 9807.0 * 110.0 / 3600.0, abs=0.1)
    assert dive.run.status.state is RunState.RUNNING


def test_the_wrong_density_is_an_error_of_its_share():
    dive = Dive(**{"sim.autopilot.water_density_kgpm3": 1025.0, "auv1.vehicle.depth_m": 5.0})
    dive.leg(0, 200.0)
    dive.fly(60)
    assert dive.depths_m[-30:] == pytest.approx([5.0 / 1.025] * 30, abs=0.25)
    assert dive.run.status.state is RunState.RUNNING


@pytest.mark.parametrize("at_s", [3.0, 9.0])
def test_a_gauge_that_freezes_in_a_dive_warns_and_then_holds(at_s):
    dive, last = Dive(**{"auv1.vehicle.depth_m": 7.0}), []

    def freeze(now_s, report):
        if now_s < at_s:
            last[:] = [report.pressure_pa]
        return report if now_s < at_s else dataclasses.replace(report, pressure_pa=last[0])

    dive.distort = freeze
    dive.leg(0, 400.0)
    dive.fly(120)
    assert dive.run.status.state is RunState.HOLDING
    assert "have diverged by" in dive.run.limits["pressure"]
    assert dive.warned_s < 20.0
    assert max(dive.depths_m) <= 7.0 + 1.0 + 0.3, "a metre (link.depth_difference_m), and how well it keeps its depth"


def test_a_gauge_that_falls_silent_warns_and_then_holds_at_the_same_depth():
    dive = Dive()
    dive.leg(0, 400.0)
    dive.fly(40)
    assert dive.run.status.state is RunState.RUNNING
    dive.passes = lambda datagram: datagram[7] != mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2
    dive.fly(15)
    assert dive.run.limits["pressure"].startswith("no SCALED_PRESSURE2 for ")
    dive.passes = lambda datagram: True
    dive.fly(5)
    assert dive.depths_m[-15:] == pytest.approx([3.0] * 15, abs=0.3)


def test_before_the_depth_has_its_zero_the_mission_does_not_start():
    dive = Dive()
    dive.link.gauge.zero_pa = math.nan  # as after a restart
    # with a fix it would be zeroed at the surface
    dive.passes = lambda datagram: datagram[7] != mavlink.MAVLINK_MSG_ID_GPS_RAW_INT
    dive.fly(10)
    assert dive.run.status.state is RunState.WAITING
    assert dive.run.status.reason == "depth has no zero: disarm the vehicle at the surface or on deck"
    assert dive.run.limits == {}
    dive.passes = lambda datagram: True
    dive.fly(10)
    assert dive.run.status.state is RunState.RUNNING
