"""The link against a model of ArduSub, which restarts its trajectory from rest on each position target."""

import dataclasses
import itertools
import math

import pytest
from ardusub_model import AUTO, GUIDED, MANUAL, NOW_S, STEP_S, SURFACE, ArduSub
from pymavlink.dialects.v20 import common as mavlink

from auv_lse_common.vocabulary.mission_run import Action, Stop
from auv_lse_mavlink.messages.conversion import Target
from auv_lse_mavlink.messages.datum import Origin

HOLD, RISE = Stop(action=Action.HOLD), Stop(action=Action.SURFACE)
FAR = Target(north_m=60.0, east_m=0.0, depth_m=3.0, heading_rad=0.0, speed_mps=1.0)
#: Mean speed (m/s) of ArduSub 4.5-dev over 60 m at 1 m/s, by the period (s) at which its target was repeated.
MEASURED_MPS = {0.2: 0.02, 0.5: 0.13, 1.0: 0.32, 2.0: 0.62, 5.0: 0.84, 10.0: 0.87, math.inf: 0.86}


def under_way(depth_m=3.0, target=FAR, **values):
    sub = ArduSub(**values)
    sub.position[2] = depth_m
    sub.ready()
    sub.link.command(sub.now_s, target)
    sub.run(5.0)
    return sub


def mean_mps(sub, seconds=30.0):
    before = list(sub.position)
    took_s = sub.run(seconds)
    return math.dist(before, sub.position) / took_s


@pytest.mark.parametrize("period_s", MEASURED_MPS)
def test_the_model_is_as_slow_as_ardusub(period_s):
    sub = ArduSub(link=False).ready()
    sub.position = [0.0, 0.0, 3.0]
    due_s, began_s = sub.now_s, sub.now_s
    for _ in range(400):
        if sub.now_s >= due_s - 1e-6:
            due_s += period_s
            sub.go([60.0, 0.0, 3.0])
        sub.run(STEP_S)
    assert sub.position[0] / (sub.now_s - began_s) == pytest.approx(MEASURED_MPS[period_s], abs=0.09)


def test_an_ardusub_travels_at_its_speed():
    sub = under_way()
    assert mean_mps(sub) >= 0.8
    assert len(sub.targets()) == 1


def test_px4_gets_its_target_again_at_more_than_2_hz():
    sub = ArduSub(autopilot=mavlink.MAV_AUTOPILOT_PX4)
    sub.mode = 6 << 16
    sub.arm()
    sub.run(1.0)
    sub.link.command(sub.now_s, FAR)
    sub.run(10.0)
    times = [t for t, _ in sub.targets()]
    assert max(b - a for a, b in itertools.pairwise(times)) < 0.5


def test_a_hold_stops_and_a_surface_target_surfaces():
    sub = under_way()
    sub.link.stop(sub.now_s, HOLD)
    sub.run(10.0)
    stopped = list(sub.position)
    sub.run(10.0)
    assert math.dist(stopped, sub.position) < 0.1
    assert sub.position[2] == pytest.approx(3.0, abs=0.1)
    sub.link.stop(sub.now_s, RISE)
    assert sub.run(25.0, until=lambda: sub.position[2] < 0.2) < 10.0


@pytest.mark.parametrize("how", ["mode", "arming", "reboot", "link lost"])
def test_an_autopilot_that_forgets_target_and_speed_gets_both_again(how):
    sub = under_way(target=dataclasses.replace(FAR, speed_mps=0.7))
    since_s = sub.elapsed_s
    if how == "mode":
        sub.enter(MANUAL)
        sub.run(5.0)
        sub.enter(GUIDED)
    elif how == "arming":
        sub.arm(False)
        sub.run(5.0)
        sub.arm()
    elif how == "reboot":
        sub.reboot()
        sub.run(5.0)
        sub.arm().enter(GUIDED)
    else:
        sub.silent = True
        sub.run(10.0)
        sub.silent = False
        sub.run(1.0)
    sub.run(3.0)
    assert len(sub.targets(since_s)) == 1
    assert sub.speeds(since_s) == [0.7]
    assert mean_mps(sub) == pytest.approx(0.7 * 0.88, abs=0.05)


