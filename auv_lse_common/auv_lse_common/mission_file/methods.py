"""Planning methods by name, and their families.

`METHODS` lists the values of `planner.method`, each with its default parameters where they differ from those of the
paper's augmented method (`sections.planner.from_method`). `FAMILIES` holds the properties that other packages need.
`auv_lse_planner.methods.families` has a class for each family. docs/extending/adding-a-method.md shows how to add one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from auv_lse_common.vocabulary.naive_ids import FITTED_OF_GROUP

#: Least number of positions on each leg for the map's reward. With one position, the remaining risk is overestimated
#: twice as much for turning paths as for straight lanes (docs/design/planner.md).
MAP_LOCATIONS_PER_LEG = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """Properties of a family of methods, whose plans are made in the same way.

    Attributes:
        bound_of: The quantity that reward and bound measure: the drop of risk over the whole "map" or at the positions
            of this vehicle's "path", or the length of the "line" located.
        to_the_end: Whether a plan is evaluated to the mission's end, whatever the horizon.
        all_mates: Whether the plans of all team mates count; otherwise only of those with lower numbers (paper).
        positions_per_leg: Least number of positions on each leg at which this vehicle's paths are evaluated.
        sends_tours: Whether plans are sent as tours or as long sequences of actions.
    """

    bound_of: str = "path"
    to_the_end: bool = False
    all_mates: bool = False
    positions_per_leg: int = 1
    sends_tours: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodEntry:
    """A value of `planner.method`.

    Attributes:
        family: Name of its family.
        parameters: Planner parameters that differ from the paper's augmented method.
        of_paper: Whether it is the paper's, and so maximizes the paper's reward.
        risk_integral: How the expected risk is computed: exactly, or with the paper's approximation.
    """

    family: str = "path"
    parameters: Mapping[str, Any] = field(default_factory=dict)
    of_paper: bool = False
    risk_integral: str = "exact"


FAMILIES: dict[str, Family] = {
    "tour": Family(
        bound_of="map", to_the_end=True, all_mates=True, positions_per_leg=MAP_LOCATIONS_PER_LEG, sends_tours=True
    ),
    "line": Family(
        bound_of="line", to_the_end=True, all_mates=True, positions_per_leg=MAP_LOCATIONS_PER_LEG, sends_tours=True
    ),
    "path": Family(),
    "naive": Family(to_the_end=True),
    "random": Family(),
    "benefit": Family(),
    "variance": Family(),
    "straddle": Family(),
}

#: No naive path after the searched legs, and no incumbent.
_PLAIN: dict[str, Any] = {"augmented": False, "naive_paths": (), "incumbent": False}
#: A tour over the rest of the mission.
_TOUR: dict[str, Any] = {"augmented": False, "naive_paths": (), "iterations": 150}

METHODS: dict[str, MethodEntry] = {
    # One tour over the rest of the mission, re-optimized within a budget, so that it meets the bound.
    "tour": MethodEntry(
        family="tour",
        parameters={**_TOUR, "credit": "beyond", "horizon": 8, "exploration": 0.5, "tour_interval": 4},
    ),
    # The same search for the length of isobath located.
    "line": MethodEntry(
        family="line",
        parameters={
            **_TOUR,
            "credit": "beyond",
            "horizon": 10,
            "exploration": 0.5,
            "tour_interval": 4,
            "iterations": 80,
        },
    ),
    # The paper's methods; the third uses the paper's approximate risk integral.
    "augmented": MethodEntry(of_paper=True),
    "plain": MethodEntry(of_paper=True, parameters={**_PLAIN, "horizon": 10, "iterations": 300, "exploration": 0.5}),
    "exponential_quadratic": MethodEntry(of_paper=True, risk_integral="exponential_quadratic"),
    # Baselines: a tour that is never re-optimized, a single naive path, and one-leg scores.
    "fixed_tour": MethodEntry(family="tour", parameters={**_TOUR, "tour_interval": 0}),
    "lawnmower": MethodEntry(family="naive", parameters={"horizon": 1, "naive_paths": FITTED_OF_GROUP}),
    "random": MethodEntry(family="random", parameters={**_PLAIN, "horizon": 1}),
    "myopic": MethodEntry(family="benefit", parameters={**_PLAIN, "horizon": 1}),
    "max_variance": MethodEntry(family="variance", parameters={**_PLAIN, "horizon": 1}),
    "straddle": MethodEntry(family="straddle", parameters={**_PLAIN, "horizon": 1}),
}

#: The paper's methods.
PAPER_METHODS = tuple(name for name, entry in METHODS.items() if entry.of_paper)


def unless_paper_method(given: bool | None, parameters: Mapping[str, Any]) -> bool:
    """Resolves a switch whose default is true, except with the paper's methods.

    Args:
        given: The mission file's value; None if it is left out.
        parameters: A node's nested parameters; only `planner.method` is read.
    """
    if given is not None:
        return given
    return dict(parameters.get("planner", {})).get("method") not in PAPER_METHODS
