"""What a decision starts from, and what a method proposes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.area import Grid
from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_planner.search.uct import Actions

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """What a decision starts from.

    Attributes:
        planner: The planner's parameters, complete.
        step: Mission step planned from.
        state: Heading (rad), north, east (m), shape (3,).
        horizon: Legs to search: those of the horizon that the mission still has.
        naive_paths: Ids of naive paths that may continue the plan; empty for none.
        rng: Random stream.
        deadline: Says when to stop searching; None: never.
        seeds: Action sequences to try first.
        grid: Grid of the map's places: Dec-MCTS needs it, others guess by it what naive paths bring; None: not guessed.
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """A new plan.

    Attributes:
        actions: Its actions.
        naive_path: Id of the naive path that continues it, `NONE` for none.
        value: Its exact value.
        iterations: Search iterations.
        evaluations: Different paths valued exactly.
        deadline_hit: Whether the deadline ended the search.
        ranking: Sequences with values, best first.
        progress: (iteration, best value) at every improvement.
        for_team: Actions and naive path of the plan that team mates get instead of this one; None: they get this one.
    """

    actions: Actions
    naive_path: int
    value: float
    iterations: int = 0
    evaluations: int = 0
    deadline_hit: bool = False
    ranking: list[tuple[Actions, float]] = field(default_factory=list)
    progress: list[tuple[int, float]] = field(default_factory=list)
    for_team: tuple[Actions, int] | None = None
