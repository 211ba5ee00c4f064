import math

import numpy as np
import pytest

from auv_lse_common.vocabulary.leg import Leg, leg_point


def _leg(action_deg, heading_rad=0.3, straight_m=12.0):
    return Leg(
        step=0,
        heading_rad=heading_rad,
        north_m=50.0,
        east_m=60.0,
        action_rad=math.radians(action_deg),
        radius_m=15.0,
        straight_m=straight_m,
    )


def test_points_of_a_leg_worked_by_hand():
    # a quarter circle of 15 m to starboard ends 15 m ahead and 15 m to starboard, then the straight leads to starboard
    quarter = math.pi / 2.0
    assert leg_point(quarter, 15.0, 15.0 * quarter) == pytest.approx((quarter, 15.0, 15.0))
    assert leg_point(quarter, 15.0, 15.0 * quarter + 7.0) == pytest.approx((quarter, 15.0, 22.0))
    assert leg_point(-quarter, 15.0, 15.0 * quarter + 7.0) == pytest.approx((-quarter, 15.0, -22.0))
    # half of it: 45 degrees
    root = 15.0 / math.sqrt(2.0)
    assert leg_point(quarter, 15.0, 7.5 * quarter) == pytest.approx((quarter / 2.0, root, 15.0 - root))
    assert leg_point(0.0, 15.0, 4.0) == (0.0, 4.0, 0.0)
    assert leg_point(quarter, 15.0, -3.0) == pytest.approx((0.0, -3.0, 0.0))  # behind the start


def test_leg_starts_at_its_first_state():
    leg = _leg(90.0, heading_rad=math.pi / 2.0, straight_m=0.0)  # heading east, turns to the south
    assert leg.length_m == pytest.approx(7.5 * math.pi)
    assert leg.state_at(0.0) == pytest.approx([math.pi / 2.0, 50.0, 60.0])
    assert leg.end_state[1:] == pytest.approx([35.0, 75.0])
    assert abs(leg.end_state[0]) == pytest.approx(math.pi)


def test_progress_is_the_arc_length_of_the_nearest_point():
    rng = np.random.default_rng(2)
    for action_deg in (-90.0, -30.0, -5.0, 0.0, 10.0, 20.0, 90.0):
        leg = _leg(action_deg, heading_rad=rng.uniform(-3, 3))
        for along in np.linspace(0.0, leg.length_m + 20.0, 30):
            at = leg.state_at(along)
            assert leg.progress_m(at[1], at[2]) == pytest.approx(along, abs=1e-6)
            # 2 m to starboard: the same point of the leg is nearest
            n, e = at[1] - 2.0 * math.sin(at[0]), at[2] + 2.0 * math.cos(at[0])
            assert leg.progress_m(n, e) == pytest.approx(along, abs=1e-6)
            assert leg.distance_off_m(n, e) == pytest.approx(2.0, abs=1e-6)
        behind = leg.state_at(0.0)
        n, e = behind[1] - 5.0 * math.cos(behind[0]), behind[2] - 5.0 * math.sin(behind[0])
        assert leg.progress_m(n, e) <= 0.0
        assert leg.distance_off_m(n, e) <= 5.0 + 1e-9
