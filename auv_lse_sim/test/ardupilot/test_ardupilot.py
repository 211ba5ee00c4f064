"""Short conversations with the simulated ArduSub and ArduRover; facts.toml says what the real ones do."""

from __future__ import annotations

import math

import pytest
from bench_of_autopilot import OPERATOR, Bench
from pymavlink.dialects.v20 import common as mavlink

from auv_lse_sim.emulated.ardupilot.personality import ROVER, SUB

SPEEDS = {0.2: 0.02, 0.5: 0.13, 1.0: 0.32, 2.0: 0.62, 5.0: 0.84, 10.0: 0.87}


def test_it_boots_disarmed_in_manual_and_its_heartbeat_follows_arming_and_modes():
    sub, boat = Bench(), Bench(ROVER)
    assert sub.of("HEARTBEAT")[-1].autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    assert (sub.beat, boat.beat) == ((81, 19, 3), (65, 0, 4))
    assert (sub.arm(), boat.arm()) == (0, 0)
    sub.pass_s(1.0), boat.pass_s(1.0)
    assert (sub.beat, boat.beat) == ((209, 19, 4), (193, 0, 4))
    assert (sub.mode(4), boat.mode(15)) == (0, 0)
    assert (sub.beat, boat.beat) == ((217, 4, 4), (137, 15, 4))
    assert (sub.mode(2), boat.mode(4)) == (0, 0)
    assert (sub.beat, boat.beat) == ((209, 2, 4), (129, 4, 3))
    assert sub.mode(77) != 0
    assert (6, "Arming motors") in sub.texts()
    assert (6, "Throttle armed") in boat.texts()


@pytest.mark.parametrize(("period_s", "measured_mps"), SPEEDS.items())
def test_a_repeated_target_restarts_the_subs_trajectory(period_s, measured_mps):
    sub = Bench(guided=True)
    sub.command(178, 1.0, 1.0, -1.0)
    begin_m = begin_s = math.nan
    until_s = sub.now_s + max(60.0, 4.0 * period_s)
    while sub.now_s < until_s:
        if math.isnan(begin_m) and sub.now_s > until_s - max(30.0, 2.0 * period_s):
            begin_m, begin_s = sub.position[0], sub.now_s
        sub.target(1000.0, 0.0, 0.0)
        sub.pass_s(period_s, 0.1)
    assert (sub.position[0] - begin_m) / (sub.now_s - begin_s) == pytest.approx(measured_mps, abs=0.02)


def test_a_target_sent_once_is_flown_straight_and_yaw_turns_at_once():
    sub = Bench(guided=True)
    sub.target(40.0, 30.0, 5.0, heading_rad=2.0)
    sub.pass_s(3.0)
    assert sub.autopilot.pilot.at(sub.now_s).heading_rad == pytest.approx(2.0, abs=0.01)
    track = []
    for _ in range(40):
        sub.pass_s(1.0)
        track.append(sub.position)
    for north, east, depth in track:
        assert (east, depth) == pytest.approx((0.75 * north, 0.125 * north), abs=0.01)
    assert (track[30][0] - track[10][0]) / 20.0 == pytest.approx(0.8 * 0.87, abs=0.02)
    sub.pass_s(40.0)
    assert sub.position == pytest.approx((40.0, 30.0, 5.0), abs=0.01)
    assert sub.of("NAV_CONTROLLER_OUTPUT")[-1].wp_dist == 0
    assert not sub.of("POSITION_TARGET_LOCAL_NED"), "ArduSub echoes no target"


def test_the_boat_keeps_its_speed_when_its_target_is_repeated():
    boat = Bench(ROVER, guided=True)
    boat.command(178, 1.0, 1.5, -1.0)
    for _ in range(100):
        boat.target(60.0, 20.0, 0.0)
        boat.pass_s(0.2, 0.2)
    north, east, _ = boat.position
    boat.target(60.0, 20.0, 0.0)
    boat.pass_s(1.0)
    assert math.dist(boat.position[:2], (north, east)) == pytest.approx(1.5, abs=0.05)
    boat.pass_s(40.0)
    assert math.dist(boat.position[:2], (60.0, 20.0)) < 3.0, "it holds there"


