import math

import numpy as np
import pytest
from planner_helpers import feasible_by_area, world

from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.support.compiled import plain
from auv_lse_common.vocabulary.naive_ids import COVERING, HOLD, IDS, LAWNMOWERS, STRAIGHT_ON, STRIPS
from auv_lse_common.vocabulary.plan import NONE
from auv_lse_planner.paths.naive import Lanes, lawnmower, turn_least


def _states(count, seed=1):
    rng = np.random.default_rng(seed)
    return np.column_stack(
        [rng.uniform(-math.pi, math.pi, count), rng.uniform(20, 340, count), rng.uniform(20, 440, count)]
    )


@pytest.mark.parametrize("naive_path", IDS)
def test_naive_paths_from_safe_states_stay_feasible(naive_path):
    _, motion, space, naive = world(vehicles=3)
    for state in _states(12):
        actions = naive.actions(state, naive_path, 60)
        assert len(actions) == 60
        for action in actions:
            assert action in feasible_by_area(space, state)
            state = motion.end_state(state, int(action))


@pytest.mark.parametrize("naive_path", IDS)
def test_all_receivers_build_the_same_path(naive_path):
    _, _, _, first = world(vehicles=2)
    _, _, _, second = world(vehicles=2)
    for state in _states(5, seed=2):
        state = np.float32(state).astype(float)
        assert np.array_equal(first.actions(state, naive_path, 40), second.actions(state, naive_path, 40))


def test_known_shallow_ground_does_not_change_the_path():
    a, _, space, naive = world()
    before = naive.actions(np.zeros(3), LAWNMOWERS[0], 80)
    locations = a.grid(10.0).locations_m
    space.set_shallow(locations, np.hypot(locations[:, 0] - 100, locations[:, 1] - 100) < 60, 10.0)
    assert np.array_equal(before, naive.actions(np.zeros(3), LAWNMOWERS[0], 80))
    assert not np.array_equal(before, naive.actions(np.zeros(3), LAWNMOWERS[0], 80, around_shallows=True))


def test_compiled_paths_equal_the_plain_ones():
    _, _, space, naive = world()
    frame = naive._frames[0]
    lanes = Lanes(frame.axis_rad, 60.0, frame.low_m, frame.high_m)
    for state in _states(4, seed=3):
        arguments = (space.arguments(static=True), state, 25, lanes, 1.0, 5)
        assert np.array_equal(lawnmower(*arguments), plain(lawnmower)(*arguments))
        arguments = (space.arguments(static=True), state, 25, naive._by_size)
        assert np.array_equal(turn_least(*arguments), plain(turn_least)(*arguments))


@pytest.mark.parametrize("naive_path", COVERING[:3:2])
def test_covering_lawnmower_passes_near_all_locations(naive_path):
    a, motion, _, naive = world()
    for state in (np.zeros(3), np.array([2.0, 180.0, 230.0])):
        states = motion.roll(state, naive.actions(state, naive_path, 100))
        spacing = 400.0 * 500.0 / (100 * motion.leg_length_m)
        locations = a.grid(20.0).locations_m
        nearest = np.hypot(locations[:, None, 0] - states[:, 1], locations[:, None, 1] - states[:, 2]).min(axis=1)
        assert np.mean(nearest < 0.5 * spacing + 20.0) > 0.8


def test_lanes_are_straight_and_at_the_configured_spacing():
    _, motion, _, naive = world(planner=PlannerConfig(lane_spacing_m=60.0))
    states = motion.roll(np.zeros(3), naive.actions(np.zeros(3), LAWNMOWERS[2], 80))  # across the longest side: north
    along = np.abs(np.cos(states[:, 0])) > 0.999
    off = np.abs(states[along, 2] - 60.0 * np.round(states[along, 2] / 60.0))
    assert np.mean(off < 3.0) > 0.85  # the rest is on its way from lane to lane
    assert len(set(np.round(states[along, 2][off < 3.0] / 60.0))) >= 4
    assert along.mean() > 0.6


def test_straight_on_stays_straight_and_hold_circles():
    _, motion, _, naive = world()
    state = np.array([0.0, 100.0, 200.0])
    assert list(naive.actions(state, STRAIGHT_ON, 5)) == [motion.straight_on] * 5
    held = motion.roll(state, naive.actions(state, HOLD, 40))
    assert np.hypot(held[:, 1] - 100.0, held[:, 2] - 200.0).max() <= 30.0 + 1e-6


def test_none_and_unknown_ids():
    _, _, _, naive = world()
    assert len(naive.actions(np.zeros(3), NONE, 10)) == 0
    assert len(naive.actions(np.zeros(3), LAWNMOWERS[0], 0)) == 0
    with pytest.raises(ValueError, match=r"naive_path must be .*, not 0x10"):
        naive.actions(np.zeros(3), 0x10, 5)


def test_lawnmowers_work_with_growing_straights():
    _, motion, space, naive = world(motion=MotionConfig(straight="growing"))
    state = np.array([0.0, 100.0, 100.0])
    for action in naive.actions(state, LAWNMOWERS[0], 40):
        assert action in feasible_by_area(space, state)
        state = motion.end_state(state, int(action))


def test_area_without_room_still_yields_a_path():
    *_, tiny = world(polygon=(0.0, 0.0, 30.0, 0.0, 30.0, 30.0, 0.0, 30.0))
    assert len(tiny.actions(np.zeros(3), LAWNMOWERS[0], 10)) == 10


@pytest.mark.parametrize("naive_path", [LAWNMOWERS[1], COVERING[0], STRAIGHT_ON])
def test_sums_along_equals_the_sum_at_locations(naive_path):
    a, motion, _, naive = world()
    grid = a.grid(20.0)
    slope = 2.0 * grid.north_m[:, None] - 0.5 * grid.east_m[None, :]  # bilinear interpolation is exact on a plane
    states = _states(4, seed=8)
    sums = naive.sums_along(states, naive_path, 12, slope, grid)
    for state, total in zip(states, sums, strict=True):
        locations = motion.roll(state, naive.actions(state, naive_path, 12))[1:, 1:]
        inside = np.clip(locations, [grid.north_m[0], grid.east_m[0]], [grid.north_m[-1], grid.east_m[-1]])
        assert total == pytest.approx((2.0 * inside[:, 0] - 0.5 * inside[:, 1]).sum(), abs=0.5)


def test_equivalent_strip_ids_are_tried_once():
    *_, naive = world()  # two vehicles or one: see planner_helpers
    different = naive.distinct((*COVERING, *STRIPS))
    assert different[:4] == COVERING
    state = np.array([0.0, 50.0, 50.0])
    paths = [naive.actions(state, h, 60).tolist() for h in different]
    assert len({tuple(p) for p in paths[4:]}) == len(paths[4:])
    assert naive.distinct((STRIPS[4],)) == (STRIPS[4],)  # never empty
