"""What the benchmark of straight legs finds, and that the check's bound holds."""

import math

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.vocabulary.leg import straight_stray_m
from benchmarks.navigation.straight_legs import compare, flown, planned, strays_m

ACCEPTANCE_M = 4.0


def test_more_points_follow_the_arc_and_cost_speed():
    rows = compare([0.5 * math.pi, 0.0] * 4, ACCEPTANCE_M)
    speeds = [speed_mps for _, speed_mps, _, _ in rows]
    strays = [farthest_m for _, _, _, farthest_m in rows]
    assert speeds == sorted(speeds, reverse=True)
    assert strays == sorted(strays, reverse=True)
    assert speeds[0] / speeds[-1] > 1.3


@pytest.mark.parametrize("seed", range(4))
def test_the_bound_of_the_check_holds(seed):
    config = MotionConfig()
    actions = [math.radians(a) for a in np.random.default_rng(seed).choice(config.actions_deg, 20)]
    legs = planned(actions, config)
    track, _ = flown(legs, 1, ACCEPTANCE_M)
    farthest_m = float(strays_m(legs, track).max())
    assert 2.0 < farthest_m <= straight_stray_m(0.5 * math.pi, config.turn_radius_m, ACCEPTANCE_M)
