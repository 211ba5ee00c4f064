"""The MAVLink link against an autopilot written in the test with plain pymavlink."""

import dataclasses
import itertools
import math
import socket

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega
from pymavlink.dialects.v20 import common as mavlink

from auv_lse_common.mission_file.parameters import ParameterError, from_mapping, section
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.topics.records import Altitude, Pressure
from auv_lse_common.vocabulary.dead_reckoning import Fix
from auv_lse_common.vocabulary.mission_run import Action, Stop
from auv_lse_mavlink.health import link_health
from auv_lse_mavlink.link import LinkState, VehicleLink
from auv_lse_mavlink.messages import events
from auv_lse_mavlink.messages.conversion import (
    Target,
    altitude_m,
    mission_item,
    position_target,
    target_of_item,
    target_of_position,
)
from auv_lse_mavlink.messages.datum import Datum, Origin
from auv_lse_mavlink.messages.events import AutopilotEstimate
from auv_lse_mavlink.messages.modes import obeying_modes
from auv_lse_mavlink.messages.sender_filter import SILENT_S, TWIN_S
from auv_lse_mavlink.messages.wire import MavlinkCodec
from auv_lse_mavlink.port import AutopilotPort
from auv_lse_mavlink.targets.limits import target_limits

ORIGIN = Origin(lat_deg=46.5, lon_deg=6.6)
NOW_S = 1_700_000_000.0
KEY = bytes(range(32))
A = Target(north_m=20.0, east_m=0.0, depth_m=4.0, heading_rad=0.0, step=0)
B = Target(north_m=40.0, east_m=0.0, depth_m=4.0, heading_rad=0.0, step=1)


class Autopilot:
    """Vehicle 2's autopilot, and the link to it."""

    def __init__(self, origin=ORIGIN, own_origin=ORIGIN, limits=None, **values):
        config = LinkConfig(kind="mavlink", **{"pressure": "none", **values})
        self.link = VehicleLink(config, 2, origin, limits)
        self.own_origin = own_origin
        self.mav = mavlink.MAVLink(None, srcSystem=2, srcComponent=1)
        self.reader = mavlink.MAVLink(None)
        self.now_s = NOW_S
        self.reported = []
        self.kind = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA

    def say(self, message, mav=None):
        mav = mav or self.mav
        data = message.pack(mav)
        mav.seq = (mav.seq + 1) % 256
        self.link.receive(self.now_s, data)
        self.reported += self.link.events()

    def heard(self, *kinds):
        messages = []
        for datagram in self.link.outgoing():
            messages += self.reader.parse_buffer(datagram)
        return [m for m in messages if not kinds or m.get_type() in kinds]

    def beat(self, armed=True):
        flags = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        self.say(mavlink.MAVLink_heartbeat_message(12, self.kind, flags, 4, mavlink.MAV_STATE_ACTIVE, 3))

    def up(self):
        self.beat()
        self.say_origin()
        self.heard()
        return self

    def say_origin(self):
        if self.own_origin is not None:
            lat, lon = round(self.own_origin.lat_deg * 1e7), round(self.own_origin.lon_deg * 1e7)
            self.say(mavlink.MAVLink_gps_global_origin_message(lat, lon, 0, 0))

    @property
    def boot_ms(self):
        return round((self.now_s - NOW_S) * 1000) + 5000

    def at(self, north, east, depth=4.0, yaw=0.0, speed=1.5, yaw_speed=0.0):
        self.say(mavlink.MAVLink_attitude_message(self.boot_ms, 0, 0, yaw, 0, 0, yaw_speed))
        velocity = (speed * math.cos(yaw), speed * math.sin(yaw), 0)
        self.say(mavlink.MAVLink_local_position_ned_message(self.boot_ms, north, east, depth, *velocity))

    def wait(self, seconds, beat=True):
        for _ in range(round(seconds * 10)):
            self.now_s += 0.1
            if beat:
                self.beat()
            self.link.poll(self.now_s)
            self.reported += self.link.events()

    def of(self, kind):
        return [event for event in self.reported if isinstance(event, kind)]


def other_heartbeat(system, component):
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    return mavlink.MAVLink_heartbeat_message(12, 3, 0, 4, 4, 3).pack(mav)


def signed_heartbeat(system, component):
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    mav.signing.secret_key, mav.signing.sign_outgoing = KEY, True
    mav.signing.timestamp = round((NOW_S - 1_420_070_400.0) * 1e5)
    return mavlink.MAVLink_heartbeat_message(12, 3, 0, 4, 4, 3).pack(mav)


OTHER_DIALECT = ardupilotmega.MAVLink_ahrs_message(0, 0, 0, 0, 0, 0, 0).pack(
    ardupilotmega.MAVLink(None, srcSystem=2, srcComponent=1)
)

# ------------------------------------------------------------------ frames and units


def test_a_position_east_of_the_vehicle_keeps_its_axes():
    pilot = Autopilot().up()
    pilot.at(12.0, -34.0, depth=3.5, yaw=-1.25, speed=2.0, yaw_speed=0.25)
    (odometry,) = pilot.of(AutopilotEstimate)
    assert (odometry.north_m, odometry.east_m, odometry.depth_m) == pytest.approx((12.0, -34.0, 3.5))
    assert odometry.heading_rad == pytest.approx(-1.25)
    assert odometry.speed_mps == pytest.approx(2.0)
    assert odometry.yaw_rate_radps == pytest.approx(0.25)


def test_an_unknown_yaw_rate_is_published_as_none():
    pilot = Autopilot().up()
    pilot.at(0.0, 0.0, yaw=1.0, yaw_speed=math.nan)
    (odometry,) = pilot.of(AutopilotEstimate)
    assert (odometry.heading_rad, odometry.yaw_rate_radps) == (1.0, 0.0)


@pytest.mark.parametrize(("lat", "lon"), [(2**31 - 1, 2**31 - 1), (465000000, -(2**31)), (466000000, 66000000)])
def test_an_origin_that_cannot_be_right_is_refused(lat, lon):
    pilot = Autopilot().up()
    known = pilot.link.datum
    for _ in range(3):
        pilot.say(mavlink.MAVLink_gps_global_origin_message(lat, lon, 0, 0))
    assert pilot.link.counts["origins_refused"] == 3
    (problem,) = pilot.of(events.Problem)
    assert "the autopilot's origin is refused: latitude" in problem.text
    assert ("11.1 km from the mission's" in problem.text) == (lat == 466000000)
    assert problem.text in link_health(pilot.link, "").text, "diagnostics have the reason as long as it lasts"
    pilot.at(1.0, 2.0)  # where that is, nobody knows now
    assert pilot.of(AutopilotEstimate) == []
    pilot.say_origin()
    assert pilot.link.datum == known
    pilot.at(1.0, 2.0)
    (odometry,) = pilot.of(AutopilotEstimate)
    assert (odometry.north_m, odometry.east_m) == pytest.approx((1.0, 2.0))


def test_a_tick_does_not_end_before_the_origin_is_known():
    """Otherwise the first tick's position would be discarded, and a mission in lockstep would wait for it forever."""
    pilot = Autopilot()
    pilot.link.gauge.restore(101325.0)
    pilot.beat()
    assert pilot.link.state is LinkState.UP
    assert pilot.link.gauge.is_ready
    assert not pilot.link.quiet
    pilot.say_origin()
    assert pilot.link.quiet


@pytest.mark.parametrize("mode", ["position_target", "mission"])
def test_before_the_origin_is_known_neither_odometry_nor_targets_pass(mode):
    pilot = Autopilot(own_origin=None, mode=mode)
    pilot.beat()
    pilot.at(5.0, 0.0)
    pilot.link.command(pilot.now_s, A)
    pilot.wait(3.0)
    assert pilot.of(AutopilotEstimate) == []
    assert pilot.link.counts["unplaced_positions"] == 1
    assert pilot.heard("SET_POSITION_TARGET_LOCAL_NED", "MISSION_COUNT") == []
    assert not pilot.link.quiet
    pilot.own_origin = Origin(lat_deg=46.5 + 300.0 / 111165.0, lon_deg=6.6)
    pilot.say_origin()
    pilot.at(5.0, 0.0)
    (odometry,) = pilot.of(AutopilotEstimate)
    assert odometry.north_m == pytest.approx(305.0, abs=0.2)
    (sent,) = pilot.heard("SET_POSITION_TARGET_LOCAL_NED", "MISSION_COUNT")
    assert mode == "mission" or sent.x == pytest.approx(20.0 - 300.0, abs=0.2)


