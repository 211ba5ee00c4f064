"""The methods: what `planner.method` sets of the planner's parameters, where a user does not set them.

A new method is an entry of `METHODS`: what it sets otherwise than the paper's augmented method, whose values stand with
the parameters (`config.from_method`).
"""

from __future__ import annotations

from typing import Any

from auv_lse_planner.paths.naive_ids import COVERING, FITTED, STRIPS

#: Nothing after the legs searched, and the last plan is not kept.
_PLAIN: dict[str, Any] = {"augmented": False, "naive_paths": (), "incumbent": False}

#: What each method sets otherwise than the paper's augmented method.
METHODS: dict[str, dict[str, Any]] = {
    # One tour over all that is left, optimized again and again under an account: keeps the bound (docs/planner.md).
    "tour": {
        "proposals": "tour",
        "objective": "map",
        "augmented": False,
        "naive_paths": (),
        "iterations": 150,
        "credit": "beyond",
        "horizon": 8,
        "exploration": 0.5,
        "finalists": 3,
        "tour_interval": 4,
    },
    # The paper's two methods, as printed.
    "augmented": {},
    "plain": {**_PLAIN, "horizon": 10, "iterations": 300, "exploration": 0.5},
    # The paper's augmented method with the approximate risk integral that the paper uses: `risk_method`.
    "exponential_quadratic": {},
    # The plain search, credited beyond the team mates' plans, proposes. Its finalists are nearly equal by the path's
    # reward, so the map's reward has a say in the choice among them. It did best (docs/planner.md).
    "best": {
        **_PLAIN,
        "credit": "beyond",
        "horizon": 10,
        "iterations": 150,
        "exploration": 0.5,
        "map_share": 1.0,
        "finalists": 16,
    },
    # The same proposals in the same order, continued to the mission's end: the first that is worth as much on the map
    # as the incumbent is taken. Keeps the bound (in expectation).
    "bounded": {
        "objective": "map",
        "credit": "beyond",
        "proposals": "path",
        "horizon": 10,
        "iterations": 150,
        "exploration": 0.5,
        "naive_paths": (*COVERING, *STRIPS),
        "map_share": 1.0,
        "finalists": 16,
    },
    # Risk over the whole area instead of at the path's own places.
    "map": {
        **_PLAIN,
        "objective": "map",
        "credit": "beyond",
        "horizon": 10,
        "iterations": 2000,
        "exploration": 0.5,
    },
    # Baselines: the tour of the start, never optimized again; a naive path alone, and the next leg by a score.
    "fixed_tour": {
        "proposals": "tour",
        "objective": "map",
        "augmented": False,
        "naive_paths": (),
        "iterations": 150,
        "tour_interval": 0,
        "finalists": 0,
    },
    "lawnmower": {"proposals": "naive", "horizon": 1, "naive_paths": FITTED},
    "random": {**_PLAIN, "proposals": "random", "horizon": 1},
    "myopic": {**_PLAIN, "proposals": "benefit", "horizon": 1},
    "max_variance": {**_PLAIN, "proposals": "variance", "horizon": 1},
    "straddle": {**_PLAIN, "proposals": "straddle", "horizon": 1},
}

#: The methods that maximize the paper's own reward. Of others that reward and its bound say little.
PAPERS_METHODS = ("augmented", "plain", "exponential_quadratic")

#: How the expected risk is computed, where a method does not leave that to `level_set.method`.
RISK_METHODS = {"exponential_quadratic": "exponential_quadratic"}

#: Values of `planner.proposals`: tree searches, by the reward that they search with; then the baselines.
SEARCHES = ("surrogate", "path")
PROPOSALS = ("tour", *SEARCHES, "naive", "random", "benefit", "variance", "straddle")
