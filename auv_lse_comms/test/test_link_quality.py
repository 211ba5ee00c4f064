"""Arrivals that should not be: clocks apart, one number twice, a transmitter that babbles."""

import pytest

from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_comms.bridge import ModemBridge
from auv_lse_comms.packet.codec import Packet, encode

TDMA = TdmaConfig()
PAYLOAD = encode(Packet(Plan(step=4, heading_rad=0.5, north_m=10.0, east_m=20.0, actions=(), naive_path=0xF1)))


def listener(vehicles: int = 3, tdma: TdmaConfig = TDMA) -> ModemBridge:
    return ModemBridge(tdma, PacketConfig(), 1, vehicles)


def hear(bridge: ModemBridge, source: int, cycles: int, ahead_s: float = 0.0) -> float:
    """Packets of a sender whose clock is ahead, one in each of its slots; the time after the last."""
    cycle_s = TDMA.slot_s * bridge.vehicles
    for cycle in range(cycles):
        sent_s = cycle * cycle_s + (source - 1) * TDMA.slot_s + TDMA.guard_s + 0.3 - ahead_s
        bridge.receive(sent_s + 2.0 + 0.4, source, PAYLOAD)
    return cycles * cycle_s


def test_a_team_whose_clocks_agree_gives_no_problem() -> None:
    bridge = listener()
    now_s = max(hear(bridge, source, 20) for source in (2, 3))
    assert bridge.quality.problems(now_s) == {}
    assert not any(bridge.quality.counts.values())
    assert bridge.counts["received"] == 40


@pytest.mark.parametrize(("ahead_s", "words"), [(-2.0, "0.5 s later"), (-7.0, "5.5 s later"), (4.0, "1.3 s earlier")])
def test_clock_offsets_are_reported(ahead_s: float, words: str) -> None:
    bridge = listener()
    now_s = hear(bridge, 3, 4, ahead_s)
    assert bridge.quality.problems(now_s) == {}  # not by a few packets
    now_s = hear(bridge, 3, 6, ahead_s)
    assert f"packets of vehicle 3 arrive {words} than its slots allow" in bridge.quality.problems(now_s)["clock of 3"]
    assert (bridge.quality.counts["out_of_slot.3"] > 0) == (ahead_s in (-7.0, 4.0))


def test_another_vehicle_with_ones_own_number_is_named() -> None:
    bridge = listener()
    assert bridge.receive(3.0, 1, PAYLOAD) is None
    assert "another modem has this vehicle's number, 1" in bridge.quality.problems(10.0)["own number"]
    assert bridge.quality.problems(1000.0) == {}


def test_a_transmitter_that_sends_too_much_is_limited_and_reported() -> None:
    bridge = listener()
    for second in range(300):
        bridge.receive(float(second), 2, PAYLOAD)
        if second % 30 == 23:
            bridge.receive(float(second), 3, PAYLOAD)
    assert bridge.counts["received.2"] <= 300 / 30 + 2 * 3, "and some ahead, in its slots and outside"
    assert bridge.counts["received.3"] == 10
    assert bridge.counts["rejected.excess"] == 300 - bridge.counts["received.2"]
    assert "packets of vehicle 2 beyond its slots" in bridge.quality.problems(300.0)["excess of 2"]


def test_a_problem_that_is_over_is_not_reported() -> None:
    bridge = listener()
    for second in range(60):
        bridge.receive(float(second), 2, PAYLOAD)
    now_s = hear(bridge, 3, 6, -7.0)
    assert {"excess of 2", "clock of 3"} <= set(bridge.quality.problems(now_s))
    assert bridge.quality.problems(now_s + 310.0) == {}, "ten cycles later"


def test_a_modem_that_also_sends_in_others_slots_is_named() -> None:
    bridge = listener()
    for cycle in range(8):  # in its own slot, and in every second cycle in that of vehicle 3
        bridge.receive(30.0 * cycle + 13.0, 2, PAYLOAD)
        if cycle % 2:
            bridge.receive(30.0 * cycle + 23.0, 2, PAYLOAD)
        if cycle == 3:
            assert "slots of 2" not in bridge.quality.problems(30.0 * cycle + 24.0), "an echo or two are nothing"
    for cycle in (8, 9):
        bridge.receive(30.0 * cycle + 13.0, 2, PAYLOAD)
        bridge.receive(30.0 * cycle + 23.0, 2, PAYLOAD)
    assert bridge.quality.counts["in_slot_of.3.from.2"] == 6
    assert "vehicle 2 sends in slots of others" in bridge.quality.problems(294.0)["slots of 2"]


@pytest.mark.parametrize(("late_s", "key", "session"), [(300.0, "stale of 2", "a"), (0.0, "tag of 2", "b")])
def test_packets_that_the_tag_refuses_are_named(late_s: float, key: str, session: str) -> None:
    def tagged(address: int, session: str) -> ModemBridge:
        config = PacketConfig(tag=True, key_file="key", session=session)
        return ModemBridge(TDMA, config, address, 3, key=bytes(16))

    sender, bridge = tagged(2, "a"), tagged(1, session)
    sender.set_plan(Plan(step=4, heading_rad=0.5, north_m=10.0, east_m=20.0, actions=(), naive_path=0xF1))
    payload = sender.poll(11.0)
    assert payload is not None
    bridge.receive(13.0 + late_s, 2, payload)
    assert key in bridge.quality.problems(20.0 + late_s)
    assert bridge.quality.problems(500.0 + late_s) == {}


def test_packets_in_a_mates_name_outside_of_its_slots_do_not_use_up_its_slots() -> None:
    bridge = listener()
    taken = 0
    for cycle in range(10):
        for second in range(30):  # a forger that keeps out of the slot of vehicle 2, which begins at 10 s
            if not 10 <= second < 20:
                bridge.receive(30.0 * cycle + second, 2, PAYLOAD)
            if second == 13:
                taken += bridge.receive(30.0 * cycle + 13.0, 2, PAYLOAD) is not None
    assert taken == 10
    assert bridge.counts["rejected.excess"] > 150, "the forger is held to as many"
