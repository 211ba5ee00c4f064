"""The vehicle's link drives the simulated ArduSub and ArduRover."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest
from bench_of_autopilot import ORIGIN, Bench

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.vocabulary.mission_run import Action, Stop
from auv_lse_mavlink.link import VehicleLink
from auv_lse_mavlink.messages.conversion import Target
from auv_lse_sim.emulated.ardupilot.personality import ROVER, SUB, Personality

HOLD, SURFACE = Stop(action=Action.HOLD), Stop(action=Action.SURFACE)
LEG = Target(north_m=60.0, east_m=0.0, depth_m=3.0, heading_rad=0.0, speed_mps=1.0)


class Driven(Bench):
    """An autopilot and the link to it; the link's heartbeats replace the bench's."""

    def __init__(self, personality: Personality = SUB, **values: Any) -> None:
        self.link: VehicleLink | None = None
        super().__init__(personality)
        self.beats = False
        config = LinkConfig(kind="mavlink", **{"pressure": "none", **values})
        self.link = VehicleLink(config, 1, ORIGIN)
        self.pass_s(40.0)  # it boots, and finds its position

    def pass_s(self, duration_s: float, step_s: float = 0.25) -> None:
        for _ in range(round(duration_s / step_s)):
            super().pass_s(step_s, step_s)
            if self.link is not None:
                self.link.poll(self.now_s)
                self._deliver()

    def _listen(self) -> None:
        datagrams = self.autopilot.outgoing()
        for datagram in datagrams:
            self.said += [(self.now_s, m) for m in self._reader.parse_buffer(datagram) or ()]
            if self.link is not None:
                self.link.receive(self.now_s, datagram)

    def _deliver(self) -> None:
        assert self.link is not None
        for _ in range(50):  # an upload is a conversation
            datagrams = self.link.outgoing()
            if not datagrams:
                return
            for datagram in datagrams:
                self.autopilot.receive(self.now_s, datagram)
            self._listen()

    def go(self, target: Target) -> Driven:
        assert self.link is not None
        self.link.command(self.now_s, target)
        return self

    def mean_mps(self, duration_s: float) -> float:
        before = self.position
        self.pass_s(duration_s)
        return math.dist(before, self.position) / duration_s


@pytest.mark.parametrize("personality", [SUB, ROVER], ids=["sub", "rover"])
@pytest.mark.parametrize("mode", ["position_target", "mission"])
def test_legs_stops_and_mode_changes(personality: Personality, mode: str) -> None:
    depth_m = 3.0 if personality is SUB else 0.0
    leg = dataclasses.replace(LEG, depth_m=depth_m)
    chosen = personality.guided if mode == "position_target" else personality.auto
    vehicle = Driven(personality, mode=mode)
    link = vehicle.link
    assert link is not None
    link.stop(vehicle.now_s, HOLD)  # it waits for GO, in a mission that holds
    vehicle.pass_s(3.0)
    vehicle.arm()
    vehicle.mode(chosen)
    vehicle.pass_s(15.0)
    waited = vehicle.position
    assert math.dist(waited[:2], (0.0, 0.0)) < 3.0
    vehicle.go(leg)
    link.stop(vehicle.now_s, None)
    assert vehicle.mean_mps(20.0) > 0.7
    vehicle.mode(personality.manual)
    vehicle.pass_s(5.0)
    vehicle.mode(chosen)
    vehicle.pass_s(2.0)
    assert vehicle.mean_mps(10.0) > 0.6
    link.stop(vehicle.now_s, HOLD)
    vehicle.pass_s(15.0)
    assert vehicle.mean_mps(10.0) < 0.1
    if personality is SUB:
        assert vehicle.depth_m > 0.5, "its depth grows along the leg, and it holds where it is"
        link.stop(vehicle.now_s, SURFACE)
        vehicle.pass_s(25.0)
        assert vehicle.depth_m < 0.4
    assert link.report.disobeys == ""


def test_an_autopilot_that_restarts_after_the_end_goes_nowhere() -> None:
    vehicle = Driven()
    vehicle.arm()
    vehicle.mode(SUB.guided)
    vehicle.go(dataclasses.replace(LEG, north_m=20.0, then=HOLD))
    vehicle.pass_s(60.0)
    ended = vehicle.position
    assert ended[0] == pytest.approx(20.0, abs=1.0)
    vehicle.arm(False)
    vehicle.mode(SUB.manual)
    vehicle.pass_s(3.0)
    vehicle.arm()
    vehicle.mode(SUB.guided)
    vehicle.pass_s(20.0)
    assert math.dist(vehicle.position[:2], ended[:2]) < 0.5
