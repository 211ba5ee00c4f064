"""The result of a decision: the plan for the team, the leg to travel, the bound record, and how they were found."""

from __future__ import annotations

import math
from dataclasses import dataclass

from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.plan import Plan


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundRecord:
    """Expected reward and lower bound of one decision.

    Rewards are sums of expected benefit of search, in the unit of the costs, over the whole map or over this vehicle's
    path (`Family.bound_of`).

    Attributes:
        step: Step planned from.
        now_s: Mission time.
        reward_so_far: Reward of the legs already decided.
        expected_end: Reward of the chosen path from here to its end (the paper's Jbar, or J without a naive path).
        lower_bound: The time-varying lower bound: reward_so_far + the naive path's reward, or reward_so_far +
            expected_end - budget.
        lower_bound_max: Its running maximum.
        incumbent_value: `expected_end` of the incumbent on the same data; NaN without an incumbent.
        budget: Amount by which later decisions may lower the expected end (method tour); NaN without a budget.
        void: Reason why the last plan was discarded: "shallow ground", "border of the area", "off the plan"; else
            empty.
        void_value: `expected_end` of the discarded plan on the same data, to which the budget was referred; else NaN.
    """

    step: int
    now_s: float
    method: str
    reward_so_far: float
    expected_end: float
    lower_bound: float
    lower_bound_max: float
    incumbent_value: float
    incumbent_kept: bool
    iterations: int
    deadline_hit: bool
    budget: float = math.nan
    void: str = ""
    void_value: float = math.nan

    @property
    def expected_total(self) -> float:
        """Expected reward of the whole mission: reward_so_far + expected_end."""
        return self.reward_so_far + self.expected_end


@dataclass(frozen=True, slots=True, kw_only=True)
class Statistics:
    """Statistics of the search for a decision.

    Attributes:
        team_locations: Number of locations ahead on team mates' plans.
        best_new_value: Value of the best path found by the search, in the search's reward; NaN without one.
        escape: Whether no action was feasible.
        reanchored: Whether the plan starts from odometry instead of the planned state.
        incumbent_infeasible: Whether the map now forbids the next legs of the last plan.
    """

    team_locations: int
    evaluations: int
    best_new_value: float
    escape: bool
    reanchored: bool
    incumbent_infeasible: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """A decision of `VehiclePlanner`.

    Attributes:
        plan: The path to the mission's end, for the team.
        leg: The leg to travel next.
    """

    plan: Plan
    leg: Leg
    bound: BoundRecord
    statistics: Statistics
