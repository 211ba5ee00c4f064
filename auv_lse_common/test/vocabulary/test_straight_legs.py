"""An autopilot that travels a straight line to each leg's end stays within the bounds that the check uses."""

import itertools
import math

import numpy as np
import pytest

from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.vocabulary.leg import Leg, arc_stray_m, corner_stray_m

ACCEPTANCE_M = 4.0
CONFIG = MotionConfig()


def planned(seed):
    """Twenty legs with random heading changes of the default actions, one after another."""
    state = np.zeros(3)
    legs = []
    for step, action_deg in enumerate(np.random.default_rng(seed).choice(CONFIG.actions_deg, 20)):
        action_rad = math.radians(action_deg)
        heading, north, east = map(float, state)
        leg = Leg(
            step=step, heading_rad=heading, north_m=north, east_m=east, action_rad=action_rad,
            radius_m=CONFIG.turn_radius_m,
            straight_m=CONFIG.turn_radius_m * (math.radians(CONFIG.theta_max_deg) - abs(action_rad)),
        )  # fmt: skip
        legs.append(leg)
        state = leg.state_at(leg.length_m)
    return legs


def flown(legs, step_m=0.4):
    """Positions (n, 2) of a vehicle that heads for each leg's end, and for the next one once within acceptance."""
    position, track = np.array([legs[0].north_m, legs[0].east_m]), []
    for leg in legs:
        target = leg.end_state[1:]
        within_m = ACCEPTANCE_M if leg is not legs[-1] else 0.1
        while (far_m := float(np.hypot(*(target - position)))) > within_m:
            position = position + (target - position) / far_m * min(step_m, far_m)
            track.append(position)
    return np.array(track)


def farthest_m(track, path):
    """Largest distance of a position of the track from the path (m)."""
    return max(float(np.hypot(*(path - position).T).min()) for position in track)


@pytest.mark.parametrize("seed", range(4))
def test_the_bound_of_the_check_holds(seed):
    legs = planned(seed)
    path = np.array([leg.state_at(along)[1:] for leg in legs for along in np.arange(0.0, leg.length_m, 0.25)])
    stray_m = farthest_m(flown(legs), path)
    assert 2.0 < stray_m <= arc_stray_m(0.5 * math.pi, CONFIG.turn_radius_m, ACCEPTANCE_M)


@pytest.mark.parametrize("seed", range(4))
def test_between_the_ends_of_legs_the_path_strays_less(seed):
    """The free space covers the straight lines, so the margin has to cover the corners only."""
    legs = planned(seed)
    ends = np.array([[legs[0].north_m, legs[0].east_m], *(leg.end_state[1:] for leg in legs)])
    lines = np.concatenate([a + np.linspace(0.0, 1.0, 200)[:, None] * (b - a) for a, b in itertools.pairwise(ends)])
    stray_m = farthest_m(flown(legs), lines)
    assert 0.5 < stray_m <= corner_stray_m(0.5 * math.pi, ACCEPTANCE_M)
