"""Planning methods: the planner parameters that each `planner.method` sets where the mission file leaves them out.

A method is an entry of `METHODS`. It lists only what differs from the paper's augmented method, whose values are
declared with the parameters (`sections.planner.from_method`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from auv_lse_common.vocabulary.naive_ids import FITTED

#: No naive path after the searched legs, and no incumbent.
_PLAIN: dict[str, Any] = {"augmented": False, "naive_paths": (), "incumbent": False}

#: Parameters of each method that differ from the paper's augmented method.
METHODS: dict[str, dict[str, Any]] = {
    # One tour over the rest of the mission, re-optimized within a budget, so that it meets the bound.
    "tour": {
        "proposals": "tour",
        "augmented": False,
        "naive_paths": (),
        "iterations": 150,
        "credit": "beyond",
        "horizon": 8,
        "exploration": 0.5,
        "tour_interval": 4,
    },
    # The paper's two methods, as printed.
    "augmented": {},
    "plain": {**_PLAIN, "horizon": 10, "iterations": 300, "exploration": 0.5},
    # The paper's augmented method with the paper's approximate risk integral, see `RISK_METHODS`.
    "exponential_quadratic": {},
    # Baselines: a tour that is never re-optimized, a single naive path, and one-leg scores.
    "fixed_tour": {
        "proposals": "tour",
        "augmented": False,
        "naive_paths": (),
        "iterations": 150,
        "tour_interval": 0,
    },
    "lawnmower": {"proposals": "naive", "horizon": 1, "naive_paths": FITTED},
    "random": {**_PLAIN, "proposals": "random", "horizon": 1},
    "myopic": {**_PLAIN, "proposals": "benefit", "horizon": 1},
    "max_variance": {**_PLAIN, "proposals": "variance", "horizon": 1},
    "straddle": {**_PLAIN, "proposals": "straddle", "horizon": 1},
}

#: Methods that override `level_set.method`, with the value that they use.
RISK_METHODS = {"exponential_quadratic": "exponential_quadratic"}

#: Values of `planner.proposals`: the tour, the tree search, then the baselines.
PROPOSALS = ("tour", "path", "naive", "random", "benefit", "variance", "straddle")

#: The paper's methods. They maximize the paper's reward, which says little about the other methods.
PAPER_METHODS = ("augmented", "exponential_quadratic", "plain")


def unless_paper_method(given: bool | None, parameters: Mapping[str, Any]) -> bool:
    """Resolves a switch whose default is true, but false with the paper's methods.

    Args:
        given: The mission file's value; None if it is left out.
        parameters: A node's nested parameters; only `planner.method` is read.
    """
    if given is not None:
        return given
    return dict(parameters.get("planner", {})).get("method") not in PAPER_METHODS
