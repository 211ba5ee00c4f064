"""ModemBridge: what goes out in own slots, what comes in, and the counts; whole teams over a lossy wire."""

from __future__ import annotations

import dataclasses
import json
import math
from collections import Counter

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix
from auv_lse_common.vocabulary.naive_ids import FITTED
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_comms.bridge import ModemBridge, ModemFeatures
from auv_lse_comms.health import bridge_problems
from auv_lse_comms.intake import BridgeIntake
from auv_lse_comms.packet.codec import Limits, Packet, PacketError, decode, encode
from auv_lse_comms.ranging import Timing

TDMA = TdmaConfig()
PLAN = Plan(step=4, heading_rad=0.5, north_m=10.0, east_m=20.0, actions=(1, 2, 3), naive_path=0xF1)


def bridge(address: int = 1, vehicles: int = 3, second_lead_s: float | None = None, **packet: object) -> ModemBridge:
    config = PacketConfig(**packet)  # type: ignore[arg-type]
    return ModemBridge(TDMA, config, address, vehicles, modem=ModemFeatures(second_lead_s=second_lead_s))


def rows(n: int, start_s: float = 0.0) -> Array:
    """Soundings that tell themselves apart by their depth."""
    t = start_s + np.arange(n)
    return np.stack([t, 1.5 * t, -0.5 * t, t], axis=1)


def backlog(b: ModemBridge) -> Array:
    """The samples that wait: stamp (s), north, east, depth (m), shape (n, 4)."""
    return b._samples._merged()[:, :4]


def test_sends_plan_and_samples_once_in_each_own_slot() -> None:
    b = bridge(2)
    b.set_plan(PLAN)
    b.add_soundings(rows(5))
    sent = [(t, p) for t in np.arange(0.0, 60.0, 0.25).tolist() if (p := b.poll(t)) is not None]
    assert [t for t, _ in sent] == [10.5, 40.5]
    first, second = (decode(p) for _, p in sent)
    assert first.plan == PLAN
    assert first.samples[:, 2].tolist() == [0, 1, 2, 3, 4]
    assert len(second.samples) == 0
    assert b.counts["slots.used"] == b.counts["sent"] == 2
    assert b.counts["samples.sent"] == 5


def test_fitted_lanes_of_a_large_team_are_those_of_the_senders_group_of_five() -> None:
    sender, receiver = bridge(12, vehicles=20), bridge(3, vehicles=20)
    for number in range(10, 15):
        sender.set_plan(dataclasses.replace(PLAN, naive_path=FITTED[number]))
        payload = next(p for t in range(200) if (p := sender.poll(200.0 * number + t)) is not None)
        received = receiver.receive(200.0 * number + 112.75, 12, payload)
        assert received is not None
        assert received.packet.plan.naive_path == FITTED[number]
    with pytest.raises(PacketError, match="another group"):
        sender.set_plan(dataclasses.replace(PLAN, naive_path=FITTED[4]))


RAW = DeadReckoning(stamp_s=0.0, heading_rad=0.0, north_m=100.0, east_m=-50.0, depth_m=3.0)
FIX = Fix(stamp_s=20.0, north_m=61.0, east_m=-20.0, raw_north_m=60.0, raw_east_m=-22.0, std_m=0.8)


def test_with_navigation_raw_positions_are_sent() -> None:
    sender, receiver = bridge(1, navigation=True), bridge(2, navigation=False)
    sender.set_plan(PLAN)
    sender.add_soundings(np.column_stack([rows(30), rows(30)[:, 1:3] + [3.0, -4.0]]))
    sender.set_dead_reckoning(dataclasses.replace(RAW, stamp_s=30.0))
    payload = sender.poll(30.5)
    assert payload is not None
    timing = Timing(sent_s=30.5, arrival_s=30.75, travel_s=0.25)
    received = receiver.receive(32.75, 1, payload, timing)
    assert received is not None
    sent = received.packet.samples
    assert len(sent) == 18, "19 without"
    assert np.allclose(sent[:, :2], np.stack([1.5 * sent[:, 2] + 3.0, -0.5 * sent[:, 2] - 4.0], axis=1))
    told = received.navigation
    assert told is not None
    assert (told.source, told.stamp_s, told.sent_s, told.travel_s) == (1, 30.75, 30.5, 0.25)
    assert (told.raw_north_m, told.raw_east_m, told.has_fix) == (100.0, -50.0, False)

    sender.set_fix(FIX)
    sender.set_dead_reckoning(dataclasses.replace(RAW, stamp_s=60.0))
    payload = sender.poll(60.5)
    assert payload is not None
    received = receiver.receive(62.75, 1, payload)
    assert received is not None
    told = received.navigation
    assert told is not None
    assert (told.fix_raw_north_m, told.fix_raw_east_m) == (60.0, -22.0)
    assert (told.fix_north_m, told.fix_east_m) == pytest.approx((61.0, -20.0))
    assert told.stamp_s == 62.75, "an unknown start of reception is taken for its end"
    assert math.isnan(told.travel_s)


