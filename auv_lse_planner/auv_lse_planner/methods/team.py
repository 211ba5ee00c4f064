"""Team mates of a vehicle: their last received plans, and the locations ahead on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.planner import MAX_LOCATIONS
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_planner.paths.rollout import PlannedPath

Array = NDArray[np.float64]

#: Largest delay (s) of a packet, and largest number of late packets of a mate. Any other plan with a lower step than
#: the last one corrects it: the mate has started again, or the last plan was forged.
LATE_S, LATE_MOST = 120.0, 2


@dataclass(slots=True)
class _Mate:
    plan: Plan
    last_heard_s: float
    path: PlannedPath
    reference_step: float  # the mate was at least at this step ...
    reference_s: float  # ... at this time
    late: int = 0  # plans ignored as late since the last correction


class Team:
    """The team mates of one vehicle.

    Attributes:
        others: Their numbers.
        before: Those with lower numbers, which plan before this vehicle (paper, section 6).
    """

    def __init__(
        self,
        vehicle: int,
        vehicles: int,
        leg_s: float,
        expiry_s: float,
        follow: Callable[[Plan], PlannedPath],
        assumed: Callable[[int], Plan] | None = None,
    ) -> None:
        """Starts without any plan.

        Args:
            leg_s: Duration of a leg (s).
            expiry_s: Age (s) at which a plan expires.
            assumed: The plan assumed for a team mate without a received plan (`assume_plans`); None: none.
        """
        self.others = [v for v in range(1, vehicles + 1) if v != vehicle]
        self.before = [v for v in self.others if v < vehicle]
        self._vehicle, self._leg_s, self._expiry_s, self._follow = vehicle, leg_s, expiry_s, follow
        self._mates: dict[int, _Mate] = {}
        self._assumed_plan = assumed
        self._assumed: dict[int, _Mate] = {}

    def receive_plan(self, now_s: float, vehicle: int, plan: Plan) -> None:
        """Stores the plan received from a vehicle; a repeated plan only refreshes its time of reception.

        A plan with a lower step than the current one is ignored if it may have arrived late (`LATE_S`).
        """
        if vehicle == self._vehicle:
            return
        known = self._mates.get(vehicle)
        if known is not None and known.plan == plan:
            known.last_heard_s = now_s
            return
        late, is_correction = 0 if known is None else known.late, False
        if known is not None and plan.step < known.plan.step and not self._expired(known, now_s):
            if (known.plan.step - plan.step) * self._leg_s <= LATE_S and late < LATE_MOST:
                known.late += 1
                return
            late, is_correction = 0, True
        reference_step = float(plan.step)
        if known is not None:
            # An unchanged plan may be sent long after its first step. A plan with the same state and a later step is
            # the old one, delayed by a surfacing. Keep the better estimate in both cases.
            estimate = self._step_of(known, now_s)
            delayed = plan.step > known.plan.step and np.array_equal(plan.state, known.plan.state)
            if delayed or (estimate > reference_step and plan.step <= known.plan.step and not is_correction):
                reference_step = estimate
        self._mates[vehicle] = _Mate(plan, now_s, self._follow(plan), reference_step, now_s, late)

    def _step_of(self, mate: _Mate, now_s: float) -> float:
        return mate.reference_step + (now_s - mate.reference_s) / self._leg_s

    def age_s(self, now_s: float) -> dict[int, float]:
        """Age of each team mate's last received plan (s)."""
        return {v: now_s - m.last_heard_s for v, m in sorted(self._mates.items())}

    def locations_ahead(self, now_s: float, vehicle: int) -> Array:
        """Measurement locations (P, 2) ahead of a team mate, at its estimated step."""
        mate = self._mates.get(vehicle)
        if mate is None or self._expired(mate, now_s):
            return np.empty((0, 2))
        return self._path_ahead(mate, now_s).locations_m[:MAX_LOCATIONS]

    def in_time_order(self, now_s: float) -> list[tuple[Array, Array]]:
        """For each mate with a valid or assumed plan: its legs (P,) from now to each location, and the locations (P,
        2)."""
        ahead = []
        for vehicle in self.others:
            mate = self._mates.get(vehicle) or self._assumed.get(vehicle)
            if mate is None or self._expired(mate, now_s):
                continue
            path = self._path_ahead(mate, now_s)
            each = path.leg_locations_m.shape[1]
            legs = path.step + (np.arange(len(path) * each) + 1.0) / each - self._step_of(mate, now_s)
            ahead.append((legs[:MAX_LOCATIONS], path.locations_m[:MAX_LOCATIONS]))
        return ahead

    def assume_plans(self, now_s: float) -> None:
        """Assumes plans for team mates without a received one, from the first call until `expiry_s` later."""
        if self._assumed_plan is not None:
            for vehicle in self.others:
                if vehicle not in self._mates and vehicle not in self._assumed:
                    self._assume(vehicle, now_s)

    def _assume(self, vehicle: int, now_s: float) -> None:
        assert self._assumed_plan is not None
        plan = self._assumed_plan(vehicle)
        self._assumed[vehicle] = _Mate(plan, now_s, self._follow(plan), float(plan.step), now_s)

    def snapshot(self) -> list[list[float]]:
        """Mates with an assumed plan and the time (s) of its assumption, for a journal."""
        return [[vehicle, mate.last_heard_s] for vehicle, mate in self._assumed.items()]

    def restore(self, values: Sequence[Sequence[float]]) -> None:
        """Continues from a `snapshot`; received plans must be passed to `receive_plan` again."""
        for vehicle, since_s in values:
            self._assume(int(vehicle), since_s)

    def _expired(self, mate: _Mate, now_s: float) -> bool:
        return abs(now_s - mate.last_heard_s) >= self._expiry_s  # far in the future: the clock was set back

    def _path_ahead(self, mate: _Mate, now_s: float) -> PlannedPath:
        passed = int(max(0.0, self._step_of(mate, now_s) - mate.plan.step))
        return mate.path.from_step(mate.plan.step + passed)
