"""Slot contest: of several packets of a slot without tags, the sender's own brings the samples."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_comms.bridge import MateTracks, ModemBridge, ModemFeatures, Pace
from auv_lse_comms.packet.codec import Packet, encode
from auv_lse_comms.packet.navigation import Navigation

PACE = Pace(speed_mps=1.5, leg_s=16.0, surfacing_steps=8)
#: Depths (m) that mark samples of the mate and of a forger.
TRUE_M, FORGED_M = 20.0, 40.0
#: When a mate's packet arrives after the start of its slot (s).
PHASE_S = 3.1


def payload(now_s: float, north_m: float, east_m: float, depth_m: float) -> bytes:
    """A packet of a vehicle at a position (m), with two samples there."""
    plan = Plan.at(int(now_s / PACE.leg_s), np.array([0.0, north_m, east_m]), (1,), NONE)
    navigation = Navigation(raw_cm=(round(100.0 * north_m), round(100.0 * east_m)))
    samples = np.array([[north_m, east_m, depth_m], [north_m - 20.0, east_m, depth_m]])
    return encode(Packet(plan, samples, navigation=navigation))


class Water:
    """The bridge of vehicle 1, and how much of vehicle 2 it accepts."""

    def __init__(self) -> None:
        features = ModemFeatures(on_air_s=2.0)
        self.bridge = ModemBridge(TdmaConfig(), PacketConfig(), 1, 3, modem=features)
        self.bridge.tracks = MateTracks(PACE)
        self.depths: list[float] = []
        self.ranged = 0
        self.accepted = {TRUE_M: 0, FORGED_M: 0}

    def receive(self, now_s: float, depth_m: float, content: bytes) -> bool:
        """Returns whether samples of the packet were used at once."""
        self.poll(now_s)
        received = self.bridge.receive(now_s, 2, content)
        self.accepted[depth_m] += received is not None
        if received is None:
            return False
        self.depths += received.packet.samples[:, 2].tolist()
        return len(received.packet.samples) > 0

    def poll(self, now_s: float) -> None:
        self.bridge.poll(now_s)
        for received in self.bridge.waited():
            self.depths += received.packet.samples[:, 2].tolist()
            self.ranged += received.navigation is not None

    def cycle(self, cycle: int, forged_after_s: tuple[float, ...], forged: Callable[[float], bytes]) -> None:
        """One cycle: the mate travels north, and forged packets come that long after the start of its slot."""
        start_s = 30.0 * cycle + 10.0
        arrivals = [(start_s + PHASE_S, TRUE_M, payload(start_s, 45.0 * cycle, 0.0, TRUE_M))]
        arrivals += [(start_s + after_s, FORGED_M, forged(start_s + after_s)) for after_s in forged_after_s]
        for arrival in sorted(arrivals):
            self.receive(*arrival)


def steady(now_s: float) -> bytes:
    """A forger with a track of its own."""
    return payload(now_s, 300.0, 1.5 * now_s - 200.0, FORGED_M)


def close(now_s: float) -> bytes:
    """A forger that follows the mate's track."""
    return payload(now_s, 1.5 * now_s - 15.0, 10.0, FORGED_M)


@pytest.mark.parametrize("first", [0, 3])
def test_a_forger_with_three_early_packets_in_each_slot_brings_no_samples(first: int) -> None:
    water = Water()
    for cycle in range(20):
        water.cycle(cycle, (1.0, 3.0, 5.0) if cycle >= first else (), steady)
    water.poll(620.0)
    assert water.accepted[TRUE_M] >= 19
    assert water.accepted[FORGED_M] <= 6
    assert set(water.depths) == {TRUE_M}
    assert len(water.depths) == 2 * 20


@pytest.mark.parametrize(("forger", "most"), [(steady, 0), (close, 2)])
def test_a_forger_on_time_brings_no_samples_once_the_mate_was_heard_in_the_same_slot(
    forger: Callable[[float], bytes], most: int
) -> None:
    water = Water()
    water.cycle(0, (), forger)
    for cycle in range(1, 20):
        water.cycle(cycle, (3.0,), forger)
    assert water.accepted[TRUE_M] == 20
    assert water.depths.count(FORGED_M) <= most


