"""The ways to make a new plan: a tree search on the path's reward, a naive path alone, one leg ahead."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.vocabulary.plan import NONE
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.rollout import PlannedPath, Rollout
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.sequences import PathSequences
from auv_lse_planner.search.situation import Proposal, Situation
from auv_lse_planner.search.tree import ActionTree
from auv_lse_planner.search.uct import Actions, run_search

Array = NDArray[np.float64]

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


def _path(s: Situation, rollout: Rollout, actions: Actions, naive_path: int) -> PlannedPath:
    """The path of actions and a naive path from the situation's state."""
    return rollout.path(s.step, s.state, actions, naive_path)


def naive_only(
    situation: Situation, space: FreeSpace, rollout: Rollout, reward: PathReward, naive_path: int
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
    return Proposal(actions=actions, naive_path=naive_path, value=reward.value(reward.posterior.at(places)))


def one_leg(situation: Situation, space: FreeSpace, rollout: Rollout, reward: PathReward) -> Proposal:
    """The best next leg by the score that `planner.proposals` names: the baselines that look one step ahead."""
    s, score = situation, situation.planner.proposals
    choices = space.choices(s.state)
    states = np.broadcast_to(s.state, (len(choices), 3))
    columns = reward.posterior.at(space.motion.end_states(states, choices)[:, 1:])
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
    return Proposal(actions=(action,), naive_path=NONE, value=reward.value(reward.posterior.at(places)))
