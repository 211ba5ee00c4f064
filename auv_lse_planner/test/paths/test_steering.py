import math

import numpy as np
import pytest
from planner_helpers import feasible_by_area, rollout, world

from auv_lse_common.support.compiled import plain
from auv_lse_common.vocabulary.naive_ids import LAWNMOWERS
from auv_lse_common.vocabulary.plan import NONE, Plan, Tour
from auv_lse_planner.paths.steering import Steering, due_on_line, due_on_tour, point_along, steer

LEG = 15.0 * math.pi / 2.0


def _tours(count, segments, seed=1):
    """Wandering tours with a state each, in the area of `world` and a little beyond it."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        state = np.array([rng.uniform(-3, 3), rng.uniform(20, 340), rng.uniform(20, 440)])
        bearings = tuple(int(b) % 256 for b in np.cumsum(rng.normal(0.0, 25.0, segments)))
        yield np.float32(state).astype(float), Tour(segment_legs=2, bearings=bearings)


def test_steered_tours_are_feasible_even_along_the_border():
    _, motion, space, _ = world()
    steering = Steering(space)
    for state, tour in _tours(12, 20):
        waypoints = tour.waypoints_m(state[1:], motion.leg_length_m)
        actions = steering.actions(state, waypoints, 2, 40)
        assert len(actions) == 40
        for action in actions:
            assert action in feasible_by_area(space, state)
            state = motion.end_state(state, int(action))


def test_all_receivers_steer_alike_whatever_their_map():
    a, motion, space, _ = world()
    first, second = Steering(space), Steering(world()[2])
    locations = a.grid(10.0).locations_m
    space.set_shallow(locations, np.hypot(locations[:, 0] - 100, locations[:, 1] - 100) < 60, 10.0)
    for state, tour in _tours(6, 15, seed=2):
        waypoints = tour.waypoints_m(state[1:], motion.leg_length_m)
        assert np.array_equal(first.actions(state, waypoints, 2, 30), second.actions(state, waypoints, 2, 30))


def test_compiled_steering_equals_the_plain_one():
    _, motion, space, _ = world()
    leg = motion.leg_length_m
    for state, tour in _tours(3, 5, seed=3):
        waypoints = tour.waypoints_m(state[1:], leg)
        due = due_on_tour(waypoints, 2 * leg, leg, 12)
        assert np.array_equal(due, plain(due_on_tour)(waypoints, 2 * leg, leg, 12))
        assert np.allclose(due[:, :2], due_on_line(waypoints, leg, 12)[:, :2], atol=1e-5)
        assert np.array_equal(due_on_line(waypoints, leg, 12), plain(due_on_line)(waypoints, leg, 12))
        arguments = (space.arguments(static=True), state, 10, due)
        assert np.array_equal(steer(*arguments), plain(steer)(*arguments))


def test_straight_tour_is_followed_exactly_and_continues_past_its_end():
    _, motion, space, _ = world()
    state, tour = np.array([0.0, 20.0, 100.0]), Tour(segment_legs=2, bearings=(0, 0))
    actions = Steering(space).actions(state, tour.waypoints_m(state[1:], motion.leg_length_m), 2, 8)
    assert actions.tolist() == [motion.straight_on] * 8


def test_corner_is_cut_by_at_most_the_turning_circle():
    _, motion, space, _ = world()
    state, tour = np.array([0.0, 20.0, 100.0]), Tour(segment_legs=2, bearings=(0, 0, 64, 64, 64))
    waypoints = tour.waypoints_m(state[1:], LEG)
    states = motion.roll(state, Steering(space).actions(state, waypoints, 2, 10))
    corner = waypoints[2]
    assert np.hypot(*(states[:, 1:] - corner).T).min() < motion.radius_m
    # beyond the corner it is on the line again (half of the smallest turn's offset over a leg: 1 m), heading east
    assert np.abs(states[-3:, 1] - corner[0]).max() < 2.0
    assert states[-1, 0] == pytest.approx(math.pi / 2.0, abs=math.radians(5.0))


def test_points_along_a_polyline_worked_by_hand():
    bent = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    assert point_along(bent, 10.0, 4.0) == (4.0, 0.0, 1.0, 0.0)
    assert point_along(bent, 10.0, 13.0) == (10.0, 3.0, 0.0, 1.0)
    assert point_along(bent, 10.0, 25.0) == (10.0, 15.0, 0.0, 1.0)  # straight on


def test_polyline_without_a_segment_is_rejected():
    with pytest.raises(ValueError, match="give at least two"):
        Steering(world()[2]).actions(np.zeros(3), np.zeros((1, 2)), 2, 3)
    with pytest.raises(ValueError, match="line_m: 1 locations make no segment; give at least two"):
        Steering(world()[2]).along(np.zeros(3), np.zeros((1, 2)), LEG, 3)


def test_path_follows_actions_then_tour_then_naive_path():
    roll, space = rollout(20)
    tour = Tour(segment_legs=2, bearings=(20, 40, 60))
    plan = Plan(
        step=4, heading_rad=0.3, north_m=150.0, east_m=150.0, actions=(5, 10, 2), naive_path=LAWNMOWERS[0], tour=tour
    )
    path = roll.follow(plan)
    assert (len(path), path.own) == (16, 9)
    assert path.actions[:3].tolist() == [5, 10, 2]
    start = path.states[3]
    along = Steering(space).actions(start, tour.waypoints_m(start[1:], LEG), 2, 6)
    assert path.actions[3:9].tolist() == along.tolist()
    assert path.actions[9:].tolist() == roll.naive.actions(path.states[9], LAWNMOWERS[0], 7).tolist()
    assert len(roll.path(4, plan.state, (5,), NONE, tour)) == 7
    assert len(roll.path(17, plan.state, (5,), NONE, tour)) == 3  # cut at the mission's end
