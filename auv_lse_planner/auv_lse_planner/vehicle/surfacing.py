"""When a vehicle surfaces for a fix: where that gains more than the legs that it costs.

Dead reckoning errs by a rotation and a scale about the start, so that a fix tells most far from there; soundings before
it can then be placed anew, and those after it begin right. So a vehicle weighs a surfacing

- not before `FIRST` of its mission, and each vehicle of a team a little later than the one before it: the fix of one
  serves all through ranges, and the next knows by then how little its own would add;
- where a leg ends that leads farther from the start than the next `LEGS_AHEAD` ones by its plan;
- `NEXT` of the mission after its last surfacing at the earliest: the map does not show at once what that has gained.

The gain of a fix is the drop of the loss from uncertain places (`reward/fix.py`). Its cost is the reward of the legs
that are then missing at the mission's end, as the plan has it. Both are in the unit of the map's risk.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_planner.paths.rollout import PlannedPath

#: Parts of the mission: before the first surfacing of the first vehicle, from each vehicle's turn to the next one's,
#: and between surfacings.
FIRST, TURN, NEXT = 0.3, 0.1, 0.2
#: Vehicles that have turns of their own; those after them share them.
TURNS = 3
#: Legs ahead that must not lead farther from the start.
LEGS_AHEAD = 10


class Surfacings:
    """The surfacings of one vehicle.

    Attributes:
        legs: Legs that one takes.
        most: How many there may be.
        done: How many are decided.
    """

    def __init__(self, vehicle: int, config: VehicleConfig, most: int, steps: int, leg_m: float) -> None:
        """Before the first of so many steps.

        Args:
            vehicle: Number of the vehicle, from 1.
            config: Section `vehicle`.
            most: How many there may be.
            steps: Steps of the mission.
            leg_m: Length of a leg (m).
        """
        self.legs = math.ceil(config.surfacing_s * config.speed_mps / leg_m)
        self.most = most
        self.done = 0
        self._steps = steps
        self._start_m = np.array([config.start_north_m, config.start_east_m])
        self._earliest = round((FIRST + TURN * ((vehicle - 1) % TURNS)) * steps)

    def considered(self, path: PlannedPath) -> bool:
        """Whether a surfacing is weighed where the first leg of `path` ends, which leads to the mission's end."""
        end = path.step + 1
        if self.done >= self.most or end < self._earliest or len(path) <= self.legs:
            return False
        ahead = path.states[1 : LEGS_AHEAD + 2, 1:] - self._start_m
        far_m = np.hypot(ahead[:, 0], ahead[:, 1])
        return bool(far_m[0] >= far_m.max())

    def record(self, step: int) -> None:
        """The vehicle surfaces at the end of the leg to mission step `step`."""
        self.done += 1
        self._earliest = step + round(NEXT * self._steps)

    def snapshot(self) -> list[int]:
        """How many are decided, and the earliest step of the next, for a journal."""
        return [self.done, self._earliest]

    def restore(self, value: Sequence[int]) -> None:
        """Continues from a `snapshot`."""
        self.done, self._earliest = value
