"""How each kind of method makes a new plan: tree search on the path's or the map's reward, one leg ahead, naive."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.plan import NONE
from auv_lse_gp.area import Grid
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.naive import NaivePaths
from auv_lse_planner.reward.map import MapReward
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.reward.surrogate import Surrogate
from auv_lse_planner.search.lattice import LatticeSearch
from auv_lse_planner.search.sequences import PathSequences
from auv_lse_planner.search.tree import ActionTree
from auv_lse_planner.search.uct import Actions, run_search

Array = NDArray[np.float64]

#: Keeps a share of nothing from being a division by zero.
TINY = 1e-12
#: Legs of a lawnmower that are checked against the map, and of a detour around shallow ground.
DETOUR_LEGS = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """What a decision starts from, and its budget.

    Attributes:
        state: Heading, north, east, shape (3,).
        steps_left: Steps to the mission's end.
        horizon: Legs to search.
        naive_paths: Ids of naive paths that may continue the plan; empty for none.
        iterations: Search budget.
        exploration: Exploration constant.
        batch: Paths valued together.
        samples_per_leg: Measurement places on a leg.
        finalists: Paths of a surrogate's search that are valued exactly.
        rng: Random stream.
        deadline: Says when to stop.
        seeds: Action sequences tried first.
        grid: Grid of places over the area, to guess what naive paths bring; None: not guessed.
        map_share: Weight of the map's reward in the order of finalists that the path's reward proposes.
        to_beat: Value of the incumbent, if it may stay.
    """

    state: Array
    steps_left: int
    horizon: int
    naive_paths: tuple[int, ...]
    iterations: int
    exploration: float
    batch: int
    samples_per_leg: int
    finalists: int
    rng: np.random.Generator
    deadline: Callable[[], bool] | None
    seeds: list[Actions]
    grid: Grid | None = None
    map_share: float = 0.0
    to_beat: float = -math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """A new plan.

    Attributes:
        actions: Its actions.
        naive_path: Naive path that continues it, 0xFF for none.
        value: Its exact value; NaN if the method does not value it.
        iterations: Search iterations.
        evaluations: Different paths valued exactly.
        deadline_hit: Whether the deadline ended the search.
        ranking: Sequences with values, best first.
        progress: (iteration, best value) at every improvement.
    """

    actions: Actions
    naive_path: int
    value: float
    iterations: int = 0
    evaluations: int = 0
    deadline_hit: bool = False
    ranking: list[tuple[Actions, float]] = field(default_factory=list)
    progress: list[tuple[int, float]] = field(default_factory=list)


def search_path(situation: Situation, space: FreeSpace, naive: NaivePaths, reward: PathReward) -> Proposal:
    """Tree search on the paper's reward, every path valued exactly."""
    s = situation
    sequences = PathSequences(
        reward, space.motion, naive, s.state, s.steps_left, s.naive_paths, s.samples_per_leg, s.grid
    )
    # a good part of the growing phase goes to what promises most
    seeds = [*s.seeds, *sequences.promising(space, s.horizon, s.iterations // 4, 2, s.deadline)]
    tree = ActionTree(space, s.state, s.horizon, s.exploration)
    result = run_search(tree, sequences, s.horizon, s.iterations, s.batch, s.rng, s.deadline, seeds)
    return Proposal(
        actions=result.actions,
        naive_path=sequences.continuations[result.actions].naive_path,
        value=result.value,
        iterations=result.iterations,
        evaluations=result.evaluations,
        deadline_hit=result.deadline_hit,
        ranking=result.ranking,
        progress=result.progress,
    )


def chosen_with_map(
    found: Proposal, situation: Situation, space: FreeSpace, reward: MapReward, share: float
) -> Proposal:
    """The finalist of a search on the path's reward that is best by both rewards: J / max J + share J_map / max J_map.

    The best paths of such a search are nearly equal by the path's reward (which is flat where nothing is known yet),
    and far from equal by what they bring to the map.
    """
    ranking = _by_both(found, situation, space, reward, share)
    return replace(found, actions=ranking[0][0], value=ranking[0][1], ranking=ranking)


def _by_both(
    found: Proposal, s: Situation, space: FreeSpace, reward: MapReward, share: float
) -> list[tuple[Actions, float]]:
    """The ranking with its finalists in the order of their score by both rewards."""
    finalists = [(a, v) for a, v in found.ranking[: s.finalists] if len(a) == len(found.actions)]
    values = np.array([v for _, v in finalists])
    by_map = reward.values_of_equal(
        reward.posterior.columns(np.concatenate([_head_places(s, space, a) for a, _ in finalists])),
        len(found.actions) * s.samples_per_leg,
    )
    score = values / max(values.max(), TINY) + share * by_map / max(by_map.max(), TINY)
    first = [finalists[i] for i in np.argsort(-score, kind="stable")]
    return [*first, *(f for f in found.ranking if f not in first)]


def search_map(
    situation: Situation,
    space: FreeSpace,
    naive: NaivePaths,
    reward: MapReward,
    surrogate: Surrogate,
    own: PathReward | None = None,
) -> Proposal:
    """The best path by the map's reward among the finalists of a search, each continued by a naive path.

    The search is on the reward's surrogate; finalists are continued by the naive path that the surrogate likes best,
    and valued exactly. Where `own` is given, the search is on that reward of the path's own places, and of its
    finalists, in the order of `chosen_with_map`, the first is taken that is worth at least the incumbent: the mission's
    bound asks no more, and that order brings more at once.
    """
    s = situation
    if own is None:
        search = LatticeSearch(space, surrogate, s.samples_per_leg)
        ranking, done, hit = search.run(s.state, s.horizon, s.iterations, s.exploration, s.rng, s.deadline, s.seeds)
        finalists = _diverse(ranking, s.finalists)
    else:
        found = search_path(replace(s, naive_paths=()), space, naive, own)
        done, hit = found.iterations, found.deadline_hit
        ranking = _by_both(found, s, space, reward, s.map_share)
        finalists = [a for a, _ in ranking[: s.finalists]]
    best: tuple[float, Actions, int] = (-math.inf, (), NONE)
    exact: list[tuple[Actions, float]] = []
    progress: list[tuple[int, float]] = []
    for actions in finalists:
        if exact and s.deadline is not None and s.deadline():
            hit = True
            break
        naive_path, places = _continued(s, space, naive, surrogate, actions)
        value = reward.value(reward.posterior.columns(places))
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


def _head_places(s: Situation, space: FreeSpace, actions: Actions) -> Array:
    """Measurement places (P, 2) of actions from the situation's state."""
    states = space.motion.roll(s.state, actions)
    return space.motion.sample_places(states[:-1], np.array(actions), s.samples_per_leg)


def _continued(
    s: Situation, space: FreeSpace, naive: NaivePaths, surrogate: Surrogate, actions: Actions
) -> tuple[int, Array]:
    """The naive path that continues actions best by the surrogate, and the places (P, 2) of both."""
    head = _head_places(s, space, actions)
    if not s.naive_paths:
        return NONE, head
    end = space.motion.roll(s.state, actions)[-1]
    left = s.steps_left - len(actions)
    wholes = [np.concatenate([head, naive.path_places(end, h, left, s.samples_per_leg)]) for h in s.naive_paths]
    best = int(np.argmax([surrogate.value(whole) for whole in wholes]))
    return s.naive_paths[best], wholes[best]


def _diverse(ranking: list[tuple[Actions, float]], count: int) -> list[Actions]:
    """The best sequences: half of `count` outright, half the best of each first action."""
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
    situation: Situation, space: FreeSpace, naive: NaivePaths, reward: PathReward | MapReward, naive_path: int
) -> Proposal:
    """A naive path alone (the lawnmower), to the mission's end.

    Where it would cross ground that the map shows to be too shallow, its first legs lead around and are given one by
    one, as other vehicles do not know of that ground.
    """
    s = situation
    static = naive.actions(s.state, naive_path, s.steps_left)
    actions: Actions = ()
    if not space.path_feasible(s.state, static, DETOUR_LEGS):
        around = naive.actions(s.state, naive_path, s.steps_left, around_shallows=True)
        actions = tuple(int(a) for a in around[:DETOUR_LEGS])
    places = _whole(s, space, naive, actions, naive_path)
    return Proposal(actions=actions, naive_path=naive_path, value=reward.value(reward.posterior.columns(places)))


def one_leg(
    situation: Situation, space: FreeSpace, naive: NaivePaths, reward: PathReward | MapReward, score: str
) -> Proposal:
    """The best next leg by a score, or a random one for "": the baselines that look one step ahead."""
    s = situation
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
        path = PathReward(reward.posterior, level)
        scores = path.values_of_equal(columns, 1)
    else:
        scores = s.rng.random(len(choices))
    action = int(choices[int(np.argmax(scores))])
    places = _whole(s, space, naive, (action,), NONE)
    return Proposal(actions=(action,), naive_path=NONE, value=reward.value(reward.posterior.columns(places)))


def _whole(s: Situation, space: FreeSpace, naive: NaivePaths, actions: Actions, naive_path: int) -> Array:
    """Measurement places of actions and the naive path after them."""
    own = np.array(actions, dtype=np.int64)
    state = space.motion.roll(s.state, own)[-1]
    every = np.concatenate([own, naive.actions(state, naive_path, s.steps_left - len(own))])
    return space.motion.sample_places(space.motion.roll(s.state, every)[:-1], every, s.samples_per_leg)
