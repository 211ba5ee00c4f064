"""Ranges: what a driver tells that cannot be."""

import math

from auv_lse_common.dead_reckoning import DeadReckoning
from auv_lse_comms.config import TdmaConfig
from auv_lse_comms.packet.navigation import Navigation
from auv_lse_comms.ranging import Ranging, Timing
from auv_lse_comms.tdma import Tdma


def test_a_travel_time_that_is_not_finite_stays_as_it_is() -> None:
    ranging = Ranging(Tdma(TdmaConfig(), 1, 2), second_lead_s=0.4)
    ranging.moved(DeadReckoning(stamp_s=100.0, heading_rad=0.0, north_m=0.0, east_m=0.0, depth_m=3.0))
    for travel_s in (math.inf, math.nan):
        timing = Timing(sent_s=100.0, arrival_s=100.3, travel_s=travel_s)
        told = ranging.told(101.5, 2, Navigation(raw_cm=(100, 0)), timing)
        assert told is not None
        assert not math.isfinite(told.travel_s), "and modem_node lives on"