def test_a_mission_without_an_origin_is_in_the_autopilots_own_frame():
    pilot = Autopilot(origin=None, own_origin=None)
    pilot.beat()
    pilot.at(5.0, 1.0)
    (odometry,) = pilot.of(AutopilotEstimate)
    assert (odometry.north_m, odometry.east_m) == pytest.approx((5.0, 1.0))


def test_setting_the_origin_warns_that_the_vehicles_start_is_then_taken_for_it():
    pilot = Autopilot(own_origin=None)
    pilot.beat()
    pilot.wait(10.0)
    (problem,) = pilot.of(events.Problem)
    assert "its estimator will position its start at latitude 46.5" in problem.text


def test_an_autopilot_whose_origin_is_refused_is_asked_again_and_its_origin_is_not_set():
    pilot = Autopilot(own_origin=Origin(lat_deg=47.5, lon_deg=6.6)).up()
    pilot.wait(10.0)
    asked = pilot.heard("COMMAND_LONG", "SET_GPS_GLOBAL_ORIGIN")
    assert {m.get_type() for m in asked} == {"COMMAND_LONG"}
    assert not pilot.link.placed
    pilot.own_origin = ORIGIN
    pilot.say_origin()
    assert pilot.link.placed


@pytest.mark.parametrize("lat", [2**31 - 1, 900000001])
def test_an_origin_off_the_earth_is_refused_without_a_mission_origin_too(lat):
    pilot = Autopilot(origin=None, own_origin=None).up()
    pilot.say(mavlink.MAVLink_gps_global_origin_message(lat, 0, 0, 0))
    assert pilot.link.datum.autopilot is None


def test_another_origin_of_the_autopilot_is_corrected_both_ways():
    # 0.001 deg of latitude at 46.5 deg is 111.165 m (WGS84 meridian: 111 132.95 - 559.85 cos 2p + 1.17 cos 4p m/deg)
    per_deg = 111132.954 - 559.822 * math.cos(math.radians(93.0)) + 1.175 * math.cos(math.radians(186.0))
    pilot = Autopilot(own_origin=Origin(lat_deg=46.501, lon_deg=6.6)).up()
    pilot.at(0.0, 0.0)
    (odometry,) = pilot.of(AutopilotEstimate)
    assert odometry.north_m == pytest.approx(0.001 * per_deg, abs=0.01)
    assert odometry.east_m == pytest.approx(0.0, abs=1e-3)
    assert any("origin lies 111.2 m north" in p.text for p in pilot.of(events.Problem))
    pilot.link.command(pilot.now_s, A)
    (target,) = pilot.heard("SET_POSITION_TARGET_LOCAL_NED")
    assert target.x == pytest.approx(20.0 - 0.001 * per_deg, abs=0.01)


@given(st.floats(-2000, 2000), st.floats(-2000, 2000), st.floats(0, 100), st.floats(-3.14, 3.14), st.booleans())
def test_targets_survive_both_kinds_of_message(north, east, depth, heading, shifted):
    target = Target(north_m=north, east_m=east, depth_m=depth, heading_rad=heading)
    datum = Datum(ORIGIN, Origin(lat_deg=46.503, lon_deg=6.59) if shifted else ORIGIN)
    codec, other = MavlinkCodec(245, 191), MavlinkCodec(1, 1)
    (message,) = other.decode(codec.encode(position_target(target, datum, 1234, 2, 1)))
    back = target_of_position(message, datum)
    assert (back.north_m, back.east_m) == pytest.approx((north, east), abs=1e-3)  # float32 at 2 km: 0.12 mm
    assert (back.depth_m, back.heading_rad) == pytest.approx((depth, heading), abs=1e-5)
    (message,) = other.decode(codec.encode(mission_item(target, datum, 0, 3.0, 2, 1)))
    back = target_of_item(message, datum)
    assert (back.north_m, back.east_m) == pytest.approx((north, east), abs=0.01)  # 1e-7 deg: 1.1 cm, rounded
    assert (back.depth_m, back.heading_rad) == pytest.approx((depth, heading), abs=1e-5)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"coordinate_frame": mavlink.MAV_FRAME_BODY_NED}, "not MAV_FRAME_LOCAL_NED"),
        ({"type_mask": 0xFFF}, "leaves out the position"),
        ({"x": math.nan}, "must be finite"),
    ],
)
def test_position_targets_that_mean_something_else_are_refused(change, words):
    message = position_target(A, Datum(ORIGIN, ORIGIN), 0, 2, 1)
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(ValueError, match=words):
        target_of_position(message, Datum(ORIGIN, ORIGIN))


def distance(cm, orientation=25, limits=(20, 5000)):
    return mavlink.MAVLink_distance_sensor_message(5000, *limits, cm, 1, 0, orientation, 255)


def test_only_the_sensor_that_looks_down_is_an_altimeter():
    assert altitude_m(distance(1234)) == pytest.approx(12.34)
    assert altitude_m(distance(1234, orientation=0)) is None
    assert math.isnan(altitude_m(distance(5001)))
    assert math.isnan(altitude_m(distance(19)))
    pilot = Autopilot().up()
    pilot.say(distance(500, orientation=0))
    pilot.say(distance(1234))
    (altitude,) = pilot.of(Altitude)
    assert (altitude.altitude_m, altitude.min_m, altitude.max_m) == pytest.approx((12.34, 0.2, 50.0))


def test_of_two_sonars_that_look_down_one_is_used_while_it_sends():
    """A DVL and an echo sounder at different heights of the hull; each number of a median would be a mixture."""
    pilot = Autopilot().up()

    def ping(number, distance_m):
        message = mavlink.MAVLink_distance_sensor_message(
            pilot.boot_ms, 30, 5000, round(100 * distance_m), 1, number, 25, 0
        )
        pilot.say(message)

    for _ in range(20):
        pilot.wait(0.5)
        ping(1, 9.5)
        ping(0, 9.0)
    assert {altitude.altitude_m for altitude in pilot.of(Altitude)} == {9.5}
    assert pilot.link.counts["altitudes_of_others"] == 20
    (text,) = [problem.text for problem in pilot.of(events.Problem)]
    assert text.startswith("two sensors look down: DISTANCE_SENSOR 1 is used, DISTANCE_SENSOR 0 is not")
    pilot.wait(3.5)
    ping(0, 9.0)
    assert pilot.of(Altitude)[-1].altitude_m == 9.0


def test_a_dvl_and_a_range_finder_are_not_mixed():
    """`vehicle_link_node` gets the heights of a DVL on ROS from another node."""
    pilot = Autopilot().up()
    for _ in range(20):
        pilot.wait(0.5)
        dvl = Altitude(stamp_s=pilot.now_s, altitude_m=9.5, min_m=0.0, max_m=math.inf)
        pilot.link.take_altitude("topic dvl", dvl)
        pilot.say(distance(900))
    assert {altitude.altitude_m for altitude in pilot.of(Altitude)} == {9.5}
    assert pilot.link.counts["altitudes_of_others"] == 20
    (text,) = [problem.text for problem in pilot.of(events.Problem)]
    assert text.startswith("two sensors look down: topic dvl is used, DISTANCE_SENSOR 0 is not. Turn one off")
    pilot.wait(3.5)
    pilot.say(distance(900))
    assert pilot.of(Altitude)[-1].altitude_m == 9.0


def test_pressure_in_pascal():
    pilot = Autopilot(pressure="SCALED_PRESSURE2").up()
    pilot.say(mavlink.MAVLink_scaled_pressure2_message(5000, 1405.5, 0.0, 1000))
    pilot.say(mavlink.MAVLink_scaled_pressure2_message(5000, math.nan, 0.0, 1000))  # a broken sensor
    (pressure,) = pilot.of(Pressure)
    assert pressure.pressure_pa == pytest.approx(140550.0, rel=1e-6)
    assert pilot.link.counts["bad_pressures"] == 1


