from dataclasses import replace

import numpy as np
import pytest
from planner_helpers import centers, context, rollout, search_problem

from auv_lse_common.mission_file.operating_area import Grid
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.vocabulary.naive_ids import LAWNMOWERS
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.methods.dec_mcts import DecMcts, JointDraws, distribution
from auv_lse_planner.reward.anytime import AnytimeReward, Weighting
from auv_lse_planner.reward.path import PathReward

STATE = np.array([0.3, 150.0, 150.0])
SEQUENCE = (5, 5, 6)


def _scene():
    """Three draws: a mate mows as the first lawnmower would in one, as the second would in two."""
    roll, space = rollout(20)
    posterior = Posterior(GpConfig())
    posterior.follow(centers(np.random.default_rng(9), 40))
    first, second = (roll.path(0, STATE, SEQUENCE, h).naive_places_m for h in LAWNMOWERS[:2])
    return roll, space, posterior, [first, second, second]


GRID = Grid(np.arange(0.0, 361.0, 20.0), np.arange(0.0, 461.0, 20.0), np.ones((19, 24), dtype=bool), 20.0)


def _drop(posterior, planned, places):
    """Drop of the map's expected risk that places bring beyond those planned, by plain means."""

    def risk(measured):
        known = posterior.with_planned(measured)
        columns = known.at(GRID.places_m)
        left = np.minimum(columns.planned_var_m2, columns.data_var_m2)
        return LevelSet().expected_risk(columns.mean_m, np.sqrt(columns.data_var_m2 - left), np.sqrt(left)).sum()

    return risk(planned) - risk(np.concatenate([planned, places]))


def _joint(roll, posterior, draws, ids, legs):
    rewards = []
    for places in draws:
        against = posterior.with_planned(places)
        rewards.append(AnytimeReward(CachedPoints(against, GRID.places_m), LevelSet(), (), Weighting(legs, 0, 20)))
    return JointDraws(rewards, roll, search_problem(STATE, np.random.default_rng(1), naive_paths=ids))


def test_sequence_value_is_the_mean_added_map_reward_over_the_draws():
    roll, _, posterior, draws = _scene()
    joint = _joint(roll, posterior, draws, (), len(SEQUENCE))
    (value,) = joint([SEQUENCE])
    places = roll.path(0, STATE, SEQUENCE, NONE).places_m
    exact = np.mean([_drop(posterior, planned, places) for planned in draws])
    assert value == pytest.approx(exact, rel=0.02)  # cells of hardly any risk are left out
    assert joint.naive_path[SEQUENCE] == NONE


def test_naive_path_has_the_best_mean_over_the_draws():
    roll, _, posterior, draws = _scene()
    ids = LAWNMOWERS[:2]
    joint = _joint(roll, posterior, draws, ids, 20)
    (value,) = joint([SEQUENCE])
    paths = [roll.path(0, STATE, SEQUENCE, h).places_m for h in ids]
    exact = [np.mean([_drop(posterior, planned, places) for planned in draws]) for places in paths]
    assert value == pytest.approx(max(exact), rel=0.02)
    assert joint.naive_path[SEQUENCE] == ids[int(np.argmax(exact))] == ids[0]
    alone = _joint(roll, posterior, draws[:1], ids, 20)
    alone([SEQUENCE])
    assert alone.naive_path[SEQUENCE] == ids[1]  # what the first draw alone would choose


def _search(scene, problem):
    roll, space, posterior, draws = scene
    method = DecMcts(context(roll, space, posterior, problem.rng, GRID))
    return method.search(problem, PathReward(posterior, LevelSet()), draws)


def test_sent_plan_is_drawn_from_the_best_sequences():
    problem = search_problem(STATE, np.random.default_rng(1), naive_paths=LAWNMOWERS[:2], iterations=60)
    proposal = _search(_scene(), problem)
    assert proposal.found.iterations == 20  # shared among the draws
    assert proposal.team_plan is not None
    actions, naive_path = proposal.team_plan
    assert actions in [a for a, _ in proposal.found.ranking[:10]]
    assert naive_path in LAWNMOWERS[:2]
    assert proposal.found.value == max(v for _, v in proposal.found.ranking)


def test_without_naive_paths_sequences_end_with_the_horizon_or_the_mission():
    scene = _scene()
    roll, _, posterior, draws = scene
    problem = search_problem(STATE, np.random.default_rng(1), method="plain", horizon=5, iterations=48)
    for step, horizon in ((0, 5), (18, 2)):
        proposal = _search(scene, replace(problem, step=step, horizon=horizon))
        assert len(proposal.found.actions) == horizon
        assert proposal.naive_path == NONE
        places = roll.path(step, STATE, proposal.found.actions, NONE).places_m
        exact = np.mean([_drop(posterior, planned, places) for planned in draws])
        assert proposal.found.value == pytest.approx(exact, rel=0.03)


def test_newer_plans_are_drawn_more_often():
    roll, space, posterior, _ = _scene()
    first, second = (Plan.at(0, np.array([0.0, north, 100.0]), (5,), NONE) for north in (0.0, 200.0))
    draws = []
    for seed in range(60):
        method = DecMcts(context(roll, space, posterior, np.random.default_rng(seed), GRID))
        assert method.draw(0.0).shape == (0, 2)
        method.context.team.receive_plan(0.0, 2, first)
        method.context.team.receive_plan(0.0, 2, second)
        draws.append(method.draw(0.0)[0, 0] > 150.0)
    assert 30 < sum(draws) < 60


def test_distribution_prefers_better_sequences_and_cools():
    values = np.array([100.0, 99.0, 90.0])
    early, late = distribution(values, 0), distribution(values, 99)
    assert early.sum() == pytest.approx(1.0)
    assert np.all(np.diff(early) < 0.0)
    assert late[0] > early[0]


def test_last_plan_is_kept_only_if_configured():
    assert not PlannerConfig(coordination="dec_mcts", method="augmented").complete().incumbent
    assert PlannerConfig(coordination="dec_mcts", method="augmented", incumbent=True).complete().incumbent


def test_dec_mcts_needs_a_tree_search():
    for method in ("tour", "exponential_quadratic"):
        with pytest.raises(ValueError, match="dec_mcts' is a tree search with the exact risk"):
            PlannerConfig(method=method, coordination="dec_mcts").complete()
