"""The named configurations: what `planner.method` stands for, before single parameters override it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from auv_lse_planner.config import METHODS, PlannerConfig
from auv_lse_planner.paths.naive import COVERING, LAWNMOWERS, STRIPS


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe:
    """A method with every choice made.

    Attributes:
        method: Its name.
        kind: "search" (tree search), "greedy" (one step ahead by a score), "random" or "naive" (a naive path alone).
        objective: "path" (the paper's reward) or "map" (risk over the area).
        credit: "printed" or "beyond" (see `path_reward.py`).
        horizon: Legs searched (paper: m).
        iterations: Search budget.
        exploration: Exploration constant of UCT.
        tail: Whether naive paths continue the plan to the mission's end (augmented).
        naive_paths: Their ids; the best one is taken (kind "naive": vehicle n takes the n-th, modulo their number).
        incumbent: Whether the last plan stays unless the new one is worth more.
        proposals: Which search proposes the paths that the map's reward is asked about: "surrogate" or "path".
        map_share: Weight of the map's reward in the order of the finalists of the search on the path's reward.
        finalists: Paths that the map's reward is asked about.
        risk_method: How the expected risk is computed, if not as `level_set.method` says.
        score: Score of a greedy method: "benefit", "variance" or "straddle".
    """

    method: str
    kind: str = "search"
    objective: str = "path"
    credit: str = "printed"
    horizon: int = 3
    iterations: int = 100
    exploration: float = 0.2
    tail: bool = True
    naive_paths: tuple[int, ...] = (LAWNMOWERS[0],)
    incumbent: bool = True
    score: str = ""
    proposals: str = "surrogate"
    map_share: float = 0.0
    finalists: int = 8
    risk_method: str = ""


RECIPES = {
    # The paper's two methods, as printed.
    "augmented": Recipe(method="augmented"),
    "plain": Recipe(
        method="plain", horizon=10, iterations=300, exploration=0.5, tail=False, naive_paths=(), incumbent=False
    ),
    # The paper's augmented method with the approximate risk integral that it uses.
    "exponential_quadratic": Recipe(method="exponential_quadratic", risk_method="exponential_quadratic"),
    # Risk over the whole area instead of at the path's own places.
    "map": Recipe(
        method="map",
        objective="map",
        credit="beyond",
        horizon=10,
        iterations=2000,
        exploration=0.5,
        tail=False,
        naive_paths=(),
        incumbent=False,
    ),
    # The plain search proposes, credited beyond the team mates' plans; the map's reward has a say in the choice among
    # its finalists, which are nearly equal by the path's: what did best (docs/planner.md).
    "best": Recipe(
        method="best",
        credit="beyond",
        horizon=10,
        iterations=150,
        exploration=0.5,
        tail=False,
        naive_paths=(),
        incumbent=False,
        map_share=1.0,
        finalists=16,
    ),
    # The same proposals in the same order, continued to the mission's end: the first that is worth as much on the map
    # as the incumbent is taken. Keeps the bound (in expectation).
    "bounded": Recipe(
        method="bounded",
        objective="map",
        credit="beyond",
        proposals="path",
        horizon=10,
        iterations=150,
        exploration=0.5,
        naive_paths=(*COVERING, *STRIPS),
        map_share=1.0,
        finalists=16,
    ),
    # Baselines.
    "lawnmower": Recipe(method="lawnmower", kind="naive", horizon=1, naive_paths=STRIPS),
    "random": Recipe(method="random", kind="random", horizon=1, tail=False, naive_paths=(), incumbent=False),
    "myopic": Recipe(
        method="myopic", kind="greedy", score="benefit", horizon=1, tail=False, naive_paths=(), incumbent=False
    ),
    "max_variance": Recipe(
        method="max_variance", kind="greedy", score="variance", horizon=1, tail=False, naive_paths=(), incumbent=False
    ),
    "straddle": Recipe(
        method="straddle", kind="greedy", score="straddle", horizon=1, tail=False, naive_paths=(), incumbent=False
    ),
}

assert set(RECIPES) == set(METHODS)


def recipe(config: PlannerConfig) -> Recipe:
    """The recipe of `config.method` with what `config` sets itself on top."""
    base = RECIPES[config.method]

    def pick(name: str) -> Any:
        value = getattr(config, name)
        return getattr(base, name) if value is None else value

    tail = bool(pick("tail"))
    paths: tuple[int, ...] = tuple(pick("naive_paths"))
    if tail and not paths:
        paths = (LAWNMOWERS[0],)
    return Recipe(
        method=base.method,
        kind=base.kind,
        objective=str(pick("objective")),
        credit=str(pick("credit")),
        horizon=int(pick("horizon")),
        iterations=int(pick("iterations")),
        exploration=float(pick("exploration")),
        tail=tail,
        naive_paths=paths if tail or base.kind == "naive" else (),
        incumbent=bool(pick("incumbent")),
        score=base.score,
        risk_method=base.risk_method,
        proposals=str(pick("proposals")),
        map_share=float(pick("map_share")),
        finalists=int(pick("finalists")),
    )
