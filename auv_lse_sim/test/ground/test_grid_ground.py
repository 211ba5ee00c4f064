"""Ground on a grid."""

import numpy as np
import pytest
from ground_helpers import bottom

from auv_lse_sim.ground.grid_ground import GridGround


def test_grid_is_smooth():
    """No kink at the nodes: the slope's jump across a node line falls with the step, as in a C1 surface."""
    axis = np.arange(0.0, 401.0, 10.0)
    depth = bottom(*np.meshgrid(axis, axis, indexing="ij")) + np.random.default_rng(0).normal(0, 0.2, (41, 41))
    ground = GridGround(axis, axis, depth)
    east = np.linspace(60, 340, 200)

    def jump(h):
        left = (ground.depth_m(200.0, east) - ground.depth_m(200.0 - h, east)) / h
        right = (ground.depth_m(200.0 + h, east) - ground.depth_m(200.0, east)) / h
        return np.abs(right - left).max()

    assert jump(0.1) < 0.02
    assert jump(0.01) < 0.15 * jump(0.1) + 1e-6
    assert (
        np.abs(ground.depth_m(axis[3:38, None], axis[None, 3:38]) - depth[3:38, 3:38]).max() < 1e-9
    )  # through the nodes


def test_land_and_unknown_are_nan():
    axis = np.arange(0.0, 101.0, 10.0)
    depth = np.full((11, 11), 12.0)
    depth[:, :3] = -2.0
    depth[8:, 8:] = np.nan
    ground = GridGround(axis, axis, depth)
    assert np.isnan(ground.depth_m([50.0, 95.0, 50.0], [15.0, 95.0, 101.0])).all()
    assert ground.depth_m(50.0, 60.0) == pytest.approx(12.0)
    assert "33 nodes are land" in ground.describe()
