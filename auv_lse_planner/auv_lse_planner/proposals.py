"""The ways to make a new plan: a tree search on the path's or the map's reward, a naive path alone, one leg ahead."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.plan import NONE
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.rollout import PlannedPath, Rollout
from auv_lse_planner.reward.map import MapReward
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.reward.surrogate import Surrogate
from auv_lse_planner.search.sequences import PathSequences, SurrogateSequences
from auv_lse_planner.search.tree import ActionTree
from auv_lse_planner.search.uct import Actions, SearchResult, run_search
from auv_lse_planner.situation import Proposal, Situation

Array = NDArray[np.float64]

#: Least value that a score is divided by: where all paths are worth nothing, their scores are 0.
TINY = 1e-12
#: Sequences that a search on the surrogate values together.
SURROGATE_BATCH = 16
#: Legs of a lawnmower that are checked against the map, and of a detour around shallow ground.
DETOUR_LEGS = 10


def search_path(situation: Situation, space: FreeSpace, rollout: Rollout, reward: PathReward) -> Proposal:
    """Tree search on the paper's reward, every path valued exactly."""
    s, planner = situation, situation.planner
    sequences = PathSequences(reward, rollout, s.step, s.state, s.naive_paths, s.grid)
    # a good part of the growing phase goes to what promises most
    seeds = [*s.seeds, *sequences.promising(space, s.horizon, planner.iterations // 4, 2, s.deadline)]
    tree = ActionTree(space, s.state, s.horizon, planner.exploration)
    result = run_search(tree, sequences, s.horizon, planner.iterations, planner.batch, s.rng, s.deadline, seeds)
    return Proposal(
        actions=result.actions,
        naive_path=sequences.naive_path[result.actions],
        value=result.value,
        iterations=result.iterations,
        evaluations=result.evaluations,
        deadline_hit=result.deadline_hit,
        ranking=result.ranking,
        progress=result.progress,
    )


def search_surrogate(situation: Situation, space: FreeSpace, rollout: Rollout, surrogate: Surrogate) -> SearchResult:
    """Tree search on the surrogate of the map's reward: thousands of iterations in the time of some exact values."""
    s, planner = situation, situation.planner
    tree = ActionTree(space, s.state, s.horizon, planner.exploration)
    sequences = SurrogateSequences(surrogate, rollout, s.state)
    return run_search(tree, sequences, s.horizon, planner.iterations, SURROGATE_BATCH, s.rng, s.deadline, s.seeds)


def chosen_with_map(found: Proposal, situation: Situation, rollout: Rollout, reward: MapReward) -> Proposal:
    """The finalist of a search on the path's reward that is best by both: J / max J + map_share J_map / max J_map.

    The best paths of such a search are nearly equal by the path's reward (which is flat where nothing is known yet),
    and far from equal by what they bring to the map.
    """
    ranking = _by_both(found, situation, rollout, reward)
    return replace(found, actions=ranking[0][0], value=ranking[0][1], ranking=ranking)


def _by_both(found: Proposal, s: Situation, rollout: Rollout, reward: MapReward) -> list[tuple[Actions, float]]:
    """The ranking with its finalists in the order of their score by both rewards."""
    finalists = [(a, v) for a, v in found.ranking[: s.planner.finalists] if len(a) == len(found.actions)]
    values = np.array([v for _, v in finalists])
    places = np.concatenate([_path(s, rollout, actions, NONE).places_m for actions, _ in finalists])
    by_map = reward.values_of_equal(reward.posterior.columns(places), len(places) // len(finalists))
    score = values / max(values.max(), TINY) + s.planner.map_share * by_map / max(by_map.max(), TINY)
    first = [finalists[i] for i in np.argsort(-score, kind="stable")]
    return [*first, *(f for f in found.ranking if f not in first)]


def search_map(
    situation: Situation,
    space: FreeSpace,
    rollout: Rollout,
    reward: MapReward,
    surrogate: Surrogate,
    own: PathReward | None = None,
) -> Proposal:
    """The best path by the map's reward among the finalists of a search, each continued by a naive path.

    The search is on the reward's surrogate; finalists are continued by the naive path that the surrogate likes best,
    and valued exactly. Where `own` is given, the search is on that reward of the path's own places, and of its
    finalists, in the order of `chosen_with_map`, the first is taken that is worth at least the incumbent: the mission's
    bound needs no more, and this order brings more early on.
    """
    s, planner = situation, situation.planner
    if own is None:
        searched = search_surrogate(s, space, rollout, surrogate)
        ranking, done, hit = searched.ranking, searched.iterations, searched.deadline_hit
        finalists = _diverse(ranking, planner.finalists)
    else:
        found = search_path(replace(s, naive_paths=()), space, rollout, own)
        ranking, done, hit = _by_both(found, s, rollout, reward), found.iterations, found.deadline_hit
        finalists = [a for a, _ in ranking[: planner.finalists]]
    best: tuple[float, Actions, int] = (-math.inf, (), NONE)
    exact: list[tuple[Actions, float]] = []
    progress: list[tuple[int, float]] = []
    for actions in finalists:
        if exact and s.deadline is not None and s.deadline():
            hit = True
            break
        naive_path, path = _continued(s, rollout, surrogate, actions)
        value = reward.value(reward.posterior.columns(path.places_m))
        exact.append((actions, value))
        if value > best[0]:
            best = (value, actions, naive_path)
            progress.append((done, value))
        if own is not None and value >= s.to_beat:
            best = (value, actions, naive_path)
            break
    return Proposal(
        actions=best[1],
        naive_path=best[2],
        value=best[0],
        iterations=done,
        evaluations=len(exact),
        deadline_hit=hit,
        ranking=sorted(exact, key=lambda item: -item[1]) + ranking[:16],
        progress=progress,
    )


def _path(s: Situation, rollout: Rollout, actions: Actions, naive_path: int) -> PlannedPath:
    """The path of actions and a naive path from the situation's state."""
    return rollout.path(s.step, s.state, actions, naive_path)


def _continued(s: Situation, rollout: Rollout, surrogate: Surrogate, actions: Actions) -> tuple[int, PlannedPath]:
    """The naive path that continues actions best by the surrogate, and the path of both."""
    ids = s.naive_paths or (NONE,)
    paths = [_path(s, rollout, actions, naive_path) for naive_path in ids]
    best = int(np.argmax([surrogate.value(path.places_m) for path in paths])) if len(paths) > 1 else 0
    return ids[best], paths[best]


def _diverse(ranking: list[tuple[Actions, float]], count: int) -> list[Actions]:
    """The best half of `count` sequences, then the best of each other first action, then the next best."""
    chosen = [a for a, _ in ranking[: (count + 1) // 2]]
    firsts = {a[0] for a in chosen}
    for actions, _ in ranking:
        if len(chosen) >= count:
            break
        if actions[0] not in firsts:
            firsts.add(actions[0])
            chosen.append(actions)
    for actions, _ in ranking:
        if len(chosen) >= count:
            break
        if actions not in chosen:
            chosen.append(actions)
    return chosen


def naive_only(
    situation: Situation, space: FreeSpace, rollout: Rollout, reward: PathReward | MapReward, naive_path: int
) -> Proposal:
    """A naive path alone (the lawnmower), to the mission's end.

    Where it would cross ground that the map shows to be too shallow, its first legs lead around and are given one by
    one, as other vehicles do not know of that ground.
    """
    s, naive, left = situation, rollout.naive, rollout.steps - situation.step
    static = naive.actions(s.state, naive_path, left)
    actions: Actions = ()
    if not space.path_feasible(s.state, static, DETOUR_LEGS):
        around = naive.actions(s.state, naive_path, left, around_shallows=True)
        actions = tuple(int(a) for a in around[:DETOUR_LEGS])
    places = _path(s, rollout, actions, naive_path).places_m
    return Proposal(actions=actions, naive_path=naive_path, value=reward.value(reward.posterior.columns(places)))


def one_leg(situation: Situation, space: FreeSpace, rollout: Rollout, reward: PathReward | MapReward) -> Proposal:
    """The best next leg by the score that `planner.proposals` names: the baselines that look one step ahead."""
    s, score = situation, situation.planner.proposals
    choices = space.choices(s.state)
    states = np.broadcast_to(s.state, (len(choices), 3))
    columns = reward.posterior.columns(space.motion.end_states(states, choices)[:, 1:])
    level = reward.level_set
    std = np.sqrt(columns.planned_var_m2)
    if score == "variance":
        scores = std
    elif score == "straddle":  # Bryan et al. 2006
        scores = 1.96 * std - np.abs(columns.mean_m - level.level_m)
    elif score == "benefit":
        scores = PathReward(reward.posterior, level).values_of_equal(columns, 1)
    else:
        scores = s.rng.random(len(choices))
    action = int(choices[int(np.argmax(scores))])
    places = _path(s, rollout, (action,), NONE).places_m
    return Proposal(actions=(action,), naive_path=NONE, value=reward.value(reward.posterior.columns(places)))
