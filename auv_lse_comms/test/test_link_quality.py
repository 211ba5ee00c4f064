"""Arrivals that should not be: clocks apart, one number twice, a transmitter that babbles."""

import pytest

from auv_lse_common.plan import Plan
from auv_lse_comms.bridge import ModemBridge
from auv_lse_comms.config import PacketConfig, TdmaConfig
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
def test_clocks_apart_are_named(ahead_s: float, words: str) -> None:
    bridge = listener()
    now_s = hear(bridge, 3, 4, ahead_s)
    assert bridge.quality.problems(now_s) == {}  # not by a few packets
    now_s = hear(bridge, 3, 6, ahead_s)
    assert f"packets of vehicle 3 come {words} than its slots allow" in bridge.quality.problems(now_s)["clock of 3"]
    assert (bridge.quality.counts["out_of_slot.3"] > 0) == (ahead_s in (-7.0, 4.0))


def test_another_vehicle_with_ones_own_number_is_named() -> None:
    bridge = listener()
    assert bridge.receive(3.0, 1, PAYLOAD) is None
    assert "another modem has this vehicle's number, 1" in bridge.quality.problems(10.0)["own number"]
    assert bridge.quality.problems(1000.0) == {}


def test_a_babbling_transmitter_is_cut_to_its_slots_and_named() -> None:
    bridge = listener()
    for second in range(300):
        bridge.receive(float(second), 2, PAYLOAD)
        if second % 30 == 23:
            bridge.receive(float(second), 3, PAYLOAD)
    assert bridge.counts["received.2"] <= 300 / 30 + 3
    assert bridge.counts["received.3"] == 10
    assert bridge.counts["rejected.excess"] == 300 - bridge.counts["received.2"]
    assert "packets of vehicle 2 beyond its slots are refused" in bridge.quality.problems(300.0)["excess of 2"]
