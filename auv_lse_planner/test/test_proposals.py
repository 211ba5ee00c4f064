"""How finalists of a search are chosen by the map's reward."""

import dataclasses

import numpy as np
import pytest
from planner_helpers import centers, situation, world

from auv_lse_common.plan import NONE
from auv_lse_gp.config import GpConfig
from auv_lse_gp.kept import KeptColumns
from auv_lse_gp.posterior import Posterior
from auv_lse_gp.risk import LevelSet
from auv_lse_planner.paths.naive_ids import COVERING, STRIPS
from auv_lse_planner.paths.rollout import Rollout
from auv_lse_planner.proposals import chosen_with_map, search_map, search_path
from auv_lse_planner.reward.map import MapReward
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.reward.surrogate import Surrogate

STATE = np.array([0.4, 120.0, 150.0])


@pytest.fixture(scope="module")
def scene():
    """Free space, rollout over 40 legs, a map with 40 centers, its grid."""
    a, motion, space, naive = world()
    posterior = Posterior(GpConfig())
    grid = a.grid(20.0)
    posterior.follow(centers(np.random.default_rng(3), 40))
    return space, Rollout(motion, naive, 40, 1), posterior, grid


def _situation(naive_paths=(), map_share=0.0, **changes):
    made = situation(
        STATE,
        np.random.default_rng(4),
        naive_paths=naive_paths,
        horizon=6,
        iterations=120,
        exploration=0.5,
        finalists=16,
        map_share=map_share,
    )
    return dataclasses.replace(made, **changes)


def _places(rollout, actions, naive_path=NONE):
    return rollout.path(0, STATE, actions, naive_path).places_m


def test_the_choice_is_the_best_finalist_by_both_rewards(scene):
    space, rollout, posterior, grid = scene
    own, by_map = PathReward(posterior, LevelSet()), MapReward(KeptColumns(posterior, grid.places_m), LevelSet())
    found = search_path(_situation(), space, rollout, own)
    chosen = chosen_with_map(found, _situation(map_share=1.0), rollout, by_map)
    finalists = found.ranking[:16]
    maps = np.array([by_map.value(posterior.columns(_places(rollout, a))) for a, _ in finalists])
    values = np.array([v for _, v in finalists])
    score = values / values.max() + maps / maps.max()
    assert chosen.actions == finalists[int(np.argmax(score))][0]
    assert chosen.value == pytest.approx(own.value(posterior.columns(_places(rollout, chosen.actions))))
    assert chosen.actions != found.actions  # in this scene the map has another favourite
    assert sorted(chosen.ranking) == sorted(found.ranking)


def test_a_share_of_nothing_leaves_the_searchs_choice_and_a_large_one_the_maps(scene):
    space, rollout, posterior, grid = scene
    own, by_map = PathReward(posterior, LevelSet()), MapReward(KeptColumns(posterior, grid.places_m), LevelSet())
    found = search_path(_situation(), space, rollout, own)
    assert chosen_with_map(found, _situation(map_share=0.0), rollout, by_map).actions == found.actions
    maps = {a: by_map.value(posterior.columns(_places(rollout, a))) for a, _ in found.ranking[:16]}
    assert chosen_with_map(found, _situation(map_share=1e9), rollout, by_map).actions == max(maps, key=maps.__getitem__)


def test_paths_proposed_by_their_own_reward_are_valued_on_the_map_to_the_missions_end(scene):
    space, rollout, posterior, grid = scene
    own, by_map = (
        PathReward(posterior, LevelSet(), "beyond"),
        MapReward(KeptColumns(posterior, grid.places_m), LevelSet()),
    )
    surrogate = Surrogate(grid, LevelSet())
    surrogate.set(by_map)
    found = search_map(_situation(COVERING), space, rollout, by_map, surrogate, own)
    assert found.naive_path in COVERING
    whole = _places(rollout, found.actions, found.naive_path)
    assert len(whole) == rollout.steps
    assert found.value == pytest.approx(by_map.value(posterior.columns(whole)))
    proposed = search_path(_situation(), space, rollout, own).ranking[:16]
    assert found.actions in [a for a, _ in proposed]


def test_the_first_finalist_that_beats_the_incumbent_is_taken(scene):
    space, rollout, posterior, grid = scene
    own, by_map = (
        PathReward(posterior, LevelSet(), "beyond"),
        MapReward(KeptColumns(posterior, grid.places_m), LevelSet()),
    )
    surrogate = Surrogate(grid, LevelSet())
    surrogate.set(by_map)

    def search(**changes):
        return search_map(_situation(COVERING, **changes), space, rollout, by_map, surrogate, own)

    everything = search(to_beat=np.inf)
    assert everything.evaluations == 16
    liked = search_path(_situation(), space, rollout, own).actions  # share 0: the order is the path reward's
    assert search().actions == liked
    values = dict(everything.ranking[: everything.evaluations])
    beats = search(to_beat=values[liked] + 1e-9)
    assert beats.value > values[liked]
    assert beats.evaluations > 1
    assert everything.value == max(values.values())  # none beats it: the best, for the record


def test_without_naive_paths_only_the_legs_searched_count(scene):
    space, rollout, posterior, grid = scene
    by_map = MapReward(KeptColumns(posterior, grid.places_m), LevelSet())
    surrogate = Surrogate(grid, LevelSet())
    surrogate.set(by_map)
    found = search_map(_situation(), space, rollout, by_map, surrogate)
    assert found.naive_path == NONE
    places = _places(rollout, found.actions)
    assert found.value == pytest.approx(by_map.value(posterior.columns(places)))


def test_ids_of_strips_that_name_the_same_path_are_tried_once():
    *_, naive = world()  # two vehicles or one: see planner_helpers
    different = naive.different((*COVERING, *STRIPS))
    assert different[:4] == COVERING
    state = np.array([0.0, 50.0, 50.0])
    paths = [naive.actions(state, h, 60).tolist() for h in different]
    assert len({tuple(p) for p in paths[4:]}) == len(paths[4:])
    assert naive.different((STRIPS[4],)) == (STRIPS[4],)  # never empty
