"""What a vehicle knows of its team mates: their last received plans, and the places they have still to visit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.plan import Plan

Array = NDArray[np.float64]


@dataclass(slots=True)
class _Mate:
    plan: Plan
    first_heard_s: float
    last_heard_s: float
    states: Array  # from the plan's step to the mission's end
    actions: NDArray[np.int64]
    reference_step: float  # the mate was at least at this step ...
    reference_s: float  # ... at this time
    earlier: list[_Mate]  # different plans heard before this one, the last first


class Team:
    """The team mates of one vehicle."""

    def __init__(
        self,
        vehicle: int,
        vehicles: int,
        order: str,
        leg_s: float,
        expiry_s: float,
        rebuild: Callable[[Plan], tuple[Array, NDArray[np.int64]]],
        kept: int = 1,
    ) -> None:
        """Sets up without any plan known.

        Args:
            vehicle: Own number.
            vehicles: Number of vehicles.
            order: "id" (lower numbers come before), "rotating" (the order moves on by one each step), or "all".
            leg_s: Time a leg takes.
            expiry_s: Age at which a plan is dropped.
            rebuild: States and actions of a plan to the mission's end.
            kept: Different plans of each team mate that are kept (for Dec-MCTS; else the last one).
        """
        self._vehicle, self._vehicles, self._order = vehicle, vehicles, order
        self._leg_s, self._expiry_s, self._rebuild, self._kept = leg_s, expiry_s, rebuild, kept
        self._mates: dict[int, _Mate] = {}

    def hear(self, now_s: float, vehicle: int, plan: Plan) -> None:
        """Takes the plan received of a vehicle; one of the same step and state as the last is only refreshed.

        A plan older than the one known (its step is lower) came late and is ignored.
        """
        if vehicle == self._vehicle:
            return
        known = self._mates.get(vehicle)
        if known is not None and known.plan == plan:
            known.last_heard_s = now_s
            return
        if known is not None and plan.step < known.plan.step and now_s - known.last_heard_s < self._expiry_s:
            return
        states, actions = self._rebuild(plan)
        reference_step, reference_s = float(plan.step), now_s
        if known is not None:
            # an unchanged part of an old plan may be sent long after its first step: keep the better estimate
            estimate = self._step_of(known, now_s)
            if estimate > reference_step and plan.step <= known.plan.step:
                reference_step = estimate
        earlier = [known, *known.earlier][: self._kept - 1] if known is not None else []
        for mate in earlier:
            mate.earlier = []
        self._mates[vehicle] = _Mate(plan, now_s, now_s, states, actions, reference_step, reference_s, earlier)

    def _step_of(self, mate: _Mate, now_s: float) -> float:
        return mate.reference_step + (now_s - mate.reference_s) / self._leg_s

    def plans(self, now_s: float) -> dict[int, Plan]:
        """Plans that have not expired, by vehicle."""
        return {v: m.plan for v, m in sorted(self._mates.items()) if now_s - m.last_heard_s < self._expiry_s}

    def age_s(self, now_s: float) -> dict[int, float]:
        """Age of each team mate's last received plan (s)."""
        return {v: now_s - m.last_heard_s for v, m in sorted(self._mates.items())}

    def before(self, step: int) -> list[int]:
        """Numbers of the vehicles whose plans count for a decision at `step`."""
        others = [v for v in range(1, self._vehicles + 1) if v != self._vehicle]
        if self._order == "all":
            return others
        if self._order == "id":
            return [v for v in others if v < self._vehicle]
        # rotating: at step s, vehicle 1 + (s mod K) is the first of the order
        rank = {v: (v - 1 - step) % self._vehicles for v in range(1, self._vehicles + 1)}
        return [v for v in others if rank[v] < rank[self._vehicle]]

    def legs_ahead(self, now_s: float, vehicle: int) -> tuple[Array, NDArray[np.int64]]:
        """States (L, 3) and actions (L,) of the legs that a team mate has still to travel, by its clock."""
        mate = self._mates.get(vehicle)
        if mate is None or now_s - mate.last_heard_s >= self._expiry_s:
            return np.empty((0, 3)), np.empty(0, dtype=np.int64)
        return self._ahead(mate, now_s)

    def _ahead(self, mate: _Mate, now_s: float) -> tuple[Array, NDArray[np.int64]]:
        passed = int(max(0.0, self._step_of(mate, now_s) - mate.plan.step))
        return mate.states[passed:-1], mate.actions[passed:]

    def draw(self, now_s: float, rng: np.random.Generator) -> list[tuple[Array, NDArray[np.int64]]]:
        """Legs ahead of every team mate by one of its kept plans, drawn at random: the last twice as likely each."""
        legs = []
        for _, mate in sorted(self._mates.items()):
            kept = [m for m in (mate, *mate.earlier) if now_s - m.last_heard_s < self._expiry_s]
            if kept:
                weights = 0.5 ** np.arange(len(kept))
                legs.append(self._ahead(kept[int(rng.choice(len(kept), p=weights / weights.sum()))], now_s))
        return legs
