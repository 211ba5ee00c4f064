"""With the paper's own methods everything else flies as in the paper too, unless a mission file asks otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

#: Values of `planner.method` that are the paper's. They maximize its reward; of others that and its bound say little.
PAPERS_METHODS = ("augmented", "exponential_quadratic", "plain")


def unless_papers(given: bool | None, parameters: Mapping[str, Any]) -> bool:
    """A switch that is on where a mission file leaves it out, but not with one of the paper's methods.

    Args:
        given: What the mission file says; None if it leaves it out.
        parameters: The nested parameters of a node, of which `planner.method` counts.
    """
    if given is not None:
        return given
    return dict(parameters.get("planner", {})).get("method") not in PAPERS_METHODS
