"""Vehicles keep their altitude over rising ground, directly simulated and with a simulated ArduSub."""

import numpy as np
import pytest

from benchmarks.navigation.altitude import (
    ASKED_M,
    DEPTH_M,
    FLIGHTS,
    Profile,
    fly,
    rough,
    sawtooth,
    steps,
    trapezoid,
    with_autopilot,
)


@pytest.mark.parametrize("flight", FLIGHTS)
@pytest.mark.parametrize(
    ("ground", "least_m", "over_m"),
    [(trapezoid(0.15), 0.9 * ASKED_M, 260.0), (sawtooth(0.15), 0.9 * ASKED_M, 200.0), (steps(), 1.0, 200.0)],
    ids=["trapezoid", "sawtooth", "steps"],
)
def test_slopes_and_steps(flight, ground, least_m, over_m):
    result = fly(FLIGHTS[flight], ground, over_m)
    assert result.finished
    assert result.least_m >= least_m


def test_behind_a_rise_an_ardusub_returns_to_its_depth_and_loses_little_speed():
    flat = fly(with_autopilot, Profile(((0.0, 30.0), (1.0, 30.0))), 150.0)
    over = fly(with_autopilot, trapezoid(0.25), 280.0)
    assert over.depth_m == pytest.approx(DEPTH_M, abs=0.5)
    assert over.speed_mps >= 0.93 * flat.speed_mps


@pytest.mark.parametrize("flight", FLIGHTS)
def test_rough_ground_is_not_touched(flight):
    assert fly(FLIGHTS[flight], rough(np.random.default_rng(8)), 200.0, 8).least_m >= 1.0
