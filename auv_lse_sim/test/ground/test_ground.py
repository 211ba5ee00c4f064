"""Rectangles of ground, and the ground of a mission."""

import os
from pathlib import Path

import numpy as np
import pytest

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.extent import Extent
from auv_lse_run.shipped_files import shipped_file
from auv_lse_sim.ground import ground_source
from auv_lse_sim.ground.ground_source import GROUND_VARIABLE, ground_of, shared_ground


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


def test_the_processes_of_a_mission_build_its_ground_once(monkeypatch):
    def of_another_process(settings):
        monkeypatch.setattr(ground_source, "_last", None)
        return ground_of(settings)

    built, lake = [], ground_source.SyntheticLake
    monkeypatch.setattr(ground_source, "SyntheticLake", lambda *of: built.append(of) or lake(*of))
    settings = Settings.load(shipped_file("missions/default.yaml"))
    north_m, east_m = np.meshgrid(np.arange(0.0, 500.0, 37.0), np.arange(0.0, 500.0, 37.0))
    with shared_ground() as variables:
        first = of_another_process(settings)
        again = of_another_process(settings)
        assert len(built) == 1
        np.testing.assert_array_equal(first.depth_m(north_m, east_m), again.depth_m(north_m, east_m))
        assert (again.extent, again.describe()) == (first.extent, first.describe())
        of_another_process(settings.with_overrides({"mission.seed": 77}))
        assert len(built) == 2, "another ground is not taken for this one"
        file = Path(variables[GROUND_VARIABLE])
        file.write_bytes(file.read_bytes()[:1000])
        of_another_process(settings)
        assert len(built) == 3, "half a file is not used"
    assert not file.parent.exists()
    assert GROUND_VARIABLE not in os.environ
    of_another_process(settings)
    assert len(built) == 4
    monkeypatch.setattr(ground_source.tempfile, "tempdir", "/nowhere")
    with shared_ground() as variables:
        assert of_another_process(settings) is not first
    assert variables == {}


def test_a_ground_about_the_origin_of_its_file_is_built_once(tmp_path, monkeypatch):
    built, load = [], ground_source.load_ground
    monkeypatch.setattr(ground_source, "load_ground", lambda *of: built.append(of) or load(*of))
    file = tmp_path / "soundings.csv"
    lat_deg, lon_deg = np.meshgrid(46.5 + np.arange(20) * 2e-4, 6.6 + np.arange(20) * 3e-4)
    rows = np.column_stack([lat_deg.ravel(), lon_deg.ravel(), 10.0 + 1e4 * (lat_deg.ravel() - 46.5)])
    np.savetxt(file, rows, delimiter=",", header="lat,lon,depth_m", comments="", fmt="%.7f")
    asked = Settings.load(shipped_file("missions/default.yaml"), {"sim.bathymetry.file": str(file)})
    found = ground_of(asked)
    origin = dict(zip(("area.origin_lat_deg", "area.origin_lon_deg"), found.origin, strict=True))
    assert ground_of(asked.with_overrides(origin)) is found
    assert len(built) == 1
    monkeypatch.setattr(ground_source, "_last", None)
    again = ground_of(asked.with_overrides(origin))
    assert len(built) == 2
    north_m, east_m = np.mgrid[-200:200:9, -200:200:9]
    np.testing.assert_array_equal(again.depth_m(north_m, east_m), found.depth_m(north_m, east_m))
    ground_of(asked.with_overrides({"area.origin_lat_deg": 46.501, "area.origin_lon_deg": 6.602}))
    assert len(built) == 3
