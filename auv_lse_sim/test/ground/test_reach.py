"""Ground that vehicles cannot reach is left out of a mission, and the mission says so."""

import re
from pathlib import Path

import numpy as np
import pytest

from auv_lse_common.mission_file.operating_area import OperatingArea, free_m2
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.plurals import area_size
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_sim.ground.ground_source import ground_of
from auv_lse_sim.ground.navigable import fit_to_ground
from auv_lse_sim.ground.reach import clip_to_reachable, without_unreachable
from auv_lse_sim.ground.reachable import unreached_parts

GATE = [
    0.0,
    0.0,
    0.0,
    150.0,
    150.0,
    150.0,
    150.0,
    88.0,
    170.0,
    88.0,
    170.0,
    150.0,
    320.0,
    150.0,
    320.0,
    0.0,
    170.0,
    0.0,
]
GATE += [170.0, 62.0, 150.0, 62.0, 150.0, 0.0]
#: A real lake beside the repository.
TZIBANA = Path(__file__).parents[4] / "shared" / "data" / "tzibana_grid10m.npz"


def behind_a_gate(**overrides):
    locations = {"vehicle.start_north_m": 60.0, "vehicle.start_east_m": 60.0}
    return Settings.load(None, {"area.polygon_m": GATE, **locations, **overrides})


def test_ground_behind_a_gate_is_left_out_and_named():
    fitted, (note,) = clip_to_reachable(behind_a_gate())
    assert "area: 50 % of it (2.3 ha) cannot be reached from the starts" in note
    assert "The strait at north 1" in note
    assert "is 24 m wide" in note
    assert "A safe turn needs 50 m" in note
    found = re.search(r"start vehicles there, as at north (\d+), east (\d+) m", note)
    north, east = map(float, found.groups())
    there = clip_to_reachable(behind_a_gate(**{"vehicle.start_north_m": north, "vehicle.start_east_m": east}))[0]
    assert OperatingArea(there.area).contains(np.array([[200.0, 75.0], [318.0, 2.0], [318.0, 148.0]])).all()
    area = OperatingArea(fitted.area)
    assert list(area.no_go) == ["unreachable_1"]
    assert not area.contains(np.array([[200.0, 75.0], [318.0, 2.0], [318.0, 148.0]])).any()
    assert area.contains(np.array([[145.0, 75.0], [2.0, 2.0], [60.0, 60.0]])).all()
    assert area.unreachable_m2 == pytest.approx(150.0 * 150.0, rel=0.05)
    again, notes = clip_to_reachable(fitted)
    assert again.to_patterns() == fitted.to_patterns()
    assert notes == [note]
    assert without_unreachable(fitted).to_patterns() == behind_a_gate().to_patterns()


def test_strips_and_clearance_are_those_of_the_ground_that_is_left():
    fitted, _ = clip_to_reachable(behind_a_gate())
    motion = MotionTable(fitted.motion)
    space, whole = (FreeSpace(OperatingArea(s.area), motion) for s in (fitted, behind_a_gate()))
    assert space.outline_m[:, 0].max() < 170.0
    assert whole.outline_m[:, 0].max() == 320.0
    # Wherever a vehicle could go before, it can go now.
    state = np.array([0.0, 60.0, 60.0])
    rng = np.random.default_rng(1)
    for _ in range(400):
        actions = whole.choices(state)
        assert actions.tolist() == space.choices(state).tolist()
        state = motion.end_state(state, int(rng.choice(actions)))


def test_water_around_the_ground_that_is_left_is_cut_into_simple_polygons():
    # A basin within a moat too narrow to turn, all around, behind a spit that leaves it one gap.
    corners = [(115, 115), (115, 285), (285, 285), (285, 115), (150, 115), (150, 135), (265, 135), (265, 265)]
    spit = [float(x) for corner in [*corners, (135, 265), (135, 115)] for x in corner]
    square = [80.0, 80.0, 80.0, 320.0, 320.0, 320.0, 320.0, 80.0]
    mission = Settings.load(
        None,
        {
            "area": {"polygon_m": square, "no_go": {"spit": spit}},
            "vehicle": {"start_north_m": 200.0, "start_east_m": 200.0},
        },
    )
    fitted, notes = clip_to_reachable(mission)
    assert len(notes) == 1
    area = OperatingArea(fitted.area)
    assert area.contains(np.array([[200.0, 200.0]])).all()
    assert not area.contains(np.array([[95.0, 200.0], [305.0, 200.0], [200.0, 95.0], [200.0, 305.0]])).any()


@pytest.mark.parametrize("raster_m", [2.0, 5.0])
def test_the_note_and_the_report_have_one_size_of_the_ground_that_is_left_out(raster_m: float):
    fitted, (note,) = clip_to_reachable(behind_a_gate(**{"area.raster_m": raster_m}))
    left_out_m2, left_m2 = OperatingArea(fitted.area).unreachable_m2, free_m2(fitted.area)
    share = f"{100.0 * left_out_m2 / (left_out_m2 + left_m2):.0f} %"
    assert note.startswith(f"area: {share} of it ({area_size(left_out_m2)}) cannot be reached from the starts")


def test_a_mission_in_open_water_stays_as_it_is():
    settings = Settings.load()
    fitted, notes = clip_to_reachable(settings)
    assert fitted is settings
    assert not notes


@pytest.mark.skipif(not TZIBANA.is_file(), reason=f"needs {TZIBANA}, which is not part of the repository")
def test_a_concave_lake_is_clipped_to_what_is_reached():
    settings = Settings.load(None, {"sim.bathymetry.file": str(TZIBANA), "area.margin_m": 20.0, "area.raster_m": 4.0})
    fitted, notes = fit_to_ground(settings, ground_of(settings))
    assert any("area: 4 % of it (" in note and "cannot be reached" in note for note in notes)
    area = OperatingArea(fitted.area)
    v = fitted.vehicle(1).vehicle
    start = np.array([[v.start_heading_rad, v.start_north_m, v.start_east_m]])
    assert not unreached_parts(FreeSpace(area, MotionTable(fitted.motion), settings.area.raster_m), start)
    assert area.unreachable_m2 == pytest.approx(4.9e4, rel=0.1)
