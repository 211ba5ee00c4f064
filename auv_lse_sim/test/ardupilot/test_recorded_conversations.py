"""Recorded conversations with real ArduPilots, replayed to the simulated one: what was sent to them goes in.

The operator's own ground station was on another port, so its actions are listed here with their times (s) in the
recording. The vehicle follows its trajectory exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest
from recorded_conversations import FOLDER, conversation

from auv_lse_mavlink.messages.datum import Origin
from auv_lse_mavlink.messages.wire import MavlinkCodec, mavlink
from auv_lse_sim.emulated.ardupilot.autopilot import ArduPilot
from auv_lse_sim.emulated.ardupilot.personality import ROVER, SUB, Personality
from auv_lse_sim.emulated.ardupilot.setup import Setup, recommended_parameters
from auv_lse_sim.emulated.autopilot_report import Report

if FOLDER is None:
    pytest.skip("needs the recordings of real autopilots, which are not part of the project", allow_module_level=True)

Action = Callable[[ArduPilot], Any]
STEP_S = 0.1
#: Texts that depend on the conversation; others tell of the estimator's own life.
TEXTS = ("origin set", "refusing", "rm", "Flight plan", "Mission", "Reached", "Leak", "heartbeat lost", "Failsafe")


def arm(autopilot: ArduPilot) -> None:
    autopilot.arm(True)


def disarm(autopilot: ArduPilot) -> None:
    autopilot.arm(False)


def mode(number: int) -> Action:
    return lambda autopilot: autopilot.set_mode(number)


def restart_mission(autopilot: ArduPilot) -> None:
    autopilot.restart_mission(1)


def leak(autopilot: ArduPilot) -> None:
    autopilot.failsafes.leaks = True


def pump(autopilot: ArduPilot) -> None:
    autopilot.failsafes.leaks = False


def reboot(autopilot: ArduPilot) -> None:
    autopilot.reboot(autopilot.now_s)


def slow(autopilot: ArduPilot) -> None:
    autopilot.change_speed(0.7)


#: What came before a recording that begins under way.
GUIDED = (arm, mode(4), slow)


@dataclass(frozen=True, kw_only=True)
class Story:
    """A recording, with what it does not contain.

    Attributes:
        operator: The operator's actions, with their times (s) in the recording.
        before: Actions before it begins.
        has_gps: Whether there is a GPS receiver.
        fix_s: Time (s) in the recording from which GPS has a fix.
        cut: Times (s) between which nothing reached the autopilot.
        from_s: Where the comparison begins.
        until_s: Where it ends.
        apart_m: How far (m) the simulated vehicle may be from the real one.
    """

    name: str
    operator: tuple[tuple[float, Action], ...] = ()
    before: tuple[Action, ...] = ()
    has_gps: bool = True
    has_origin: bool = True
    fix_s: float = 0.0
    cut: tuple[float, float] = (math.inf, math.inf)
    from_s: float = 0.4
    until_s: float = math.inf
    apart_m: float = 3.0
    personality: Personality = SUB
    parameters: dict[str, float] = field(default_factory=dict)


STORIES = (
    Story(
        name="sub45_send_once",
        operator=((18.17, arm), (19.66, mode(4)), (117.72, mode(19)), (123.72, mode(4)), (133.79, disarm),
                  (138.73, arm), (155.8, leak), (160.0, pump), (187.93, disarm)),
    ),
    Story(
        name="sub45_mode_change_disarm_linkdrop",
        before=GUIDED,
        operator=((36.98, mode(2)), (53.88, mode(4)), (91.43, disarm), (106.69, arm), (179.94, mode(4))),
        cut=(132.0, 169.0),
    ),
    Story(
        name="sub45_auto_mission",
        has_gps=False,
        has_origin=False,
        operator=((29.98, arm), (31.48, mode(3)), (107.69, restart_mission)),
    ),
    Story(
        name="sub45_dvl_no_gps_origin_set",
        has_gps=False,
        has_origin=False,
        operator=((47.71, arm), (49.21, mode(4))),
        from_s=20.0,
    ),
    Story(
        name="sub45_restart",
        before=GUIDED,
        operator=((13.65, reboot), (65.5, arm), (67.0, mode(4))),
        fix_s=23.2,
        until_s=53.0,
    ),
    Story(name="sub45_legs_5hz_repeat", before=GUIDED, from_s=7.0),
    Story(name="sub45_mission_gps_10s_period", before=GUIDED),
    Story(
        name="rover46_boat",
        personality=ROVER,
        operator=((24.88, reboot), (89.0, arm), (90.97, mode(15)), (166.47, disarm), (188.47, arm), (190.49, mode(15)),
                  (254.52, mode(0)), (267.67, mode(15)), (333.1, disarm)),
        fix_s=33.9,
        from_s=27.0,
        parameters={"WP_SPEED": 2.0},
        apart_m=5.0,  # it has turned back and forth with the wind
    ),
)  # fmt: skip


class Replay:
    """A recording, and what the simulated autopilot does with it.

    Attributes:
        real: What the real one sent, with times (s) in the recording.
        ours: What the simulated one sends.
        track: Time, north, east, depth (m) of the simulated one.
    """

    def __init__(self, story: Story) -> None:
        """Replays it."""
        heard = conversation(story.name)
        self.story, self._t0 = story, heard[0].time_s
        self.real = [(h.time_s - self._t0, h.message) for h in heard if not h.to_autopilot]
        self._first = {m.get_type(): m for _, m in reversed(self.real) if m.get_srcSystem() == 1}
        self.real = [(t, m) for t, m in self.real if m.get_srcSystem() == 1 and t >= story.from_s]
        self.sent = [(h.time_s - self._t0, h.message) for h in heard if h.to_autopilot]
        self.ours: list[tuple[float, Any]] = []
        self.track: list[tuple[float, float, float, float]] = []
        self._reader = MavlinkCodec(9, 9)
        self._run()
        self.ours = [(t, m) for t, m in self.ours if story.from_s <= t < story.until_s]
        self.real = [(t, m) for t, m in self.real if t < story.until_s]

    def _autopilot(self) -> ArduPilot:
        story = self.story
        origin, first = self._first.get("GPS_GLOBAL_ORIGIN"), self._first["LOCAL_POSITION_NED"]
        lat, lon = (465002698, 66003907) if origin is None else (origin.latitude, origin.longitude)
        position, yaw = (first.x, first.y), self._first["ATTITUDE"].yaw
        setup = Setup(
            personality=story.personality,
            parameters=recommended_parameters(story.personality, 245) | story.parameters,
            aiding="gps" if story.has_gps else "dvl",
            has_origin=story.has_origin,
            feeds=False,
        )
        own = Origin(lat_deg=lat * 1e-7, lon_deg=lon * 1e-7)
        return ArduPilot(1, (yaw, *position), own, lambda pilot: None, setup)

    def _run(self) -> None:
        autopilot, packer = self._autopilot(), mavlink.MAVLink(None, srcSystem=245, srcComponent=191)
        autopilot.receive(0.0, b"")
        for action in self.story.before:
            action(autopilot)
        if self.story.before:
            autopilot.guidance._begin.position_m[2] = max(self._first["LOCAL_POSITION_NED"].z, 0.0)
        end_s = min(self.story.until_s, max(self.real[-1][0], self.sent[-1][0]))
        cut_s, back_s = self.story.cut
        arrives = [(t, m) for t, m in self.sent if not cut_s <= t < back_s]
        events: list[tuple[float, Any]] = [*arrives, *self.story.operator]
        events.sort(key=lambda event: event[0])
        now_s = 0.0
        while now_s < end_s:
            now_s += STEP_S
            while events and events[0][0] <= now_s:
                at_s, event = events.pop(0)
                if callable(event):
                    autopilot.receive(at_s, b"")
                    event(autopilot)
                else:
                    autopilot.receive(at_s, event.pack(packer))
                    packer.seq = (packer.seq + 1) % 256
                self._listen(at_s, autopilot)
            self._report(now_s, autopilot)
            self._listen(now_s, autopilot)

    def _report(self, now_s: float, autopilot: ArduPilot) -> None:
        pose = autopilot.pilot.at(now_s)
        north, east, depth = map(float, pose.position_m)
        self.track.append((now_s, north, east, depth))
        gps = (north, east) if self.story.has_gps and now_s >= self.story.fix_s and depth < 0.5 else None
        vn, ve = pose.velocity_mps[:2]
        autopilot.report(
            now_s,
            Report(
                heading_rad=pose.heading_rad,
                north_m=north,
                east_m=east,
                depth_m=depth,
                gps_m=gps,
                speed_mps=math.hypot(vn, ve),
            ),
        )

    def _listen(self, now_s: float, autopilot: ArduPilot) -> None:
        for datagram in autopilot.outgoing():
            self.ours += [(now_s, m) for m in self._reader.decode(datagram)]

    # ------------------------------------------------------------------ what is compared

    @staticmethod
    def of(said: list[tuple[float, Any]], *kinds: str) -> list[tuple[float, Any]]:
        return [(t, m) for t, m in said if m.get_type() in kinds]

    def states(self, said: list[tuple[float, Any]]) -> list[tuple[float, tuple[int, int, int]]]:
        """Changes of the heartbeat, with their times (s)."""
        changes: list[tuple[float, tuple[int, int, int]]] = []
        for t, m in self.of(said, "HEARTBEAT"):
            state = (m.base_mode, m.custom_mode, m.system_status)
            if not changes or changes[-1][1] != state:
                changes.append((t, state))
        return changes

    def mission(self, said: list[tuple[float, Any]]) -> list[tuple[Any, ...]]:
        """The mission protocol's messages, and changes of MISSION_CURRENT."""
        rows: list[tuple[Any, ...]] = []
        current = None
        for _, m in self.of(said, "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK", "MISSION_ITEM_REACHED"):
            rows.append((m.get_type(), getattr(m, "seq", getattr(m, "type", None))))
        rows = [row for row in rows if row != ("MISSION_ITEM_REACHED", 0)]  # ArduRover in GUIDED, once in a while
        for _, m in self.of(said, "MISSION_CURRENT"):
            if (m.seq, m.total, m.mission_state) != current:
                current = (m.seq, m.total, m.mission_state)
                rows.append(current)
        return rows

    def texts(self, said: list[tuple[float, Any]]) -> list[tuple[int, str]]:
        texts = [(m.severity, m.text) for _, m in self.of(said, "STATUSTEXT")]
        return [entry for entry in texts if any(words in entry[1] for words in TEXTS)]