def test_while_it_cannot_follow_it_gets_no_target():
    sub = under_way()
    sub.arm(False)
    since_s = sub.elapsed_s
    sub.link.command(sub.now_s, dataclasses.replace(FAR, east_m=30.0))
    sub.run(10.0)
    assert sub.targets(since_s) == []
    assert sub.link.quiet, "a lockstep tick may end: nothing is to be sent now"
    sub.arm()
    sub.run(1.0)
    assert [position for _, position in sub.targets(since_s)] == [(60.0, 30.0, 3.0)]


@pytest.mark.parametrize(("feedback", "within_s"), [(True, 8.0), (False, 12.0)])
def test_a_target_that_it_has_evidently_forgotten_is_sent_again(feedback, within_s):
    sub = under_way(feedback=feedback)
    sub.forget()
    since_s = sub.elapsed_s
    assert sub.run(20.0, until=lambda: sub.target is not None) <= within_s
    assert len(sub.targets(since_s)) == 1
    assert sub.speeds(since_s) == [1.0]
    assert mean_mps(sub) >= 0.8


def test_one_that_never_follows_gets_it_ever_more_rarely():
    sub = ArduSub().ready()
    sub.deaf = True
    sub.link.command(sub.now_s, FAR)
    sub.run(300.0)
    times = [t for t, _ in sub.targets()]
    gaps = [b - a for a, b in itertools.pairwise(times)]
    assert gaps[:4] == pytest.approx([5.0, 10.0, 20.0, 40.0], abs=1.5)
    assert gaps[4:] == pytest.approx([60.0] * len(gaps[4:]), abs=1.5)


def test_one_that_knows_its_target_and_hardly_moves_is_not_restarted():
    """In a strong head current it is wp_dist that says whether the target is known."""
    sub = under_way()
    sub.move = lambda: None
    since_s = sub.elapsed_s
    sub.run(60.0)
    assert sub.targets(since_s) == []
    assert "not coming nearer" in sub.link.report.disobeys


def test_a_slow_drift_of_its_datum_does_not_restart_its_trajectory():
    sub = under_way(depth_m=3.0, pressure="SCALED_PRESSURE2")
    sub.link.gauge.restore(101325.0)
    sub.run(5.0)
    since_s = sub.elapsed_s
    for _ in range(300):
        sub.position[2] += 0.0005
        sub.run(STEP_S)
    assert len(sub.targets(since_s)) <= 1


def test_an_origin_that_moves_moves_the_target_with_it():
    sub = under_way()
    since_s = sub.elapsed_s
    sub.own_origin = Origin(lat_deg=46.5 + 30.0 / 111165.0, lon_deg=6.6)
    sub.go([60.0, 30.0, 3.0])  # it misunderstands its target
    sub.say_origin()
    sub.run(2.0)
    ((_, position),) = sub.targets(since_s)
    assert position == pytest.approx((30.0, 0.0, 3.0), abs=0.1)
    sub.run(80.0)
    assert sub.position == pytest.approx([60.0, 0.0, 3.0], abs=1.0)


def test_an_origin_that_moves_in_silence_is_noticed_and_asked_for():
    sub = under_way()
    sub.own_origin = Origin(lat_deg=46.5 + 30.0 / 111165.0, lon_deg=6.6)
    since_s = sub.elapsed_s
    sub.run(10.0)
    requests = [m for t, m in sub.received if t > since_s and m.get_type() == "COMMAND_LONG" and m.command == 512]
    assert requests
    sub.run(60.0)
    assert sub.position == pytest.approx([60.0, 0.0, 3.0], abs=1.0)
    assert sub.link.report.disobeys == ""


def test_positions_that_contradict_each_other_are_a_reason_to_hold():
    sub = under_way()
    sub.say_origin = lambda: None  # its answers are lost
    sub.own_origin = Origin(lat_deg=46.5 + 30.0 / 111165.0, lon_deg=6.6)
    sub.run(20.0)
    assert "30.0 m apart" in sub.link.report.disobeys