@pytest.mark.parametrize(("measured_s", "north_m", "travel_s"), [(0.25, 475.0, 0.25), (0.9995, 100.0, -0.0005)])
@pytest.mark.parametrize("seconds", [0, 2])
def test_the_second_in_which_a_packet_was_sent_follows_from_the_raw_positions(
    measured_s: float, north_m: float, travel_s: float, seconds: int
) -> None:
    sender, receiver = (bridge(address, navigation=True, second_lead_s=0.0) for address in (1, 2))
    sender.set_plan(PLAN)
    sender.set_dead_reckoning(RAW)
    payload = sender.poll(1.0)
    assert payload is not None
    receiver.set_dead_reckoning(dataclasses.replace(RAW, north_m=north_m + 1500.0 * seconds, stamp_s=3.0))
    # a modem tells what is left of the travel time beyond whole seconds, as if it were all of it
    timing = Timing(sent_s=10.0, arrival_s=10.0 + measured_s, travel_s=measured_s)
    received = receiver.receive(12.0, 1, payload, timing)
    assert received is not None
    assert received.navigation is not None
    assert received.navigation.travel_s == pytest.approx(travel_s + seconds)
    assert received.navigation.sent_s == pytest.approx(10.0 + measured_s - travel_s - seconds)


def test_a_synchronous_packet_has_the_position_at_its_transmission() -> None:
    sender = bridge(1, navigation=True, second_lead_s=0.4)
    sender.set_plan(PLAN)
    sender.set_dead_reckoning(dataclasses.replace(RAW, stamp_s=0.0))
    sender.set_dead_reckoning(dataclasses.replace(RAW, stamp_s=1.0, north_m=RAW.north_m + 1.5))
    payload = sender.poll(1.2)  # goes out at 2.0
    assert payload is not None
    navigation = decode(payload).navigation
    assert navigation is not None
    assert navigation.raw_m == pytest.approx((RAW.north_m + 3.0, RAW.east_m))


def test_mates_are_pinged_in_turn_in_what_is_left_of_own_slots() -> None:
    b = ModemBridge(TDMA, PacketConfig(), 2, 3, modem=ModemFeatures(pings=True))
    b.set_plan(PLAN)
    asked: list[tuple[float, int]] = []
    for now_s in np.arange(0.0, 100.0, 0.5).tolist():
        b.poll(now_s)
        if (mate := b.ping(now_s)) is not None:
            asked.append((now_s, mate))
    # the packet goes out at 10.5, and takes 2.2 s; the ping and its answer are over before the guard
    assert asked == [(13.0, 1), (43.0, 3), (73.0, 1)]
    assert 13.0 + TDMA.ping_s <= 20.0 - TDMA.guard_s


def test_the_answer_to_a_ping_is_a_range_and_no_packet() -> None:
    intake = BridgeIntake(bridge(2, navigation=True))
    intake.add_answer(17.0, 3, Timing(arrival_s=17.0, travel_s=0.25))
    intake.add_answer(18.0, 7, Timing(arrival_s=18.0, travel_s=0.25))
    assert intake.process() == []
    (ranged,) = intake.ranges
    assert (ranged.source, ranged.stamp_s, ranged.travel_s, ranged.by_ping) == (3, 17.0, 0.25, True)
    assert intake.bridge.counts["rejected.source"] == 1
    intake.process()
    assert intake.ranges == []