def test_entering_guided_and_arming_clear_target_and_speed():
    sub = Bench(guided=True)
    sub.command(178, 1.0, 0.5, -1.0)
    sub.target(500.0, 0.0, 0.0)
    sub.pass_s(20.0)
    for forget in (lambda: (sub.mode(19), sub.mode(4)), lambda: (sub.arm(False), sub.target(9.0, 9.0, 9.0), sub.arm())):
        forget()
        sub.pass_s(10.0)
        north = sub.position[0]
        sub.pass_s(20.0)
        assert sub.position[0] == pytest.approx(north, abs=0.1), "it holds"
        sub.target(500.0, 0.0, 0.0)
        sub.pass_s(20.0)
        north = sub.position[0]
        sub.pass_s(1.0)
        assert sub.position[0] - north == pytest.approx(0.87, abs=0.01), "WPNAV_SPEED again"


def test_a_leg_that_continues_after_a_stop_or_in_another_mode_counts_once():
    """Else the simulator ends a mission too early whose vehicle was held, or restarted."""
    sub = Bench(guided=True)
    sub.target(500.0, 0.0, 4.0)
    for interrupt in (lambda: (sub.mode(19), sub.mode(4)), lambda: sub.target(*sub.position), lambda: None):
        sub.pass_s(10.0)
        assert sub.autopilot.pilot.step == 0
        interrupt()
        sub.target(500.0, 0.0, 4.0)
    sub.target(500.0, 20.0, 4.0)
    assert sub.autopilot.pilot.step == 1


def test_a_complete_mission_stays_complete_until_it_is_reset():
    sub = Bench()
    sub.upload([(0.5, 0.0)])
    assert (sub.of("MISSION_CURRENT")[-1].mission_state, sub.of("MISSION_ACK")[-1].type) == (2, 0)
    sub.arm()
    assert sub.mode(3) == 0
    sub.pass_s(5.0)
    assert sub.of("MISSION_CURRENT")[-1].mission_state == 5
    assert [m.seq for m in sub.of("MISSION_ITEM_REACHED")] == [1]
    sub.upload([(60.0, 0.0)])
    assert sub.of("MISSION_CURRENT")[-1].mission_state == 2
    assert sub.command(300) == 0
    sub.pass_s(20.0)
    assert sub.position[0] < 1.0, "MISSION_START is acknowledged without effect"
    assert sub.command(224, 1.0, 1.0) == 0
    sub.pass_s(20.0)
    assert sub.of("MISSION_CURRENT")[-1].mission_state == 3
    assert sub.position[0] > 10.0
    sub.upload([(0.0, 80.0)])
    sub.pass_s(20.0)
    assert sub.position[1] > 10.0, "an active mission takes the next one at once"
    assert not sub.of("MISSION_REQUEST_INT")


def test_a_boat_says_that_its_mission_changed():
    boat = Bench(ROVER)
    boat.upload([(100.0, 0.0)])
    boat.arm()
    boat.mode(10)
    boat.pass_s(5.0)
    boat.upload([(100.0, 50.0)])
    assert boat.texts().count((2, "Auto mission changed, restarted command")) == 2


def test_after_a_lost_ground_station_the_sub_surfaces_and_stays_in_alt_hold():
    sub = Bench(guided=True)
    sub.target(0.0, 0.0, 4.0)
    sub.pass_s(30.0)
    sub.beats, lost_s = False, sub.now_s
    sub.pass_s(1.5)
    assert sub.beat == (217, 4, 4)
    sub.pass_s(1.25)
    assert sub.beat == (209, 9, 5)
    assert (4, "MYGCS: 245, heartbeat lost") in sub.texts(lost_s)
    depth_m = sub.depth_m
    sub.pass_s(1.0)
    assert depth_m - sub.depth_m == pytest.approx(1.3, abs=0.25)
    sub.pass_s(5.0)
    assert sub.beat == (209, 2, 5)
    sub.beats = True
    sub.pass_s(5.0)
    assert sub.beat == (209, 2, 4), "it stays there"