@pytest.mark.parametrize("how", ["reboot", "another origin"])
@pytest.mark.parametrize("begun", [True, False])
def test_without_a_mission_origin_a_frame_that_moves_ends_the_travel(how, begun):
    sub = ArduSub(origin=None).ready()
    if begun:
        sub.link.command(sub.now_s, FAR)
    sub.run(5.0)
    since_s = sub.elapsed_s
    if how == "reboot":
        sub.reboot()
    else:
        sub.own_origin = Origin(lat_deg=46.501, lon_deg=6.6)
        sub.say_origin()
    sub.run(2.0)
    sub.arm().enter(GUIDED)
    sub.run(5.0)
    assert ("may have moved" in sub.link.report.disobeys) == begun
    assert sub.targets(since_s) == []


# ------------------------------------------------------------------ after the end


@pytest.mark.parametrize("how", ["reboot", "mode", "arming"])
@pytest.mark.parametrize("end", [HOLD, RISE, Stop(action=Action.GO_TO, position_m=(20.0, 10.0))])
def test_nothing_moves_after_the_end(end, how):
    sub = under_way(target=dataclasses.replace(FAR, north_m=20.0, then=end))
    sub.run(60.0)
    ended = list(sub.position)
    sub.position[0] -= 100.0  # towed home
    if how == "reboot":
        sub.reboot()
    sub.arm(False).enter(MANUAL)
    sub.run(10.0)
    home = list(sub.position)
    sub.arm().enter(GUIDED)
    sub.run(30.0)
    assert ended[:2] == pytest.approx([20.0, 10.0 if end.action is Action.GO_TO else 0.0], abs=4.5)
    assert math.dist(home, sub.position) < 0.5


@pytest.mark.parametrize("stop", [HOLD, RISE])
def test_nothing_moves_after_a_surfacing_or_a_hold(stop):
    sub = under_way()
    sub.link.stop(sub.now_s, stop)
    sub.run(30.0)
    sub.reboot()
    sub.position = [-50.0, 20.0, 0.0]  # recovered, and launched again elsewhere
    sub.run(5.0)
    sub.arm().enter(GUIDED)
    sub.run(30.0)
    assert sub.position == pytest.approx([-50.0, 20.0, 0.0], abs=0.5)


def test_a_vehicle_that_reboots_while_it_rises_goes_on_rising():
    sub = under_way(depth_m=30.0, target=dataclasses.replace(FAR, depth_m=30.0))
    sub.link.stop(sub.now_s, RISE)
    sub.run(5.0)
    sub.reboot().arm().enter(GUIDED)
    assert sub.position[2] > 20.0
    sub.run(60.0)
    assert sub.position[2] < 0.3


def recovering(**values):
    """An ArduSub on its way to a recovery position after its mission's end."""
    end = Stop(action=Action.GO_TO, position_m=(200.0, 0.0))
    sub = under_way(target=dataclasses.replace(FAR, north_m=20.0, then=end), **values)
    sub.run(40.0)
    sub.link.stop(sub.now_s, None, ended=True)
    sub.run(10.0)
    assert 22.0 < sub.position[0] < 150.0
    return sub


@pytest.mark.parametrize("how", ["reboot", "arming"])
def test_on_the_way_to_recovery_a_handled_vehicle_surfaces_where_it_is(how):
    sub = recovering()
    if how == "reboot":
        sub.reboot()
    sub.arm(False).enter(MANUAL)
    sub.run(5.0)
    found = list(sub.position)
    sub.arm().enter(GUIDED)
    sub.run(30.0)
    assert sub.position == pytest.approx([*found[:2], 0.0], abs=0.3)
    assert any("on the vehicle's way after its mission" in text for text in sub.problems())
    sub.link.stop(sub.now_s, Stop(action=Action.GO_TO, position_m=(200.0, 0.0)))  # the operator's ABORT
    sub.run(20.0)
    assert sub.position[0] > found[0] + 10.0


@pytest.mark.parametrize("how", ["mode", "link lost"])
def test_on_the_way_to_recovery_a_pilot_or_a_gap_only_interrupts(how):
    sub = recovering()
    if how == "mode":
        sub.enter(MANUAL)
        sub.run(5.0)
        sub.enter(GUIDED)
    else:
        sub.silent = True
        sub.run(10.0)
        sub.silent = False
    before = list(sub.position)
    sub.run(20.0)
    assert sub.position[0] > before[0] + 10.0