def test_without_a_fresh_raw_position_a_packet_has_no_samples() -> None:
    b = bridge(navigation=True)
    b.set_plan(PLAN)
    assert b.add_soundings(rows(5)) == 0
    assert b.counts["samples.unplaced"] == 5
    assert b.add_soundings(np.column_stack([rows(5), rows(5)[:, 1:3]])) == 5
    b.set_dead_reckoning(RAW)
    payload = b.poll(2.5)  # 2.5 s old
    assert payload is not None
    packet = decode(payload)
    assert (packet.plan, len(packet.samples), packet.navigation) == (PLAN, 0, None)
    assert b.unsent == 5


def test_a_fix_that_does_not_fit_is_left_out_and_counted() -> None:
    b = bridge(navigation=True)
    b.set_plan(PLAN)
    b.set_dead_reckoning(RAW)
    b.set_fix(dataclasses.replace(FIX, north_m=400.0))
    payload = b.poll(0.5)
    assert payload is not None
    navigation = decode(payload).navigation
    assert navigation is not None
    assert navigation.fix_off_dm is None
    assert b.counts["navigation.outside"] == 1


def test_after_a_restart_the_last_fix_is_sent_again() -> None:
    told: list[tuple[object, ...]] = []
    first = bridge(navigation=True)
    first.remember = lambda kind, *values: told.append((kind, *values))
    first.set_plan(PLAN)
    first.set_fix(FIX)
    second = bridge(navigation=True)
    second.recall(told)
    second.set_dead_reckoning(RAW)
    payload = second.poll(0.5)
    assert payload is not None
    navigation = decode(payload).navigation
    assert navigation is not None
    assert navigation.fix_raw_m == (60.0, -22.0)


def test_sends_the_latest_plan() -> None:
    b = bridge()
    b.set_plan(PLAN)
    b.set_plan(dataclasses.replace(PLAN, step=5, actions=(4,)))
    payload = b.poll(1.0)
    assert payload is not None
    assert (decode(payload).plan.step, decode(payload).plan.actions) == (5, (4,))


def test_backlog_after_a_gap_spreads_over_it() -> None:
    b = bridge()
    b.set_plan(PLAN)
    b.add_soundings(rows(300))
    payload = b.poll(301.0)
    assert payload is not None
    got = decode(payload).samples[:, 2]
    assert len(got) == 19
    assert got[0] == 0
    assert got[-1] == 299
    assert np.diff(got).max() <= 17
    assert b.unsent == 281


def test_each_sample_is_sent_once_and_none_starves() -> None:
    b = bridge(1, 1)
    b.set_plan(PLAN)
    sent: list[float] = []
    for slot in range(400):
        if slot < 60:
            b.add_soundings(rows(30, 30.0 * slot))
        payload = b.poll(10.0 * slot + 1.0)
        assert payload is not None
        sent += decode(payload).samples[:, 2].tolist()
    assert sorted(sent) == list(range(1800))
    assert b.counts["samples.sent"] == b.counts["samples.queued"] == 1800


def test_late_soundings_take_their_position_in_time() -> None:
    b = bridge()
    b.add_soundings(rows(3, 10.0))
    b.add_soundings(rows(3, 0.0))
    assert backlog(b)[:, 0].tolist() == [0, 1, 2, 10, 11, 12]


def test_soundings_outside_the_limits_are_not_queued() -> None:
    b = ModemBridge(TDMA, PacketConfig(), 1, 3, limits=Limits(north_m=(0.0, 10.0), depth_m=(0.0, 50.0)))
    assert b.add_soundings([[0, 5, 0, 5], [1, 11, 0, 5], [2, 5, 0, 51], [3, 6, 0, 6]]) == 2
    assert b.counts["samples.outside"] == 2


@pytest.mark.parametrize("bad", [[[0.0, 1.0, 2.0]], [0.0, 1.0, 2.0, 3.0], np.zeros((2, 5))])
def test_soundings_of_another_shape_are_refused(bad: object) -> None:
    with pytest.raises(ValueError, match=r"the shape \(n, 4\), \(n, 6\) or \(n, 7\)"):
        bridge().add_soundings(bad)  # type: ignore[arg-type]