def test_global_position_that_does_not_agree_is_reported_once():
    pilot = Autopilot().up()
    for _ in range(3):
        pilot.at(0.0, 0.0)
        pilot.say(mavlink.MAVLink_global_position_int_message(5000, 465000000, 66000000, 0, 0, 0, 0, 0, 0))
    assert pilot.of(events.Problem) == []
    for _ in range(3):
        pilot.say(mavlink.MAVLink_global_position_int_message(5000, 465010000, 66000000, 0, 0, 0, 0, 0, 0))
    (problem,) = pilot.of(events.Problem)
    assert "111.2 m apart" in problem.text


# ------------------------------------------------------------------ times


def test_stamps_are_the_autopilots_when_its_clock_agrees():
    pilot = Autopilot().up()
    pilot.say(mavlink.MAVLink_system_time_message(round((NOW_S + 0.5) * 1e6), 5000))
    pilot.at(0.0, 0.0)
    assert pilot.of(AutopilotEstimate)[-1].stamp_s == pytest.approx(NOW_S + 0.5)
    pilot.say(mavlink.MAVLink_system_time_message(round((NOW_S + 3600.0) * 1e6), 5000))
    pilot.at(0.0, 0.0)
    assert pilot.of(AutopilotEstimate)[-1].stamp_s == NOW_S  # an hour off: the time of receipt
    pilot.say(mavlink.MAVLink_system_time_message(0, 5000))  # it does not know
    pilot.at(0.0, 0.0)
    assert pilot.of(AutopilotEstimate)[-1].stamp_s == NOW_S


def test_a_time_since_boot_that_wraps_after_49_days_is_no_reboot():
    pilot = Autopilot().up()
    before_ms = 2**32 - 1500
    for passed_ms in (0, 1000, 2000, 3000):
        pilot.now_s = NOW_S + passed_ms / 1000.0
        boot_ms = (before_ms + passed_ms) % 2**32
        if passed_ms < 2000:
            pilot.say(mavlink.MAVLink_system_time_message(round((pilot.now_s + 0.5) * 1e6), boot_ms))
        pilot.say(mavlink.MAVLink_attitude_message(boot_ms, 0, 0, 0.0, 0, 0, 0.0))
        pilot.say(mavlink.MAVLink_local_position_ned_message(boot_ms, 0.0, 0.0, 4.0, 0, 0, 0))
        assert pilot.of(AutopilotEstimate)[-1].stamp_s == pytest.approx(pilot.now_s + 0.5)
        assert pilot.link._clock.boot_ms_at(pilot.now_s + 0.5) % 2**32 == pytest.approx(boot_ms, abs=1)
    assert pilot.link.counts["reboots"] == 0
    pilot.say(mavlink.MAVLink_attitude_message(2**31, 0, 0, 0.0, 0, 0, 0.0))
    pilot.say(mavlink.MAVLink_attitude_message(300, 0, 0, 0.0, 0, 0, 0.0))
    assert pilot.link.counts["reboots"] == 1


def test_an_autopilot_that_falls_silent_is_lost_in_time_although_the_host_sets_its_clock_back():
    pilot = Autopilot(lost_after_s=5.0).up()
    pilot.link.poll(NOW_S + 3.0)
    pilot.link.poll(NOW_S - 3600.0)
    assert pilot.link.state is LinkState.UP
    pilot.link.poll(NOW_S - 3598.0)
    assert pilot.link.state is LinkState.DOWN
    (state,) = [event for event in pilot.link.events() if isinstance(event, events.AutopilotState)]
    assert state.stamp_s == NOW_S, "by the clock of that time"


@pytest.mark.parametrize(
    ("by_s", "is_steady"),
    [*((by_s, True) for by_s in (3600.0, 9.9, 6.0, 2.0, -2.0)), (3600.0, False), (-3600.0, False)],
)
def test_a_clock_that_is_set_loses_no_link_and_changes_no_sender(by_s, is_steady):
    """Without a steady clock, short steps ahead are ticks of a simulation."""
    pilot, set_s = Autopilot(), 0.0
    steady = (lambda: pilot.now_s - set_s) if is_steady else None
    pilot.link = VehicleLink(LinkConfig(kind="mavlink", lost_after_s=5.0), 2, ORIGIN, steady=steady)
    pilot.up()
    pilot.wait(2.0)
    pilot.now_s, set_s = pilot.now_s + by_s, by_s
    pilot.link.poll(pilot.now_s)
    assert not pilot.link.recognizes(other_heartbeat(2, 1))
    counts = pilot.link.counts
    assert (counts["lost"], counts["clock_steps"], pilot.link.placed) == (0, 1, True)
    pilot.wait(6.0, beat=False)
    assert counts["clock_steps"] == 1
    assert pilot.link.state is LinkState.DOWN


@pytest.mark.parametrize("how", ["utc 0", "boot time back", "link lost"])
def test_an_autopilot_that_reboots_under_water_does_not_stamp_by_its_old_clock(how):
    pilot = Autopilot().up()
    pilot.say(mavlink.MAVLink_system_time_message(round(NOW_S * 1e6), 5_000_000))
    pilot.say(mavlink.MAVLink_attitude_message(5_000_000, 0, 0, 0.0, 0, 0, 0.0))
    pilot.say(mavlink.MAVLink_local_position_ned_message(5_000_000, 1.0, 2.0, 4.0, 0, 0, 0))
    assert pilot.of(AutopilotEstimate)[-1].stamp_s == pytest.approx(NOW_S)
    if how == "utc 0":
        pilot.say(mavlink.MAVLink_system_time_message(0, 2000))
    if how == "link lost":
        pilot.wait(6.0, beat=False)
        pilot.beat()
    pilot.say_origin()
    pilot.say(mavlink.MAVLink_attitude_message(2100, 0, 0, 0.0, 0, 0, 0.0))
    pilot.say_origin()
    pilot.say(mavlink.MAVLink_local_position_ned_message(2100, 1.0, 2.0, 4.0, 0, 0, 0))
    assert len(pilot.of(AutopilotEstimate)) == 2
    assert pilot.of(AutopilotEstimate)[-1].stamp_s == pilot.now_s


def test_a_rebooted_autopilots_origin_is_unknown_until_it_reports_it():
    pilot = Autopilot(set_origin=False).up()
    pilot.say(mavlink.MAVLink_attitude_message(5_000_000, 0, 0, 0.0, 0, 0, 0.0))
    assert pilot.link.placed
    pilot.say(mavlink.MAVLink_attitude_message(4_999_900, 0, 0, 0.0, 0, 0, 0.0))  # a datagram out of order
    assert pilot.link.placed
    pilot.say(mavlink.MAVLink_attitude_message(2000, 0, 0, 0.0, 0, 0, 0.0))
    assert not pilot.link.placed
    assert pilot.link.counts["reboots"] == 1
    assert any("the autopilot rebooted" in problem.text for problem in pilot.of(events.Problem))
    pilot.heard()
    pilot.wait(0.2)
    assert len(pilot.heard("COMMAND_LONG")) == 1  # asked for at once


def test_a_position_without_a_fresh_heading_gives_no_odometry():
    pilot = Autopilot(stale_after_s=3.0).up()
    pilot.say(mavlink.MAVLink_local_position_ned_message(5000, 1.0, 2.0, 3.0, 0, 0, 0))
    assert pilot.of(AutopilotEstimate) == []
    pilot.at(1.0, 2.0)
    pilot.wait(3.5)
    pilot.say(mavlink.MAVLink_local_position_ned_message(5000, 1.0, 2.0, 3.0, 0, 0, 0))
    assert len(pilot.of(AutopilotEstimate)) == 1
    assert pilot.link.counts["stale_attitude"] == 2
    pilot.at(math.nan, 2.0)
    assert pilot.link.counts["bad_positions"] == 1


# ------------------------------------------------------------------ link


