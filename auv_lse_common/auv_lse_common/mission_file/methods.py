"""The methods: what `planner.method` sets of the planner's parameters, where a user does not set them.

A new method is an entry of `METHODS`: what it sets otherwise than the paper's augmented method, whose values stand with
the parameters (`config.from_method`).
"""

from __future__ import annotations

from typing import Any

from auv_lse_common.vocabulary.naive_ids import FITTED

#: Nothing after the legs searched, and the last plan is not kept.
_PLAIN: dict[str, Any] = {"augmented": False, "naive_paths": (), "incumbent": False}

#: What each method sets otherwise than the paper's augmented method.
METHODS: dict[str, dict[str, Any]] = {
    # One tour over all that is left, optimized again and again under an account: keeps the bound (docs/planner.md).
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
    # The paper's augmented method with the approximate risk integral that the paper uses: `risk_method`.
    "exponential_quadratic": {},
    # Baselines: the tour of the start, never optimized again; a naive path alone, and the next leg by a score.
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

#: How the expected risk is computed, where a method does not leave that to `level_set.method`.
RISK_METHODS = {"exponential_quadratic": "exponential_quadratic"}

#: Values of `planner.proposals`: the tour, the tree search, then the baselines.
PROPOSALS = ("tour", "path", "naive", "random", "benefit", "variance", "straddle")