def test_soundings_that_are_not_finite_are_dropped_and_counted() -> None:
    b = bridge()
    rows_ = [[0, 1, 1, 1], [1, 2, math.nan, 3], [math.inf, 2, 2, 3], [3, 2, 2, -math.inf], [4, 2, 2, 3]]
    assert b.add_soundings(rows_) == 2
    assert b.counts["samples.bad"] == 3
    assert backlog(b)[:, 0].tolist() == [0, 4]
    assert b.add_soundings([[5, 2, 2, math.nan]]) == b.add_soundings([]) == 0
    assert b.unsent == 2


def test_a_plan_that_does_not_fit_is_refused_and_the_previous_one_stays() -> None:
    b = bridge()
    b.set_plan(PLAN)
    with pytest.raises(PacketError, match="step is 70000"):
        b.set_plan(dataclasses.replace(PLAN, step=70000))
    payload = b.poll(1.0)
    assert payload is not None
    assert decode(payload).plan.step == 4


def test_receives_plan_and_samples() -> None:
    b = bridge(1)
    packet = Packet(PLAN, np.arange(6.0).reshape(2, 3))
    received = b.receive(12.5, 2, encode(packet))
    assert received is not None
    assert (received.source, received.stamp_s, received.packet) == (2, 12.5, packet)
    assert b.counts == {"received": 1, "received.2": 1, "samples.received": 2}


def test_refused_packets_are_counted_by_reason() -> None:
    b = ModemBridge(TDMA, PacketConfig(), 1, 3, limits=Limits(n_actions=11, north_m=(-100.0, 100.0)))
    good = encode(Packet(PLAN))
    for source, payload in (
        (2, good[:-1]),
        (2, b""),
        (1, good),
        (0, good),
        (4, good),
        (2, encode(Packet(dataclasses.replace(PLAN, actions=(11,))))),
        (3, encode(Packet(dataclasses.replace(PLAN, north_m=101.0)))),
        (3, good[:2] + b"\x00\x00\xc0\x7f" + good[6:]),
    ):
        assert b.receive(1.0, source, payload) is None
    assert {k: v for k, v in b.counts.items() if v} == {
        "rejected.length": 2,
        "rejected.source": 3,
        "rejected.action": 1,
        "rejected.position": 1,
        "rejected.not_finite": 1,
    }


def missed(b: ModemBridge) -> dict[str, int]:
    return {k.removeprefix("slots.missed."): v for k, v in b.counts.items() if k.startswith("slots.missed.") and v}


def test_missed_slots_and_why() -> None:
    b = bridge(1, 3)  # own slots at 0, 30, 60, ...
    for t in range(12):
        b.poll(float(t))
    assert missed(b) == {"plan": 1}
    b.set_plan(PLAN)
    b.poll(29.0)
    assert b.poll(31.0) is not None
    b.poll(59.0)
    b.poll(68.0)
    assert b.poll(69.0) is None
    b.poll(70.0)
    assert missed(b) == {"plan": 1, "late": 1}
    b.poll(155.0)  # slots at 90, 120 and 150 begun; the last still goes on
    assert b.counts["slots.used"] == 2
    assert missed(b) == {"plan": 1, "late": 1, "asleep": 2}
    assert b.poll(184.0) is not None
    b.poll(190.0)
    assert missed(b) == {"plan": 1, "late": 1, "asleep": 2}


@pytest.mark.parametrize("order", [(1,), (2,), (1, 2), (1, 1, 2), (2, 1, 0, 1), (1, 2, 3, 1, 1)])
def test_slots_slept_through_are_counted_exactly(order: tuple[int, ...]) -> None:
    rng = np.random.default_rng(len(order))
    for _ in range(50):
        b = ModemBridge(TdmaConfig(order=order), PacketConfig(), 1, 3)
        first, last = sorted(rng.integers(0, 60, 2).tolist())
        b.poll(10.0 * first + 5.0)
        b.poll(10.0 * last + 5.0)
        # no plan: each own slot from the first poll's to the one before the last poll's was missed
        assert sum(missed(b).values()) == sum(order[i % len(order)] == 1 for i in range(first, last))