def test_a_leak_surfaces_the_sub_too():
    sub = Bench(guided=True)
    sub.target(0.0, 0.0, 4.0)
    sub.pass_s(30.0)
    sub.autopilot.failsafes.leaks = True
    sub.pass_s(0.5)
    assert sub.beat == (209, 9, 4)
    assert (2, "Leak Detected") in sub.texts()
    sub.pass_s(8.0)
    assert sub.beat == (209, 2, 4)


@pytest.mark.parametrize(("personality", "mode"), [(SUB, 9), (ROVER, 4)])
def test_arming_after_the_link_went_silent_does_not_last(personality, mode):
    autopilot = Bench(personality)
    autopilot.pass_s(2.0)
    autopilot.beats = False
    autopilot.pass_s(10.0)
    autopilot.arm()
    autopilot.pass_s(0.5)
    assert autopilot.beat[1] in (mode, personality.hold)


@pytest.mark.parametrize("personality", [SUB, ROVER])
def test_the_simulated_operator_chooses_the_mode_again_after_the_link_was_silent(personality):
    """As people do with a ground station, which a simulated vehicle does not have."""
    autopilot = Bench(personality, operator_mode=personality.guided)
    autopilot.pass_s(5.0)
    assert autopilot.beat[1] == personality.guided
    autopilot.beats = False
    autopilot.pass_s(30.0)
    assert autopilot.beat[1] == personality.hold
    autopilot.beats = True
    autopilot.pass_s(8.0)
    assert autopilot.beat[1] == personality.hold, "the operator needs a moment"
    autopilot.pass_s(4.0)
    assert autopilot.beat[1] == personality.guided
    autopilot.mode(personality.hold)
    autopilot.pass_s(30.0)
    assert autopilot.beat[1] == personality.hold, "chosen by a person, not by a failsafe"


def test_a_ground_station_that_was_never_heard_is_not_missed():
    sub = Bench()
    sub.autopilot.failsafes.boot(sub.now_s)
    sub.beats = False
    sub.arm()
    sub.mode(4)
    sub.pass_s(30.0)
    assert sub.beat == (217, 4, 4)


def test_without_an_origin_there_is_no_position_until_one_is_set():
    sub = Bench(aiding="none", has_origin=False)
    sub.pass_s(3.0)
    assert not sub.of("LOCAL_POSITION_NED")
    assert {(m.lat, m.lon) for m in sub.of("GLOBAL_POSITION_INT")} == {(0, 0)}
    assert {(m.fix_type, m.time_usec) for m in sub.of("GPS_RAW_INT")} == {(0, 0)}
    assert sub.mode(4) != 0
    assert sub.command(512, 49.0) == 0
    assert not sub.of("GPS_GLOBAL_ORIGIN")
    sub.send(mavlink.MAVLink_set_gps_global_origin_message(1, 465000000, 66000000, 0))
    assert sub.texts()[-2:] == [(6, "EKF3 IMU0 origin set"), (6, "EKF3 IMU1 origin set")]
    assert [(m.latitude, m.longitude) for m in sub.of("GPS_GLOBAL_ORIGIN")] == [(465000000, 66000000)]
    sub.pass_s(1.0)
    assert sub.of("LOCAL_POSITION_NED")
    assert sub.mode(4) == 0


def test_while_it_boots_with_gps_it_refuses_an_origin_and_finds_one_itself():
    sub = Bench()
    booted_s = sub.now_s
    sub.autopilot.reboot(booted_s)
    sub.pass_s(2.0)
    sub.send(mavlink.MAVLink_set_gps_global_origin_message(1, 465000000, 66000000, 0))
    assert (4, "EKF3 refusing set origin") in sub.texts(booted_s)
    assert not sub.of("GPS_GLOBAL_ORIGIN", booted_s)
    assert sub.of("ATTITUDE")[-1].time_boot_ms == pytest.approx(2000, abs=300)
    sub.pass_s(18.0)
    assert len(sub.of("GPS_GLOBAL_ORIGIN", booted_s)) == 1
    assert not sub.of("LOCAL_POSITION_NED", booted_s + 0.1)
    sub.pass_s(22.0)
    assert sub.of("LOCAL_POSITION_NED", booted_s + 0.1)


