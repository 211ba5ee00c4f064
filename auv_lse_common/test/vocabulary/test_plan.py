from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.plan import MAX_SEGMENTS, Plan, Tour

LEG_M = 23.56
SEGMENT_M = 2 * LEG_M
#: Half of 1/256 of a turn (rad), by which the direction of a segment is rounded at most.
HALF_A_STEP = math.pi / 256
#: The table of directions is rounded to float32: 6e-8 of a segment.
TABLE_M = 1e-5


def test_plan_is_rounded_as_in_a_packet():
    plan = Plan(
        step=7,
        heading_rad=0.1,
        north_m=123.456789,
        east_m=-9.87654321,
        actions=(np.int64(3), 5),
        naive_path=0xF0,
    )
    assert plan.north_m == float(np.float32(123.456789))
    assert plan.actions == (3, 5)
    assert type(plan.actions[0]) is int
    again = Plan(
        step=7,
        heading_rad=plan.heading_rad,
        north_m=plan.north_m,
        east_m=plan.east_m,
        actions=(3, 5),
        naive_path=0xF0,
    )
    assert again == plan


def test_tour_waypoints_worked_by_hand():
    # 0 north, 64 east, 32 north-east, 192 west; segments of 2 legs of 10 m
    tour = Tour(segment_legs=2, bearings=(0, 64, 32, 192))
    diagonal = 20.0 * math.sqrt(0.5)
    far = 21.0 + diagonal
    by_hand = [(1.0, 2.0), (21.0, 2.0), (21.0, 22.0), (far, 22.0 + diagonal), (far, 2.0 + diagonal)]
    np.testing.assert_allclose(tour.waypoints_m(np.array([1.0, 2.0]), 10.0), by_hand, rtol=0, atol=TABLE_M)
    assert tour.legs == 8


def test_tour_waypoints_are_identical():
    """Sums one after the other of numbers that a float32 holds: written out here once more, and once as printed."""
    rng = np.random.default_rng(3)
    tour = Tour(segment_legs=3, bearings=tuple(rng.integers(0, 256, MAX_SEGMENTS).tolist()))
    got = tour.waypoints_m(np.array([123.25, -77.5]), LEG_M)
    north, east = 123.25, -77.5
    for i, bearing in enumerate(tour.bearings):
        north += 3 * LEG_M * float(np.float32(math.cos(bearing * math.tau / 256)))
        east += 3 * LEG_M * float(np.float32(math.sin(bearing * math.tau / 256)))
        assert (got[i + 1, 0], got[i + 1, 1]) == (north, east)
    assert [v.hex() for v in got[-1].tolist()] == ["0x1.853d60d6947b6p+7", "0x1.57e6ca1563d72p+7"]


def from_polyline_m(locations_m: Array, polyline_m: Array) -> Array:
    """Distance (m) of positions (P, 2) to a polyline (n, 2)."""
    starts, steps = polyline_m[:-1], np.diff(polyline_m, axis=0)
    to = locations_m[:, None, :] - starts
    length = np.maximum((steps**2).sum(axis=1), 1e-300)
    along = np.clip((to * steps).sum(axis=2) / length, 0.0, 1.0)
    return np.hypot(*np.moveaxis(to - along[..., None] * steps, 2, 0)).min(axis=1)


@st.composite
def polylines(draw: st.DrawFn) -> Array:
    """From a few metres to the longest way that 64 segments hold, from long lanes to hairpins."""
    corners = draw(st.lists(st.tuples(st.floats(-300, 300), st.floats(-300, 300)), min_size=2, max_size=40))
    polyline = np.array(corners)
    length = np.hypot(*np.diff(polyline, axis=0).T).sum()
    return polyline * min(1.0, 60 * SEGMENT_M / max(length, 1.0))


@settings(max_examples=300)
@given(polylines())
def test_rounding_errors_do_not_accumulate(polyline_m: Array):
    if np.hypot(*np.diff(polyline_m, axis=0).T).sum() < 1.0:
        return
    tour = Tour.through(polyline_m, 2, LEG_M)
    waypoints = tour.waypoints_m(polyline_m[0], LEG_M)
    assert from_polyline_m(waypoints[:-1], polyline_m).max() <= SEGMENT_M * HALF_A_STEP + TABLE_M
    # the way ends within half a segment of the polyline's end, or has passed it by less
    off = np.hypot(*(waypoints[-1] - polyline_m[-1]))
    assert off <= SEGMENT_M * (0.5 + HALF_A_STEP) + TABLE_M or len(tour.bearings) == 1


