import itertools

import numpy as np
import pytest
from golden_tree import GOLDEN, lines_of_the_tree
from planner_helpers import centers, rollout, search_problem
from reference_tree import TreeSearch, exhaustive_search

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.vocabulary.naive_ids import LAWNMOWERS
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.path_search import search_path
from auv_lse_planner.search.sequences import PathSequences


def _toy(horizon=4, kinds=5, seed=3):
    """A made-up problem: states are counters, the value a fixed function of the actions."""
    weights = np.random.default_rng(seed).normal(size=(horizon, kinds))

    def valuer(sequences):
        return np.array([sum(weights[i, a] for i, a in enumerate(s)) for s in sequences])

    def choices(state):
        return np.arange(kinds - int(state[0]) % 2)  # not all actions everywhere

    def end_state(state, action):
        return state + np.array([1.0, 0.0, 0.0])

    return choices, end_state, valuer, horizon


def _search(problem, rng, batch=4, exploration=0.5):
    choices, end_state, valuer, horizon = problem
    return TreeSearch(choices, end_state, valuer, horizon, exploration, batch, rng)


def test_seeded_tree_equals_the_golden_tree():
    """It changes only if the search does: where it descends, the order of its draws, what it credits."""
    assert lines_of_the_tree() == GOLDEN.read_text().splitlines()


def test_the_same_seed_gives_the_same_result():
    problem = _toy()
    result, again = (_search(problem, np.random.default_rng(1)).run(np.zeros(3), 60) for _ in range(2))
    assert result == again
    assert result.iterations == 60
    assert len(result.ranking) == min(64, result.evaluations)


def test_search_finds_the_optimum_of_a_small_tree():
    problem = _toy()
    best = exhaustive_search(*problem[:3], np.zeros(3), problem[3])
    assert best.evaluations == 5 * 4 * 5 * 4
    found = _search(problem, np.random.default_rng(2)).run(np.zeros(3), 400)
    assert found.value == pytest.approx(best.value)
    assert found.actions == best.actions


def test_exhaustive_search_returns_the_maximum():
    choices, end_state, valuer, _ = _toy(horizon=3)

    allowed = [s for s in itertools.product(range(5), repeat=3) if s[1] < 4]
    best = exhaustive_search(choices, end_state, valuer, np.zeros(3), 3)
    assert best.value == valuer(allowed).max()


def test_deadline_returns_a_path_and_is_reported():
    problem = _toy()
    result = _search(problem, np.random.default_rng(3)).run(np.zeros(3), 1000, deadline=lambda: True)
    assert result.deadline_hit
    assert result.iterations == 2
    assert len(result.actions) == 4


def test_seeds_are_tried_first_and_infeasible_ones_skipped():
    problem = _toy()
    good = exhaustive_search(*problem[:3], np.zeros(3), 4)
    result = _search(problem, np.random.default_rng(4)).run(
        np.zeros(3),
        2,
        seeds=[(0, 4, 0, 0), good.actions],  # action 4 is not allowed at step 1
    )
    assert result.value == pytest.approx(good.value)


def test_tree_search_against_exhaustive_search_on_real_situations():
    """In most small situations the search finds nearly the best path."""
    good = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        posterior = Posterior(GpConfig())
        posterior.follow(centers(rng, 30 * seed))
        reward = PathReward(posterior, LevelSet())
        state = np.array([rng.uniform(-3, 3), *rng.uniform(60, 300, 2)])
        left = int(rng.integers(3, 25))
        naive_paths = (LAWNMOWERS[0],) if left > 3 else ()
        roll, space = rollout(left)
        sequences = PathSequences(reward, roll, 0, state, naive_paths)
        best = exhaustive_search(space.choices, space.motion.end_state, sequences, state, 3)
        there = search_problem(state, rng, naive_paths=naive_paths, iterations=150)
        found = search_path(there, space, roll, reward)
        good += found.found.value >= 0.99 * best.value
        assert found.found.value <= best.value + 1e-9
    assert good >= 5


def test_polished_sequence_cannot_be_improved_by_a_single_change():
    problem = _toy()
    result = _search(problem, np.random.default_rng(7)).run(np.zeros(3), 300)
    _, _, valuer, _ = problem
    for i in range(4):
        for action in range(5 - i % 2):
            changed = (*result.actions[:i], action, *result.actions[i + 1 :])
            assert valuer([changed])[0] <= result.value + 1e-12
