"""Tree search on the paper's reward: sequences of actions, each continued by a naive path."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from auv_lse_common.mission_file.operating_area import Grid
from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.support.arrays import Array
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.rollout import Rollout
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.sequences import PathSequences
from auv_lse_planner.search.tree import ActionTree
from auv_lse_planner.search.uct import Actions, SearchResult, run_search

#: Number of paths that the search evaluates together.
BATCH = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchProblem:
    """The inputs of a tree search.

    Attributes:
        step: Mission step planned from.
        state: Heading (rad), north, east (m), shape (3,).
        horizon: Legs to search: the horizon, or the remaining legs of the mission if fewer.
        naive_paths: Ids of naive paths that may continue the plan; empty for none.
        deadline: Returns whether to stop searching; None: no deadline.
        grid: Grid of the map's locations, to estimate the reward of naive paths; None: no estimate.
    """

    planner: PlannerConfig
    step: int
    state: Array
    horizon: int
    naive_paths: tuple[int, ...]
    rng: np.random.Generator
    deadline: Callable[[], bool] | None = None
    seeds: list[Actions] = field(default_factory=list)
    grid: Grid | None = None


@dataclass(frozen=True, slots=True)
class Proposal:
    """A new plan.

    Attributes:
        found: Its actions, their value, and statistics of the search.
        naive_path: Id of the naive path that continues it, `NONE` for none.
    """

    found: SearchResult
    naive_path: int


def search_path(problem: SearchProblem, space: FreeSpace, rollout: Rollout, reward: PathReward) -> Proposal:
    """Searches for the sequence of the largest reward; every path is evaluated exactly."""
    p, planner = problem, problem.planner
    sequences = PathSequences(reward, rollout, p.step, p.state, p.naive_paths, p.grid)
    # try the most promising sequences first
    seeds = [*p.seeds, *sequences.promising(space, p.horizon, planner.iterations // 4, 2, p.deadline)]
    tree = ActionTree(space, p.state, p.horizon, planner.exploration)
    found = run_search(tree, sequences, p.horizon, planner.iterations, BATCH, p.rng, p.deadline, seeds)
    return Proposal(found, sequences.naive_path[found.actions])
