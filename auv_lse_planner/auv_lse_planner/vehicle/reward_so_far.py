"""The reward of a vehicle's mission so far, and its lower bound."""

import math
from collections.abc import Mapping


class RewardSoFar:
    """Reward of the legs already decided."""

    def __init__(self) -> None:
        self.value = 0.0
        self._risk_at_start = math.nan
        self._bound_max = -math.inf

    def measure(self, risk: float) -> None:
        """Sets the reward to the drop of the map's risk since the first call; NaN leaves it to `add`, leg by leg."""
        if math.isnan(risk):
            return
        if math.isnan(self._risk_at_start):
            self._risk_at_start = risk + self.value
        self.value = self._risk_at_start - risk

    def continue_with_other_cells(self) -> None:
        """Keeps the reward, and measures drops from the next risk on, which is that of other cells."""
        self._risk_at_start = math.nan

    def add(self, reward: float) -> None:
        """Adds the expected reward of a leg."""
        self.value += reward

    def bound(self, assured: float) -> tuple[float, float]:
        """The lower bound and its running maximum; `assured` is the plan's reward that no later decision can lose."""
        lower = self.value + assured
        self._bound_max = max(self._bound_max, lower)
        return lower, self._bound_max

    def snapshot(self) -> dict[str, float]:
        """The reward, for a journal."""
        return {"reward": self.value, "risk_at_start": self._risk_at_start, "bound_max": self._bound_max}

    def restore(self, values: Mapping[str, float]) -> None:
        """Continues from a `snapshot`."""
        self.value = values["reward"]
        self._risk_at_start, self._bound_max = values["risk_at_start"], values["bound_max"]
