import numpy as np
import pytest
from planner_helpers import centers, rollout, world

import auv_lse_planner.search.lattice as module
from auv_lse_common.compiled import plain
from auv_lse_common.plan import NONE
from auv_lse_gp.config import GpConfig
from auv_lse_gp.kept import KeptColumns
from auv_lse_gp.posterior import Posterior
from auv_lse_gp.risk import LevelSet
from auv_lse_planner.reward.map import MapReward
from auv_lse_planner.reward.surrogate import Surrogate
from auv_lse_planner.search.lattice import LatticeSearch

STATE = np.array([0.4, 150.0, 200.0])


def _search(spacing=40.0, samples=1):
    rng = np.random.default_rng(1)
    a, _, space, _ = world()
    grid = a.grid(spacing)
    posterior = Posterior(GpConfig())
    posterior.follow(centers(rng, 40))
    surrogate = Surrogate(grid, LevelSet())
    surrogate.set(MapReward(KeptColumns(posterior, grid.places_m), LevelSet()))
    return space, surrogate, LatticeSearch(space, surrogate, samples)


def _run(search, iterations=300, seed=1, deadline=None, seeds=(), horizon=6):
    return search.run(STATE, horizon, iterations, 0.5, np.random.default_rng(seed), deadline, list(seeds))


@pytest.mark.parametrize("samples", [1, 2])
def test_values_are_the_surrogates_and_paths_are_feasible(samples):
    roll, _ = rollout(20, samples)
    space, surrogate, search = _search(samples=samples)
    ranking, done, hit = _run(search)
    assert done == 300
    assert not hit
    values = [v for _, v in ranking]
    assert values == sorted(values, reverse=True)
    assert len({a for a, _ in ranking}) == len(ranking)
    for actions, value in ranking[:10]:
        state = STATE
        for action in actions:
            assert action in space.feasible(state)
            state = space.motion.end_state(state, action)
        places = roll.path(0, STATE, actions, NONE).places_m
        assert value == pytest.approx(surrogate.value(places), rel=1e-5)


def test_the_compiled_search_does_what_the_plain_one_does(monkeypatch):
    _, _, search = _search(spacing=80.0)
    quick = _run(search, 40)
    monkeypatch.setattr(module, "run_chunk", plain(module.run_chunk))
    slow = _run(search, 40)
    assert [a for a, _ in quick[0]] == [a for a, _ in slow[0]]
    assert [v for _, v in quick[0]] == pytest.approx([v for _, v in slow[0]], rel=1e-6)


def test_the_same_seed_gives_the_same_search_and_more_iterations_are_no_worse():
    _, _, search = _search()
    assert _run(search) == _run(search)
    short, long = _run(search, 100), _run(search, 2000)
    assert long[0][0][1] >= short[0][0][1]


def test_it_finds_a_good_part_of_what_random_search_finds_with_far_more():
    _, surrogate, search = _search()
    best_random = 0.0
    space = search._space
    rng = np.random.default_rng(5)
    for _ in range(1500):
        state, places = STATE, []
        for _ in range(6):
            state = space.motion.end_state(state, int(rng.choice(space.choices(state))))
            places.append(state[1:])
        best_random = max(best_random, surrogate.value(np.array(places)))
    assert _run(search, 1500)[0][0][1] >= best_random


def test_the_deadline_and_the_seeds():
    _, _, search = _search()
    ranking, done, hit = _run(search, 5000, deadline=lambda: True)
    assert (done, hit) == (100, True)
    best = _run(search, 3000)[0][0]
    again = _run(search, 100, seed=9, seeds=[best[0]])
    assert again[0][0][1] >= best[1] - 1e-6
    assert ranking
