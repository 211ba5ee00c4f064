import dataclasses

import numpy as np
import pytest
from planner_helpers import centers, dense_posterior, expected_risk, path_reward

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.support.compiled import plain
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.reward import path as module
from auv_lse_planner.reward.path import PathReward, small_inverse_diagonals


def _situation(seed, data=60, team=0, level=None, credit="whole"):
    rng = np.random.default_rng(seed)
    config = GpConfig()
    known = centers(rng, data)
    posterior = Posterior(config)
    posterior.follow(known)
    others = rng.uniform(0, 400, (team, 2))
    posterior = posterior.with_planned(others)
    level = level or LevelSet()
    return rng, config, known, others, level, PathReward(posterior, level, credit)


def _dense_value(config, known, others, path, level, credit):
    """The paper's reward by plain dense algebra."""
    mean, var, after = dense_posterior(config, known, np.concatenate([others, path]), path)
    if credit == "whole":
        before = level.risk(mean, np.sqrt(var))
    else:
        _, _, planned = dense_posterior(config, known, others, path)
        before = expected_risk(level, mean, var, planned)
    return before - expected_risk(level, mean, var, after)


LEVELS = [LevelSet(), LevelSet(cost_false_safe=20.0, cost_false_unsafe=5.0)]


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("credit", ["whole", "beyond"])
@pytest.mark.parametrize(("data", "team", "length"), [(0, 0, 10), (60, 0, 30), (60, 25, 100), (200, 60, 13)])
def test_value_agrees_with_the_dense_computation_within_1e_9(data, team, length, level, credit):
    rng, config, known, others, level, reward = _situation(data + length, data, team, level, credit)
    for _ in range(3):
        path = rng.uniform([0, 0], [360, 460], (length, 2))
        columns = reward.posterior.at(path)
        dense = _dense_value(config, known, others, path, level, credit)
        assert reward.contributions(columns) == pytest.approx(dense, abs=1e-9)
        assert reward.value(columns) == pytest.approx(dense.sum(), abs=1e-9 * max(1.0, dense.sum()))


def test_values_of_many_paths_equal_single_values():
    rng, *_, reward = _situation(3, 50, 10)
    for length in (1, 7, 30):  # of one location, as the myopic baseline asks; short; long
        columns = reward.posterior.at(rng.uniform(0, 400, (4 * length, 2)))
        one_by_one = [reward.value(columns.slice(i * length, (i + 1) * length)) for i in range(4)]
        assert reward.values_of_equal(columns, length) == pytest.approx(one_by_one, abs=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_value_never_decreases_with_length_and_is_0_without_locations(seed):
    rng, *_, reward = _situation(seed, 40, 5)
    path = reward.posterior.at(rng.uniform(0, 400, (25, 2)))
    values = [reward.value(path.take(np.arange(n))) for n in range(26)]
    assert values[0] == 0.0
    assert np.all(np.diff(values) >= -1e-9)


def test_credit_beyond_subtracts_the_team_mates_benefit():
    rng = np.random.default_rng(6)
    posterior = Posterior(GpConfig())
    posterior.follow(centers(rng, 30))
    path = rng.uniform(0, 400, (10, 2))
    planned = posterior.with_planned(path)  # a team mate goes exactly there
    columns = planned.at(path)
    whole, beyond = PathReward(planned, LevelSet()), PathReward(planned, LevelSet(), "beyond")
    assert 0.0 < beyond.value(columns) < 0.2 * whole.value(columns)
    alone = PathReward(posterior, LevelSet()).value(posterior.at(path))
    assert whole.value(columns) > alone


def test_unknown_credit_is_rejected():
    with pytest.raises(ValueError, match="credit must be 'whole' or 'beyond', not 'half'"):
        _situation(8, 5, credit="half")


@pytest.mark.parametrize("length", [3, 30])  # factorized by compiled loops, and by LAPACK
def test_indefinite_covariance_is_an_error(length):
    rng, *_, reward = _situation(9, 50)
    columns = reward.posterior.at(rng.uniform(0, 400, (2 * length, 2)))
    broken = dataclasses.replace(columns, white=3.0 * columns.white)  # explains more than there is
    with pytest.raises(ValueError, match=f"covariance of {length} planned locations is not positive definite"):
        reward.values_of_equal(broken, length)
    with pytest.raises(ValueError, match=f"covariance of {length} planned locations is not positive definite"):
        reward.value(broken.slice(0, length))


@pytest.mark.parametrize("length", [1, 10, 24, 25])
def test_values_of_equal_paths_equal_single_values(length):
    rng, reward = path_reward(50, 10, "beyond")
    columns = reward.posterior.at(rng.uniform(0, 400, (5 * length, 2)))
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


def test_long_paths_use_lapack_and_have_the_same_value(monkeypatch):
    rng, reward = path_reward(30, 0, "whole")
    columns = reward.posterior.at(rng.uniform(0, 400, (40, 2)))
    short = reward.values_of_equal(columns, 10)
    monkeypatch.setattr(module, "MAX_SMALL_PATH", 0)
    assert reward.values_of_equal(columns, 10) == pytest.approx(short, abs=1e-11)


def test_the_paths_own_reward_does_not_telescope():
    """Legs are credited at their own position only, a planned path at all of its locations at once."""
    config, level = GpConfig(), LevelSet()
    posterior = Posterior(config)
    reward = PathReward(posterior, level)
    path = posterior.at(np.column_stack([np.arange(1, 41) * 10.0, np.zeros(40)]))
    whole = reward.value(path)
    # leg by leg on perfect data: each location is already well known when it is reached, so there is less left to
    # credit
    stepwise = 0.0
    for i in range(40):
        known = Centers(np.column_stack([np.arange(1, i + 1) * 10.0, np.zeros(i)]), np.full(i, 15.0), np.full(i, 0.3))
        posterior.follow(known)
        here = posterior.at(np.array([[(i + 1) * 10.0, 0.0]]))
        stepwise += PathReward(posterior, level).value(here)
    assert stepwise < 0.95 * whole


@pytest.mark.parametrize("length", [5, 30])
def test_variance_of_uncertain_places_earns_no_reward(length):
    """What a path leaves is what the posterior has once it is planned: with the locations' variance, before and
    after."""
    rng = np.random.default_rng(4)
    known = centers(rng, 40)
    effect = 0.5 * rng.standard_normal((40, 3))
    posterior = Posterior(GpConfig())
    posterior.follow(Centers(known.locations_m, known.depths_m, known.noise_std_m, effect))
    path = rng.uniform(-100.0, 100.0, (length, 2))
    reward = PathReward(posterior, LevelSet())
    columns = posterior.at(path)
    left = reward.var_after_m2(columns)
    two = reward.values_of_equal(posterior.at(np.concatenate([path, path])), length)
    assert two == pytest.approx([reward.value(columns)] * 2)
    posterior = posterior.with_planned(path)
    planned = posterior.at(path).planned_var_m2
    assert planned.min() > 0.0
    assert left == pytest.approx(planned, rel=1e-6, abs=1e-9)