def test_joins_in_mid_cycle() -> None:
    b = bridge(3, 3)
    b.set_plan(PLAN)
    assert b.poll(1_000_004.0) is None  # slot 100000, owner 2
    assert b.poll(1_000_011.0) is not None
    assert missed(b) == {}


def test_a_clock_set_back_sends_no_slot_twice() -> None:
    b = bridge(1, 3)
    b.set_plan(PLAN)
    assert b.poll(32.0) is not None
    assert b.poll(25.0) is None
    assert b.poll(31.0) is None
    assert b.poll(61.0) is not None


def test_no_counter_is_used_twice_whatever_the_clock_does_and_however_often_the_node_is_restarted() -> None:
    """Two packets with the tag of one slot would let a receiver refuse the true one."""
    rng = np.random.default_rng(3)
    used: list[tuple[str, float]] = []
    b, now_s = tagged_team()[0], 1e4
    for _ in range(60):
        for _ in range(int(rng.integers(2, 300))):
            now_s += 0.5
            if b.poll(now_s) is not None:
                tags = b.counters()["tags"]
                used.append((tags["era"], tags["sealed_s"]))
        now_s += rng.choice([0.0, 0.0, -34.0, -3600.0, 3600.0, 7.0])
        values = json.loads(json.dumps(b.counters()))
        if rng.random() < 0.5:
            b = tagged_team()[0]
            if rng.random() < 0.7:
                b.restore_counters(values)
            else:  # lost
                b.begin_era()
    assert len(used) > 80
    assert len(used) == len(set(used))


def test_what_was_accepted_is_not_accepted_again_after_a_restart() -> None:
    one, two = tagged_team()[:2]
    payload = one.poll(1.0)
    assert payload is not None
    assert two.receive(2.0, 1, payload) is not None
    again = tagged_team()[1]
    again.restore_counters(json.loads(json.dumps(two.counters())))
    assert again.receive(3.0, 1, payload) is None
    assert again.counts["rejected.replay"] == 1


def test_samples_that_the_modem_did_not_send_are_requeued() -> None:
    b = bridge()
    b.not_sent(1.0)  # nothing to take back
    b.set_plan(PLAN)
    b.add_soundings(rows(40))
    assert b.poll(1.0) is not None
    assert b.unsent == 21
    b.not_sent(7.0)  # none was given out then
    assert b.unsent == 21
    b.not_sent(1.0)
    b.not_sent(1.0)
    assert backlog(b).tolist() == rows(40).tolist()
    assert missed(b) == {"modem": 1}
    assert b.counts["sent"] == b.counts["slots.used"] == b.counts["samples.sent"] == 0


def test_settings_change_at_a_cycles_start() -> None:
    b = bridge(1, 3)
    b.set_plan(PLAN)
    assert b.tdma.change(TdmaConfig(order=(2, 1), slot_s=20.0), 5.0) == 30.0
    sent = [t for t in range(130) if b.poll(float(t)) is not None]
    assert sent == [1, 61, 101]  # [20, 40) of the new settings began before the change
    assert missed(b) == {}


def test_tag_within_a_team() -> None:
    key = bytes(range(16))
    config = PacketConfig(tag=True, key_file="key", session="a")
    team = [ModemBridge(TDMA, config, a, 3, key=key) for a in (1, 2)]
    outsider = ModemBridge(TDMA, PacketConfig(), 2, 3)
    for b in (*team, outsider):
        b.set_plan(PLAN)
        b.add_soundings(rows(19))
    payload, forged = team[1].poll(11.0), outsider.poll(11.0)
    assert payload is not None
    assert forged is not None
    assert payload[:-6] == forged[:-6]
    assert team[0].receive(13.0, 2, payload) is not None
    assert team[0].receive(23.0, 2, payload) is None
    assert team[0].receive(33.0, 2, forged) is None
    assert team[0].receive(33.0, 3, payload) is None
    assert outsider.receive(13.0, 1, payload) is None
    assert team[0].counts["rejected.replay"] == 1
    assert team[0].counts["rejected.tag"] == 2
    assert outsider.counts["rejected.spare"] == 1


def tagged_team(session: str = "a") -> list[ModemBridge]:
    config = PacketConfig(tag=True, key_file="key", session=session)
    team = [ModemBridge(TDMA, config, a, 3, key=bytes(range(16))) for a in (1, 2)]
    for b in team:
        b.set_plan(PLAN)
    return team


