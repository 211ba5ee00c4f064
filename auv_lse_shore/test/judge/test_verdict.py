"""A map against the true ground."""

import numpy as np
import pytest

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_gp.map.depth_map import DepthField, DepthMap
from auv_lse_record.run_data import GroundGrid
from auv_lse_shore.judge.team_map import mission_settings
from auv_lse_shore.judge.verdict import judge


def test_judging_counts_cells_on_the_wrong_side(synthetic_run):
    run = synthetic_run(steps=1)
    settings = mission_settings(run.parameters, 1)[0]
    grid = DepthMap(settings.gp, settings.level_set, OperatingArea(settings.area)).grid
    depth = np.where(grid.north_m[:, None] < 60.0, 10.0, 20.0) * np.ones(len(grid.east_m))
    mean = depth.copy()
    mean[0, 0] = 16.0  # called safe, is not
    mean[-1, :3] = 14.0  # called unsafe, is safe
    field = DepthField(grid, mean, *np.full((2, *mean.shape), 0.1), *np.zeros((2, *mean.shape)), 1.0, 0)
    ground = GroundGrid(north_m=grid.north_m, east_m=grid.east_m, depth_m=depth, inside=grid.inside)
    verdict = judge(field, settings, ground, grid.inside, [])
    cells, deep = mean.size, int(np.count_nonzero(depth >= 15.0))
    assert verdict.false_safe_m2 == 36.0
    assert verdict.false_unsafe_m2 == 3 * 36.0
    assert verdict.f1 == pytest.approx(2 * (deep - 3) / (2 * (deep - 3) + 4))
    assert verdict.loss == pytest.approx(10.0 * 4 / cells)
    assert verdict.depth_rmse_m == pytest.approx(np.sqrt((3 * 6.0**2 + 6.0**2) / cells))
