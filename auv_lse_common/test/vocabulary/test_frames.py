"""Conventions, by values worked out by hand, and round trips."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from auv_lse_common.vocabulary.frames import (
    geodetic_from_local,
    heading_from_quaternion,
    heading_from_yaw,
    local_from_geodetic,
    quaternion_from_heading,
    unwrapped_deg,
    wrap_pi,
    yaw_from_heading,
)
from auv_lse_common.vocabulary.seeds import stream

angles = st.floats(-50.0, 50.0)


@pytest.mark.parametrize(
    ("heading_deg", "yaw_deg"), [(0.0, 90.0), (90.0, 0.0), (180.0, -90.0), (-90.0, -180.0), (45.0, 45.0)]
)
def test_north_is_yaw_90_and_clockwise_becomes_counter_clockwise(heading_deg: float, yaw_deg: float) -> None:
    assert math.degrees(yaw_from_heading(math.radians(heading_deg))) == pytest.approx(yaw_deg, abs=1e-12)


@given(angles)
def test_headings_survive_the_round_trip(heading_rad: float) -> None:
    for back in (
        heading_from_yaw(yaw_from_heading(heading_rad)),
        heading_from_quaternion(*quaternion_from_heading(heading_rad)),
    ):
        assert abs(float(wrap_pi(back - heading_rad))) < 1e-12  # rounding of angles up to 50 rad
    assert math.hypot(*quaternion_from_heading(heading_rad)) == pytest.approx(1.0, abs=1e-15)


@given(angles)
def test_wrapped_angles_are_in_the_half_open_range(angle_rad: float) -> None:
    wrapped = float(wrap_pi(angle_rad))
    assert -math.pi <= wrapped < math.pi
    assert math.sin(wrapped) == pytest.approx(math.sin(angle_rad), abs=1e-12)


def test_degree_of_latitude_has_the_ellipsoids_length() -> None:
    # Meridian arc of WGS84 from 45 N: 111 131.8 m per degree about 45 deg (from 44.5 to 45.5).
    north, east = local_from_geodetic(45.5, 7.0, 44.5, 7.0)
    assert float(north) == pytest.approx(111_131.8, abs=0.5)
    assert float(east) == pytest.approx(0.0, abs=1e-6)


@given(st.floats(-5000.0, 5000.0), st.floats(-5000.0, 5000.0))
def test_positions_survive_the_geodetic_round_trip(north_m: float, east_m: float) -> None:
    lat, lon = geodetic_from_local(north_m, east_m, 17.1221, -91.6281)
    north, east = local_from_geodetic(lat, lon, 17.1221, -91.6281)
    assert math.hypot(float(north) - north_m, float(east) - east_m) < 1e-3  # PROJ takes the last 0.6 mm for the origin


def test_longitudes_on_both_sides_of_the_antimeridian_have_no_jump() -> None:
    assert unwrapped_deg([179.9, -179.9]).tolist() == pytest.approx([179.9, 180.1])
    assert unwrapped_deg([-0.1, 0.1]).tolist() == [-0.1, 0.1]
    assert unwrapped_deg([359.9, 0.1]).tolist() == pytest.approx([-0.1, 0.1])
    globe = [0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0]
    assert unwrapped_deg(globe).tolist() == globe
    assert unwrapped_deg([]).tolist() == []


def test_streams_repeat_and_differ_by_name() -> None:
    first = stream(7, "planner", 1).random(5)
    assert np.array_equal(first, stream(7, "planner", 1).random(5))
    others = [stream(7, "planner", 2), stream(8, "planner", 1), stream(7, "sensors", 1), stream(7, "planner")]
    assert not any(np.array_equal(first, other.random(5)) for other in others)
