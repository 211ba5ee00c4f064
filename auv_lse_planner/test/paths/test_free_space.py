import math

import numpy as np
import pytest
from planner_helpers import border_distance, clearance_m, feasible_by_area, is_free, is_safe, track_of, world

from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.support.compiled import plain
from auv_lse_planner.paths.free_space import cheapest_action, clearance_at, escape_action, feasible_mask, leg_clearance

ISLAND = {"island": (100.0, 150.0, 180.0, 150.0, 180.0, 250.0, 100.0, 250.0)}
WITH_ISLAND = (0.0, 0.0, 400.0, 0.0, 400.0, 420.0, 0.0, 420.0)
L_SHAPE = (0.0, 0.0, 300.0, 0.0, 300.0, 70.0, 90.0, 70.0, 90.0, 400.0, 0.0, 400.0)


@pytest.mark.parametrize(
    ("polygon", "no_go", "straight"),
    [
        (WITH_ISLAND, ISLAND, "constant"),
        (WITH_ISLAND, ISLAND, "growing"),
        (L_SHAPE, {}, "constant"),  # with growing straights the loop (48 m) has no room there
    ],
)
def test_random_walks_of_feasible_actions_never_get_stuck_or_leave_the_area(polygon, no_go, straight):
    area, motion, space, _ = world(polygon, MotionConfig(straight=straight), no_go=no_go)
    rng = np.random.default_rng(4)
    walked = 0
    for _ in range(60):
        state = np.array([rng.uniform(-math.pi, math.pi), *rng.uniform(0, 400, 2)])
        if not is_safe(space, state) or clearance_m(space, state[None, 1:])[0] < 1.0:
            continue
        for _ in range(40):
            actions = space.feasible(state)
            assert len(actions), f"stuck in {state}"
            action = int(rng.choice(actions))
            track = track_of(motion, state, action, 0.5)
            assert border_distance(area, track).min() >= area.margin_m - 0.5  # raster of 2 m, bilinear
            assert area.contains(track).all()
            state = motion.end_state(state, action)
            assert is_safe(space, state)
            walked += 1
    assert walked > 300


def straight_lines(motion, state, action):
    end = motion.end_state(state, action)[1:]
    return state[1:] + np.linspace(0.0, 1.0, 60)[:, None] * (end - state[1:])


def test_with_straight_legs_the_line_to_each_leg_s_end_is_free_too():
    """An autopilot cuts the arc of a quarter turn by 4 m: here across the corner of an island."""
    config = MotionConfig(straight_legs=True)
    area, motion, space, _ = world(WITH_ISLAND, config, no_go=ISLAND)
    _, _, arcs_only, _ = world(WITH_ISLAND, MotionConfig(), no_go=ISLAND)
    rng, refused = np.random.default_rng(4), 0
    for _ in range(1000):
        state = np.array([rng.uniform(-math.pi, math.pi), *rng.uniform((66, 116), (100, 150))])
        actions = space.feasible(state)
        for action in actions:
            lines = straight_lines(motion, state, action)
            assert border_distance(area, lines).min() >= area.margin_m - 0.5
            assert area.contains(lines).all()
        for action in set(arcs_only.feasible(state)) - set(actions):
            refused += 1
            assert border_distance(area, straight_lines(motion, state, action)).min() < area.margin_m + 1.5
    assert refused >= 5


def test_with_straight_legs_random_walks_never_get_stuck():
    _, motion, space, _ = world(WITH_ISLAND, MotionConfig(straight_legs=True), no_go=ISLAND)
    rng, walked = np.random.default_rng(5), 0
    for _ in range(30):
        state = np.array([rng.uniform(-math.pi, math.pi), *rng.uniform(20, 380, 2)])
        if not is_safe(space, state):
            continue
        for _ in range(30):
            actions = space.feasible(state)
            assert len(actions), f"stuck in {state}"
            state = motion.end_state(state, int(rng.choice(actions)))
            walked += 1
    assert walked > 200


def test_pockets_are_not_entered():
    # A corridor 24 m wide inside the margin: the vehicle fits, its turning circle (30 m) does not.
    _, motion, space, _ = world(
        (0.0, 0.0, 200.0, 0.0, 200.0, 200.0, 124.0, 200.0, 124.0, 420.0, 80.0, 420.0, 80.0, 200.0, 0.0, 200.0)
    )
    state = np.array([math.pi / 2, 102.0, 165.0])  # heading for the corridor's mouth
    free = [a for a in range(motion.actions) if is_free(space, state, a)]
    assert motion.straight_on in free
    assert motion.straight_on not in space.feasible(motion.end_state(state, motion.straight_on))
    inside = np.array([math.pi / 2, 102.0, 300.0])
    assert not is_safe(space, inside)


