import math

import numpy as np
import pytest
from planner_helpers import rollout

from auv_lse_common.vocabulary.naive_ids import HOLD, LAWNMOWERS, STRIPS
from auv_lse_common.vocabulary.plan import NONE, Plan, Tour

PLAN = Plan(step=4, heading_rad=0.3, north_m=150.0, east_m=150.0, actions=(5, 10, 2), naive_path=LAWNMOWERS[0])


@pytest.mark.parametrize("samples", [1, 2, 5])
def test_path_reaches_the_missions_end_with_the_naive_path(samples):
    roll, space = rollout(20, samples)
    path = roll.follow(PLAN)
    assert (path.step, len(path), path.own) == (4, 16, 3)
    assert path.states.shape == (17, 3)
    assert path.actions[:3].tolist() == [5, 10, 2]
    assert path.actions[3:].tolist() == roll.naive.actions(path.states[3], LAWNMOWERS[0], 13).tolist()
    assert path.leg_locations_m.shape == (16, samples, 2)
    legs = [space.motion.leg(0, state, int(a)) for state, a in zip(path.states, path.actions, strict=False)]
    along = (np.arange(samples) + 1.0) / samples
    expected = [[leg.state_at(f * leg.length_m)[1:] for f in along] for leg in legs]
    assert path.leg_locations_m == pytest.approx(np.array(expected), abs=1e-9)
    assert np.concatenate([path.own_locations_m, path.naive_locations_m]).tolist() == path.locations_m.tolist()
    assert len(path.own_locations_m) == 3 * samples


def test_locations_of_a_leg_worked_by_hand():
    roll, _ = rollout(20, samples_per_leg=3)
    straight, turn = roll.leg_locations(np.array([[0.0, 1.0, 2.0], [0.0, 0.0, 0.0]]), np.array([5, 10]))
    third = 15.0 * math.pi / 6.0
    assert straight == pytest.approx(np.array([[1.0 + third, 2.0], [1.0 + 2 * third, 2.0], [1.0 + 3 * third, 2.0]]))
    # a quarter circle of 15 m to starboard: after 30, 60 and 90 degrees
    assert turn == pytest.approx(
        np.array([[15.0 * math.sin(a), 15.0 - 15.0 * math.cos(a)] for a in (math.pi / 6, math.pi / 3, math.pi / 2)])
    )


def test_a_path_from_a_later_step():
    path = rollout(20, samples_per_leg=2)[0].follow(PLAN)
    for step, own in ((4, 3), (5, 2), (7, 0), (12, 0)):
        later = path.from_step(step)
        assert (later.step, len(later), later.own) == (step, 20 - step, own)
        assert np.array_equal(later.states, path.states[step - 4 :])
        assert np.array_equal(later.locations_m, path.locations_m[2 * (step - 4) :])
    end = path.from_step(25)
    assert (end.step, len(end)) == (20, 0)
    assert np.array_equal(end.states[0], path.states[-1])


def test_path_without_naive_path_ends_with_its_actions_or_the_mission():
    roll, _ = rollout(20)
    assert len(roll.path(4, PLAN.state, PLAN.actions, NONE)) == 3
    assert len(roll.path(18, PLAN.state, PLAN.actions, NONE)) == 2
    assert len(roll.path(20, PLAN.state, PLAN.actions, LAWNMOWERS[0])) == 0


@pytest.mark.parametrize("samples", [1, 2])
@pytest.mark.parametrize("naive_path", [LAWNMOWERS[0], LAWNMOWERS[3], STRIPS[1], HOLD, NONE])
def test_batch_of_naive_paths_equals_single_ones(naive_path, samples):
    roll, _ = rollout(30, samples, vehicles=3)
    rng = np.random.default_rng(2)
    states = np.stack([rng.uniform(-3, 3, 20), rng.uniform(-10, 370, 20), rng.uniform(-10, 470, 20)], axis=1)
    for state, own in zip(states, roll.naive_locations(states, naive_path, 30), strict=True):
        assert own == pytest.approx(roll.path(0, state, (), naive_path).locations_m, abs=1e-9)


@pytest.mark.parametrize(
    ("change", "followed"),
    [
        ({}, True),
        ({"naive_path": NONE}, True),
        ({"step": 20}, True),
        ({"step": 21}, False),
        ({"naive_path": 0x20}, False),
        ({"actions": (77,)}, False),
        ({"actions": (-1,)}, False),
        ({"north_m": math.nan}, False),
        ({"heading_rad": math.inf}, False),
        ({"tour": Tour(segment_legs=2, bearings=(0, 255))}, True),
        ({"tour": Tour(segment_legs=0, bearings=(0, 255))}, False),
        ({"tour": Tour(segment_legs=256, bearings=(0, 255))}, False),
        ({"tour": Tour(segment_legs=2, bearings=())}, False),
        ({"tour": Tour(segment_legs=2, bearings=(0,) * 65)}, False),
        ({"tour": Tour(segment_legs=2, bearings=(0, 256))}, False),
        ({"tour": Tour(segment_legs=2, bearings=(-1,))}, False),
    ],
)
def test_invalid_plans_are_detected(change, followed):
    import dataclasses

    assert rollout(20)[0].can_follow(dataclasses.replace(PLAN, **change)) is followed


def test_batch_of_sequences_visits_the_same_locations_as_single_ones():
    roll, space = rollout(20, samples_per_leg=3)
    rng = np.random.default_rng(1)
    states = np.array([[0.3, 150.0, 150.0], [1.0, 200.0, 100.0]])
    actions = rng.integers(0, space.motion.actions, (2, 5))
    for state, own, locations in zip(states, actions, roll.locations_of_many(states, actions), strict=True):
        assert locations == pytest.approx(roll.path(0, state, tuple(own), NONE).locations_m)
