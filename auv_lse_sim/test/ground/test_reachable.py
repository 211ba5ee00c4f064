"""What feasible actions reach: gates, straits that one leg bridges, arms, open water."""

import numpy as np
import pytest
from planner_helpers import world

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_sim.ground.reachable import strait_to, unreached_parts


def two_basins(width_m, length_m):
    """Two squares of 150 m, the second one north of the first, joined by a gate in the middle."""
    w, e, far = 75.0 - width_m / 2.0, 75.0 + width_m / 2.0, 150.0 + length_m
    corners = [(0, 0), (0, 150), (150, 150), (150, e), (far, e), (far, 150), (far + 150, 150), (far + 150, 0), (far, 0)]
    return tuple(float(x) for corner in [*corners, (far, w), (150, w), (150, 0)] for x in corner)


def parts_of(polygon, starts=((0.0, 60.0, 60.0),), **options):
    return unreached_parts(world(polygon, **options)[2], np.array(starts))


def strait_of(polygon, part):
    return strait_to(world(polygon)[2], part)


@pytest.mark.parametrize(("width_m", "length_m"), [(27.0, 20.0), (46.0, 40.0)])
def test_a_gate_narrower_than_a_turn_cuts_off_what_is_behind(width_m, length_m):
    (part,) = parts_of(two_basins(width_m, length_m))
    assert part.area_m2 == pytest.approx(150.0 * 150.0, rel=0.08)
    location_m, strait_width_m = strait_of(two_basins(width_m, length_m), part)
    assert location_m == pytest.approx([150.0 + length_m / 2.0, 75.0], abs=length_m / 2.0 + 4.0)
    assert strait_width_m == pytest.approx(width_m, abs=4.0)


def test_one_leg_bridges_a_short_strait():
    # As narrow as one that is closed if it is long: a leg of 23.6 m leads from a location to turn to the next one.
    assert not parts_of(two_basins(46.0, 6.0))
    assert not parts_of(two_basins(60.0, 40.0))  # a turn fits in


def test_an_arm_without_room_to_turn_is_reached_as_far_as_its_mouth():
    arm = (0.0, 0.0, 150.0, 0.0, 150.0, 55.0, 300.0, 55.0, 300.0, 95.0, 150.0, 95.0, 150.0, 150.0, 0.0, 150.0)
    (part,) = parts_of(arm)
    assert part.area_m2 == pytest.approx(130.0 * 40.0, rel=0.12)
    assert strait_of(arm, part)[1] < 50.0  # a turn needs 2 x (10 m of margin + 15 m of radius)


def test_each_basin_counts_that_has_a_start():
    basins = two_basins(27.0, 20.0)
    assert not parts_of(basins, ((0.0, 60.0, 60.0), (0.0, 240.0, 60.0)))
    (part,) = parts_of(basins, ((0.0, 240.0, 60.0),))
    assert part.nodes[:75].sum() > 0.9 * part.nodes.sum()


def test_the_default_area_can_be_reached_from_anywhere_in_it():
    rectangle = AreaConfig().polygon_m
    for start in ((0.0, 0.0, 0.0), (1.0, 450.0, -20.0), (0.0, 545.0, 645.0), (0.0, 900.0, 900.0)):
        assert not parts_of(rectangle, (start,))
    island = {"island": (100.0, 150.0, 180.0, 150.0, 180.0, 250.0, 100.0, 250.0)}
    assert not parts_of(rectangle, no_go=island)


@pytest.mark.parametrize(("turn_radius_m", "corner_m"), [(2.0, 600.0), (15.0, 9000.0)])
def test_short_legs_and_a_large_area_leave_nothing_out(turn_radius_m, corner_m):
    """The start is at the border, so that the flood is needed."""
    raster_m = turn_radius_m / 3.0
    polygon = [0.0, 0.0, corner_m, 0.0, corner_m, corner_m, 0.0, corner_m]
    area = OperatingArea(AreaConfig(polygon_m=polygon, margin_m=turn_radius_m / 1.5, raster_m=raster_m))
    space = FreeSpace(area, MotionTable(MotionConfig(turn_radius_m=turn_radius_m)), raster_m)
    assert not unreached_parts(space, np.zeros((1, 3)))


@pytest.mark.parametrize("actions_deg", [(-5.0, 0.0, 90.0), (-90.0, 0.0, 5.0), (0.0, 10.0, 90.0)])
def test_a_wide_loop_to_the_other_side_does_not_lead_through_a_gate(actions_deg):
    basins = tuple(4.0 * x for x in two_basins(10.0, 20.0))
    (part,) = parts_of(basins, ((0.0, 240.0, 240.0),), motion=MotionConfig(actions_deg=actions_deg))
    assert part.area_m2 == pytest.approx(600.0 * 600.0, rel=0.08)


@pytest.mark.parametrize(
    ("actions_deg", "start"),
    [
        ((-90.0, -30.0, 0.0, 30.0, 90.0), (2.81, 0.3, 386.5)),
        ((-90.0, 0.0, 5.0), (-0.47, 1.3, 3.3)),
        ((-90.0, 0.0, 5.0), (-0.53, 3.9, 37.5)),
    ],
)
def test_a_start_at_the_border_from_which_only_escapes_lead_back_reaches_the_area(actions_deg, start):
    square = (0.0, 0.0, 400.0, 0.0, 400.0, 400.0, 0.0, 400.0)
    assert not parts_of(square, (start,), motion=MotionConfig(actions_deg=actions_deg))
    assert not parts_of(square, (start, start), motion=MotionConfig(actions_deg=actions_deg))


def test_few_headings_do_not_move_a_turning_loop_through_water_without_room_for_a_leg():
    motion = MotionConfig(turn_radius_m=25.0, actions_deg=(0.0, 90.0))
    room = (0.0, 0.0, 200.0, 0.0, 200.0, 120.0, 0.0, 120.0)
    (part,) = parts_of(room, ((0.3, 100.0, 60.0),), motion=motion, margin_m=0.0)
    assert part.area_m2 == pytest.approx(2400.0, rel=0.05)  # as a search of all actions from the start leaves out
    assert not parts_of(tuple(1.5 * x for x in room), ((0.3, 150.0, 90.0),), motion=motion, margin_m=0.0)
