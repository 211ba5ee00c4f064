"""The account of a vehicle's reward: what it has brought, what the plan in hand promises, and the lower bound."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundRecord:
    """The account of one decision. Rewards are sums of expected benefit of search, in the unit of the costs.

    Attributes:
        step: Step planned from.
        now_s: Mission time.
        jbar: Value of the chosen path to its end (the paper's Jbar, or J without a naive path).
        naive_part: The part of `jbar` that the naive path brings.
        reward_so_far: Reward credited for the legs already decided.
        lower_bound: reward_so_far + naive_part: the time-varying lower bound.
        lower_bound_max: Its running maximum.
        promised: reward_so_far + jbar.
        incumbent_value: Value of continuing the last plan on the same data; NaN where there was none.
        incumbent_kept: Whether the last plan was continued.
        iterations: Search iterations.
        deadline_hit: Whether the deadline ended the search.
        method: The method.
        account: What may still be spent of the expected end (method tour), never negative: the bound is promised -
            account. NaN for a method without an account.
        void: Why the last plan was given up without a charge: "shallow ground", "off the plan"; else empty.
    """

    step: int
    now_s: float
    jbar: float
    naive_part: float
    reward_so_far: float
    lower_bound: float
    lower_bound_max: float
    promised: float
    incumbent_value: float
    incumbent_kept: bool
    iterations: int
    deadline_hit: bool
    method: str
    account: float = math.nan
    void: str = ""


class Account:
    """Reward and lower bound of one vehicle over its mission.

    Attributes:
        reward_so_far: Reward credited for the legs already decided.
    """

    def __init__(self) -> None:
        """Starts with no reward."""
        self.reward_so_far = 0.0
        self._risk_at_start = math.nan
        self._bound_max = -math.inf

    def snapshot(self) -> dict[str, float]:
        """The account, for a journal."""
        return {"reward": self.reward_so_far, "risk_at_start": self._risk_at_start, "bound_max": self._bound_max}

    def restore(self, values: Mapping[str, float]) -> None:
        """Goes on from what `snapshot` gave."""
        self.reward_so_far = values["reward"]
        self._risk_at_start, self._bound_max = values["risk_at_start"], values["bound_max"]

    def measure(self, risk: float) -> None:
        """Credits the drop of the map's risk since the first call: with the map's reward it is measured."""
        if math.isnan(self._risk_at_start):
            self._risk_at_start = risk
        self.reward_so_far = self._risk_at_start - risk

    def credit(self, reward: float) -> None:
        """Credits the reward expected of a leg: with the path's reward."""
        self.reward_so_far += reward

    def bound(self, naive_part: float) -> tuple[float, float]:
        """The lower bound with this naive part of the plan, and the largest bound so far."""
        lower = self.reward_so_far + naive_part
        self._bound_max = max(self._bound_max, lower)
        return lower, self._bound_max
