"""Whole missions in one process."""

import tracemalloc

import numpy as np
import pytest

from auv_lse_common.mission_file.settings import Settings
from auv_lse_comms.packet.codec import decode
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of


def fleet(**overrides) -> Fleet:
    settings = Settings.load(
        None, {"mission.steps": 12, "planner.method": "plain", "planner.iterations": 20, **overrides}
    )
    return Fleet(settings, ground_of(settings))


@pytest.fixture(scope="module")
def mission():
    f = fleet()
    return f, f.run()


def test_mission_runs_to_its_end(mission):
    _, run = mission
    assert [v.steps for v in run.vehicles] == [12, 12, 12]
    assert not run.notes
    # 12 legs of 23.56 m at 1.5 m/s, speeds 2 % apart, a tick for the first decision.
    assert run.end_s == pytest.approx(12 * 23.56 / 1.5, rel=0.15)
    for v in run.vehicles:
        assert [d.step for d in v.decisions] == list(range(12))
        assert len(v.truth) == len(v.odometry) == run.end_s
        assert (np.diff(v.soundings.stamp_s) > 0).all()
        assert len(v.soundings) > 0.85 * run.end_s
        assert all(b.now_s > a.now_s for a, b in zip(v.decisions, v.decisions[1:], strict=False))


def test_packets_are_those_of_the_protocol(mission):
    f, run = mission
    assert {s.source for s in run.sent} == {1, 2, 3}
    for sent in run.sent:
        assert len(sent.payload) == 252
        slot = f.cores[0].bridge.tdma.slot(sent.stamp_s)
        assert slot.owner == sent.source
        packet = decode(sent.payload)
        step = [d.step for d in run.vehicles[sent.source - 1].decisions if d.now_s <= sent.stamp_s][-1]
        assert packet.plan.step <= step  # an incumbent stays anchored where it was made
    arrived = {(r.source, r.payload) for r in run.received}
    assert arrived <= {(s.source, s.payload) for s in run.sent}
    heard = sum(len(v.received) for v in run.vehicles)
    assert heard == sum(len(decode(r.payload).samples) for r in run.received)


def test_vehicles_follow_their_plans(mission):
    f, run = mission
    for cores, v in zip(f.cores, run.vehicles, strict=True):
        leg = cores.planner.leg
        assert leg is not None
        assert leg.step == 11
        end = leg.end_state
        assert np.hypot(v.odometry[:, 1] - end[1], v.odometry[:, 2] - end[2]).min() < 2.0


def test_same_seed_same_mission(mission):
    _, run = mission
    again = fleet().run()
    for a, b in zip(run.vehicles, again.vehicles, strict=True):
        assert [(d.now_s, d.step, d.plan.actions, d.jbar) for d in a.decisions] == [
            (d.now_s, d.step, d.plan.actions, d.jbar) for d in b.decisions
        ]
        assert np.array_equal(a.soundings.rows, b.soundings.rows)
    assert [s.payload for s in run.sent] == [s.payload for s in again.sent]


def test_another_seed_another_mission(mission):
    _, run = mission
    other = fleet(**{"mission.seed": 2}).run()
    assert not np.array_equal(run.vehicles[0].truth[:50], other.vehicles[0].truth[:50])


def test_maps_hold_own_and_heard_soundings(mission):
    f, run = mission
    for cores, v in zip(f.cores, run.vehicles, strict=True):
        counts = cores.map.counts
        total = counts.kept + counts.too_close + counts.merged + counts.outliers + counts.refused
        assert total == len(v.soundings) + len(v.received)


def test_start_delays_and_speeds_per_vehicle():
    f = fleet(**{"mission.steps": 4, "auv2.vehicle.start_delay_s": 40.0, "auv3.vehicle.speed_mps": 1.0})
    run = f.run()
    first = [v.decisions[0].now_s for v in run.vehicles]
    assert first == [1.0, 40.0, 1.0]
    ends = [v.decisions[-1].now_s for v in run.vehicles]
    assert ends[1] > ends[0] + 30.0
    assert ends[2] > 1.3 * ends[0]


def test_ideal_world_has_no_navigation_error():
    run = fleet(**{"mission.steps": 3, "sim.ideal": True}).run()
    for v in run.vehicles:
        assert np.array_equal(v.truth, v.odometry)


def test_loss_of_all_packets_leaves_each_alone():
    run = fleet(**{"mission.steps": 6, "sim.channel.packet_loss": 1.0}).run()
    assert run.sent
    assert not run.received
    assert all(len(v.received) == 0 for v in run.vehicles)


def test_twenty_vehicles():
    run = fleet(**{"mission.vehicles": 20, "mission.steps": 3, "planner.iterations": 5}).run()
    assert [v.steps for v in run.vehicles] == [3] * 20
    assert len({s.source for s in run.sent}) >= 4


def test_a_mission_that_cannot_end_is_stopped(monkeypatch):
    f = fleet(**{"mission.vehicles": 1, "mission.steps": 20, "planner.iterations": 5})
    monkeypatch.setattr(f.cores[0].planner, "due", lambda now_s: False)
    run = f.run()
    assert run.end_s >= f.settings.longest_s
    assert any("stopped at" in note and "auv1 had not finished" in note for note in run.notes)


def test_memory_stays_bounded():
    """A tick leaves behind its record, under 20 kB for 2 vehicles with their maps, and nothing else grows."""
    f = fleet(**{"mission.vehicles": 2, "mission.steps": 400, "planner.method": "random"})
    for _ in range(200):
        f.tick()
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(150):
        f.tick()
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 150 * 20_000
