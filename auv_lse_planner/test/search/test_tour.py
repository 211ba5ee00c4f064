import math

import numpy as np
import pytest
from planner_helpers import rollout, world

from auv_lse_common.support.compiled import plain
from auv_lse_common.vocabulary.plan import length_m
from auv_lse_planner.paths.polyline import locations_along, pull_back
from auv_lse_planner.paths.position_margin import EXACT, PositionMargin, room_shortfall
from auv_lse_planner.paths.steering import Steering
from auv_lse_planner.search.tour import ROOM_M, TourSearch

LEG = 15.0 * math.pi / 2.0


class Basin:
    """Stand-in reward: each location counts by its nearness to a point of its own."""

    def __init__(self, goals_m):
        self.goals = goals_m

    def coarse_value(self, locations_m):
        return self.value_and_gradient(locations_m)[0]

    def value_and_gradient(self, locations_m):
        off = locations_m - self.goals[: len(locations_m)]
        near = np.exp(-0.5 * (off**2).sum(axis=1) / 60.0**2)
        return float(near.sum()), -near[:, None] * off / 60.0**2


def _polyline(rng, corners):
    return np.array([60.0, 60.0]) + np.concatenate([np.zeros((1, 2)), rng.uniform(0, 250, (corners, 2))])


def test_locations_along_a_polyline_worked_by_hand():
    bent = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 8.0]])
    locations, segments, along = locations_along(bent, 4.0, 4.0, 6)
    assert locations.tolist() == [[4, 0], [8, 0], [10, 2], [10, 6], [10, 10], [10, 14]]
    assert segments.tolist() == [0, 0, 1, 1, 1, 1]
    assert along.tolist() == [4, 8, 2, 6, 10, 14]


def test_gradient_with_respect_to_waypoints_agrees_with_finite_differences():
    rng = np.random.default_rng(1)
    reward = Basin(rng.uniform(0, 300, (30, 2)))
    corners = _polyline(rng, 7)

    def value(w):
        return reward.value_and_gradient(locations_along(w, 0.5 * LEG, LEG, 30)[0])[0]

    locations, segments, along = locations_along(corners, 0.5 * LEG, LEG, 30)
    gradient = pull_back(corners, segments, along, reward.value_and_gradient(locations)[1])
    for k in range(len(corners)):
        for axis in (0, 1):
            step = np.zeros_like(corners)
            step[k, axis] = 1e-4
            slope = (value(corners + step) - value(corners - step)) / 2e-4
            assert gradient[k, axis] == pytest.approx(slope, abs=1e-7)  # differences of values near 20: 1e-15 / 1e-4


def test_compiled_equals_plain():
    rng = np.random.default_rng(2)
    corners = _polyline(rng, 5)
    fast, slow = locations_along(corners, 3.0, LEG, 20), plain(locations_along)(corners, 3.0, LEG, 20)
    for a, b in zip(fast, slow, strict=True):
        assert np.array_equal(a, b)
    gradient = rng.normal(size=(20, 2))
    assert pull_back(corners, *fast[1:], gradient) == pytest.approx(
        plain(pull_back)(corners, *fast[1:], gradient), rel=1e-12
    )
    _, _, space, _ = world()
    own = space.arguments()
    locations = rng.uniform(-30, 400, (40, 2))
    for covariance in (EXACT, np.array([[900.0, 200.0], [200.0, 400.0]])):
        arguments = (own, 20.0, locations, space.margin_m, covariance)
        fast, slow = room_shortfall(*arguments), plain(room_shortfall)(*arguments)
        assert fast[0] == pytest.approx(slow[0], rel=1e-12)
        assert fast[1] == pytest.approx(slow[1], rel=1e-12)


@pytest.mark.parametrize("std_m", [0.0, 20.0])
def test_lack_of_room_gradient_agrees_with_finite_differences(std_m: float):
    _, _, space, _ = world()
    margin = PositionMargin(np.diag([std_m**2, 0.0]))
    location = np.array([[-13.3, 101.1]])
    total, gradient = margin.shortfall_m2(space, location, 20.0)
    assert total > (0.0 if std_m == 0.0 else 40.0**2)
    for axis in (0, 1):
        step = np.zeros((1, 2))
        step[0, axis] = 1e-5
        slope = (
            margin.shortfall_m2(space, location + step, 20.0)[0] - margin.shortfall_m2(space, location - step, 20.0)[0]
        ) / 2e-5
        assert gradient[0, axis] == pytest.approx(slope, abs=1e-5)


