"""Messages to and from the cores' numbers, by values worked out by hand and by round trips."""

from __future__ import annotations

import dataclasses
import importlib.util
import math

import numpy as np
import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.topics.ros_conversions import (
    dead_reckoning_from_message,
    dead_reckoning_message,
    doubles,
    fix_from_message,
    fix_message,
    floats,
    header,
    mate_navigation_from_message,
    mate_navigation_message,
    plan_from_message,
    plan_message,
    raw_sounding_row,
    seconds,
    sounding_message,
    sounding_row,
    stamp,
)
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation
from auv_lse_common.vocabulary.mission_run import Action, Stop
from auv_lse_common.vocabulary.plan import Plan, Tour
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.map.depth_map import DepthField, Isobath
from auv_lse_gp.ros_conversions import (
    centers_from_message,
    centers_message,
    field_message,
    isobath_markers,
    risk_map_message,
)
from auv_lse_msgs.msg import Waypoint
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.ros_conversions import (
    navigation,
    path_message,
    waypoint_message,
)
from auv_lse_sim.engine.ros_conversions import altitude_message, leg_of_waypoint, odometry_message, pressure_message
from auv_lse_sim.vehicle.vehicle_state import NavigationEstimate

pytestmark = pytest.mark.ros


def test_stamps_come_back_to_the_nanosecond() -> None:
    for value in (0.0, 1.0, 1611.000000001, 1.8e9 + 0.25):
        assert seconds(stamp(value)) == pytest.approx(value, abs=1e-9 + np.spacing(value))
    assert stamp(0.9999999999).sec == 1, "rounded, not cut"
    assert header(3.5).frame_id == "map"


def test_arrays_keep_their_numbers() -> None:
    values = np.array([1.5, -2.25, 1e-7])
    assert list(doubles(values)) == values.tolist()
    assert np.allclose(floats(values), values, rtol=1e-7)


def test_odometry_becomes_enu_with_its_covariance() -> None:
    # heading 30 deg, variances (heading 0.01, north 4, east 9), north-east covariance 1, heading-north 0.1
    covariance = np.array([[0.01, 0.1, 0.0], [0.1, 4.0, 1.0], [0.0, 1.0, 9.0]])
    odometry = NavigationEstimate(
        stamp_s=2.0, heading_rad=math.radians(30), north_m=10.0, east_m=20.0, speed_mps=1.5, covariance=covariance
    )
    message = odometry_message(odometry, 3.0, 2)
    p = message.pose.pose.position
    assert (p.x, p.y, p.z) == (20.0, 10.0, -3.0)
    matrix = np.asarray(message.pose.covariance).reshape(6, 6)
    assert (matrix[0, 0], matrix[1, 1], matrix[5, 5]) == (9.0, 4.0, 0.01)
    assert (matrix[0, 1], matrix[1, 5], matrix[0, 5]) == (1.0, -0.1, 0.0), "yaw grows against heading"
    assert message.child_frame_id == "auv2"
    assert navigation(message) == pytest.approx((math.radians(30), 10.0, 20.0), abs=1e-12)


def test_plans_and_legs_come_back() -> None:
    plan = Plan(step=7, heading_rad=0.5, north_m=1.25, east_m=-2.5, actions=(1, 10, 0), naive_path=0xF4)
    assert plan_from_message(plan_message(1.0, 3, plan)) == plan
    with_tour = dataclasses.replace(plan, tour=Tour(segment_legs=2, bearings=(0, 255, 64)))
    assert plan_from_message(plan_message(1.0, 3, with_tour)) == with_tour
    hostile = plan_message(1.0, 3, with_tour)
    hostile.segment_legs = 0
    assert not plan_from_message(hostile).tour.is_sound
    leg = MotionTable(MotionConfig()).leg(7, plan.state, 3)
    message = waypoint_message(1.0, leg, 1.5, 4.0, Stop(action=Action.SURFACE))
    assert (message.last, message.then) == (True, int(Action.SURFACE))
    assert not waypoint_message(1.0, leg, 1.5, 4.0, None).last
    assert leg_of_waypoint(message) == leg
    assert (message.end_heading_rad, message.end_north_m, message.end_east_m) == tuple(leg.end_state)
    message.straight_m = math.nan
    with pytest.raises(ValueError, match="waypoint of step 7"):
        leg_of_waypoint(message)
    with pytest.raises(ValueError, match="radius above 0"):
        leg_of_waypoint(Waypoint(step=1))


def test_a_path_lies_at_the_vehicles_depth() -> None:
    path = path_message(1.0, np.array([[0.0, 1.0, 2.0], [math.pi / 2, 3.0, 4.0]]), 5.0)
    assert [(q.pose.position.x, q.pose.position.y, q.pose.position.z) for q in path.poses] == [(2, 1, -5), (4, 3, -5)]
    assert path.poses[1].pose.orientation.w == pytest.approx(1.0), "heading east is yaw 0"


