"""The order in which the bridge takes what has come in, and what it reports."""

from __future__ import annotations

import math

import numpy as np

from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_comms.bridge import ModemBridge
from auv_lse_comms.intake import BridgeIntake
from auv_lse_comms.packet.codec import Packet, encode


def intake() -> BridgeIntake:
    return BridgeIntake(ModemBridge(TdmaConfig(), PacketConfig(), 1, 3))


def plan(step: int, actions: tuple[int, ...] = (1,)) -> Plan:
    return Plan(step=step, heading_rad=0.0, north_m=1.0, east_m=2.0, actions=actions, naive_path=0xFF)


def payload(step: int) -> bytes:
    return encode(Packet(plan(step), np.zeros((0, 3))))


def test_packets_are_taken_by_stamp_and_source_however_they_came_in() -> None:
    own = intake()
    for stamp_s, source, step in ((2.0, 3, 5), (2.0, 2, 4), (1.0, 3, 3)):
        own.add_packet(stamp_s, source, payload(step))
    own.add_packet(0.5, 2, b"noise")
    heard = own.process()
    assert [(r.stamp_s, r.source, r.packet.plan.step) for r in heard] == [(1.0, 3, 3), (2.0, 2, 4), (2.0, 3, 5)]
    assert own.process() == [], "each is taken once"


def test_a_sounding_that_is_not_finite_is_reported_once() -> None:
    own = intake()
    own.add_soundings([(1.0, 0.0, 0.0, 12.0), (2.0, 0.0, 0.0, math.nan)])
    own.process()
    assert own.problems == ["soundings that are not finite are not sent: 1 so far"]
    assert own.bridge.unsent == 1
    own.process()
    assert own.problems == []


def test_a_sounding_without_a_raw_position_is_reported_where_packets_need_one() -> None:
    own = BridgeIntake(ModemBridge(TdmaConfig(), PacketConfig(navigation=True), 1, 3))
    own.add_soundings([(1.0, 0.0, 0.0, 12.0, 0.5, 0.5), (2.0, 0.0, 0.0, 12.0, math.nan, math.nan)])
    own.process()
    (problem,) = own.problems
    assert problem.startswith("soundings without a dead-reckoned position are not sent: 1 so far; ")
    assert own.bridge.unsent == 1


def test_a_plan_that_does_not_fit_is_reported_and_the_previous_one_stays() -> None:
    own = intake()
    own.set_plan(plan(1))
    own.poll(0.0)
    own.set_plan(plan(2, actions=(1,) * 300))
    own.poll(0.1)
    (problem,) = own.problems
    assert problem.startswith("plan of step 2 does not fit a packet: ")
    assert own.bridge.counts["plans.unsendable"] == 1
