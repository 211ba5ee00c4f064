"""What a decision gives: the plan for the team, the leg to travel, the account, and how it was found."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_planner.methods.account import BoundRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class Statistics:
    """How a decision was found.

    Attributes:
        centers: Kernel centers of the map.
        team_places: Places that team mates' plans still hold.
        evaluations: Different paths valued.
        best_new_value: Value of the best path the search found, by the search's own reward; NaN if there was none.
        progress: (iteration, best value) at every improvement.
        escape: Whether nothing was feasible.
        reanchored: Whether the plan starts from odometry instead of the planned state.
        incumbent_infeasible: Whether the last plan had to be given up because the map now forbids its next legs.
    """

    centers: int
    team_places: int
    evaluations: int = 0
    best_new_value: float = math.nan
    progress: list[tuple[int, float]] = field(default_factory=list)
    escape: bool = False
    reanchored: bool = False
    incumbent_infeasible: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """What `VehiclePlanner.decide` gives.

    Attributes:
        plan: The path to the mission's end, for the team.
        leg: The leg to travel next.
        bound: The account.
        statistics: How it was found.
    """

    plan: Plan
    leg: Leg
    bound: BoundRecord
    statistics: Statistics