def leaving(now_s: float) -> bytes:
    """A forger that begins beside the mate, and leaves its track."""
    return payload(now_s, 0.7 * now_s, 0.9 * now_s, FORGED_M)


def test_a_forger_that_leaves_the_mates_track_has_a_track_of_its_own() -> None:
    water = Water()
    for cycle in range(20):
        water.cycle(cycle, (1.0, 3.0, 5.0), leaving)
    water.poll(620.0)
    assert water.accepted[TRUE_M] >= 17
    assert water.accepted[FORGED_M] <= 20
    assert water.depths.count(TRUE_M) >= 2 * 16
    assert water.depths.count(FORGED_M) <= 2 * 2


def test_an_early_packet_that_follows_the_mates_track_brings_no_samples() -> None:
    water = Water()
    for cycle in range(20):
        water.cycle(cycle, (1.0,) if cycle else (), close)
    water.poll(620.0)
    assert set(water.depths) == {TRUE_M}
    assert len(water.depths) == 2 * 20


def test_without_a_forger_samples_are_used_at_once() -> None:
    water = Water()
    for cycle in range(20):
        content = payload(30.0 * cycle, 45.0 * cycle, 0.0, TRUE_M)
        assert water.receive(30.0 * cycle + 10.0 + PHASE_S, TRUE_M, content)
        assert not water.receive(30.0 * cycle + 15.0 + PHASE_S, TRUE_M, content), "an echo"
    water.poll(620.0)
    assert water.depths == [TRUE_M] * 40


@pytest.mark.parametrize("off_s", [-13.0, -2.0, 7.0, 14.0])
def test_a_mate_whose_clock_is_wrong_loses_no_sample(off_s: float) -> None:
    water = Water()
    for cycle in range(1, 21):
        water.receive(30.0 * cycle + 10.0 + PHASE_S + off_s, TRUE_M, payload(30.0 * cycle, 45.0 * cycle, 0.0, TRUE_M))
    water.poll(700.0)
    assert water.accepted[TRUE_M] == 20
    assert water.depths == [TRUE_M] * 40
    assert water.ranged == 20


def test_packets_that_a_modem_delivers_together_all_count() -> None:
    water = Water()
    for cycle in range(3):
        water.receive(108.0 + 0.1 * cycle, TRUE_M, payload(30.0 * cycle, 10.0 * cycle, 0.0, TRUE_M))
    water.poll(200.0)
    assert water.depths == [TRUE_M] * 6


def test_a_track_that_lost_is_trusted_again_when_it_is_alone() -> None:
    water = Water()
    for cycle in range(6):
        water.cycle(cycle, (1.0, 3.0, 5.0), steady)
    heard = []
    for cycle in range(6, 14):
        now_s = 30.0 * cycle + 10.0 + PHASE_S
        before = water.accepted[FORGED_M]
        water.receive(now_s, FORGED_M, steady(now_s))
        heard.append(water.accepted[FORGED_M] > before)
    assert heard == [False] * 4 + [True] * 4


@pytest.mark.parametrize("first_s", [1.0, 6.0], ids=["in time", "late"])
def test_of_a_flood_a_slot_brings_some_plans_and_the_samples_of_one_packet(first_s: float) -> None:
    water = Water()
    cycles, ahead = 10, 3
    for cycle in range(cycles):
        for number in range(8):
            now_s = 30.0 * cycle + 10.0 + first_s + 0.45 * number
            water.receive(now_s, TRUE_M, payload(30.0 * cycle, 45.0 * cycle + number, 0.0, TRUE_M))
    water.poll(330.0)
    assert water.accepted[TRUE_M] <= (5 if first_s == 1.0 else 1) * cycles + ahead
    assert len(water.depths) <= 2 * (cycles + ahead)
