"""What a vehicle knows of its team mates: their last received plans, and the places they have still to visit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.planner import MOST_PLACES
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_planner.paths.rollout import PlannedPath

Array = NDArray[np.float64]


@dataclass(slots=True)
class _Mate:
    plan: Plan
    last_heard_s: float
    path: PlannedPath
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
        follow: Callable[[Plan], PlannedPath],
        kept: int = 1,
        assumed: Callable[[int], Plan] | None = None,
    ) -> None:
        """Sets up without any plan known.

        Args:
            vehicle: Own number.
            vehicles: Number of vehicles.
            order: "id" (lower numbers come before) or "all".
            leg_s: Time a leg takes.
            expiry_s: Age at which a plan is dropped.
            follow: The path of a plan.
            kept: Different plans of each team mate that are kept (for Dec-MCTS; else the last one).
            assumed: The plan that a team mate never heard is taken to follow since the first call of
                `in_time_order`; None: none.
        """
        self._vehicle, self._vehicles, self._order = vehicle, vehicles, order
        self._leg_s, self._expiry_s, self._follow, self._kept = leg_s, expiry_s, follow, kept
        self._mates: dict[int, _Mate] = {}
        self._assumed_plan = assumed
        self._assumed: dict[int, _Mate] = {}

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
        reference_step, reference_s = float(plan.step), now_s
        if known is not None:
            # an unchanged part of an old plan may be sent long after its first step, and a plan from the same state at
            # a later step is the old one, put off by a surfacing: keep the better estimate
            estimate = self._step_of(known, now_s)
            put_off = plan.step > known.plan.step and np.array_equal(plan.state, known.plan.state)
            if put_off or (estimate > reference_step and plan.step <= known.plan.step):
                reference_step = estimate
        earlier = [known, *known.earlier][: self._kept - 1] if known is not None else []
        for mate in earlier:
            mate.earlier = []
        self._mates[vehicle] = _Mate(plan, now_s, self._follow(plan), reference_step, reference_s, earlier)

    def _step_of(self, mate: _Mate, now_s: float) -> float:
        return mate.reference_step + (now_s - mate.reference_s) / self._leg_s

    def age_s(self, now_s: float) -> dict[int, float]:
        """Age of each team mate's last received plan (s)."""
        return {v: now_s - m.last_heard_s for v, m in sorted(self._mates.items())}

    @property
    def others(self) -> list[int]:
        """Numbers of the team mates."""
        return [v for v in range(1, self._vehicles + 1) if v != self._vehicle]

    def before(self, step: int) -> list[int]:
        """Numbers of the vehicles whose plans count for a decision at `step`."""
        others = self.others
        if self._order == "all":
            return others
        return [v for v in others if v < self._vehicle]

    def places_ahead(self, now_s: float, vehicle: int) -> Array:
        """Measurement places (P, 2) that a team mate has still to visit, by its clock."""
        mate = self._mates.get(vehicle)
        if mate is None or now_s - mate.last_heard_s >= self._expiry_s:
            return np.empty((0, 2))
        return self._ahead(mate, now_s)

    def _ahead(self, mate: _Mate, now_s: float) -> Array:
        passed = int(max(0.0, self._step_of(mate, now_s) - mate.plan.step))
        return mate.path.from_step(mate.plan.step + passed).places_m[:MOST_PLACES]

    def in_time_order(self, now_s: float) -> list[tuple[Array, Array]]:
        """Of each team mate whose plan counts, the places (P, 2) ahead, and legs (P,) from now after which it is there.

        A team mate never heard is taken to follow the assumed plan, from the first call on and as long as a plan lasts.
        """
        ahead = []
        for vehicle in range(1, self._vehicles + 1):
            if vehicle == self._vehicle:
                continue
            mate = self._mates.get(vehicle) or self._never_heard(now_s, vehicle)
            if mate is None or now_s - mate.last_heard_s >= self._expiry_s:
                continue
            step = self._step_of(mate, now_s)
            path = mate.path.from_step(mate.plan.step + int(max(0.0, step - mate.plan.step)))
            each = path.leg_places_m.shape[1]
            legs = path.step + (np.arange(len(path) * each) + 1.0) / each - step
            ahead.append((legs[:MOST_PLACES], path.places_m[:MOST_PLACES]))
        return ahead

    def snapshot(self) -> list[list[float]]:
        """Since when (s) which mates never heard are taken to follow the assumed plan, for a journal."""
        return [[vehicle, mate.last_heard_s] for vehicle, mate in self._assumed.items()]

    def restore(self, values: Sequence[Sequence[float]]) -> None:
        """Goes on from what `snapshot` gave; plans heard are heard again by `hear`."""
        for vehicle, since_s in values:
            self._never_heard(since_s, int(vehicle))

    def _never_heard(self, now_s: float, vehicle: int) -> _Mate | None:
        if vehicle not in self._assumed and self._assumed_plan is not None:
            plan = self._assumed_plan(vehicle)
            self._assumed[vehicle] = _Mate(plan, now_s, self._follow(plan), float(plan.step), now_s, [])
        return self._assumed.get(vehicle)

    def draw(self, now_s: float, rng: np.random.Generator) -> Array:
        """Places (P, 2) ahead of all team mates by one kept plan of each, drawn at random.

        A plan is twice as likely as the one that was heard before it.
        """
        places = [np.empty((0, 2))]
        for _, mate in sorted(self._mates.items()):
            kept = [m for m in (mate, *mate.earlier) if now_s - m.last_heard_s < self._expiry_s]
            if kept:
                weights = 0.5 ** np.arange(len(kept))
                places.append(self._ahead(kept[int(rng.choice(len(kept), p=weights / weights.sum()))], now_s))
        return np.concatenate(places)