def test_heartbeats_go_out_whether_or_not_anybody_is_heard():
    pilot = Autopilot()
    pilot.wait(5.0, beat=False)
    assert len(pilot.heard("HEARTBEAT")) in (9, 10), "twice a second"
    assert pilot.link.state is LinkState.DOWN


def test_the_link_is_lost_and_found():
    pilot = Autopilot(lost_after_s=5.0).up()
    assert pilot.link.status.armed
    pilot.wait(4.9, beat=False)
    assert pilot.link.state is LinkState.UP
    pilot.wait(0.3, beat=False)
    assert pilot.link.state is LinkState.DOWN
    assert len(pilot.of(events.LinkLost)) == 1
    pilot.wait(30.0, beat=False)
    assert len(pilot.of(events.LinkLost)) == 1
    pilot.beat(armed=False)
    assert pilot.link.state is LinkState.UP
    assert not pilot.link.status.armed
    assert len(pilot.of(events.LinkUp)) == 2


def test_others_on_the_network_are_not_the_autopilot():
    pilot = Autopilot()
    stranger = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    pilot.say(mavlink.MAVLink_heartbeat_message(12, 3, 0, 4, 4, 3), stranger)
    assert pilot.link.state is LinkState.DOWN
    assert pilot.link.counts["from_others"] == 1


def test_a_datagram_is_recognized_by_its_sender():
    pilot = Autopilot()
    beat = mavlink.MAVLink_heartbeat_message(12, 3, 0, 4, 4, 3)
    good = beat.pack(pilot.mav)
    assert pilot.link.recognizes(good)
    for bad in (b"", b"x", good[:-1], bytes([good[0]]) + good[2:], beat.pack(mavlink.MAVLink(None, srcSystem=7))):
        assert not pilot.link.recognizes(bad)
    assert pilot.link.counts["other_senders"] == 5


def test_a_second_autopilot_with_the_same_ids_is_ignored_and_reported():
    """Two vehicles with ArduPilot's default id on one port: their positions would be one vehicle's."""
    pilot = Autopilot().up()
    other = mavlink.MAVLink_heartbeat_message(12, 3, 0, 4, 4, 3).pack(pilot.mav)
    for _ in range(round(TWIN_S) + 3):
        pilot.wait(1.0)
        assert not pilot.link.recognizes(other)
    (text,) = [problem.text for problem in pilot.of(events.Problem)]
    assert text == (
        "another sender has the autopilot's system ID 2, and is ignored. Give each autopilot its own system ID "
        "(SYSID_THISMAV, MAV_SYSID since 4.8) or port, and send its messages here by one route only."
    )
    pilot.wait(SILENT_S + 0.1, beat=False)
    assert pilot.link.recognizes(other), "a router that was restarted sends from another port"


def test_a_router_that_is_restarted_twice_is_no_second_autopilot():
    pilot = Autopilot().up()
    for _ in range(3):
        assert not pilot.link.recognizes(other_heartbeat(2, 1))
        pilot.wait(20.0 * TWIN_S)
    assert pilot.of(events.Problem) == []
    assert pilot.link.counts["twins"] == 3


def test_a_second_autopilot_takes_over_when_the_link_is_lost_and_that_is_reported():
    pilot = Autopilot(lost_after_s=3.9).up()

    def second_passes(beat):
        pilot.wait(1.0, beat)
        return pilot.link.recognizes(other_heartbeat(2, 1))

    assert not any(second_passes(beat=True) for _ in range(round(TWIN_S) + 2))
    assert [second_passes(beat=False) for _ in range(4)] == [False, False, False, True]
    assert not pilot.link.recognizes(other_heartbeat(2, 1)), "until that one is silent"
    pilot.wait(0.1)
    _, text = [problem.text for problem in pilot.of(events.Problem)]
    assert text.startswith(
        "the autopilot was silent for 4.0 s; another sender with its system ID 2 takes its place. Give each autopilot"
    )


def test_after_the_port_is_reopened_the_autopilot_is_heard_at_once():
    """Its address is unknown then, though it was heard a moment ago: it counted as a second autopilot for 1.5 s."""
    config = LinkConfig(kind="mavlink", endpoint="udpin://127.0.0.1:0", pressure="none")
    port = AutopilotPort(config, 2, None)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for number in range(4):
            port.step(NOW_S + number, float(number))
            assert port.transport is not None
            sender.sendto(other_heartbeat(2, 1), ("127.0.0.1", port.transport.local_port))
            port.step(NOW_S + number, float(number))
            assert port.link.senders._heard_s == NOW_S + number
            port.connection.close(float(number), "the network is down")
    assert (port.link.counts["twins"], port.link.counts["other_senders"]) == (0, 0)


def test_the_origin_is_asked_for_and_set_if_there_is_none():
    pilot = Autopilot(own_origin=None)
    pilot.beat()
    assert [m.get_type() for m in pilot.heard("COMMAND_LONG", "SET_GPS_GLOBAL_ORIGIN")] == ["COMMAND_LONG"]
    pilot.wait(2.5)
    sent = pilot.heard("COMMAND_LONG", "SET_GPS_GLOBAL_ORIGIN")
    assert [m.get_type() for m in sent] == ["SET_GPS_GLOBAL_ORIGIN", "COMMAND_LONG"]
    assert (sent[0].latitude, sent[0].longitude) == (465000000, 66000000)
    pilot.own_origin = ORIGIN
    pilot.say_origin()
    pilot.wait(10.0)
    assert pilot.heard("COMMAND_LONG", "SET_GPS_GLOBAL_ORIGIN") == []


def test_after_a_slow_link_the_origin_is_requested_and_not_set_again():
    pilot = Autopilot(own_origin=None, lost_after_s=5.0)
    pilot.beat()
    pilot.wait(2.5)
    pilot.own_origin = ORIGIN
    pilot.say_origin()
    pilot.wait(6.0, beat=False)
    assert not pilot.link.placed
    pilot.heard()
    pilot.wait(8.0)  # its answer takes so long
    assert pilot.heard("SET_GPS_GLOBAL_ORIGIN") == []
    pilot.say_origin()
    assert pilot.link.placed
    pilot.at(0.0, 0.0)
    pilot.wait(6.0, beat=False)
    pilot.beat()
    pilot.say(mavlink.MAVLink_attitude_message(2000, 0, 0, 0.0, 0, 0, 0.0))  # it has rebooted meanwhile
    pilot.wait(2.5)
    assert len(pilot.heard("SET_GPS_GLOBAL_ORIGIN")) == 1
    pilot.say_origin()
    pilot.wait(6.0, beat=False)
    pilot.heard()
    pilot.wait(35.0)
    assert pilot.heard("SET_GPS_GLOBAL_ORIGIN"), "an autopilot that never answers gets it in the end"


def test_the_autopilots_warnings_are_reported():
    pilot = Autopilot().up()
    pilot.say(mavlink.MAVLink_statustext_message(4, b"Leak detected"))
    pilot.say(mavlink.MAVLink_statustext_message(6, b"all is well"))
    assert [p.text for p in pilot.of(events.Problem)] == ["autopilot: Leak detected"]


def test_a_warning_in_pieces_is_reported_whole_and_once():
    """MAVLink 2 cuts texts longer than 50 characters; the pieces have an id, and the last one is shorter."""
    long = "PreArm: battery 1 below minimum arming voltage, check leak sensors and the EKF's yaw"
    pilot = Autopilot().up()
    for number in (1, 2):  # a repetition has the next id
        pilot.say(mavlink.MAVLink_statustext_message(4, long[:50].encode(), number, 0))
        pilot.say(mavlink.MAVLink_statustext_message(4, long[50:].encode(), number, 1))
    assert [p.text for p in pilot.of(events.Problem)] == [f"autopilot: {long}"]
    pilot.say(mavlink.MAVLink_statustext_message(4, b"x" * 50, 3, 0))  # its end gets lost
    pilot.say(mavlink.MAVLink_statustext_message(4, b"EKF failsafe"))
    assert [p.text for p in pilot.of(events.Problem)][1:] == [f"autopilot: {'x' * 50}", "autopilot: EKF failsafe"]


