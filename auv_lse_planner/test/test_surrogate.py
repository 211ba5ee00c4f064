import numpy as np
import pytest
from planner_helpers import centers, world
from scipy.stats import spearmanr

from auv_lse_common.compiled import plain
from auv_lse_gp.config import GpConfig
from auv_lse_gp.kept import KeptColumns
from auv_lse_gp.posterior import Posterior
from auv_lse_gp.risk import LevelSet
from auv_lse_planner.reward.map import MapReward
from auv_lse_planner.reward.surrogate import Surrogate, fill_row, risk_table, table_risk


def _situation(seed, data, team=0, level=None, spacing=20.0):
    rng = np.random.default_rng(seed)
    a, motion, space, _ = world()
    grid = a.grid(spacing)
    posterior = Posterior(GpConfig())
    posterior.follow(centers(rng, data))
    posterior.plan(rng.uniform(0, 360, (team, 2)))
    level = level or LevelSet()
    reward = MapReward(KeptColumns(posterior, grid.places_m), level)
    surrogate = Surrogate(grid, level)
    surrogate.set(reward)
    return rng, motion, space, reward, surrogate, grid


def _walk(rng, motion, space, length):
    state = np.array([rng.uniform(-3, 3), *rng.uniform(60, 300, 2)])
    actions = []
    for _ in range(length):
        actions.append(int(rng.choice(space.choices(state))))
        state = motion.end_state(state, actions[-1])
    return actions, state


@pytest.mark.parametrize("level", [LevelSet(), LevelSet(cost_false_safe=20.0, cost_false_unsafe=4.0)])
def test_the_table_reads_the_expected_risk(level):
    table = risk_table(level)
    rng = np.random.default_rng(1)
    h, phi = rng.uniform(-4, 4, 2000), rng.uniform(0, np.pi / 2, 2000)
    exact = level.expected_risk(level.level_m - h, np.cos(phi), np.sin(phi))
    read = np.array([table_risk(table, x, y) for x, y in zip(h, phi, strict=True)])
    # bilinear on steps of 1/16 and 1.4 degrees: a few thousandths of the largest risk (the cost of a wrong call)
    assert np.abs(read - exact).max() < 4e-3 * max(level.cost_false_safe, level.cost_false_unsafe)


@pytest.mark.parametrize("team", [0, 20])
def test_one_place_on_the_grid_is_valued_almost_exactly(team):
    rng, _, _, reward, surrogate, grid = _situation(2, 40, team)
    for place in grid.places_m[rng.integers(0, len(grid.places_m), 20)]:
        exact = reward.value(reward.posterior.columns(place[None]))
        # the table of the risk is read bilinearly, and drops of less than NEGLIGIBLE of a variance are left out
        assert surrogate.value(place[None]) == pytest.approx(exact, rel=0.06, abs=0.5)


@pytest.mark.parametrize(("seed", "data"), [(3, 0), (4, 30), (5, 120), (6, 250)])
def test_it_ranks_paths_like_the_exact_drop(seed, data):
    rng, motion, space, reward, surrogate, _ = _situation(seed, data)
    exact, quick = [], []
    for _ in range(60):
        state = np.array([rng.uniform(-3, 3), *rng.uniform(40, 320, 2)])
        states, actions = [state], []
        for _ in range(10):
            actions.append(int(rng.choice(space.choices(states[-1]))))
            states.append(motion.end_state(states[-1], actions[-1]))
        places = np.array(states)[1:, 1:]
        exact.append(reward.value(reward.posterior.columns(places)))
        quick.append(surrogate.value(places))
    assert spearmanr(exact, quick).statistic > 0.9


def test_monotone_and_submodular():
    rng, _, _, _, surrogate, grid = _situation(7, 60)
    for _ in range(20):
        places = grid.places_m[rng.integers(0, len(grid.places_m), 12)]
        small, large, extra = places[:4], places[:11], places[11:]
        gain_small = surrogate.value(np.concatenate([small, extra])) - surrogate.value(small)
        gain_large = surrogate.value(np.concatenate([large, extra])) - surrogate.value(large)
        assert gain_small >= gain_large - 1e-3
        assert gain_large >= -1e-3


def test_compiled_rows_equal_the_plain_ones():
    _, _, _, _, s, _ = _situation(8, 30, spacing=50.0)
    for place in (0, 5, len(s.h) - 1):
        one, two = np.zeros(len(s.h), np.float32), np.zeros(len(s.h), np.float32)
        arguments = (s.covariance, s.noise, place, s._table, s.h, s.data_var, s.base_var, s.base_risk)
        fill_row(one, *arguments)
        plain(fill_row)(two, *arguments)
        assert one == pytest.approx(two, rel=1e-5, abs=1e-5)  # float32
