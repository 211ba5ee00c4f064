"""The link hears what a real ArduPilot sent in its simulator, and is commanded what it was commanded then."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink
from recordings import recording

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.safety.fence import Fence
from auv_lse_common.safety.watch import SafetyWatch
from auv_lse_common.vocabulary.mission_run import Action, Command, MissionRun, Stop
from auv_lse_mavlink.autopilot_check import AutopilotCheck
from auv_lse_mavlink.link import VehicleLink
from auv_lse_mavlink.messages import events
from auv_lse_mavlink.messages.conversion import Target
from auv_lse_mavlink.messages.datum import Origin

ORIGIN = Origin(lat_deg=46.5, lon_deg=6.6)
OWN = (465002698, 66003907)  # 1e-7 deg: 30 m north and east of it
POLL_S = 0.1
POSITION = "SET_POSITION_TARGET_LOCAL_NED"


def without_gaps(rows):
    """Time since the begin, time, packet of each message; in between at least every `POLL_S`, without a packet."""
    last_s = 0.0
    for elapsed_s, now_s, packet, _ in rows:
        while elapsed_s - last_s > POLL_S:
            last_s += POLL_S
            yield last_s, now_s - elapsed_s + last_s, b""
        last_s = elapsed_s
        yield elapsed_s, now_s, packet


class Replay:
    """A link that hears a recording, and before it the origin that the autopilot of most recordings had.

    Attributes:
        sent: What it sent: time (s), message.
        reported: Its events, each with its time (s).
    """

    def __init__(self, name, command=lambda replay, now_s: None, silent_s=(0.0, 0.0), **values):
        self.link = VehicleLink(LinkConfig(kind="mavlink", **values), 1, ORIGIN)
        self.link.gauge.restore(101325.0)
        self.sent, self.reported, self.position = [], [], None
        reader = mavlink.MAVLink(None)
        reader.robust_parsing = True
        writer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.link.receive(recording(name)[0][1], mavlink.MAVLink_gps_global_origin_message(*OWN, 0, 0).pack(writer))
        for elapsed_s, now_s, packet in without_gaps(recording(name)):
            self.now_s, self.elapsed_s = now_s, elapsed_s
            command(self, elapsed_s)
            if packet and not silent_s[0] < elapsed_s < silent_s[1]:
                self.link.receive(now_s, packet)
            self.link.poll(now_s)
            self.sent += [
                (elapsed_s, message) for data in self.link.outgoing() for message in reader.parse_buffer(data) or ()
            ]
            for event in self.link.events():
                self.reported.append((elapsed_s, event))
                self.position = event if isinstance(event, events.AutopilotEstimate) else self.position

    def of(self, kind):
        return [(t, m) for t, m in self.sent if m.get_type() == kind]

    def targets(self):
        datum = self.link.datum
        return [(t, *datum.from_local_ned(m.x, m.y), m.z) for t, m in self.of(POSITION)]

    def speeds(self):
        return [(t, round(m.param2, 2)) for t, m in self.of("COMMAND_LONG") if m.command == 178]

    def problems(self):
        return [(round(t), event.text) for t, event in self.reported if isinstance(event, events.Problem)]


def legs(name, speed_mps, origin=ORIGIN):
    """Commands the targets of a recording, in the mission's frame, when they were first sent."""
    began_s = recording(name)[0][1]
    due, last = [], None
    for _, now_s, _, message in recording(name, "to_ap"):
        if message.get_type() == POSITION and (last is None or math.dist(last, (message.x, message.y)) > 1.0):
            last = message.x, message.y
            due.append((now_s - began_s, message))

    def command(replay, elapsed_s):
        while due and elapsed_s >= due[0][0] and replay.link.placed:
            message = due.pop(0)[1]
            north_m, east_m = replay.link.datum.from_local_ned(message.x, message.y)
            target = Target(
                north_m=north_m, east_m=east_m, depth_m=message.z, heading_rad=message.yaw, speed_mps=speed_mps,
                step=replay.link.counts["targets"], begins_m=(math.inf, math.inf),
            )  # fmt: skip
            replay.link.command(replay.now_s, target)

    return command


@pytest.mark.parametrize("name", ["sub45_send_once", "rover46_boat", "sub45_mission_gps_10s_period"])
def test_wp_dist_confirms_targets_that_are_followed(name):
    replay = Replay(name, legs(name, 0.7), pressure="none" if "rover" in name else "SCALED_PRESSURE2")
    assert len(replay.targets()) >= 3
    assert replay.link.counts["targets_forgotten"] == 0
    assert [text for _, text in replay.problems() if "ignores" in text] == []


def test_an_ardusub_that_was_slowed_by_repeated_targets_gets_each_once():
    name = "sub45_legs_5hz_repeat"
    replay = Replay(name, legs(name, math.nan), pressure="none")
    assert len(replay.targets()) == 1
    assert len([m for *_, m in recording(name, "to_ap") if m.get_type() == POSITION]) > 200


def test_target_and_speed_follow_mode_and_arming():
    """MANUAL at 98 s, GUIDED at 104 s; disarmed at 114 s, armed at 119 s of this recording."""
    replay = Replay("sub45_send_once", legs("sub45_send_once", 0.7))
    assert [speed for _, speed in replay.speeds()] == [0.7, 0.7, 0.7]
    for resent_s, (at_s, _) in zip((106.3, 121.6), replay.speeds()[1:], strict=True):
        assert at_s == pytest.approx(resent_s, abs=0.5)
        assert [t for t, *_ in replay.targets() if abs(t - at_s) < 0.05]


