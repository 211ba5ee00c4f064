"""Mate tracks: packets without a tag that follow one another are accepted, impossible ones are not."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_comms.bridge import MateTracks, ModemBridge, Pace
from auv_lse_comms.bridge.mate_tracks import speeds_apart
from auv_lse_comms.health import bridge_problems
from auv_lse_comms.packet.codec import Packet, encode
from auv_lse_comms.packet.navigation import Navigation

PACE = Pace(speed_mps=1.5, leg_s=16.0, surfacing_steps=8)


def packet(now_s: float, north_m: float, step: int | None = None, samples: Array | None = None) -> Packet:
    """A packet of a vehicle at `north_m`."""
    plan = Plan.at(int(now_s / PACE.leg_s) if step is None else step, np.array([0.0, north_m, 0.0]), (1,), NONE)
    navigation = Navigation(raw_cm=(round(100.0 * north_m), 0))
    return Packet(plan, np.zeros((0, 3)) if samples is None else samples, navigation=navigation)


def taken(tracks: MateTracks, now_s: float, source: int, content: Packet) -> Mask | None:
    """Mask of the samples that are accepted; None if the packet is not."""
    track = tracks.take(now_s, source, content)
    return tracks.reachable(track, content.samples) if tracks.is_trusted(source, track) else None


def cruise(tracks: MateTracks, cycles: range) -> list[bool]:
    """Which packets of a vehicle that travels north are accepted."""
    return [taken(tracks, 30.0 * cycle, 2, packet(30.0 * cycle, 45.0 * cycle)) is not None for cycle in cycles]


@pytest.mark.parametrize("seed", range(5))
def test_honest_packets_are_accepted_whatever_is_lost(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tracks = MateTracks(PACE)
    tracks.since_s = 0.0
    heading, positions, surfaced = 0.0, [np.zeros(2)], 0
    for now in range(1, 3000):
        heading += rng.normal(0.0, 0.1)
        positions.append(positions[-1] + 1.5 * np.array([np.cos(heading), np.sin(heading)]))
        if now % 30 or rng.random() < 0.5:
            continue
        surfaced += 8 * (rng.random() < 0.02)
        samples = np.column_stack([np.array(positions)[rng.integers(len(positions), size=15)], np.ones(15)])
        plan = Plan.at(now // 16 + surfaced, np.array([0.0, *positions[-1]]), (1,), NONE)
        navigation = Navigation(raw_cm=(round(100.0 * positions[-1][0]), round(100.0 * positions[-1][1])))
        possible = taken(tracks, float(now), 2, Packet(plan, samples, navigation=navigation))
        assert possible is not None
        assert possible.all()


def test_samples_of_a_mate_that_tells_one_plan_for_long_and_no_position_are_accepted() -> None:
    tracks = MateTracks(PACE)
    taken(tracks, 0.0, 2, dataclasses.replace(packet(0.0, 0.0), navigation=None))
    for cycle in range(1, 20):
        samples = np.array([[45.0 * cycle, 0.0, 20.0], [5000.0, 0.0, 20.0]])
        told = dataclasses.replace(packet(30.0, 45.0, samples=samples), navigation=None)
        possible = taken(tracks, 30.0 * cycle, 2, told)
        assert possible is not None
        assert possible.tolist() == [True, False]


def test_a_plan_that_was_kept_for_long_may_be_replaced_by_one_far_ahead() -> None:
    tracks = MateTracks(PACE)
    for cycle in range(40):  # a path from the start, told unchanged for 20 minutes
        told = packet(30.0 * cycle, 45.0 * cycle, step=0)
        told = dataclasses.replace(told, plan=Plan.at(0, np.zeros(3), (), 0xE0))
        assert taken(tracks, 30.0 * cycle, 2, told) is not None
    restarted = MateTracks(PACE)
    restarted.recall(2, json.loads(json.dumps(tracks.last(2))))
    for known in (tracks, restarted):
        assert taken(known, 1200.0, 2, packet(1200.0, 1800.0)) is not None, "the first plan since"
    assert taken(tracks, 1230.0, 2, packet(1230.0, 1845.0, step=500)) is None


@pytest.mark.parametrize(("north_m", "step"), [(2000.0, None), (None, 90)])
def test_impossible_packets_are_refused_and_do_not_harm(north_m: float | None, step: int | None) -> None:
    tracks = MateTracks(PACE)
    assert all(cruise(tracks, range(6)))
    forged = packet(181.0, 270.0 if north_m is None else north_m, step)
    assert taken(tracks, 181.0, 2, forged) is None
    assert all(cruise(tracks, range(7, 12)))


def test_samples_where_the_mate_cannot_have_been_are_left_out() -> None:
    tracks = MateTracks(PACE)
    cruise(tracks, range(11))
    samples = np.array([[0.0, 0.0, 5.0], [200.0, 30.0, 5.0], [200.0, 300.0, 5.0], [900.0, 0.0, 5.0]])
    possible = taken(tracks, 330.0, 2, packet(330.0, 495.0, samples=samples))
    assert possible is not None
    assert possible.tolist() == [True, True, False, False]


def test_a_vehicle_that_starts_again_elsewhere_is_accepted_after_some_packets() -> None:
    tracks = MateTracks(PACE)
    cruise(tracks, range(20))
    heard = [
        taken(tracks, 600.0 + 30.0 * cycle, 2, packet(600.0, -3000.0 - 45.0 * cycle, cycle)) is not None
        for cycle in range(8)
    ]
    assert heard == [False] * 3 + [True] * 5


def test_forged_packets_at_random_positions_and_first_in_each_slot_do_not_shut_out_the_true_ones() -> None:
    tracks, rng, heard, forged = MateTracks(PACE), np.random.default_rng(1), [], 0
    for cycle in range(40):
        for early in range(3):
            now_s = 30.0 * cycle - 6.0 + 2.0 * early
            forged += taken(tracks, now_s, 2, packet(now_s, *rng.uniform(-1000.0, 3000.0, 1))) is not None
        heard += cruise(tracks, range(cycle, cycle + 1))
    assert all(heard[6:])
    assert forged <= 40


def test_one_of_several_packets_of_a_slot_is_not_excess() -> None:
    bridge = ModemBridge(TdmaConfig(), PacketConfig(), 1, 3)
    bridge.tracks = MateTracks(PACE)
    true = 0
    for cycle in range(20):
        now_s = 30.0 * cycle + 13.0
        content = packet(now_s, 45.0 * cycle)
        for early in range(3):
            plan = dataclasses.replace(content.plan, actions=(early,))
            bridge.receive(now_s - 2.5 + 0.5 * early, 2, encode(dataclasses.replace(content, plan=plan)))
        true += bridge.receive(now_s, 2, encode(content)) is not None
        assert bridge.receive(now_s, 2, encode(content)) is None, "an echo"
    assert true == 20
    assert "beyond its slots" in bridge.quality.problems(600.0)["excess of 2"]


def test_a_restarted_bridge_remembers_tracks() -> None:
    before, journal = ModemBridge(TdmaConfig(), PacketConfig(), 1, 3), []
    before.tracks = MateTracks(PACE)
    before.remember = lambda *event: journal.append(event)
    before.poll(0.0)
    for cycle in range(3):
        assert before.receive(30.0 * cycle + 13.0, 2, encode(packet(30.0 * cycle, 45.0 * cycle))) is not None
    after = ModemBridge(TdmaConfig(), PacketConfig(), 1, 3)
    after.tracks = MateTracks(PACE)
    after.recall(journal)
    assert after.tracks.since_s == 0.0
    assert after.receive(103.0, 2, encode(packet(103.0, 2000.0))) is None
    assert after.counts["rejected.implausible"] == 1


def test_no_sequence_of_hostile_packets_raises() -> None:
    rng, bridge = np.random.default_rng(3), ModemBridge(TdmaConfig(), PacketConfig(), 1, 3)
    bridge.tracks = MateTracks(PACE)
    now_s = 0.0
    for _ in range(1500):
        now_s += rng.choice([0.0, 0.5, 30.0, -40.0, 5000.0], p=[0.2, 0.6, 0.15, 0.03, 0.02])
        plan = Plan.at(int(rng.integers(65536)), rng.choice([0.0, 1.0, 1e6, -1e6], 3), (), NONE)
        plan = dataclasses.replace(plan, heading_rad=0.0)
        navigation = None if rng.random() < 0.5 else Navigation(raw_cm=(int(rng.integers(-(2**23), 2**23)), 0))
        samples = rng.choice([0.0, 5.0, 1e4], (int(rng.integers(15)), 3))
        bridge.receive(now_s, int(rng.integers(2, 4)), encode(Packet(plan, samples, navigation=navigation)))
        bridge_problems(bridge, now_s)
    assert bridge.counts["received"] > 0
    assert bridge.counts["rejected.implausible"] > 0


@pytest.mark.parametrize(
    ("speeds_mps", "words"),
    [
        ([0.5, 2.5, 1.5], "auv2 (2.5 m/s) is more than 2 times as fast as auv1 (0.5 m/s)"),
        ([0.2, 0.2, 1.5], "auv3 (1.5 m/s) is more than 2 times as fast as auv1, auv2 (0.2 m/s)"),
        ([1.5, 0.6, 0.5], "auv1 (1.5 m/s) is more than 2 times as fast as auv2, auv3 (0.5 m/s)"),
        ([1.0, 2.0, 1.5], None),
        ([1.5, 1.5], None),
        ([0.2], None),
    ],
)
def test_a_team_whose_slow_vehicles_refuse_packets_of_fast_mates_is_named(
    speeds_mps: list[float], words: str | None
) -> None:
    text = speeds_apart(speeds_mps)
    assert (words in text) if words else not text