def test_a_warning_whose_end_gets_lost_is_reported_after_a_second():
    pilot = Autopilot().up()
    pilot.say(mavlink.MAVLink_statustext_message(2, b"x" * 50, 3, 0))
    assert not pilot.of(events.Problem)
    pilot.link.poll(NOW_S + 1.1)
    pilot.reported += pilot.link.events()
    assert [p.text for p in pilot.of(events.Problem)] == [f"autopilot: {'x' * 50}"]


def test_a_warning_without_an_end_is_cut_off():
    pilot = Autopilot().up()
    for number in range(40):
        pilot.say(mavlink.MAVLink_statustext_message(4, b"x" * 50, 3, number % 256))
    assert {len(p.text) for p in pilot.of(events.Problem)} == {len("autopilot: ") + 500}


def test_a_leak_in_a_lost_text_counts_at_once():
    pilot = Autopilot().up()
    pilot.say(mavlink.MAVLink_statustext_message(2, b"Leak detected" + b"." * 37, 3, 0))
    assert pilot.link.report.leak == 1


@settings(max_examples=200)
@given(st.binary(max_size=300))
def test_garbage_is_survived_and_counted(data):
    pilot = Autopilot()
    pilot.link.receive(NOW_S, data)
    for _ in range(30):  # a false start byte may swallow up to 280 bytes of what follows
        pilot.beat()
    assert pilot.link.state is LinkState.UP
    assert pilot.link.events() == []


def test_lost_datagrams_are_counted():
    pilot = Autopilot().up()
    pilot.mav.seq = (pilot.mav.seq + 3) % 256
    pilot.beat()
    assert pilot.link.wire["gaps"] == 3


def test_messages_of_another_dialect_are_no_lost_ones():
    """ArduPilot sends many of its own, and each has a number."""
    pilot = Autopilot().up()
    own = ardupilotmega.MAVLink(None, srcSystem=2, srcComponent=1)
    for _ in range(300):
        own.seq = pilot.mav.seq
        pilot.say(ardupilotmega.MAVLink_ahrs_message(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), own)
        pilot.mav.seq = own.seq
        pilot.beat()
    assert (pilot.link.wire["gaps"], pilot.link.wire["unknown"], pilot.link.counts["from_others"]) == (0, 300, 0)
    own.seq = pilot.mav.seq = (pilot.mav.seq + 2) % 256
    pilot.say(ardupilotmega.MAVLink_ahrs_message(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), own)
    assert pilot.link.wire["gaps"] == 2


@pytest.mark.parametrize(
    ("key", "data", "words"),
    [
        (None, b"", "nothing arrives"),
        (None, bytes(range(200)), "what arrives is not MAVLink; check the port and its speed"),
        (None, other_heartbeat(7, 1), "only other systems or components are heard"),
        (None, other_heartbeat(2, 100), "only other systems or components are heard"),
        (None, OTHER_DIALECT, "only messages of another MAVLink dialect arrive"),
        (bytes(32), other_heartbeat(2, 1), "messages arrive without a signature or with another key's"),
        (bytes(32), other_heartbeat(255, 190), "only other systems or components are heard"),
        (KEY, signed_heartbeat(255, 190), "only other systems or components are heard"),
        (KEY, signed_heartbeat(2, 1), "signed messages arrive, but no answer to TIMESYNC"),
    ],
)
@pytest.mark.parametrize("kind", ["serial", "udpin"])
def test_diagnostics_say_why_no_autopilot_is_heard(key, data, words, kind):
    link = VehicleLink(LinkConfig(kind="mavlink"), 2, ORIGIN, key=key, nonce=5)
    if kind == "serial" or not data or link.recognizes(data):
        link.receive(NOW_S, data)
    assert link_health(link, "").text.startswith(f"no autopilot heard: {words}")


def test_an_autopilot_that_sends_everything_but_heartbeats_is_not_called_silent():
    """A router that filters messages by their type: cable, port, ids and key are right."""
    pilot = Autopilot()
    pilot.at(0.0, 0.0)
    text = link_health(pilot.link, "").text
    assert text.startswith("no autopilot heard: its other messages arrive, but no HEARTBEAT"), text
    pilot.up()
    for _ in range(8):
        pilot.wait(1.0, beat=False)
        pilot.at(0.0, 0.0)
    assert link_health(pilot.link, "").text == text
    pilot.wait(6.0, beat=False)
    assert "nothing arrives; check power" in link_health(pilot.link, "").text


@pytest.mark.parametrize("noise", [OTHER_DIALECT, bytes(range(200))])
def test_a_lost_autopilot_was_on_the_right_port_with_the_right_dialect(noise):
    pilot = Autopilot().up()
    pilot.link.receive(NOW_S, noise)
    pilot.wait(6.0, beat=False)
    assert "nothing arrives; check power" in link_health(pilot.link, "").text


def test_a_lost_autopilot_had_the_key_and_has_answered():
    pilot = Signing()
    pilot.link = VehicleLink(LinkConfig(kind="mavlink"), 2, ORIGIN, key=KEY, nonce=5)
    pilot.link.receive(NOW_S, other_heartbeat(2, 1))
    pilot.beat()
    pilot.say(mavlink.MAVLink_timesync_message(1, 5))
    pilot.beat()
    pilot.wait(6.0, beat=False)
    pilot.link.receive(pilot.now_s, other_heartbeat(255, 190))
    assert "only other systems or components are heard" in link_health(pilot.link, "").text


# ------------------------------------------------------------------ waypoints one after another


def targets(pilot):
    return [(m.x, m.y) for m in pilot.heard("SET_POSITION_TARGET_LOCAL_NED")]


@pytest.mark.parametrize("repeats", [False, True])
def test_a_target_is_sent_at_once_and_the_next_waits_until_it_is_reached(repeats):
    pilot = Autopilot(acceptance_m=4.0, target_period_s=1.0)
    pilot.kind = mavlink.MAV_AUTOPILOT_GENERIC if repeats else pilot.kind
    pilot.up()
    pilot.at(0.0, 0.0)
    pilot.link.command(pilot.now_s, A)
    assert targets(pilot) == [(20.0, 0.0)]
    assert pilot.link.quiet
    pilot.link.command(pilot.now_s, B)
    assert targets(pilot) == []
    pilot.wait(2.3)
    assert targets(pilot) == [(20.0, 0.0)] * 2 * repeats
    pilot.at(15.9, 0.0)
    assert targets(pilot) == []
    pilot.at(16.1, 0.0)
    assert targets(pilot) == [(40.0, 0.0)]
    assert [e.target for e in pilot.of(events.TargetSent)] == [A, B]
    pilot.at(39.9, 0.0)
    pilot.wait(1.1)
    assert targets(pilot) == [(40.0, 0.0)] * repeats  # there is no other yet
    assert pilot.link.targets == (B,)


def test_the_start_of_the_first_leg_is_a_target_to_reach_like_any_other():
    pilot = Autopilot(acceptance_m=4.0).up()
    pilot.at(0.0, 0.0)
    pilot.link.command(pilot.now_s, dataclasses.replace(A, step=-1))
    pilot.link.command(pilot.now_s, dataclasses.replace(B, step=0))
    assert targets(pilot) == [(20.0, 0.0)]


def test_a_target_passed_by_on_the_side_counts_as_reached_but_one_behind_does_not():
    pilot = Autopilot(acceptance_m=4.0).up()
    pilot.link.command(pilot.now_s, A)
    pilot.link.command(pilot.now_s, B)
    pilot.heard()
    pilot.at(25.0, 60.0)  # far to the side: it must have gone another way
    assert targets(pilot) == []
    pilot.at(21.0, 7.0)
    assert targets(pilot) == [(40.0, 0.0)]


def test_targets_are_kept_while_the_link_is_down_and_sent_when_it_is_up():
    pilot = Autopilot()
    pilot.link.command(pilot.now_s, A)
    pilot.wait(1.0, beat=False)
    assert targets(pilot) == []
    pilot.beat()
    pilot.say_origin()
    assert targets(pilot) == [(20.0, 0.0)]
    pilot.wait(6.0, beat=False)
    pilot.heard()
    pilot.beat()
    assert targets(pilot) == []  # it may have rebooted: where is its origin?
    pilot.say_origin()
    assert targets(pilot) == [(20.0, 0.0)]


