"""A leg as the motion model has it, in numbers for compiled code, is the leg that all packages share."""

import numpy as np
import pytest

from auv_lse_common.vocabulary.leg import Leg
from auv_lse_sim.vehicle.motion_model import leg_length, on_leg
from auv_lse_sim.vehicle.records import LEG, new_record


@pytest.mark.parametrize("action_rad", [0.0, 0.4, -0.4, np.pi / 2.0, -np.pi / 2.0])
def test_a_leg_is_that_of_all_packages(action_rad: float) -> None:
    leg = Leg(step=0, heading_rad=2.5, north_m=10.0, east_m=-4.0, action_rad=action_rad, radius_m=15.0, straight_m=9.0)
    record = new_record(LEG, leg.heading_rad, leg.north_m, leg.east_m, leg.action_rad, leg.radius_m, leg.straight_m)
    assert leg_length(record) == pytest.approx(leg.length_m, rel=1e-15)
    for along_m in np.linspace(-1.0, leg.length_m + 3.0, 23):
        assert on_leg(record, along_m)[:3] == pytest.approx(tuple(leg.state_at(along_m)), rel=1e-14, abs=1e-13)