def test_an_old_packet_is_refused_even_by_a_receiver_that_has_forgotten_it() -> None:
    payload = tagged_team()[1].poll(11.0)
    restarted = tagged_team()[0]
    for late_s in (70.0, 100.0, 2900.0):  # two cycles of 30 s later and on
        assert restarted.receive(11.0 + late_s, 2, payload) is None
    assert restarted.counts["rejected.stale"] == 3
    assert restarted.receive(13.0 + 86400.0, 2, payload) is None  # the next day, with the same key and name
    assert restarted.counts["rejected.tag"] == 1
    assert restarted.receive(13.0, 2, payload) is not None
    assert tagged_team("b")[0].receive(13.0, 2, payload) is None


def test_a_restarted_sender_is_heard_at_once() -> None:
    listener, sender = tagged_team()
    sender.set_plan(dataclasses.replace(PLAN, step=40))
    assert listener.receive(13.0, 2, sender.poll(11.0)) is not None
    restarted = tagged_team()[1]  # plans from an earlier step
    assert listener.receive(43.0, 2, restarted.poll(41.0)) is not None


def cycle(team: list[ModemBridge], start_s: float) -> list[bool]:
    """Whether each of two vehicles' packets is heard, in a cycle of slots."""
    return [
        team[1 - k].receive(start_s + 10.0 * k + 3.0, k + 1, team[k].poll(start_s + 10.0 * k + 1.0)) is not None
        for k in (0, 1)
    ]


@pytest.mark.parametrize("restarted", [False, True])
def test_vehicles_whose_wrong_clocks_are_corrected_hear_each_other_again(restarted: bool) -> None:
    team = tagged_team()
    journals: list[list[str]] = [[], []]
    for b, journal in zip(team, journals, strict=True):
        b.remember = lambda *event, journal=journal: journal.append(json.dumps(event))

    assert cycle(team, 3600.0) == [True, True]
    if restarted:
        team = tagged_team()
        for b, journal in zip(team, journals, strict=True):
            b.recall([json.loads(event) for event in journal])
    assert [cycle(team, 30.0 * n) for n in range(3)] == [[True, True]] * 3
    assert not [text for b in team for text in bridge_problems(b, 90.0).values()]


def test_a_vehicle_that_lost_its_state_in_a_later_era_is_named_and_heard_after_an_answer() -> None:
    team = tagged_team()
    assert [cycle(team, start_s) for start_s in (7200.0, 3600.0, 0.0)] == [[True, True]] * 3
    team[0] = tagged_team()[0]
    team[0].begin_era()
    assert cycle(team, 30.0) == [False, True]
    assert "vehicle 1 are refused: a clock was set back" in " ".join(bridge_problems(team[1], 60.0).values())
    assert [cycle(team, 30.0 * (2 + n)) for n in range(3)] == [[True, True]] * 3


@pytest.mark.parametrize(("off_s", "words"), [(3600.0, "3600 s ahead of"), (-7200.0, "7200 s behind")])
def test_a_clock_that_is_hours_off_is_named(off_s: float, words: str) -> None:
    listener, sender = tagged_team()
    assert listener.receive(7213.0, 2, sender.poll(7211.0 + off_s)) is None
    assert f"its clock is about {words} this vehicle's" in bridge_problems(listener, 7220.0)["stale of 2"]


def test_a_call_to_abort_needs_a_tag_unless_configured_otherwise() -> None:
    listener, sender = tagged_team()
    assert not listener.must_abort(listener.receive(13.0, 2, sender.poll(11.0)))
    sender.abort_calls.own = True
    received = listener.receive(43.0, 2, sender.poll(41.0))
    assert (received.packet.plan.actions, received.packet.plan.naive_path) == ((), 0xFF), "it goes nowhere"
    assert listener.must_abort(received)
    stranger = bridge(2)
    stranger.set_plan(PLAN)
    stranger.abort_calls.own = True
    call = stranger.poll(11.0)
    assert listener.receive(73.0, 2, call) is None, "without the key it is no packet at all"
    plain = bridge(1)
    assert not plain.must_abort(plain.receive(13.0, 2, call))
    assert plain.counts["aborts_refused.2"] == 1
    trusting = bridge(1, abort_without_tag=True)
    assert trusting.must_abort(trusting.receive(13.0, 2, call))
    assert trusting.counts["aborts.2"] == 1


