import numpy as np
import pytest
from planner_helpers import actions_by_chance, centers, path_reward, rollout
from reference_tree import exhaustive_search

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.vocabulary.naive_ids import LAWNMOWERS
from auv_lse_common.vocabulary.plan import NONE
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.sequences import PathSequences

STATE = np.array([0.3, 150.0, 150.0])


@pytest.mark.parametrize("credit", ["whole", "beyond"])
@pytest.mark.parametrize(("data", "team"), [(0, 0), (0, 12), (60, 0), (200, 40)])
@pytest.mark.parametrize(("naive_paths", "samples", "horizon"), [((), 1, 10), ((), 3, 10), ((0xF0, 0xF4), 1, 3)])
def test_batch_values_equal_exact_path_values(data, team, credit, naive_paths, samples, horizon):
    roll, space = rollout(60, samples)
    rng, reward = path_reward(data, team, credit)
    sequences = PathSequences(reward, roll, 0, STATE, naive_paths)
    first = [tuple(int(a) for a in actions_by_chance(space, STATE, rng.random(horizon))) for _ in range(8)]
    second = [(*s[: horizon // 2], *([5] * (horizon - horizon // 2))) for s in first]  # known prefixes
    for batch in (first, second, first):
        values = sequences(batch)
        for sequence, value in zip(batch, values, strict=True):
            exact = [
                reward.value(reward.posterior.at(roll.path(0, STATE, sequence, naive_path).locations_m))
                for naive_path in naive_paths or [NONE]
            ]
            assert value == pytest.approx(max(exact), abs=1e-9)
            assert sequences.naive_path[sequence] == (naive_paths or [NONE])[int(np.argmax(exact))]


def test_sequence_values_include_the_naive_path():
    roll, _ = rollout(20, samples_per_leg=2)
    rng = np.random.default_rng(9)
    posterior = Posterior(GpConfig())
    posterior.follow(centers(rng, 40))
    reward = PathReward(posterior, LevelSet())
    state = np.array([0.3, 150.0, 150.0])
    both = PathSequences(reward, roll, 0, state, LAWNMOWERS[:2])
    values = both([(5, 5, 6), (5, 4, 6), (5, 5, 6)])
    for sequence, value in zip([(5, 5, 6), (5, 4, 6)], values, strict=False):
        alone = [reward.value(posterior.at(roll.path(0, state, sequence, h).locations_m)) for h in LAWNMOWERS[:2]]
        assert value == pytest.approx(max(alone), abs=1e-9)
        assert both.naive_path[sequence] == LAWNMOWERS[int(np.argmax(alone))]


def test_promising_sequences_are_the_best_sequences():
    short, space = rollout(2, samples_per_leg=2)
    long, _ = rollout(20, samples_per_leg=2)
    rng = np.random.default_rng(10)
    posterior = Posterior(GpConfig())
    posterior.follow(centers(rng, 60))
    reward = PathReward(posterior, LevelSet())
    state = np.array([0.3, 150.0, 150.0])
    alone = PathSequences(reward, short, 0, state, ())
    best = exhaustive_search(space.choices, space.motion.end_state, alone, state, 2)
    first = PathSequences(reward, long, 0, state, LAWNMOWERS[:1]).promising(space, 2, 5, 1)
    assert first[:5] == [a for a, _ in best.ranking[:5]]
    assert {sequence[0] for sequence in first} == set(space.choices(state))
    assert alone.promising(space, 10, 5, 1) == []