def test_optimized_waypoints_stay_in_the_area_and_off_shallow_ground():
    a, _, space, _ = world()
    locations = a.grid(10.0).locations_m
    shoal = np.array([180.0, 180.0])
    space.set_shallow(locations, np.hypot(*(locations - shoal).T) < 40, 10.0)
    search = TourSearch(space, 1)
    begin = search.lanes(np.array([0.0, 0.0]), 40, 0.0, 2, (0, 1))
    goals = np.stack([np.linspace(0, 700, 40), np.linspace(0, 200, 40)], axis=1)  # leads out of the area
    found = search.improve(begin, 40, Basin(goals), 60)
    assert found.value > 1.2 * Basin(goals).value_and_gradient(search.locations(begin, 40))[0]
    assert np.array_equal(found.waypoints_m[0], begin[0])
    assert a.clearance_m(found.waypoints_m).min() > 0.0
    visited = search.locations(found.waypoints_m, 40)
    assert np.hypot(*(visited - shoal).T).min() > 40.0 - ROOM_M


def test_deadline_returns_the_best_tour_so_far():
    search = TourSearch(world()[2], 1)
    begin = search.lanes(np.zeros(2), 40, 0.0, 3, (0, 1))
    goals = np.full((40, 2), 200.0)
    asked = []

    def deadline():
        asked.append(1)
        return len(asked) > 3

    found = search.improve(begin, 40, Basin(goals), 60, deadline)
    assert found.deadline_hit
    assert found.evaluations == 4
    assert found.value >= Basin(goals).value_and_gradient(search.locations(begin, 40))[0] - 1e-9


@pytest.mark.parametrize("vehicles", [1, 3])
def test_initial_tours_have_the_missions_length_and_stay_in_the_area(vehicles):
    a, _, space, _ = world(vehicles=vehicles)
    search = TourSearch(space, 1)
    for vehicle in range(1, vehicles + 1):
        for tour in search.starts(np.zeros(2), 100, vehicle, vehicles):
            assert len(tour) == 51
            assert a.clearance_m(tour).min() > -1e-9
    assert search.segment_legs(100) == 2
    assert search.segment_legs(400) == 8


def _lanes(legs):
    """A state, the actions of narrow lanes from it, and their path as a fine polyline."""
    paths, space = rollout(legs)
    motion = paths.motion
    state = np.array([0.0, 40.0, 60.0])
    turn, back = motion.actions - 1, 0
    lane = [motion.straight_on] * 5
    actions = np.array((lane + [turn] * 2 + lane + [back] * 2) * 4)[:legs]
    states = motion.roll(state, actions)
    line = paths.leg_locations(states[:-1], actions, 4).reshape(-1, 2)
    return state, actions, np.concatenate([state[None, 1:], line]), space


def test_bend_without_gain_preserves_the_path_and_its_narrow_turns():
    legs = 28
    state, actions, line, space = _lanes(legs)
    found = TourSearch(space, 1).bend(line, legs, Basin(np.full((legs, 2), 1e5)), 10)
    assert np.array_equal(found.waypoints_m, line)
    again = Steering(space).along(state, found.waypoints_m, length_m(line) / legs, legs)
    assert np.array_equal(again, actions)


def test_bend_increases_the_value_and_keeps_the_start():
    legs = 28
    _, _, line, space = _lanes(legs)
    goals = locations_along(line, 0.5 * LEG, LEG, legs)[0] + np.array([0.0, 15.0])
    reward, search = Basin(goals), TourSearch(space, 1)
    before = reward.coarse_value(locations_along(line, 0.5 * LEG, LEG, legs)[0])
    found = search.bend(line, legs, reward, 30)
    after = reward.coarse_value(locations_along(found.waypoints_m, 0.5 * LEG, LEG, legs)[0])
    assert after - before > 0.5 * (legs - before), "half of what there is to gain"
    assert np.array_equal(found.waypoints_m[0], line[0])
    assert len(found.waypoints_m) == len(line)


def test_bend_stops_at_the_deadline():
    legs = 28
    _, _, line, space = _lanes(legs)
    found = TourSearch(space, 1).bend(line, legs, Basin(line[2::4] + 30.0), 30, lambda: True)
    assert found.deadline_hit
    assert found.evaluations == 1