@pytest.mark.parametrize("mode", ["position_target", "mission"])
def test_a_replanned_leg_replaces_the_old_one(mode):
    pilot = Autopilot(mode=mode).up()
    other = dataclasses.replace(A, east_m=9.0)
    for target in (A, B):
        pilot.link.command(pilot.now_s, target)
    pilot.heard()
    pilot.link.command(pilot.now_s, dataclasses.replace(B, east_m=9.0))
    assert [t.east_m for t in pilot.link.targets] == [0.0, 9.0]
    pilot.link.command(pilot.now_s, other)
    assert pilot.link.targets == (other,)
    if mode == "position_target":
        assert targets(pilot) == [(20.0, 9.0)]


@pytest.mark.parametrize("mode", ["position_target", "mission"])
def test_a_leg_that_begins_elsewhere_replaces_all_waiting_targets(mode):
    """The planner has given up a leg whose end is never passed; the link kept its target for ever."""
    pilot = Autopilot(mode=mode).up()
    pilot.at(-30.0, 5.0)
    pilot.link.command(pilot.now_s, A)
    pilot.link.command(pilot.now_s, dataclasses.replace(B, begins_m=(A.north_m, A.east_m + 3.0)))
    assert len(pilot.link.targets) == 2, "the map has moved a little: it follows"
    pilot.heard()
    other = dataclasses.replace(B, step=B.step + 1, north_m=-50.0, begins_m=(-30.0, 5.0))
    pilot.link.command(pilot.now_s, other)
    assert pilot.link.targets == (other,)
    if mode == "position_target":
        assert targets(pilot) == [(-50.0, 0.0)]


def test_setpoints_are_fast_enough_for_px4_offboard():
    pilot = Autopilot()
    pilot.kind = mavlink.MAV_AUTOPILOT_PX4
    pilot.up().link.command(pilot.now_s, A)
    pilot.heard()
    pilot.wait(10.0)
    assert len(targets(pilot)) >= 10.0 * 2.5


def test_a_target_that_is_no_position_is_refused():
    with pytest.raises(ValueError, match="must be finite"):
        Autopilot().up().link.command(NOW_S, dataclasses.replace(A, north_m=math.nan))


# ------------------------------------------------------------------ missions


def request(pilot, number, legacy=False):
    make = mavlink.MAVLink_mission_request_message if legacy else mavlink.MAVLink_mission_request_int_message
    pilot.say(make(245, 191, number, 0))


def acknowledge(pilot, result=0, selects=True):
    """Answers an upload, and (if `selects`) the choice of the current item after it."""
    pilot.say(mavlink.MAVLink_mission_ack_message(245, 191, result, 0))
    for message in pilot.heard("MISSION_SET_CURRENT") if selects else ():
        pilot.say(mavlink.MAVLink_mission_current_message(message.seq))


@pytest.mark.parametrize("legacy", [False, True])
def test_a_mission_is_counted_asked_for_and_accepted(legacy):
    pilot = Autopilot(mode="mission", upload_timeout_s=1.0)
    pilot.say(mavlink.MAVLink_heartbeat_message(12, mavlink.MAV_AUTOPILOT_PX4, 0, 4, 4, 3))
    pilot.say_origin()
    pilot.heard()
    pilot.link.command(pilot.now_s, A)
    (count,) = pilot.heard("MISSION_COUNT")
    assert (count.count, count.target_system, count.target_component) == (1, 2, 1)
    assert not pilot.link.quiet
    request(pilot, 0, legacy)
    (item,) = pilot.heard("MISSION_ITEM_INT")
    assert (item.seq, item.command, item.frame, item.z) == (0, 16, 6, -4.0)
    assert item.x == pytest.approx(465000000 + 20.0 / 111165.0 * 1e7, abs=15)
    pilot.link.command(pilot.now_s, B)  # while it is under way: the next upload has both
    request(pilot, 0, legacy)  # the autopilot did not get it: again
    assert len(pilot.heard("MISSION_ITEM_INT")) == 1
    acknowledge(pilot)
    (count,) = pilot.heard("MISSION_COUNT")
    assert count.count == 2
    for number in (0, 1):
        request(pilot, number, legacy)
    assert [m.seq for m in pilot.heard("MISSION_ITEM_INT")] == [0, 1]
    acknowledge(pilot)
    assert pilot.link.quiet
    assert [e.target for e in pilot.of(events.TargetSent)] == [A, B]


@pytest.mark.parametrize("asker", [(255, 190), (245, 190)])
def test_answers_to_a_ground_station_on_the_same_link_are_not_ours(asker):
    """It uploads its own mission, and changes the speed."""
    pilot = Autopilot(mode="mission").up()
    pilot.link.command(pilot.now_s, A)
    pilot.heard()
    pilot.say(mavlink.MAVLink_mission_ack_message(*asker, 0, 0))
    pilot.say(mavlink.MAVLink_mission_request_int_message(*asker, 7, 0))
    pilot.say(mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_DO_CHANGE_SPEED, 2, 0, 0, *asker))
    assert pilot.heard() == [], "its mission would be flown"
    assert (pilot.link.refused_speed, pilot.link.counts["to_others"]) == ("", 3)
    for number in (0, 1):
        request(pilot, number)
    assert [m.seq for m in pilot.heard("MISSION_ITEM_INT")] == [0, 1]


def test_ardupilot_gets_its_home_item_first():
    pilot = Autopilot(mode="mission").up()
    pilot.link.command(pilot.now_s, A)
    (count,) = pilot.heard("MISSION_COUNT")
    assert count.count == 2


def test_after_each_upload_the_first_leg_becomes_the_current_item():
    pilot = Autopilot(mode="mission")
    pilot.kind = mavlink.MAV_AUTOPILOT_PX4
    pilot.up()
    for target in (A, B):
        pilot.link.command(pilot.now_s, target)
        acknowledge(pilot, selects=False)
        pilot.say(mavlink.MAVLink_mission_current_message(5))  # still the old one
        pilot.wait(2.0)  # lost: again
        chosen = pilot.heard("MISSION_SET_CURRENT")
        assert [(m.seq, m.target_system, m.target_component) for m in chosen] == [(0, 2, 1)] * 2
        assert not pilot.link.quiet
        pilot.say(mavlink.MAVLink_mission_current_message(0))
        assert pilot.link.quiet
        assert pilot.of(events.TargetSent)[-1].target == target


def test_an_unanswered_upload_is_repeated_reported_and_restarted():
    pilot = Autopilot(mode="mission", upload_timeout_s=1.0, upload_retries=2).up()
    pilot.link.command(pilot.now_s, A)
    assert len(pilot.heard("MISSION_COUNT")) == 1
    pilot.wait(2.5)
    assert len(pilot.heard("MISSION_COUNT")) == 2
    pilot.wait(1.0)
    assert any("no answer after 2 repeats" in p.text for p in pilot.of(events.Problem))
    pilot.wait(1.5)
    assert len(pilot.heard("MISSION_COUNT")) >= 1
    assert pilot.link.counts["uploads_failed"] == 1


@pytest.mark.parametrize(("result", "name"), [(4, "MAV_MISSION_NO_SPACE"), (1, "MAV_MISSION_ERROR"), (99, "99")])
def test_a_refused_mission_is_reported_by_name_and_tried_again(result, name):
    pilot = Autopilot(mode="mission", upload_timeout_s=1.0).up()
    pilot.link.command(pilot.now_s, A)
    pilot.heard()
    acknowledge(pilot, result)
    assert any(name in p.text for p in pilot.of(events.Problem))
    assert pilot.heard("MISSION_COUNT") == []  # not at once: it would only be refused again
    pilot.wait(1.2)
    assert len(pilot.heard("MISSION_COUNT")) == 1


def test_an_item_that_does_not_exist_ends_the_upload():
    pilot = Autopilot(mode="mission").up()
    pilot.link.command(pilot.now_s, A)
    request(pilot, 9)
    assert any("requested item 9 of 2" in p.text for p in pilot.of(events.Problem))