def test_centers_come_back_and_a_ragged_message_is_refused() -> None:
    centers = Centers(np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([5.0, 6.0]), np.array([0.3, 0.2]))
    message = centers_message(1.0, 4, centers)
    back = centers_from_message(message)
    assert np.array_equal(back.places_m, centers.places_m)
    assert np.array_equal(back.noise_std_m, centers.noise_std_m)
    message.depth_m = [1.0]
    with pytest.raises(ValueError, match=r"have \[2, 2, 1, 2\] values"):
        centers_from_message(message)


def test_maps_have_south_west_first_and_unknown_outside() -> None:
    area = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, 40.0, 0.0, 40.0, 80.0, 0.0, 40.0)))
    grid = area.grid(10.0)
    inside = np.where(grid.inside, 1.0, np.nan)
    field = DepthField(grid, 15.0 * inside, inside, 1.2 * inside, 2.5 * inside, 0.5 * inside, 0.7, 1)
    message = field_message(1.0, field, 15.0)
    assert message.variance_scale == 0.7
    assert (message.rows, message.columns) == grid.inside.shape
    assert (message.south_m, message.west_m) == (grid.north_m[0], grid.east_m[0])
    risk = risk_map_message(1.0, field, 5.0)
    cells = np.asarray(risk.data).reshape(risk.info.height, risk.info.width)
    assert set(np.unique(cells)) == {-1, 50}
    assert np.array_equal(cells == -1, ~grid.inside)
    assert risk.info.origin.position.x == pytest.approx(grid.east_m[0] - 5.0)


def test_an_isobath_becomes_segments_between_its_vertices() -> None:
    lines = [np.array([[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]), np.array([[9.0, 8.0], [7.0, 6.0]])]
    markers = isobath_markers(1.0, Isobath(lines, [], lines[:1], 0.95), 15.0)
    ends = [[(p.x, p.y) for p in marker.points] for marker in markers]
    first = [(1.0, 0.0), (3.0, 2.0), (3.0, 2.0), (5.0, 4.0)]
    assert ends == [[*first, (8.0, 9.0), (6.0, 7.0)], [], first]
    assert all(p.z == -15.0 for p in markers[0].points)


def test_no_echo_is_infinite_and_depth_is_pressure() -> None:
    assert altitude_message(1.0, math.nan, 1).range == math.inf
    assert altitude_message(1.0, 12.5, 1).range == 12.5
    assert pressure_message(1.0, 10.0, 1).fluid_pressure == pytest.approx(101325.0 + 98066.5)


def test_raw_places_and_fixes_come_back_as_they_were() -> None:
    raw = DeadReckoning(stamp_s=12.5, heading_rad=0.5, north_m=10.25, east_m=-3.5, depth_m=2.0)
    message = dead_reckoning_message(raw, 2)
    assert (message.pose.pose.position.x, message.pose.pose.position.y) == (-3.5, 10.25), "ENU"
    back = dead_reckoning_from_message(message)
    assert back.heading_rad == pytest.approx(0.5, abs=1e-12), "by a quaternion and back"
    assert dataclasses.replace(back, heading_rad=0.5) == raw
    fix = Fix(stamp_s=600.0, north_m=101.0, east_m=52.0, raw_north_m=104.5, raw_east_m=50.25, std_m=0.8)
    assert fix_from_message(fix_message(fix)) == fix


def test_a_sounding_without_a_raw_place_has_none() -> None:
    row = (1.5, 10.0, 20.0, 15.0)
    assert sounding_row(sounding_message(row)) == row
    assert np.isnan(raw_sounding_row(sounding_message(row))[4:]).all()
    assert raw_sounding_row(sounding_message((*row, 11.0, 19.0))) == (*row, 11.0, 19.0)


def test_what_a_mate_tells_of_its_navigation_comes_back_with_and_without_a_fix() -> None:
    mate = MateNavigation(
        stamp_s=61.25,
        source=3,
        sent_s=61.0,
        raw_north_m=310.0,
        raw_east_m=-40.5,
        fix_raw_north_m=200.0,
        fix_raw_east_m=-10.0,
        fix_north_m=203.0,
        fix_east_m=-11.5,
        travel_s=0.25,
    )
    assert mate.has_fix
    assert mate_navigation_from_message(mate_navigation_message(mate)) == mate
    without = MateNavigation(stamp_s=61.25, source=3, sent_s=61.0, raw_north_m=310.0, raw_east_m=-40.5)
    back = mate_navigation_from_message(mate_navigation_message(without))
    assert not back.has_fix
    assert math.isnan(back.travel_s)
