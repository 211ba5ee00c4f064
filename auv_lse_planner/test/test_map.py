import dataclasses

import numpy as np
import pytest
from planner_helpers import area, centers, dense_posterior, expected_risk

from auv_lse_gp.centers import Centers
from auv_lse_gp.config import GpConfig
from auv_lse_gp.kept import KeptColumns
from auv_lse_gp.posterior import Posterior
from auv_lse_gp.risk import LevelSet
from auv_lse_planner.reward.map import MapReward


def _situation(seed, data=60, team=0, level=None):
    rng = np.random.default_rng(seed)
    config, level = GpConfig(), level or LevelSet()
    known = centers(rng, data)
    posterior = Posterior(config)
    grid = area().grid(40.0)
    posterior.follow(known)
    others = rng.uniform(0, 400, (team, 2))
    posterior.plan(others)
    return rng, config, known, others, level, grid.places_m, MapReward(KeptColumns(posterior, grid.places_m), level)


@pytest.mark.parametrize("level", [LevelSet(), LevelSet(cost_false_safe=3.0, cost_false_unsafe=10.0)])
@pytest.mark.parametrize(("data", "team"), [(0, 0), (60, 0), (80, 30)])
def test_value_agrees_with_the_dense_computation_to_1e_9(data, team, level):
    rng, config, known, others, level, places, reward = _situation(1, data, team, level)
    path = rng.uniform([0, 0], [360, 460], (40, 2))
    mean, var, after = dense_posterior(config, known, np.concatenate([others, path]), places)
    _, _, planned = dense_posterior(config, known, others, places)
    dense = expected_risk(level, mean, var, planned) - expected_risk(level, mean, var, after)
    value = reward.value(reward.posterior.columns(path))
    assert value == pytest.approx(dense.sum(), abs=1e-9 * max(1.0, dense.sum()))


@pytest.mark.parametrize("seed", range(4))
def test_a_longer_path_is_never_worth_less_and_none_is_worth_nothing(seed):
    rng, *_, reward = _situation(seed, 50, 8)
    columns = reward.posterior.columns(rng.uniform(0, 400, (20, 2)))
    values = [reward.value(columns.slice(0, count)) for count in range(21)]
    assert values[0] == pytest.approx(0.0, abs=1e-9)
    assert np.all(np.diff(values) >= -1e-9)


def test_it_telescopes_in_expectation():
    """E over the first leg's measurement of (drop so far + value of the rest) is the value of the whole beforehand."""
    config, level = GpConfig(), LevelSet()
    rng = np.random.default_rng(3)
    known = centers(rng, 25)
    grid = area().grid(40.0)
    posterior = Posterior(config)
    posterior.follow(known)
    first, rest = np.array([[130.0, 200.0]]), rng.uniform(50, 350, (6, 2))
    kept = KeptColumns(posterior, grid.places_m)
    reward = MapReward(kept, level)
    whole = reward.value(posterior.columns(np.concatenate([first, rest])))
    now = reward.risk_in_hand.sum()
    at = posterior.columns(first)
    spread = np.sqrt(at.data_var_m2[0] + config.noise_std_m**2)
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)
    total = 0.0
    for node, weight in zip(nodes, weights / weights.sum(), strict=True):
        measured = Centers(
            np.concatenate([known.places_m, first]),
            np.append(known.depths_m, at.mean_m[0] + spread * node),
            np.append(known.noise_std_m, config.noise_std_m),
        )
        posterior.follow(measured)
        later = MapReward(kept, level)
        total += weight * (now - later.risk_in_hand.sum() + later.value(posterior.columns(rest)))
    # 60 Gauss-Hermite nodes on integrands with kinks (the call about a place changes): 0.5 %
    assert total == pytest.approx(whole, rel=5e-3)


def test_the_paths_own_reward_does_not_telescope():
    """Legs are credited at their own place only, a planned path at all of its places at once."""
    from auv_lse_planner.reward.path import PathReward

    config, level = GpConfig(), LevelSet()
    posterior = Posterior(config)
    reward = PathReward(posterior, level)
    path = posterior.columns(np.column_stack([np.arange(1, 41) * 10.0, np.zeros(40)]))
    whole = reward.value(path)
    # leg by leg on perfect data: each place is already well known when it is reached, so there is less left to credit
    stepwise = 0.0
    for i in range(40):
        known = Centers(np.column_stack([np.arange(1, i + 1) * 10.0, np.zeros(i)]), np.full(i, 15.0), np.full(i, 0.3))
        posterior.follow(known)
        here = posterior.columns(np.array([[(i + 1) * 10.0, 0.0]]))
        stepwise += PathReward(posterior, level).value(here)
    assert stepwise < 0.95 * whole


@pytest.mark.parametrize("team", [0, 12])
def test_paths_valued_together_have_the_values_that_they_have_alone(team):
    rng, *_, reward = _situation(8, 70, team)
    columns = reward.posterior.columns(rng.uniform(0, 400, (5 * 7, 2)))
    together = reward.values_of_equal(columns, 7)
    alone = [reward.value(columns.slice(7 * i, 7 * i + 7)) for i in range(5)]
    assert together == pytest.approx(np.array(alone), rel=1e-9)


def test_places_whose_covariance_is_not_positive_definite_are_an_error():
    rng, *_, reward = _situation(9, 50)
    columns = reward.posterior.columns(rng.uniform(0, 400, (2 * 7, 2)))
    broken = dataclasses.replace(columns, white=3.0 * columns.white)  # explains more than there is
    with pytest.raises(ValueError, match="covariance of 7 planned places is not positive definite"):
        reward.values_of_equal(broken, 7)
    with pytest.raises(ValueError, match="covariance of 7 planned places is not positive definite"):
        reward.value(broken.slice(0, 7))
