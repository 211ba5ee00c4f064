"""What the benchmark of straight legs finds, and that the check's bound holds."""

import itertools
import math

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.vocabulary.leg import arc_stray_m, corner_stray_m
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
    assert 2.0 < farthest_m <= arc_stray_m(0.5 * math.pi, config.turn_radius_m, ACCEPTANCE_M)


@pytest.mark.parametrize("seed", range(4))
def test_between_the_ends_of_legs_the_path_strays_less(seed):
    """The free space covers the straight lines, so the margin has to cover the corners only."""
    actions = [math.radians(a) for a in np.random.default_rng(seed).choice(MotionConfig().actions_deg, 20)]
    legs = planned(actions, MotionConfig())
    track, _ = flown(legs, 1, ACCEPTANCE_M)
    ends = np.array([[legs[0].north_m, legs[0].east_m], *(leg.end_state[1:] for leg in legs)])
    lines = np.concatenate([a + np.linspace(0.0, 1.0, 200)[:, None] * (b - a) for a, b in itertools.pairwise(ends)])
    farthest_m = max(float(np.hypot(*(lines - position).T).min()) for position in track[::10])
    assert 0.5 < farthest_m <= corner_stray_m(0.5 * math.pi, ACCEPTANCE_M)