@pytest.fixture(scope="module", params=STORIES, ids=lambda story: story.name)
def replay(request: pytest.FixtureRequest) -> Replay:
    return Replay(request.param)


def test_commands_are_acknowledged_alike(replay: Replay) -> None:
    def acks(said: list[tuple[float, Any]]) -> list[tuple[int, int]]:
        return [(m.command, m.result) for _, m in replay.of(said, "COMMAND_ACK")]

    if replay.real[0][0] <= replay.sent[0][0]:
        assert acks(replay.ours) == acks(replay.real)
    assert {result for _, result in acks(replay.ours)} <= {mavlink.MAV_RESULT_ACCEPTED}


def test_modes_arming_and_status_change_alike(replay: Replay) -> None:
    real, ours = replay.states(replay.real), replay.states(replay.ours)
    assert [state for _, state in ours] == [state for _, state in real]
    # heartbeats come once a second
    assert [t for t, _ in ours[1:]] == pytest.approx([t for t, _ in real[1:]], abs=1.6)


def test_missions_are_taken_and_flown_alike(replay: Replay) -> None:
    assert replay.mission(replay.ours) == replay.mission(replay.real)


def test_texts_are_alike(replay: Replay) -> None:
    assert replay.texts(replay.ours) == replay.texts(replay.real)


def test_the_origin_is_announced_alike(replay: Replay) -> None:
    def origins(said: list[tuple[float, Any]]) -> list[tuple[int, int, int]]:
        """Position and tenth of a minute; two messages at the same time count once."""
        return sorted({(m.latitude, m.longitude, round(t / 6.0)) for t, m in replay.of(said, "GPS_GLOBAL_ORIGIN")})

    if replay.story.personality is SUB:
        assert origins(replay.ours) == origins(replay.real)


def test_the_vehicle_is_where_the_real_one_was(replay: Replay) -> None:
    apart_m, k = [], 0
    for t, m in replay.of(replay.real, "LOCAL_POSITION_NED"):
        while k + 1 < len(replay.track) and replay.track[k + 1][0] <= t:
            k += 1
        if t < replay.story.until_s:
            apart_m.append(math.dist((m.x, m.y, m.z), replay.track[k][1:]))
    assert max(apart_m) < replay.story.apart_m