def test_long_straight_tour_stays_on_its_line():
    """The direction that a byte holds worst: without making good 64 segments of 47 m end 37 m beside the line."""
    angle = 10.5 * math.tau / 256
    end = 64 * SEGMENT_M * np.array([math.cos(angle), math.sin(angle)])
    tour = Tour.through(np.array([[0.0, 0.0], end]), 2, LEG_M)
    assert set(tour.bearings) == {10, 11}
    assert len(tour.bearings) == 64
    waypoints = tour.waypoints_m(np.zeros(2), LEG_M)
    assert from_polyline_m(waypoints, np.array([[0.0, 0.0], 1.1 * end])).max() < 0.6
    assert np.hypot(*(waypoints[-1] - end)) < 1.0
    alike = Tour(segment_legs=2, bearings=(10,) * 64).waypoints_m(np.zeros(2), LEG_M)
    assert np.hypot(*(alike[-1] - end)) > 36.0


@settings(max_examples=200)
@given(
    st.integers(1, 255),
    st.lists(st.integers(0, 255), min_size=1, max_size=MAX_SEGMENTS),
    st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)),
)
def test_tour_through_its_own_waypoints_is_unchanged(legs: int, bearings: list[int], start: tuple[float, float]):
    tour = Tour(segment_legs=legs, bearings=tuple(bearings))
    assert Tour.through(tour.waypoints_m(np.array(start), LEG_M), legs, LEG_M) == tour


def test_rest_of_half_a_segment_becomes_a_segment():
    def segments(length_m: float) -> int:
        return len(Tour.through(np.array([[0.0, 0.0], [0.0, length_m]]), 1, 10.0).bearings)

    assert [segments(v) for v in (1.0, 10.0, 14.9, 15.1, 20.0, 24.0, 26.0)] == [1, 1, 1, 2, 2, 2, 3]


def test_polyline_back_to_its_start_is_one_segment():
    there_and_back = np.array([[1.0, 0.0], [0.0, 0.0], [1.0, 0.0]])
    assert Tour.through(there_and_back, 2, LEG_M).bearings == (128,)


@pytest.mark.parametrize(
    ("waypoints_m", "legs", "message"),
    [
        ([[0.0, 0.0], [0.0, 660.0]], 1, "a polyline of 660 m needs more than 64 segments of 10 m; choose longer"),
        ([[0.0, 0.0], [0.0, math.nan]], 1, r"must be finite north, east of shape \(n, 2\); its shape is \(2, 2\)"),
        ([[0.0, 0.0, 1.0]], 1, r"its shape is \(1, 3\)"),
        ([[1.0, 2.0]], 1, "never leave the start"),
        ([[1.0, 2.0], [1.0, 2.0]], 1, "never leave the start"),
        ([[0.0, 0.0], [0.0, 60.0]], 0, "segment_legs must be 1..255, not 0"),
        ([[0.0, 0.0], [0.0, 60.0]], 256, "segment_legs must be 1..255, not 256"),
    ],
)
def test_invalid_polylines_are_rejected(waypoints_m: list[list[float]], legs: int, message: str):
    with pytest.raises(ValueError, match=message):
        Tour.through(np.array(waypoints_m), legs, 10.0)


@pytest.mark.parametrize(
    ("legs", "bearings"), [(0, (1,)), (256, (1,)), (1, ()), (1, (0,) * 65), (1, (256,)), (1, (-1,))]
)
def test_invalid_tour_has_no_waypoints(legs: int, bearings: tuple[int, ...]):
    tour = Tour(segment_legs=legs, bearings=bearings)
    assert not tour.is_sound
    with pytest.raises(ValueError, match=r"segment_legs must be 1\.\.255, with 1\.\.64 bearings of 0\.\.255"):
        tour.waypoints_m(np.zeros(2), LEG_M)


def test_tour_is_encoded_in_two_fields():
    tour = Tour(segment_legs=2, bearings=(0, 255))
    plan = Plan.at(0, np.zeros(3), (1,), 0xF0, tour)
    assert plan.tour_fields == (2, (0, 255))
    assert Tour.from_fields(*plan.tour_fields) == tour
    assert Plan.at(0, np.zeros(3), (1,), 0xF0).tour_fields == (0, ())
    assert Tour.from_fields(0, np.zeros(0, dtype=np.uint8)) is None
    assert not Tour.from_fields(0, (1,)).is_sound
    assert not Tour.from_fields(1, ()).is_sound


def test_tour_accepts_integers_only():
    assert type(Tour(segment_legs=np.uint8(2), bearings=np.array([3, 4], dtype=np.uint8)).bearings[0]) is int
    with pytest.raises(TypeError):
        Tour(segment_legs=2, bearings=(1.5,))
