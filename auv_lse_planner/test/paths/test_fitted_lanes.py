"""Fitted lanes: by hand, against the plain loops, and against the lanes that are not fitted."""

import itertools
import math

import numpy as np
import pytest
from planner_helpers import world

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.support.compiled import plain
from auv_lse_common.vocabulary.naive_ids import COVERING, FITTED, STRIPS
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.paths.fitted_lanes import (
    ENDS,
    MAX_LANES,
    MAX_LENGTH_RATIO,
    SIDES,
    fit,
    lane_spans,
    lay,
    mean_distance,
    rows_of,
)
from auv_lse_planner.paths.naive import CACHED_FITS
from auv_lse_planner.paths.polyline import locations_along
from auv_lse_planner.paths.rollout import Rollout
from auv_lse_planner.reward.anytime import AnytimeReward, Weighting


def _rectangle(along, across, grid):
    u, v = np.meshgrid(np.arange(0.5, along / grid) * grid, np.arange(0.5, across / grid) * grid, indexing="ij")
    return np.column_stack([u.ravel(), v.ravel()])


def _lay(locations, grid, begin, count, side, end, corners):
    lanes = np.empty((2 * count - 1, 3))
    return lay(lanes, lane_spans(rows_of(locations), grid, begin, count, side, lanes), grid, begin, end, corners)


def _mean_distance(locations, corners, length):
    """Of all locations to all segments."""
    total = 0.0
    for u, v in locations.tolist():
        nearest, left = math.inf, length
        for (u0, v0), (u1, v1) in itertools.pairwise(corners.tolist()):
            du, dv = u1 - u0, v1 - v0
            size = math.sqrt(du * du + dv * dv)
            if size > 0.0:
                t = min(max(((u - u0) * du + (v - v0) * dv) / (size * size), 0.0), min(left / size, 1.0))
                off = u - u0 - t * du, v - v0 - t * dv
                nearest = min(nearest, off[0] * off[0] + off[1] * off[1])
            left -= size
            if left <= 0.0:
                break
        total += math.sqrt(nearest)
    return total / len(locations)


def test_lanes_worked_by_hand():
    locations, corners = _rectangle(300.0, 200.0, 20.0), np.empty((7, 2))
    # two lanes, half a gap (50 m) from the sides, ends half of that from the border; and one back between them
    length = _lay(locations, np.array([20.0, 20.0]), np.zeros(2), 2, 1.0, 0.5, corners)
    expected = [[0, 0], [25, 50], [275, 50], [275, 150], [25, 150], [25, 100], [275, 100]]
    assert corners == pytest.approx(np.array(expected, dtype=float))
    assert length == pytest.approx(math.hypot(25, 50) + 250 + 100 + 250)


def test_lanes_end_where_the_strip_does():
    """An L-shaped strip: each lane spans the locations at most three quarters of a row beside it."""
    locations = np.array([[10.0, 5.0], [20.0, 5.0], [30.0, 5.0], [10.0, 15.0], [0.0, 15.0]])
    assert rows_of(locations).tolist() == [[5.0, 10.0, 30.0], [15.0, 0.0, 10.0]]
    lanes = np.empty((3, 3))
    assert lane_spans(rows_of(locations), np.array([10.0, 10.0]), np.zeros(2), 2, 1.0, lanes) == 5.0
    assert lanes.tolist() == [[5.0, 10.0, 30.0], [15.0, 0.0, 10.0], [10.0, 0.0, 30.0]]


def test_mean_distance_worked_by_hand():
    line = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    locations = np.array([[5.0, 3.0], [13.0, 4.0], [10.0, 14.0]])
    assert mean_distance(locations, line, 20.0, math.inf) == pytest.approx((3.0 + 3.0 + 4.0) / 3.0)
    cut_at_the_corner = mean_distance(locations, line, 10.0, math.inf)
    assert cut_at_the_corner == pytest.approx((3.0 + 5.0 + 14.0) / 3.0)
    assert mean_distance(locations, line, 20.0, 3.3) == math.inf


