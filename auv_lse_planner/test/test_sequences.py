import itertools

import numpy as np
import pytest
from planner_helpers import centers, rollout, world

from auv_lse_common.compiled import plain
from auv_lse_common.plan import NONE
from auv_lse_gp.config import GpConfig
from auv_lse_gp.posterior import Posterior
from auv_lse_gp.risk import LevelSet
from auv_lse_planner.reward import path as path_reward
from auv_lse_planner.reward.path import PathReward, small_inverse_diagonals
from auv_lse_planner.search.prefixes import Prefixes
from auv_lse_planner.search.sequences import PathSequences

STATE = np.array([0.3, 150.0, 150.0])


def _reward(data, team, credit, seed=3):
    rng = np.random.default_rng(seed)
    posterior = Posterior(GpConfig())
    posterior.follow(centers(rng, data))
    posterior.plan(rng.uniform(0, 400, (team, 2)))
    return rng, PathReward(posterior, LevelSet(), credit)


@pytest.mark.parametrize("credit", ["printed", "beyond"])
@pytest.mark.parametrize(("data", "team"), [(0, 0), (0, 12), (60, 0), (200, 40)])
@pytest.mark.parametrize(("naive_paths", "samples", "horizon"), [((), 1, 10), ((), 3, 10), ((0xF0, 0xF4), 1, 3)])
def test_values_of_a_batch_are_the_exact_values_of_its_paths(data, team, credit, naive_paths, samples, horizon):
    roll, space = rollout(60, samples)
    rng, reward = _reward(data, team, credit)
    sequences = PathSequences(reward, roll, 0, STATE, naive_paths)
    first = [tuple(int(a) for a in space.random_actions(STATE, rng.random(horizon))) for _ in range(8)]
    second = [(*s[: horizon // 2], *([5] * (horizon - horizon // 2))) for s in first]  # known prefixes
    for batch in (first, second, first):
        values = sequences(batch)
        for sequence, value in zip(batch, values, strict=True):
            exact = [
                reward.value(reward.posterior.columns(roll.path(0, STATE, sequence, naive_path).places_m))
                for naive_path in naive_paths or [NONE]
            ]
            assert value == pytest.approx(max(exact), abs=1e-9)
            assert sequences.naive_path[sequence] == (naive_paths or [NONE])[int(np.argmax(exact))]


@pytest.mark.parametrize("length", [1, 10, 24, 25])
def test_paths_of_equal_length_are_worth_what_they_are_one_by_one(length):
    rng, reward = _reward(50, 10, "beyond")
    columns = reward.posterior.columns(rng.uniform(0, 400, (5 * length, 2)))
    expected = [reward.value(columns.slice(i * length, (i + 1) * length)) for i in range(5)]
    assert reward.values_of_equal(columns, length) == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("function", [small_inverse_diagonals, plain(small_inverse_diagonals)])
def test_diagonals_of_small_inverses(function):
    rng = np.random.default_rng(1)
    for count in (1, 2, 3, 10, 24):
        roots = rng.normal(size=(4, count, count + 2))
        matrices = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(count)
        expected = [np.diag(np.linalg.solve(m, np.eye(count))) for m in matrices]
        diagonals = np.empty((4, count))
        assert function(np.tril(matrices), diagonals)
        assert diagonals == pytest.approx(np.array(expected), rel=1e-10)
    assert not function(np.array([[[1.0, 0.0], [2.0, 1.0]]]), np.empty((1, 2)))


def test_a_covariance_that_cannot_be_is_refused():
    rng, reward = _reward(5, 0, "printed")
    columns = reward.posterior.columns(rng.uniform(0, 400, (3, 2)))
    columns.white[:] += 100.0  # more than all of the variance explained
    with pytest.raises(ValueError, match="3 planned places is not positive definite"):
        reward.values_of_equal(columns, 3)


def test_prefixes_are_numbered_once():
    _, motion, _, _ = world()
    prefixes = Prefixes(motion, STATE)
    sequences = np.array(list(itertools.product((0, 5, 7), repeat=3)))
    numbers = prefixes.enter(sequences)
    assert prefixes.count == 1 + 3 + 9 + 27
    assert sorted(set(numbers.ravel().tolist())) == list(range(1, 40))
    assert (prefixes.enter(sequences[::-1]) == numbers[::-1]).all()
    assert prefixes.count == 40
    for sequence, own in zip(sequences, numbers, strict=True):
        rolled = motion.roll(STATE, sequence)
        assert (prefixes.states(own) == rolled[1:]).all()
    states, actions, ends = prefixes.last_legs(1)
    rolled = motion.roll(STATE, sequences[0])
    assert np.array_equal(states[:3], rolled[:-1])
    assert actions[:3].tolist() == sequences[0].tolist()
    assert np.array_equal(ends[:3], rolled[1:])


def test_long_paths_take_the_other_way_and_are_worth_the_same(monkeypatch):
    rng, reward = _reward(30, 0, "printed")
    columns = reward.posterior.columns(rng.uniform(0, 400, (40, 2)))
    short = reward.values_of_equal(columns, 10)
    monkeypatch.setattr(path_reward, "SMALL", 0)
    assert reward.values_of_equal(columns, 10) == pytest.approx(short, abs=1e-11)