def test_after_the_end_a_restarted_autopilot_is_not_sent_away():
    """It had ended its mission 90 m away, was restarted at 14 s, and was armed and set to GUIDED at 67 s."""
    end = Target(north_m=17.8, east_m=119.0, depth_m=0.2, heading_rad=0.0, speed_mps=0.7, then=Stop(action=Action.HOLD))

    def command(replay, elapsed_s):
        if elapsed_s > 1.0 and not replay.link.counts["targets"]:
            replay.link.command(replay.now_s, end)

    replay = Replay("sub45_restart", command)
    assert replay.position is not None
    here = replay.position.north_m, replay.position.east_m
    assert math.dist(here, (17.8, 119.0)) > 60.0, "another link drove it there"
    ((_, *first, _), *later) = [row for row in replay.targets() if row[0] > 20.0]
    assert math.dist(first, (30.0, 30.0)) < 0.5, "where it stood"
    assert all(math.dist(position, (30.0, 30.0)) < 0.5 for _, *position, _ in later)


@pytest.mark.parametrize("link_age_s", [20.0, 30.0])
def test_30_s_without_link_are_one_loss_with_one_limit(link_age_s):
    """The stack heard nothing from 138 s to 168 s of this recording, which another listener made."""
    name = "sub45_mode_change_disarm_linkdrop"
    watch = SafetyWatch(
        SafetyConfig(link_age_s=link_age_s),
        Fence((-1e3, -1e3, 1e3, -1e3, 1e3, 1e3, -1e3, 1e3), 0.0),
        50.0,
        has_autopilot=True,
    )
    run = MissionRun(at_once=True, on_abort=Stop(action=Action.SURFACE))
    run.command(Command.GO, "test")
    seen, stepped_s = [], 0.0

    def step(replay, elapsed_s):
        nonlocal stepped_s
        for _, event in replay.reported[len(seen) :]:
            seen.append(event)
            if isinstance(event, events.AutopilotState):
                watch.autopilot(event.report)
            elif isinstance(event, events.AutopilotEstimate):
                here = event.north_m, event.east_m, event.depth_m
                watch.odometry(event.stamp_s, event.heading_rad, *here, event.speed_mps)
        if replay.now_s - stepped_s >= 0.1:
            stepped_s = replay.now_s
            watch.step(replay.now_s, run)

    Replay(name, step, silent_s=(138.0, 168.0))
    assert set(run.limits) == ({"link"} if link_age_s == 20.0 else set())


def test_a_mission_that_is_complete_is_restarted_until_it_is_active():
    """MISSION_SET_CURRENT left it at state 2; somebody's command 224 made it 3 at 108 s."""

    def command(replay, elapsed_s):
        if elapsed_s > 9.5 and not replay.link.targets:
            replay.link.command(
                replay.now_s, Target(north_m=0.0, east_m=0.0, depth_m=0.0, heading_rad=0.0, speed_mps=0.7)
            )
        elif elapsed_s > 37.5 and len(replay.link.targets) < 2:
            replay.link.command(
                replay.now_s, Target(north_m=-50.0, east_m=70.0, depth_m=3.0, heading_rad=0.0, speed_mps=0.7, step=1)
            )

    replay = Replay("sub45_auto_mission", command, mode="mission", pressure="none")
    restarts = [(t, m.param1, m.param2) for t, m in replay.of("COMMAND_LONG") if m.command == 224]
    assert replay.of("MISSION_SET_CURRENT") == []
    assert {(item, reset) for _, item, reset in restarts} == {(1.0, 1.0)}
    assert restarts[0][0] < 12.0
    waited = [t for t, *_ in restarts if 38.0 < t < 108.0]
    assert len(waited) > 3, "it is not content with state 2"
    assert [m.seq for t, m in replay.of("MISSION_ITEM_INT") if t < 12.0] == [0, 1], "asked for with MISSION_REQUEST"


def checked(name, until_s=60.0, **values):
    """The findings of autopilot-check while it hears a recording: whether it is right, by text."""
    check = AutopilotCheck(LinkConfig(kind="mavlink", **values), 1)
    for elapsed_s, now_s, packet in without_gaps(recording(name)):
        if elapsed_s > until_s:
            break
        check.receive(now_s, packet)
    return {finding.text: finding.ok for finding in check.findings()}


def test_the_check_names_the_parameters_of_an_ardusub_with_defaults():
    """SRn are 0: heartbeats and little else arrive."""
    found = checked("sub45_defaults_no_streams")
    missing = [text for text, ok in found.items() if ok is False]
    for words in ("LOCAL_POSITION_NED", "SR0_EXTRA1", "SR0_EXTRA3", "SR0_RAW_SENS", "RNGFND1_TYPE"):
        assert any(words in text for text in missing), (words, missing)
    assert any("SR0_EXT_STAT" in text for text in found)


def test_the_check_finds_nothing_missing_in_the_streams_of_a_boat_that_is_set_up():
    found = checked("rover46_boat", until_s=130.0, pressure="none")
    for name in ("HEARTBEAT", "LOCAL_POSITION_NED", "ATTITUDE", "DISTANCE_SENSOR"):
        ((text, ok),) = [(text, ok) for text, ok in found.items() if text.startswith(f"{name}:")]
        assert ok, text
    assert found["origin known"]
    assert found["armed"]


def test_the_check_knows_a_vehicle_without_gps():
    found = checked("sub45_dvl_no_gps_origin_set")
    assert "VISO_TYPE: no answer" in found
    ((text, ok),) = [(text, ok) for text, ok in found.items() if text.startswith("LOCAL_POSITION_NED:")]
    assert ok, text