def test_points_are_one_leg_apart_and_continue_straight():
    line = np.array([[0.0, 0.0], [0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    expected = [[0, 0], [6, 0], [10, 2], [10, 8], [10, 14]]
    assert locations_along(line, 0.0, 6.0, 5)[0] == pytest.approx(np.array(expected, dtype=float), abs=0.01)


def test_compiled_equals_plain():
    locations, sides, ends = _rectangle(300.0, 200.0, 40.0), np.array(SIDES), np.array(ENDS)
    arguments = (locations, np.array([40.0, 40.0]), np.array([10.0, 20.0]), 900.0, sides, ends)
    assert fit(*arguments) == plain(fit)(*arguments)
    corners, again, lanes, same = np.empty((11, 2)), np.empty((11, 2)), np.empty((5, 3)), np.empty((5, 3))
    rows = rows_of(locations)
    assert np.array_equal(rows, plain(rows_of)(locations))
    own = (rows, np.array([40.0, 40.0]), np.array([10.0, 20.0]), 3, 0.85)
    half_gap = lane_spans(*own, lanes)
    assert half_gap == plain(lane_spans)(*own, same)
    assert np.array_equal(lanes, same)
    laid = (lanes, half_gap, *own[1:3], 0.7)
    assert lay(*laid, corners) == plain(lay)(*laid, again)
    assert np.array_equal(corners, again)
    distance = mean_distance(locations, corners, 900.0, math.inf)
    assert distance == plain(mean_distance)(locations, corners, 900.0, math.inf)


@pytest.mark.parametrize("seed", range(8))
def test_what_is_skipped_changes_no_bit(seed):
    """The mean distance is that to all segments, and the design the first best one of all."""
    rng = np.random.default_rng(seed)
    grid = rng.uniform(15.0, 60.0, 2) if seed % 2 else np.full(2, 30.0)
    u, v = np.meshgrid(np.arange(rng.integers(3, 10)) * grid[0], np.arange(rng.integers(3, 10)) * grid[1])
    locations = np.column_stack([u.ravel(), v.ravel()]) + rng.uniform(-500.0, 500.0, 2)
    locations = locations[rng.random(len(locations)) < 0.9]
    begin = locations.mean(axis=0) + rng.normal(0.0, 150.0, 2)
    length = float(rng.uniform(200.0, 2000.0))
    best, first = math.inf, None
    for turned, count in itertools.product((False, True), range(1, MAX_LANES + 1)):
        order = [1, 0] if turned else [0, 1]
        own, spacing, start = np.ascontiguousarray(locations[:, order]), grid[order], begin[order]
        for side, end in itertools.product(SIDES, ENDS):
            corners = np.empty((4 * count - 1, 2))
            size = _lay(own, spacing, start, count, side, end, corners)
            if count > 1 and size > MAX_LENGTH_RATIO * length:
                continue
            distance = _mean_distance(own, corners, length)
            assert mean_distance(own, corners, length, math.inf) == distance
            if distance < best:
                best, first = distance, (turned, count, side, end)
    assert fit(locations, grid, begin, length, np.array(SIDES), np.array(ENDS)) == first


def test_first_of_equally_good_designs():
    """A square strip, from its corner: lanes along and across it are the same, and one lane has no other side."""
    locations, begin = _rectangle(200.0, 200.0, 20.0), np.zeros(2)
    turned, count, side, _ = fit(locations, np.full(2, 20.0), begin, 100.0, np.array(SIDES), np.array(ENDS))
    assert (turned, count, side) == (False, 1, SIDES[0])


@pytest.mark.parametrize("length", [700.0, 1500.0, 3000.0])
def test_no_other_number_of_lanes_has_a_smaller_mean_distance(length):
    locations, begin = _rectangle(600.0, 400.0, 25.0), np.zeros(2)
    grid = np.array([25.0, 25.0])
    turned, count, side, end = fit(locations, grid, begin, length, np.array(SIDES), np.array(ENDS))
    found = []
    for across in (False, True):
        own = locations[:, ::-1].copy() if across else locations
        for lanes in range(1, 15):
            corners = np.empty((4 * lanes - 1, 2))
            if _lay(own, grid, begin, lanes, 1.0, 0.85, corners) <= 1.25 * length:
                found.append(mean_distance(own, corners, length, math.inf))
    corners = np.empty((4 * count - 1, 2))
    own = locations[:, ::-1].copy() if turned else locations
    _lay(own, grid, begin, count, side, end, corners)
    assert mean_distance(own, corners, length, math.inf) <= min(found)


LARGE = (-50.0, -50.0, 550.0, -50.0, 550.0, 650.0, -50.0, 650.0)
BENT = (0.0, -50.0, 300.0, -50.0, 300.0, 250.0, 600.0, 250.0, 600.0, 550.0, 0.0, 550.0)


# The shares are a little above those found: .90, .80, .71.
@pytest.mark.parametrize(("polygon", "vehicles", "share"), [(LARGE, 1, 0.92), (LARGE, 3, 0.82), (BENT, 1, 0.75)])
def test_fitted_lanes_leave_less_risk_than_covering_lanes(polygon, vehicles, share):
    area, motion, _, naive = world(polygon=polygon, vehicles=vehicles)
    roll = Rollout(motion, naive, 100, 1)
    kept = CachedPoints(Posterior(GpConfig()), area.grid(30.0).locations_m)
    left = []
    for ids in (STRIPS, FITTED):
        own, *mates = (roll.path(0, np.zeros(3), (), ids[number]).locations_m for number in range(vehicles))
        ahead = [(np.arange(1.0, 101.0), locations) for locations in mates]
        reward = AnytimeReward(kept, LevelSet(), ahead, Weighting(100, 0, 100))
        left.append(reward.risk_before - reward.value(own[:, None]).expected_end)
    assert left[1] < share * left[0]


@pytest.mark.parametrize("vehicles", [3, 8, 20])
def test_the_lanes_of_a_team_keep_apart(vehicles):
    """In one strip of the area each: vehicles that share one would travel side by side from a common start."""
    _, motion, _, naive = world(polygon=LARGE, vehicles=vehicles)
    roll, start = Rollout(motion, naive, 60, 1), np.array([0.0, 250.0, 300.0])
    middles = [np.median(roll.path(0, start, (), FITTED[number]).locations_m[20:, 0]) for number in range(vehicles)]
    assert np.diff(np.sort(middles)).min() > 0.5 * 600.0 / vehicles


def test_lane_fits_are_cached():
    _, _, _, naive = world()
    first = naive._fitted(np.array([0.0, 10.0, 20.0]), FITTED[0], 40)
    assert naive._fitted(np.array([1.0, 10.0, 20.0]), FITTED[0], 40) is first  # the heading does not count
    for north in range(2 * CACHED_FITS):
        naive._fitted(np.array([0.0, float(north), 0.0]), FITTED[0], 40)
    assert len(naive._fits) == CACHED_FITS
    again = naive._fitted(np.array([0.0, 10.0, 20.0]), FITTED[0], 40)
    assert again is not first
    assert np.array_equal(again, first)


def test_one_vehicle_has_one_strip():
    *_, naive = world()
    paths = [naive.actions(np.zeros(3), naive_path, 50) for naive_path in FITTED]
    assert all(np.array_equal(paths[0], path) for path in paths)
    assert naive.distinct((*COVERING, *FITTED)) == (*COVERING, FITTED[0])


@pytest.mark.parametrize(
    "polygon", [(0, 0, 400, 400, 0, 400), (0, 0, 500, 300, 400, 500, -100, 200), (0, 0, 300, 900, 600, 0)]
)
def test_slanted_area_has_strips_beyond_its_raster(polygon):
    area, motion, space, naive = world(polygon=tuple(map(float, polygon)), vehicles=3)
    c, s = math.cos(naive._frames[0].axis_rad), math.sin(naive._frames[0].axis_rad)
    for locations, _ in naive._strip_locations:
        north, east = locations[:, 0] * c - locations[:, 1] * s, locations[:, 0] * s + locations[:, 1] * c
        off = [-(space.clearance_m(n, e) + space.margin_m) for n, e in zip(north, east, strict=True)]
        assert max(off) <= math.sqrt(0.5) * space.cell_m  # the nearest node is inside
    start = np.array([0.5, *area.polygon.mean(axis=0)])
    actions = naive.actions(start, FITTED[1], 60)
    end = motion.roll(start, actions)[-1]
    assert space.clearance_m(end[1], end[2]) > 0.0