def test_a_call_to_abort_is_not_obeyed_again_after_a_reset() -> None:
    own, mate = bridge(1, abort_without_tag=True), bridge(2)
    mate.set_plan(PLAN)
    remembered: list[tuple[object, ...]] = []
    own.remember = lambda *event: remembered.append(json.loads(json.dumps(event)))

    def hears(start_s: float, listener: ModemBridge) -> bool:
        return listener.must_abort(listener.receive(start_s + 2.0, 2, mate.poll(start_s)))

    mate.abort_calls.own = True
    assert hears(11.0, own)
    assert hears(41.0, own), "as long as safety_node has not said that it is done"
    own.abort_calls.own = True
    assert not hears(71.0, own)
    own.abort_calls.own = False  # RESET here; the mate still calls
    assert not hears(101.0, own)
    again = bridge(1, abort_without_tag=True)
    again.recall(remembered)
    assert not hears(131.0, again), "nor after a restart"
    mate.abort_calls.own = False
    assert not hears(161.0, own)
    mate.abort_calls.own = True
    assert hears(191.0, own), "a new call"


def test_a_call_sent_before_the_mate_was_reset_does_not_abort_again() -> None:
    own, mate = bridge(1, abort_without_tag=True), bridge(2)
    mate.set_plan(PLAN)
    own.abort_calls.own = mate.abort_calls.own = True  # neither has heard the other
    in_the_water = mate.poll(11.0)
    own.abort_calls.own = mate.abort_calls.own = False  # RESET to both
    assert not own.must_abort(own.receive(13.0, 2, in_the_water))
    assert not own.must_abort(own.receive(43.0, 2, mate.poll(41.0)))
    mate.abort_calls.own = True
    assert own.must_abort(own.receive(73.0, 2, mate.poll(71.0))), "a new call"


def test_a_mate_that_goes_on_calling_after_the_reset_is_obeyed_from_its_second_packet() -> None:
    own, mate = bridge(1, abort_without_tag=True), bridge(2)
    mate.set_plan(PLAN)
    own.abort_calls.own = mate.abort_calls.own = True
    own.abort_calls.own = False
    assert not own.must_abort(own.receive(13.0, 2, mate.poll(11.0)))
    assert own.must_abort(own.receive(43.0, 2, mate.poll(41.0)))


def test_a_packet_that_comes_again_with_its_samples_ends_no_call() -> None:
    own, mate = bridge(1, abort_without_tag=True), bridge(2)
    mate.set_plan(PLAN)
    mate.abort_calls.own = True
    received = own.receive(13.0, 2, mate.poll(11.0))
    assert own.must_abort(received)
    own.abort_calls.own = True
    again = dataclasses.replace(received, packet=dataclasses.replace(received.packet, abort=False), again=True)
    assert not own.must_abort(again)
    assert own.abort_calls.obeyed == {2}


def test_a_vehicle_without_a_plan_can_call_to_abort() -> None:
    listener, waiting = bridge(1, abort_without_tag=True), bridge(2)
    assert waiting.poll(11.0) is None
    waiting.abort_calls.own = True
    received = listener.receive(43.0, 2, waiting.poll(41.0))
    assert received is not None
    assert listener.must_abort(received)
    assert received.packet.plan.actions == ()


def test_a_call_to_abort_that_mates_ignore_is_reported() -> None:
    plain, trusting = bridge(1), bridge(1, abort_without_tag=True)
    assert bridge_problems(plain, 0.0) == {}
    plain.abort_calls.own = trusting.abort_calls.own = True
    assert "packet.tag" in bridge_problems(plain, 0.0)["abort"]
    assert bridge_problems(trusting, 0.0) == {}


@pytest.mark.parametrize("apart_s", [-7.0, -2.0, 2.0, 7.0])
def test_clocks_some_seconds_apart_do_not_break_the_tag(apart_s: float) -> None:
    listener, sender = tagged_team()
    for cycle in range(5):
        sent_s = 11.0 + 30.0 * cycle
        assert listener.receive(sent_s + 2.0 + apart_s, 2, sender.poll(sent_s)) is not None


