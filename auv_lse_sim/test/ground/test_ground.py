"""Rectangles of ground, and the ground of a mission."""

import numpy as np
import pytest

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.extent import Extent
from auv_lse_run.shipped_files import shipped_file
from auv_lse_sim.ground.ground_source import ground_of


def test_empty_extent_is_refused():
    with pytest.raises(ValueError, match="is empty"):
        Extent(north_min_m=0, north_max_m=0, east_min_m=0, east_max_m=5)


def test_the_ground_of_a_mission_is_built_once(tmp_path):
    mission = shipped_file("missions/default.yaml")
    lake = Settings.load(mission)
    assert ground_of(lake) is ground_of(lake.with_overrides({"mission.steps": 7}))
    assert ground_of(lake) is not ground_of(lake.with_overrides({"mission.seed": 77}))
    file = tmp_path / "grid.npz"
    axis = np.arange(0.0, 60.0, 10.0)
    survey = lake.with_overrides({"sim.bathymetry.file": str(file)})
    for depth_m in (10.0, 12.5):
        np.savez(file, north_m=axis, east_m=axis, depth_m=np.full((6, 6), depth_m) + axis / 100.0)
        found = ground_of(survey)
        assert found is ground_of(survey)
        assert found.depth_m(20.0, 0.0) == pytest.approx(depth_m), "a changed file is read again"
