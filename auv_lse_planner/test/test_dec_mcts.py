import numpy as np
import pytest
from planner_helpers import centers, rollout, situation

from auv_lse_gp.config import GpConfig
from auv_lse_gp.posterior import Posterior
from auv_lse_gp.risk import LevelSet
from auv_lse_planner.config import PlannerConfig
from auv_lse_planner.paths.naive_ids import LAWNMOWERS
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.dec_mcts import JointDraws, distribution, search_dec_mcts
from auv_lse_planner.search.sequences import PathSequences

STATE = np.array([0.3, 150.0, 150.0])
SEQUENCE = (5, 5, 6)


def _scene():
    """Three draws: a mate mows as the first lawnmower would in one, as the second would in two."""
    roll, space = rollout(20)
    posterior = Posterior(GpConfig())
    posterior.follow(centers(np.random.default_rng(9), 40))
    first, second = (roll.path(0, STATE, SEQUENCE, h).naive_places_m for h in LAWNMOWERS[:2])
    return roll, space, posterior, [first, second, second]


def test_the_naive_path_is_the_best_in_the_mean_over_the_draws():
    roll, _, posterior, draws = _scene()
    rewards = []
    for places in draws:
        against = posterior.copy()
        against.plan(places)
        rewards.append(PathReward(against, LevelSet(), "beyond"))
    ids = LAWNMOWERS[:2]
    valuers = [PathSequences(reward, roll, 0, STATE, ids) for reward in rewards]
    joint = JointDraws(valuers)
    value = joint([SEQUENCE])[0]
    exact = [
        np.mean([r.value(r.posterior.columns(roll.path(0, STATE, SEQUENCE, h).places_m)) for r in rewards]) for h in ids
    ]
    assert value == pytest.approx(max(exact))
    assert joint.naive_path(SEQUENCE) == ids[int(np.argmax(exact))] == ids[0]
    alone = PathSequences(rewards[0], roll, 0, STATE, ids)
    alone([SEQUENCE])
    assert alone.naive_path[SEQUENCE] == ids[1]  # what the first draw alone would choose


def test_team_mates_get_a_plan_drawn_from_the_best():
    roll, space, posterior, draws = _scene()
    there = situation(STATE, np.random.default_rng(1), naive_paths=LAWNMOWERS[:2], iterations=60)
    found = search_dec_mcts(there, space, roll, posterior, LevelSet(), draws)
    assert found.iterations == 20  # shared among the draws
    assert found.for_team is not None
    actions, naive_path = found.for_team
    assert actions in [a for a, _ in found.ranking[:10]]
    assert naive_path in LAWNMOWERS[:2]
    assert found.value == max(v for _, v in found.ranking)


def test_it_prefers_better_sequences_and_cools():
    values = np.array([100.0, 99.0, 90.0])
    early, late = distribution(values, 0), distribution(values, 99)
    assert early.sum() == pytest.approx(1.0)
    assert np.all(np.diff(early) < 0.0)
    assert late[0] > early[0]


def test_the_maps_reward_is_refused():
    with pytest.raises(ValueError, match="dec_mcts' searches by the path's reward"):
        PlannerConfig(method="tour", coordination="dec_mcts").complete()
