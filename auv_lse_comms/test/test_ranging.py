"""Ranges: where a transmission starts, whom to ping and when, and what a driver tells that cannot be."""

import math

import pytest

from auv_lse_common.mission_file.sections.acoustics import TdmaConfig
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning
from auv_lse_comms.packet.navigation import Navigation
from auv_lse_comms.ranging import Ranging, Timing
from auv_lse_comms.tdma import Tdma


def test_a_travel_time_that_is_not_finite_stays_as_it_is() -> None:
    ranging = Ranging(Tdma(TdmaConfig(), 1, 2), second_lead_s=0.4)
    ranging.set_dead_reckoning(DeadReckoning(stamp_s=100.0, heading_rad=0.0, north_m=0.0, east_m=0.0, depth_m=3.0))
    for travel_s in (math.inf, math.nan):
        timing = Timing(sent_s=100.0, arrival_s=100.3, travel_s=travel_s)
        told = ranging.mate_navigation(101.5, 2, Navigation(raw_cm=(100, 0)), timing)
        assert told is not None
        assert not math.isfinite(told.travel_s), "and modem_node lives on"


def _raw(stamp_s: float, north_m: float, east_m: float) -> DeadReckoning:
    return DeadReckoning(stamp_s=stamp_s, heading_rad=0.0, north_m=north_m, east_m=east_m, depth_m=3.0)


def test_a_packet_holds_the_position_at_its_transmission() -> None:
    """It starts on the next second that is at least .4 s away; the vehicle goes on as in the last second."""
    ranging = Ranging(Tdma(TdmaConfig(), 1, 2), second_lead_s=0.4)
    assert ranging.raw_at_start(100.0) is None
    ranging.set_dead_reckoning(_raw(99.0, 10.0, 20.0))
    ranging.set_dead_reckoning(_raw(100.0, 11.5, 19.0))
    for now_s, stamp_s in ((100.3, 101.0), (100.7, 102.0)):
        told = ranging.raw_at_start(now_s)
        assert told is not None
        assert told.stamp_s == stamp_s
        assert told.north_m == pytest.approx(11.5 + 1.5 * (stamp_s - 100.0))
        assert told.east_m == pytest.approx(19.0 - 1.0 * (stamp_s - 100.0))


def test_one_mate_in_turn_is_pinged_in_what_is_left_of_each_own_slot() -> None:
    config = TdmaConfig()
    tdma = Tdma(config, 2, 3)
    ranging = Ranging(tdma, pings=True)
    pinged = []
    for cycle in range(3):
        slot = tdma.slot(15.0 + 30.0 * cycle)
        key, sent_s = (slot.index, slot.since_s), slot.start_s + config.guard_s
        last_s = slot.end_s - config.guard_s - config.ping_s
        assert ranging.ping(sent_s + config.send_duration_s - 0.01, sent_s, key) is None, "the packet is on its way"
        assert ranging.ping(last_s + 0.01, sent_s, key) is None, "its answer would come in the next slot"
        assert ranging.ping(last_s, sent_s, None) is None, "no packet was sent in this slot"
        pinged.append(ranging.ping(last_s if cycle else sent_s + config.send_duration_s, sent_s, key))
        assert ranging.ping(last_s, sent_s, key) is None, "once a slot"
    assert pinged == [1, 3, 1]