def test_an_upload_is_aborted_with_the_link_and_restarted():
    pilot = Autopilot(mode="mission", lost_after_s=5.0, upload_retries=100).up()
    pilot.link.command(pilot.now_s, A)
    pilot.wait(5.2, beat=False)
    assert pilot.link.state is LinkState.DOWN
    pilot.heard()
    pilot.beat()
    pilot.say_origin()
    pilot.wait(2.0)
    assert len(pilot.heard("MISSION_COUNT")) >= 1


def test_reached_ends_are_left_out_of_the_next_mission():
    pilot = Autopilot(mode="mission").up()
    for target in (A, B):
        pilot.link.command(pilot.now_s, target)
        pilot.heard()
        for number in itertools.count():
            request(pilot, number)
            if not pilot.heard("MISSION_ITEM_INT") or number > 3:
                break
        acknowledge(pilot)
    pilot.at(19.0, 0.0)
    assert pilot.link.targets == (B,)


@pytest.mark.parametrize(
    "area",
    [
        {"origin_lat_deg": 46.5},
        {"origin_lat_deg": 465.0, "origin_lon_deg": 6.6},
        {"origin_lat_deg": 46.5, "origin_lon_deg": math.nan},
        {"origin_lat_deg": "north", "origin_lon_deg": 6.6},
        7,
    ],
)
def test_a_mission_origin_that_is_no_position_is_named(area):
    with pytest.raises(ParameterError, match=r"m.yaml: area.* (need|are .* one is missing|must be a (number|mapping))"):
        section(AreaConfig, {"area": area}, "area", "m.yaml")


def test_the_missions_origin():
    assert Origin.of(from_mapping(AreaConfig, {"origin_lat_deg": 46.5, "origin_lon_deg": 6.6}, "m.yaml")) == ORIGIN
    assert Origin.of(AreaConfig()) is None


def test_missions_need_an_origin():
    with pytest.raises(ValueError, match=r"area\.origin_lat_deg"):
        VehicleLink(LinkConfig(kind="mavlink", mode="mission"), 2, None)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"lost_after_s": 0.5}, "lost_after_s"),
        ({"mode": "guided"}, "position_target"),
        ({"system_id": 0}, "system_id"),
        ({"end_point": "x"}, "did you mean 'endpoint'"),
    ],
)
def test_settings_that_cannot_work_are_refused_by_name(values, words):
    with pytest.raises(ParameterError, match=words):
        from_mapping(LinkConfig, values, "mission.yaml: link")


# ------------------------------------------------------------------ stops, limits, what the autopilot says of itself


def targets_of(messages):
    return [(round(m.x, 1), round(m.y, 1), round(m.z, 1)) for m in messages]


def test_a_stop_holds_the_vehicle_where_it_was_until_it_is_lifted():
    pilot = Autopilot().up()
    pilot.link.command(pilot.now_s, A)
    pilot.link.command(pilot.now_s, B)
    pilot.at(12.0, 1.0)
    pilot.heard()
    pilot.link.stop(pilot.now_s, Stop(action=Action.HOLD))
    assert targets_of(pilot.heard("SET_POSITION_TARGET_LOCAL_NED")) == [(12.0, 1.0, 4.0)]
    pilot.at(21.0, 0.0)  # it has drifted past the end of its leg
    pilot.wait(1.0)
    assert targets_of(pilot.heard("SET_POSITION_TARGET_LOCAL_NED")) == [], "it holds the same position"
    pilot.link.stop(pilot.now_s, Stop(action=Action.SURFACE))
    pilot.wait(1.0)
    assert set(targets_of(pilot.heard("SET_POSITION_TARGET_LOCAL_NED"))) == {(21.0, 0.0, 0.0)}
    pilot.link.stop(pilot.now_s, Stop(action=Action.GO_TO, position_m=(-5.0, -6.0)))
    pilot.wait(1.0)
    assert set(targets_of(pilot.heard("SET_POSITION_TARGET_LOCAL_NED"))) == {(-5.0, -6.0, 4.0)}
    pilot.link.stop(pilot.now_s, None)
    pilot.wait(1.0)
    assert set(targets_of(pilot.heard("SET_POSITION_TARGET_LOCAL_NED"))) == {(40.0, 0.0, 4.0)}


def test_a_stop_that_comes_before_the_position_is_known_waits_for_it():
    pilot = Autopilot().up()
    pilot.link.stop(pilot.now_s, Stop(action=Action.HOLD))
    pilot.wait(1.0)
    assert pilot.heard("SET_POSITION_TARGET_LOCAL_NED") == []
    assert pilot.link.quiet
    pilot.at(3.0, 4.0, depth=0.2)
    assert targets_of(pilot.heard("SET_POSITION_TARGET_LOCAL_NED")) == [(3.0, 4.0, 0.2)]


@pytest.mark.parametrize(
    ("then", "position"),
    [(Action.HOLD, (20.0, 0.0, 4.0)), (Action.SURFACE, (19.0, 0.0, 0.0)), (Action.GO_TO, (-5.0, -6.0, 4.0))],
)
def test_after_the_last_target_the_vehicle_does_what_it_says(then, position):
    pilot = Autopilot().up()
    stop = Stop(action=then, position_m=(-5.0, -6.0) if then is Action.GO_TO else (math.nan, math.nan))
    pilot.link.command(pilot.now_s, dataclasses.replace(A, then=stop))
    pilot.at(10.0, 0.0)
    assert targets_of(pilot.heard("SET_POSITION_TARGET_LOCAL_NED"))[-1] == (20.0, 0.0, 4.0)
    pilot.at(19.0, 0.0)
    pilot.wait(0.5)
    last = [(20.0, 0.0, 4.0), *targets_of(pilot.heard("SET_POSITION_TARGET_LOCAL_NED"))][-1]
    assert last == position


@pytest.mark.parametrize("mode", ["position_target", "mission"])
@pytest.mark.parametrize("gps", [True, False])
def test_a_leg_that_ends_with_a_surfacing_waits_for_the_fix_and_for_the_depth(mode, gps):
    pilot = Autopilot(mode=mode, target_period_s=1.0).up()
    end = Target(north_m=100.0, east_m=0.0, depth_m=4.0, heading_rad=0.0, step=1, surface=True)
    pilot.link.command(pilot.now_s, end)
    pilot.link.command(pilot.now_s, dataclasses.replace(end, north_m=120.0, step=2, surface=False))
    depth, depths = 4.0, []
    for second in range(200):
        pilot.at(*((50.0, 0.0) if second < 5 else (99.0, 0.0)), depth=depth, speed=0.0)
        kind = mavlink.GPS_FIX_TYPE_3D_FIX if gps and depth < 0.3 else mavlink.GPS_FIX_TYPE_NO_FIX
        pilot.say(mavlink.MAVLink_gps_raw_int_message(0, kind, 0, 0, 0, 0, 0, 0, 0, 9, h_acc=800))
        pilot.wait(1.0)
        surfacing = pilot.link._targets._surfacing
        wanted = pilot.link.targets[0].depth_m if surfacing is None else surfacing.target.depth_m
        depth += max(-0.5, min(0.5, wanted - depth))
        depths.append(depth)
    up = [second for second, depth in enumerate(depths) if depth < 0.3]
    assert up[0] in range(11, 16), "7 or 8 s after the end of the leg"
    assert len(up) == pytest.approx(21 if gps else 113, abs=4), "20 s of fixes, or two minutes in all"
    assert pilot.link.counts["surfacings_without_fix"] == (not gps)
    assert depths[-1] == 4.0
    assert [t.step for t in pilot.link.targets] == [2], "it goes on"
    assert len([e for e in pilot.of(events.Problem) if "without a GPS fix" in e.text]) == (not gps)
    assert len(pilot.of(Fix)) == gps


def test_a_speed_is_sent_when_it_changes():
    pilot = Autopilot().up()
    for step, speed in enumerate((1.5, 1.5, 0.8)):
        pilot.link.command(pilot.now_s, dataclasses.replace(A, north_m=20.0 * step, step=step, speed_mps=speed))
        pilot.at(20.0 * step - 1.0, 0.0)
        pilot.wait(0.3)
    speeds = [m for m in pilot.heard("COMMAND_LONG") if m.command == mavlink.MAV_CMD_DO_CHANGE_SPEED]
    assert [(m.param1, round(m.param2, 2)) for m in speeds] == [(1.0, 1.5), (1.0, 0.8)]