def test_escape_leads_back_from_a_corner_and_from_outside():
    _, motion, space, _ = world()
    for state in (np.array([0.8, 378.0, 478.0]), np.array([0.0, 390.0, 200.0]), np.array([math.pi, -30.0, -30.0])):
        assert not len(space.feasible(state))
        for _ in range(12):
            actions = space.choices(state)
            state = motion.end_state(state, int(actions[0]))
            if len(space.feasible(state)):
                break
        assert len(space.feasible(state)), f"still stuck in {state}"


def test_feasible_actions_avoid_shallow_ground():
    area, motion, space, _ = world()
    grid = area.grid(10.0)
    locations = grid.locations_m
    shoal = np.hypot(locations[:, 0] - 180.0, locations[:, 1] - 230.0) < 40.0
    state = np.array([0.0, 120.0, 230.0])
    assert motion.straight_on in space.feasible(state)
    space.set_shallow(locations, shoal, 10.0)
    assert motion.straight_on not in space.feasible(state)
    assert motion.straight_on in feasible_by_area(space, state)
    for action in space.feasible(state):
        track = track_of(motion, state, int(action), 0.5)
        assert np.hypot(track[:, 0] - 180.0, track[:, 1] - 230.0).min() > 35.0
    space.set_shallow(locations, np.zeros(len(locations), bool), 10.0)
    assert motion.straight_on in space.feasible(state)


def test_shallow_ground_beyond_reach_does_not_matter():
    area, _, space, _ = world()
    grid = area.grid(10.0)
    locations = grid.locations_m
    shoal = np.hypot(locations[:, 0] - 180.0, locations[:, 1] - 330.0) < 60.0
    space.set_shallow(locations, shoal, 10.0)
    whole = space.raster
    here, reach_m = np.array([120.0, 190.0]), 150.0
    near = np.hypot(*(locations - here).T) <= reach_m
    assert 0 < (shoal & ~near).sum() < shoal.sum(), "the shoal is cut by what is in reach"
    space.set_shallow(locations[near], shoal[near], 10.0)
    north = space.north0_m + space.cell_m * np.arange(whole.shape[0])
    east = space.east0_m + space.cell_m * np.arange(whole.shape[1])
    closer = np.hypot(north[:, None] - here[0], east[None, :] - here[1]) < reach_m - 60.0
    assert np.array_equal(np.minimum(space.raster, 50.0)[closer] > 0.0, np.minimum(whole, 50.0)[closer] > 0.0)
    positive = closer & (whole > 0.0)
    assert np.allclose(np.minimum(space.raster, 50.0)[positive], np.minimum(whole, 50.0)[positive])


def test_compiled_functions_equal_the_plain_ones():
    _, _, space, _ = world(no_go=ISLAND)
    a = space.arguments()
    rng = np.random.default_rng(6)
    for _ in range(40):
        state = (rng.uniform(-math.pi, math.pi), rng.uniform(-30, 390), rng.uniform(-30, 490))
        assert clearance_at(a, *state[1:]) == plain(clearance_at)(a, *state[1:])
        assert leg_clearance(a, *state, 3) == plain(leg_clearance)(a, *state, 3)
        costs = rng.random(len(a.turns))
        cheapest = [f(a, *state, costs.copy(), False) for f in (cheapest_action, plain(cheapest_action))]
        assert cheapest[0] == cheapest[1]
        allowed = np.flatnonzero(feasible_mask(a, *state))
        assert cheapest[0] == (allowed[np.argmin(costs[allowed])] if len(allowed) else escape_action(a, *state))
        assert np.array_equal(feasible_mask(a, *state), plain(feasible_mask)(a, *state))
        assert escape_action(a, *state) == plain(escape_action)(a, *state)


def test_leg_clearance_agrees_with_dense_sampling():
    _, motion, space, _ = world(no_go=ISLAND)
    a = space.arguments()
    rng = np.random.default_rng(7)
    checked = 0
    for _ in range(300):
        state = np.array([rng.uniform(-math.pi, math.pi), rng.uniform(0, 360), rng.uniform(0, 460)])
        action = int(rng.integers(motion.actions))
        dense = clearance_m(space, track_of(motion, state, action, 0.25)).min()
        free = is_free(space, state, action)
        if dense >= 1.0:
            assert free
            checked += 1
        elif dense < -0.5:
            assert not free
            checked += 1
        assert leg_clearance(a, *state, action) >= dense - 1e-9
    assert checked > 250