def test_contradictory_settings_are_refused() -> None:
    with pytest.raises(ValueError, match=r"packet.tag is true, but there is no key"):
        ModemBridge(TDMA, PacketConfig(tag=True, key_file="key", session="a"), 1, 3)
    with pytest.raises(ValueError, match="key_file is empty, but tag: true needs"):
        PacketConfig(tag=True)
    with pytest.raises(ValueError, match="depth_min_m is 5 m, but must be below"):
        PacketConfig(depth_min_m=5.0, depth_max_m=5.0)


def test_a_late_failure_report_requeues_its_own_packet() -> None:
    b = bridge()
    b.set_plan(PLAN)
    b.add_soundings(rows(60))
    first, second = b.poll(1.0), b.poll(31.0)
    assert first is not None
    assert second is not None
    b.not_sent(1.0)
    assert b.unsent == 41
    assert set(decode(first).samples[:, 2]) <= set(backlog(b)[:, 3])
    assert not set(decode(second).samples[:, 2]) & set(backlog(b)[:, 3])
    b.not_sent(31.0)
    assert b.unsent == 60
    assert b.counts["sent"] == b.counts["samples.sent"] == 0
    assert missed(b)["modem"] == 2


@pytest.mark.parametrize("loss", [0.0, 0.4, 1.0])
def test_loss_is_estimated_from_the_slots_of_others(loss: float) -> None:
    rng = np.random.default_rng(4)
    b = ModemBridge(TdmaConfig(order=(1, 2, 0, 3)), PacketConfig(), 1, 3)
    estimates = []
    for t in range(40 * 200):
        owner = b.tdma.slot(float(t)).owner
        if owner in (2, 3) and t % 10 == 4 and rng.random() >= loss:
            assert b.receive(float(t), owner, encode(Packet(PLAN))) is not None
        b.poll(float(t))
        estimates.append(b.loss)
    assert estimates[0] == 0.0
    late = estimates[len(estimates) // 4 :]
    # an exponential mean with gain 0.1 scatters by sqrt(0.1 / 1.9) of one draw's deviation; its mean far less
    assert np.mean(late) == pytest.approx(loss, abs=0.06)


@pytest.mark.parametrize("vehicles", [1, 2, 3, 20])
def test_a_team_over_a_lossy_wire(vehicles: int) -> None:
    """Every sample that was sent and not lost arrives once, whatever the loss; the schedule is kept by all."""
    rng = np.random.default_rng(vehicles)
    team = [bridge(a, vehicles) for a in range(1, vehicles + 1)]
    heard: list[Counter[float]] = [Counter() for _ in team]
    sent: list[Counter[float]] = [Counter() for _ in team]
    delivered = [0] * vehicles
    cycles = 6
    for t in range(10 * vehicles * cycles):
        for b in team:
            b.add_soundings([[t, 1.0, 2.0, (t * vehicles + b.address - 1) / 8.0]])
            b.set_plan(dataclasses.replace(PLAN, step=t))
        payloads = [(b.address, p) for b in team if (p := b.poll(float(t))) is not None]
        assert len(payloads) <= 1
        for source, payload in payloads:
            assert source == team[0].tdma.slot(t).owner
            sent[source - 1].update(decode(payload).samples[:, 2].tolist())
            for b in team:
                if b.address != source and rng.random() > 0.3:
                    received = b.receive(t + 3.0, source, payload)
                    assert received is not None
                    assert received.packet.plan.step == t
                    heard[b.address - 1].update(received.packet.samples[:, 2].tolist())
                    delivered[b.address - 1] += 1
    for i, b in enumerate(team):
        assert b.counts["slots.used"] == cycles
        assert missed(b) == {}
        assert set(sent[i].values()) <= {1}
        assert set(heard[i].values()) <= {1}
        assert set(heard[i]) <= set().union(*(sent[j] for j in range(vehicles) if j != i))
        assert b.counts["received"] == delivered[i]
        assert not [k for k in b.counts if k.startswith("rejected")]