@pytest.mark.parametrize("mode", ["position_target", "mission"])
def test_a_target_too_deep_or_far_outside_never_reaches_the_autopilot(mode):
    parameters = {"area": {"polygon_m": [0.0, 0.0, 100.0, 0.0, 100.0, 100.0, 0.0, 100.0]}, "vehicle": {"depth_m": 4.0}}
    pilot = Autopilot(limits=target_limits(parameters, "test"), mode=mode).up()
    pilot.at(10.0, 10.0)
    for bad, words in (
        (dataclasses.replace(A, depth_m=9.5), r"depth 9.5 m is deeper than 9.0 m \(safety.max_depth_m\)"),
        (dataclasses.replace(A, north_m=300.0), r"200 m outside the area.*more than 150 m"),
    ):
        with pytest.raises(ValueError, match=words):
            pilot.link.command(pilot.now_s, bad)
    pilot.wait(3.0)
    assert pilot.heard("SET_POSITION_TARGET_LOCAL_NED", "MISSION_COUNT") == []
    assert pilot.link.counts["targets_refused"] == 2
    pilot.at(500.0, 10.0)  # a vehicle that is farther out still is led back
    pilot.link.command(pilot.now_s, dataclasses.replace(A, north_m=300.0))
    assert len(pilot.heard("SET_POSITION_TARGET_LOCAL_NED", "MISSION_COUNT")) == 1


def test_invalid_limits_are_reported():
    with pytest.raises(ParameterError, match=r"m.yaml: area.polygon_m has .*at least 3 corners"):
        target_limits({"area": {"polygon_m": [0.0, 1.0]}}, "m.yaml")
    assert target_limits({}, "m.yaml").deepest_m == 10.0
    assert not target_limits({}, "m.yaml").is_afloat
    boat = Autopilot(limits=target_limits({"vehicle": {"depth_m": 0.0}}, "m.yaml"))
    assert boat.link.gauge.depth_m(0.0, 2.5) == 0.0


def test_the_autopilot_reports_mode_charge_and_a_leak():
    pilot = Autopilot().up()
    (state,) = pilot.of(events.AutopilotState)
    assert (state.report.heard, state.report.armed, state.report.mode, state.report.mode_obeys) == (True, True, 4, True)
    assert math.isnan(state.report.battery)
    assert state.report.leak == -1
    flags = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    pilot.say(mavlink.MAVLink_heartbeat_message(12, 3, flags, 19, mavlink.MAV_STATE_ACTIVE, 3))  # ArduSub: MANUAL
    assert not pilot.link.report.mode_obeys
    pilot.say(mavlink.MAVLink_sys_status_message(0, 0, 0, 500, 14800, -1, 64, 0, 0, 0, 0, 0, 0))
    pilot.say(mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_CRITICAL, b"Leak Detected"))
    pilot.beat(armed=False)
    state = pilot.of(events.AutopilotState)[-1]
    assert (state.report.armed, state.report.battery, state.battery_v, state.report.leak) == (False, 0.64, 14.8, 1)
    pilot.wait(4.0)
    assert pilot.link.report.battery == 0.64
    pilot.wait(26.5)
    assert math.isnan(pilot.link.report.battery), "its messages have stopped"
    assert pilot.link.report.leak == 1, "it tells of a leak every 20 s"
    pilot.wait(25.0)
    assert pilot.link.report.leak == -1, "after a RESET the limit does not trip again of itself"
    pilot.wait(6.0, beat=False)
    assert not pilot.of(events.AutopilotState)[-1].report.heard


def test_the_charge_is_what_the_energy_used_leaves_of_the_battery():
    """ArduPilot reports no percentage without BATT_CAPACITY, and energy with 1 hJ (0.03 Wh) of resolution."""
    pilot = Autopilot(battery_wh=266.0).up()
    pilot.say(mavlink.MAVLink_sys_status_message(0, 0, 0, 500, 14800, -1, 64, 0, 0, 0, 0, 0, 0))
    assert math.isnan(pilot.link.report.battery), "the percentage is that of another capacity"
    voltages = [14800] + [65535] * 9
    for battery, used_hj, charge in ((1, 900, math.nan), (0, -1, math.nan), (0, 2394, 0.75), (0, 99999, 0.0)):
        message = mavlink.MAVLink_battery_status_message(battery, 0, 0, 32767, voltages, 0, 74, used_hj, -1)
        pilot.say(message)
        assert pilot.link.report.battery == pytest.approx(charge, nan_ok=True)


@pytest.mark.parametrize(
    ("autopilot", "kind", "mission", "modes"),
    [
        (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_SUBMARINE, False, (4,)),
        (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_SURFACE_BOAT, True, (10,)),
        (mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_SUBMARINE, False, (393216,)),
        (mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_SUBMARINE, True, (67371008,)),
        (mavlink.MAV_AUTOPILOT_GENERIC, mavlink.MAV_TYPE_SUBMARINE, False, ()),
    ],
)
def test_modes_in_which_autopilots_follow_targets(autopilot, kind, mission, modes):
    assert obeying_modes(autopilot, kind, mission) == modes


# ------------------------------------------------------------------ signing


class Signing(Autopilot):
    """An autopilot that signs with pymavlink, as MAVProxy's `signing setup` makes it."""

    def __init__(self, key=KEY, link_key=KEY):
        super().__init__()
        self.link = VehicleLink(LinkConfig(kind="mavlink"), 2, ORIGIN, key=link_key)
        self.mav.signing.secret_key, self.mav.signing.sign_outgoing = key, key is not None
        self.mav.signing.timestamp = round((NOW_S - 1_420_070_400.0) * 1e5)


def test_signed_messages_pass_both_ways_and_no_others():
    pilot = Signing().up()
    pilot.reader.signing.secret_key = KEY  # pymavlink refuses what is not signed by it
    pilot.link.command(pilot.now_s, A)
    pilot.at(1.0, 0.0)
    pilot.wait(1.0)
    assert pilot.link.state is LinkState.UP
    assert pilot.heard("SET_POSITION_TARGET_LOCAL_NED")
    assert pilot.reader.signing.badsig_count == 0
    for other in (Signing(key=None), Signing(key=bytes(32))):
        other.beat()
        assert other.link.state is LinkState.DOWN
        assert other.link.wire["bad"] > 0


def test_a_signed_message_is_accepted_once_and_forged_ones_do_not_block_genuine_ones():
    pilot = Signing().up()
    kept = mavlink.MAVLink_heartbeat_message(12, 3, 0, 19, mavlink.MAV_STATE_ACTIVE, 3).pack(pilot.mav)
    pilot.link.poll(pilot.now_s + SILENT_S)
    assert pilot.link.recognizes(kept)
    pilot.link.receive(pilot.now_s, kept)
    assert pilot.link.status.mode == 19
    pilot.beat()
    assert pilot.link.status.mode == 4
    pilot.link.receive(pilot.now_s, kept)
    assert pilot.link.status.mode == 4, "it came before"
    assert not pilot.link.recognizes(kept), "nor does it make its sender the peer"
    forger = mavlink.MAVLink(None, srcSystem=2, srcComponent=1)
    forger.signing.secret_key, forger.signing.sign_outgoing = bytes(32), True
    forger.signing.timestamp = pilot.mav.signing.timestamp + 10**9  # hours ahead
    pilot.link.receive(pilot.now_s, mavlink.MAVLink_heartbeat_message(12, 3, 0, 19, 4, 3).pack(forger))
    pilot.say(mavlink.MAVLink_heartbeat_message(12, 3, 0, 2, mavlink.MAV_STATE_ACTIVE, 3))
    assert pilot.link.status.mode == 2


def test_a_key_of_another_length_is_refused():
    with pytest.raises(ValueError, match="key has 16 bytes, not 32"):
        VehicleLink(LinkConfig(kind="mavlink"), 2, ORIGIN, key=bytes(16))
