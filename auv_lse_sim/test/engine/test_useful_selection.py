"""`packet.selection: useful`: the bridge of `auv_lse_comms` with the receivers' risk of `auv_lse_gp`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_comms.packet.codec import Packet, decode, encode
from auv_lse_comms.settings import bridge_of
from auv_lse_gp.map.receivers_risk import ReceiversRisk
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of

Array = NDArray[np.float64]
MISSION: dict[str, Any] = {
    "mission": {"vehicles": 2, "steps": 50},
    "area": {"polygon_m": [0.0, 0.0, 300.0, 0.0, 300.0, 400.0, 0.0, 400.0]},
    "packet": {"selection": "useful", "expected_loss": 0.0, "navigation": False},
}
PLAN = Plan(step=1, heading_rad=0.0, north_m=5.0, east_m=0.0, actions=(1, 1, 1), naive_path=NONE)
OWN_SLOT_S, OTHER_SLOT_S, NEXT_OWN_SLOT_S = 1.0, 11.0, 21.0


def soundings(n: int, seed: int = 1) -> Array:
    rng = np.random.default_rng(seed)
    return np.column_stack([np.arange(n), rng.uniform(0.0, 300.0, n), rng.uniform(0.0, 400.0, n), rng.normal(15, 2, n)])


@pytest.mark.parametrize("waiting", [25, 60, 600])
@pytest.mark.parametrize("heard", [0, 7])
def test_samples_of_a_packet_that_was_not_sent_are_worth_what_they_were(waiting: int, heard: int) -> None:
    """Nothing of the packet stays counted as known: the next packet is the one of a bridge that never made it."""
    bridge, never = (bridge_of(MISSION, "m.yaml", 1, ReceiversRisk.from_parameters) for _ in range(2))
    for b in (bridge, never):
        b.set_plan(PLAN)
        b.add_soundings(soundings(waiting))
    first = bridge.poll(OWN_SLOT_S)
    assert first is not None
    if heard:
        along_m = np.arange(heard, dtype=float)  # where a mate that sends PLAN can have been
        mates = encode(Packet(PLAN, np.column_stack([5.0 + along_m, along_m, 15.0 + 0.0 * along_m])))
        assert bridge.receive(OTHER_SLOT_S, 2, mates) is not None
        assert never.receive(OTHER_SLOT_S, 2, mates) is not None
    bridge.not_sent(OWN_SLOT_S)
    assert bridge.unsent == waiting
    again, expected = bridge.poll(NEXT_OWN_SLOT_S), never.poll(NEXT_OWN_SLOT_S)
    assert again is not None
    assert expected is not None
    np.testing.assert_array_equal(decode(again).samples, decode(expected).samples)
    if not heard:
        np.testing.assert_array_equal(decode(again).samples, decode(first).samples)


def test_a_fault_in_the_maps_parameters_is_named() -> None:
    with pytest.raises(ParameterError, match=r"m.yaml: gp.kernel: got 'none'"):
        bridge_of({**MISSION, "gp": {"kernel": "none"}}, "m.yaml", 1, ReceiversRisk.from_parameters)


def test_a_fleet_flies_with_it() -> None:
    overrides = {
        "mission": {"vehicles": 2, "steps": 4},
        "planner": {"method": "lawnmower"},
        "packet": MISSION["packet"],
    }
    settings = Settings.load(overrides=overrides)
    fleet = Fleet(settings, ground_of(settings))
    fleet.run()
    assert all(cores.bridge.counts["samples.sent"] > 19 for cores in fleet.cores)
