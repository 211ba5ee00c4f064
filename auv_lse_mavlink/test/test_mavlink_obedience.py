"""An autopilot that refuses or ignores its targets, or a stop, for 5 s is reported; one that follows never is."""

import math
import random

import pytest
from pymavlink.dialects.v20 import common as mavlink

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.vocabulary.health import Level
from auv_lse_common.vocabulary.mission_run import Action, Stop
from auv_lse_mavlink.health import link_health
from auv_lse_mavlink.link import VehicleLink
from auv_lse_mavlink.messages.conversion import Target
from auv_lse_mavlink.messages.datum import Origin
from auv_lse_mavlink.messages.events import AutopilotState
from auv_lse_mavlink.targets.limits import TargetLimits

HOLD, SURFACE = Stop(action=Action.HOLD), Stop(action=Action.SURFACE)
FAR = Target(north_m=300.0, east_m=0.0, depth_m=4.0, heading_rad=0.0, step=0)
A = Target(north_m=20.0, east_m=0.0, depth_m=4.0, heading_rad=0.0, step=0)
NOW_S = 1_700_000_000.0
STEP_S = 0.2


class Vehicle:
    """A vehicle that moves as the test says, whatever its link sends; and the link."""

    def __init__(self, radius_m=15.0, **values):
        config = LinkConfig(kind="mavlink", pressure="none", **values)
        self.link = VehicleLink(config, 2, Origin(lat_deg=46.5, lon_deg=6.6), TargetLimits(turn_radius_m=radius_m))
        self.mav, self.reader = mavlink.MAVLink(None, srcSystem=2, srcComponent=1), mavlink.MAVLink(None)
        self.now_s, self.states, self.boot_ms = NOW_S, [], 5000
        self.mode = 3 if config.mode == "mission" else 4  # ArduSub: AUTO, GUIDED
        self.position, self.yaw = [0.0, 0.0, 4.0], 0.0
        self.beat()
        self.say(mavlink.MAVLink_gps_global_origin_message(465000000, 66000000, 0, 0))

    def say(self, message):
        self.link.receive(self.now_s, message.pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256

    def beat(self):
        flags = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        self.say(mavlink.MAVLink_heartbeat_message(12, 3, flags, self.mode, mavlink.MAV_STATE_ACTIVE, 3))

    def at(self, north, east, depth, yaw, speed):
        self.say(mavlink.MAVLink_attitude_message(self.boot_ms, 0, 0, yaw, 0, 0, 0))
        velocity = speed * math.cos(yaw), speed * math.sin(yaw), 0
        self.say(mavlink.MAVLink_local_position_ned_message(self.boot_ms, north, east, depth, *velocity))

    def move(self, seconds, speed=1.5, yaw_rate=0.0, sink=0.0, jitter_m=0.0, answer=lambda: None):
        rng = random.Random(1)
        for number in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            self.boot_ms += round(1000.0 * STEP_S)
            self.yaw += yaw_rate * STEP_S
            self.position[0] += speed * math.cos(self.yaw) * STEP_S
            self.position[1] += speed * math.sin(self.yaw) * STEP_S
            self.position[2] = max(0.0, self.position[2] + sink * STEP_S)
            if number % 5 == 0:
                self.beat()
            self.at(
                *(x + rng.gauss(0.0, jitter_m) for x in self.position), math.remainder(self.yaw, 2.0 * math.pi), speed
            )
            self.link.poll(self.now_s)
            self.states += [event for event in self.link.events() if isinstance(event, AutopilotState)]
            answer()
        return self

    def wait(self, seconds, beat=True):
        for _ in range(round(seconds)):
            self.now_s += 1.0
            if beat:
                self.beat()
            self.link.poll(self.now_s)

    def heard(self, *kinds):
        messages = [m for datagram in self.link.outgoing() for m in self.reader.parse_buffer(datagram)]
        return [m for m in messages if m.get_type() in kinds]

    @property
    def problem(self):
        return self.link.report.disobeys

    @property
    def level(self):
        return link_health(self.link, "").level

    def commanded(self, target=FAR):
        self.link.command(self.now_s, target)
        return self


def held(**values):
    vehicle = Vehicle(**values).commanded().move(3.0)
    vehicle.link.stop(vehicle.now_s, HOLD)
    return vehicle


@pytest.mark.parametrize(
    ("how", "motion"),
    [
        ("stands", {"speed": 0.0, "yaw": 1.0}),
        ("stands in waves", {"speed": 0.02, "jitter_m": 0.05, "yaw": 1.0}),
        ("goes elsewhere", {"speed": 1.5, "yaw": 2.0}),
        ("passes abeam", {"speed": 1.5, "yaw": math.pi / 2}),
    ],
)
def test_ignored_targets_are_a_warning_after_5_s_then_an_error(how, motion):
    vehicle = Vehicle().commanded()
    vehicle.yaw = motion.pop("yaw", 0.0)
    vehicle.move(4.0, **motion)
    assert (vehicle.problem, vehicle.level) == ("", Level.OK), how
    vehicle.move(3.0, **motion)
    assert "the autopilot ignores its target for" in vehicle.problem
    assert vehicle.level is Level.WARN
    assert vehicle.states[-1].report.disobeys, "safety_node hears it at once"
    vehicle.move(5.0, **motion)
    assert vehicle.level is Level.ERROR
    vehicle.yaw = math.atan2(-vehicle.position[1], 300.0 - vehicle.position[0])
    vehicle.move(1.0)
    assert (vehicle.problem, vehicle.level) == ("", Level.OK)
    assert vehicle.states[-1].report.disobeys == ""
    assert vehicle.link.counts["disobeyed"] == 1


@pytest.mark.parametrize("speed", [0.0, -0.3])
def test_a_vehicle_that_heads_for_its_target_against_a_current_is_slow_at_first(speed):
    vehicle = Vehicle().commanded().move(2.0)
    vehicle.move(25.0, speed)
    assert (vehicle.problem, vehicle.level) == ("", Level.WARN)
    assert "no progress towards the target for" in link_health(vehicle.link, "").text
    vehicle.move(15.0, speed)
    assert "the autopilot ignores its target" in vehicle.problem
    assert "no progress" not in link_health(vehicle.link, "").text
    vehicle.move(10.0)
    assert (vehicle.problem, vehicle.level) == ("", Level.OK)


def test_slow_progress_is_no_disobedience():
    vehicle = Vehicle().commanded().move(2.0)
    for _ in range(100):
        assert vehicle.move(1.0, 0.02).problem == ""
    assert vehicle.level is Level.WARN


@pytest.mark.parametrize("speed", [0.3, 1.5, 3.0])
@pytest.mark.parametrize("radius_m", [2.0, 15.0, 40.0])
def test_a_vehicle_that_turns_to_its_target_follows_it(speed, radius_m):
    vehicle = Vehicle(radius_m=radius_m).commanded()
    vehicle.yaw = 0.9 * math.pi  # away from it
    turn_s = 0.9 * math.pi * radius_m / speed
    for _ in range(min(math.ceil(turn_s), 60)):
        vehicle.move(1.0, speed, -speed / radius_m)
        assert vehicle.problem == ""


@pytest.mark.parametrize(("speed", "ignores"), [(1.5, False), (0.5, False), (0.0, True)])
def test_a_jump_of_the_estimate_away_from_the_target_is_no_disobedience(speed, ignores):
    vehicle = Vehicle().commanded().move(4.0)
    vehicle.position[0] -= 30.0
    vehicle.yaw = math.pi if ignores else 0.0
    problems = [vehicle.move(1.0, speed).problem for _ in range(20)]
    assert any(problems) == ignores, problems


def test_a_jump_of_the_estimate_is_no_progress():
    vehicle = Vehicle().commanded().move(1.0)
    vehicle.yaw = math.pi
    for _ in range(3):
        vehicle.position[0] += 30.0
        vehicle.move(2.0, 0.0)
    assert "ignores its target" in vehicle.problem


def test_circling_at_the_end_of_a_leg_is_not_reported_as_disobedience():
    vehicle = Vehicle().commanded(A)
    vehicle.move(60.0, 1.5, 0.1)
    assert vehicle.problem == ""


@pytest.mark.parametrize("how", ["stands", "circles", "brakes", "drifts back"])
def test_a_stop_that_is_obeyed(how):
    vehicle = held()
    if how == "brakes":
        for tenth in range(14, 0, -2):
            vehicle.move(0.6, tenth / 10.0)
    if how == "drifts back":
        vehicle.move(3.0, 1.5)
        vehicle.yaw = math.pi
        vehicle.move(4.0, 0.5)
    for _ in range(30):
        vehicle.move(1.0, *((1.5, 0.1) if how == "circles" else (0.0, 0.0)), jitter_m=0.02)
        assert vehicle.problem == "", how


@pytest.mark.parametrize("motion", [(1.5, 0.0), (0.5, 0.0), (1.5, 0.01)])
def test_an_ignored_stop_is_reported_after_5_s(motion):
    vehicle = held().move(4.0, *motion)
    assert vehicle.problem == ""
    vehicle.move(2.0, *motion)
    assert "the autopilot ignores the stop for" in vehicle.problem
    assert f"{motion[0]} m/s" in vehicle.problem


def test_a_vehicle_that_turns_far_from_the_position_of_a_stop_ignores_it():
    vehicle = held()
    for _ in range(20):  # a mission of its own, with turns
        vehicle.move(4.0).move(1.0, 1.5, 0.4)
        vehicle.yaw = 0.0
    assert "ignores the stop" in vehicle.problem


@pytest.mark.parametrize(("sink", "ignored"), [(-0.1, False), (0.0, True), (0.1, True)])
def test_a_vehicle_that_does_not_rise_ignores_surface(sink, ignored):
    vehicle = Vehicle().commanded().move(3.0)
    vehicle.link.stop(vehicle.now_s, SURFACE)
    vehicle.move(7.0, sink=sink)
    assert ("the autopilot does not surface: at" in vehicle.problem) == ignored
    vehicle.move(40.0, sink=-0.1)
    vehicle.move(60.0, 0.3)  # it drifts at the surface
    assert vehicle.problem == ""


def test_a_pilot_who_takes_over_is_no_disobedience_but_a_warning():
    vehicle = Vehicle().commanded()
    vehicle.mode, vehicle.yaw = 19, math.pi
    vehicle.move(20.0)
    assert vehicle.problem == ""
    text = link_health(vehicle.link, "").text
    assert text == "armed; mode 19 instead of 4 (link.modes); it follows no targets"
    assert vehicle.level is Level.WARN


def test_no_disobedience_is_reported_while_the_autopilot_is_silent_or_has_no_target():
    vehicle = Vehicle()
    vehicle.move(20.0, 0.0)
    assert vehicle.problem == ""
    vehicle.commanded().move(3.0, 0.0)
    vehicle.wait(8.0)  # heartbeats without positions
    assert vehicle.problem == ""
    vehicle.wait(8.0, beat=False)
    assert (vehicle.problem, vehicle.link.report.heard) == ("", False)


@pytest.mark.parametrize("result", [mavlink.MAV_MISSION_DENIED, None])
def test_refused_and_unanswered_missions_are_reported_after_5_s(result):
    vehicle = Vehicle(mode="mission").commanded()

    def answer():
        for _ in vehicle.heard("MISSION_COUNT"):
            if result is not None:
                vehicle.say(mavlink.MAVLink_mission_request_int_message(245, 191, 0, 0))
                vehicle.say(mavlink.MAVLink_mission_ack_message(245, 191, result, 0))

    vehicle.move(4.6, 0.0, answer=answer)
    assert vehicle.problem == ""
    vehicle.move(2.0, 0.0, answer=answer)
    why = "no answer" if result is None else "the autopilot refused the mission: MAV_MISSION_DENIED"
    assert vehicle.problem.startswith("the autopilot takes no mission for")
    assert vehicle.problem.endswith(why)
    assert vehicle.level is Level.WARN
    vehicle.move(5.0, 0.0, answer=answer)
    assert vehicle.level is Level.ERROR


def test_a_mission_that_takes_long_to_upload_is_not_refused():
    vehicle = Vehicle(mode="mission")
    vehicle.link.stop(NOW_S, HOLD)
    for step in range(40):
        vehicle.commanded(Target(north_m=20.0 * step + 20.0, east_m=0.0, depth_m=4.0, heading_rad=0.0, step=step))
    vehicle.link.stop(NOW_S, None)

    def request(number):
        vehicle.say(mavlink.MAVLink_mission_request_int_message(245, 191, number, 0))
        return vehicle.move(STEP_S, 0.5)

    assert [request(number).problem for number in range(40)] == [""] * 40
    assert "takes no mission" in [request(39) for _ in range(40)][-1].problem, "it asks for the same item forever"


def test_a_refused_speed_is_a_warning():
    vehicle = Vehicle().commanded()
    for result, level in ((mavlink.MAV_RESULT_DENIED, Level.WARN), (mavlink.MAV_RESULT_ACCEPTED, Level.OK)):
        vehicle.say(mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_DO_CHANGE_SPEED, result))
        assert vehicle.level is level
        text = link_health(vehicle.link, "").text
        assert ("it refused the speed: MAV_RESULT_DENIED" in text) == (level is Level.WARN)
    assert vehicle.link.counts["speeds_refused"] == 1
    assert vehicle.problem == ""


def test_setting_the_host_clock_is_not_reported_as_disobedience():
    vehicle = Vehicle()
    vehicle.yaw = math.pi
    vehicle.commanded().move(4.0, 0.0)
    vehicle.now_s -= 3600.0
    vehicle.move(0.5, 0.0)
    assert vehicle.problem == ""
    vehicle.move(3.0, 0.0)
    assert vehicle.problem