@pytest.mark.parametrize("surfacing", ["stop", "for a fix"])
def test_the_way_to_the_surface_is_vertical_also_after_a_drift(surfacing):
    target = dataclasses.replace(FAR, north_m=15.0, depth_m=20.0, surface=surfacing != "stop")
    sub = under_way(depth_m=20.0, target=target)
    if surfacing == "stop":
        sub.link.stop(sub.now_s, RISE)
    sub.run(20.0, until=lambda: sub.position[2] < 18.0)
    sub.enter(MANUAL)
    sub.position[1] += 30.0  # it drifts while a pilot has it
    sub.run(5.0)
    sub.enter(GUIDED)
    sub.run(1.0)
    rising = []
    while sub.position[2] > 0.5:
        sub.run(1.0)
        rising.append(list(sub.position[:2]))
    assert max(math.dist(rising[0], place) for place in rising) < 0.3
    assert sub.position[1] > 29.0


# ------------------------------------------------------------------ missions


def test_a_completed_mission_is_restarted():
    """While a vehicle waits for GO it is sent a mission that holds; it is complete at once."""
    sub = ArduSub(mode="mission")
    sub.position[2] = 3.0
    sub.run(1.0)
    sub.say_origin()
    sub.link.stop(sub.now_s, HOLD)
    sub.run(3.0)
    sub.arm().enter(AUTO)
    sub.run(10.0)
    assert sub.mission_state == 5, "it holds, and its mission is complete"
    sub.link.command(sub.now_s, FAR)
    sub.link.stop(sub.now_s, None)
    assert mean_mps(sub) >= 0.7
    assert sub.link.quiet


def test_in_a_mission_the_speed_follows_the_mode():
    sub = ArduSub(mode="mission").ready(AUTO)
    sub.position[2] = 3.0
    sub.link.command(sub.now_s, dataclasses.replace(FAR, north_m=100.0, speed_mps=0.5))
    sub.run(10.0)
    for _ in range(2):
        sub.enter(MANUAL)
        sub.run(3.0)
        sub.enter(AUTO)
        sub.run(5.0)
        assert mean_mps(sub, 10.0) == pytest.approx(0.5 * 0.88, abs=0.05)


def test_an_older_autopilot_without_the_command_gets_the_current_item():
    sub = ArduSub(mode="mission").ready(AUTO)
    sub.on_command_long = lambda message: sub.say(mavlink.MAVLink_command_ack_message(message.command, 3))
    sub.link.command(sub.now_s, FAR)
    sub.run(3.0)
    assert [m.seq for _, m in sub.received if m.get_type() == "MISSION_SET_CURRENT"] == [1]


def test_a_restarted_command_is_no_warning():
    sub = ArduSub().ready()
    sub.say(mavlink.MAVLink_statustext_message(4, b"Auto mission changed, restarted command"))
    assert sub.problems() == []
    sub.say(mavlink.MAVLink_statustext_message(4, b"GCS Failsafe"))
    assert sub.problems() == ["autopilot: GCS Failsafe"]


def test_a_gps_vehicle_that_boots_is_not_asked_every_2_s_to_take_an_origin():
    sub = ArduSub()
    sub.say_origin = lambda: None

    def refuse(message):
        sub.say(mavlink.MAVLink_statustext_message(4, b"EKF3 refusing set origin"))

    sub.on_set_gps_global_origin = refuse
    sub.run(60.0)
    sent = [m for _, m in sub.received if m.get_type() == "SET_GPS_GLOBAL_ORIGIN"]
    assert 1 <= len(sent) <= 3
    assert len([text for text in sub.problems() if "refusing set origin" in text]) == 1


def test_a_failsafe_that_surfaces_is_followed_by_the_leg_again():
    sub = under_way()
    sub.enter(SURFACE)
    sub.run(10.0)
    since_s = sub.elapsed_s
    assert sub.position[2] == 0.0
    sub.enter(GUIDED)
    sub.run(30.0)
    assert [position for _, position in sub.targets(since_s)] == [pytest.approx((60.0, 0.0, 3.0), abs=0.01)]
    assert sub.now_s > NOW_S