def test_streams_follow_their_rates_and_a_new_rate_counts_after_a_reboot():
    sub = Bench(parameters={"SR0_POSITION": 2.0, "RNGFND1_TYPE": 10.0})
    begin_s = sub.now_s
    sub.pass_s(10.0)
    assert len(sub.of("LOCAL_POSITION_NED", begin_s)) == pytest.approx(20, abs=1)
    silent = ("SCALED_PRESSURE2", "SYS_STATUS", "ATTITUDE", "SYSTEM_TIME", "DISTANCE_SENSOR")
    assert not any(sub.of(kind) for kind in silent)
    for name in (b"SR0_RAW_SENS", b"SR0_EXTRA3"):
        sub.send(mavlink.MAVLink_param_set_message(1, 1, name, 4.0, 4), OPERATOR)
    sub.pass_s(2.0)
    assert not sub.of("SCALED_PRESSURE2")
    sub.autopilot.reboot(sub.now_s)
    sub.pass_s(2.0)
    assert sub.of("SCALED_PRESSURE2")
    assert sub.of("SCALED_PRESSURE3")[-1].press_abs == 0.0
    assert (sub.of("DISTANCE_SENSOR")[-1].max_distance, sub.of("DISTANCE_SENSOR")[-1].current_distance) == (700, 885)
    sub.send(mavlink.MAVLink_param_set_message(1, 1, b"RNGFND1_MAX_CM", 5000.0, 4), OPERATOR)
    sub.pass_s(1.0)
    assert sub.of("DISTANCE_SENSOR")[-1].max_distance == 5000
    sub.autopilot.has_echo, silent_s = False, sub.now_s
    sub.pass_s(2.0)
    assert not sub.of("DISTANCE_SENSOR", silent_s + 0.1)


def test_parameters_have_the_names_and_units_of_the_firmware():
    for renamed, name, value in ((False, b"RNGFND1_MAX_CM", 700.0), (True, b"RNGFND1_MAX", 7.0)):
        sub = Bench(parameters={}, renamed=renamed)
        sub.send(mavlink.MAVLink_param_request_read_message(1, 1, name, -1))
        assert sub.of("PARAM_VALUE")[-1].param_value == pytest.approx(value)
    known = len(sub.of("PARAM_VALUE"))
    sub.send(mavlink.MAVLink_param_request_read_message(1, 1, b"SYSID_MYGCS", -1))
    assert len(sub.of("PARAM_VALUE")) == known, "an unknown name is not answered"
    sub.send(mavlink.MAVLink_param_request_list_message(1, 1))
    listed = sub.of("PARAM_VALUE")[known:]
    assert len(listed) == listed[0].param_count
    assert {"MAV_GCS_SYSID", "WP_SPD", "MAV1_POSITION"} <= {m.param_id for m in listed}


def test_messages_that_nobody_asked_for():
    sub = Bench(feeds=True)
    begin_s = sub.now_s
    sub.pass_s(60.0)
    assert len([m for m in sub.of("TIMESYNC", begin_s) if m.tc1 == 0]) == pytest.approx(6, abs=1)
    assert {m.param_id for m in sub.of("PARAM_VALUE", begin_s)} == {"STAT_RUNTIME", "BARO1_GND_PRESS"}
    assert sub.of("HEARTBEAT", system=250)
    assert sub.of("DISTANCE_SENSOR", system=250)
    elevations = [m for m in sub.of("STATUSTEXT", begin_s) if m.text.startswith("Field Elevation")]
    assert len(elevations) == pytest.approx(60, abs=2)


def test_a_joystick_that_stops_disarms_the_sub_with_its_default_parameters():
    sub = Bench(parameters={"FS_PILOT_INPUT": 2.0})
    sub.arm()
    for _ in range(5):
        sub.send(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0), OPERATOR)
        sub.pass_s(1.0)
    assert sub.beat[0] == 209
    sub.pass_s(3.5)
    assert sub.beat[0] == 81
    assert (2, "Lost manual control") in sub.texts()
