"""When a vehicle surfaces for a fix: planned with its path, and paid for with legs.

Dead reckoning errs by a turn and a stretch about the start, so that a fix tells most far from there; soundings before
it can then be booked anew, and those after it begin right. The rule is simple. A mission of n surfacings has n equal
parts, and in each of them the vehicle surfaces between 30 % and 60 % of the part: where that leg ends that by its own
plan leads farthest from the start. As the plan changes, the rule looks at what is still ahead of it.

A surfacing takes the time of some legs, which are then missing at the mission's end. It is not worth that if it takes
more than `DEAREST` of the mission, or if the vehicle has not come `FAR_M` from its start, where GPS knows little more
than dead reckoning.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from auv_lse_planner.config import VehicleConfig
from auv_lse_planner.paths.rollout import PlannedPath

#: Part of a surfacing's share of the mission in which it may come.
WINDOW = (0.3, 0.6)
#: Largest part of the mission that a surfacing may take.
DEAREST = 0.06
#: Nearer to the start than this (m) a fix is not worth its time.
FAR_M = 100.0


class Surfacings:
    """The planned surfacings of one vehicle.

    Attributes:
        legs: Legs that one takes.
        wanted: How many there are to be.
        done: How many are decided, or were not worth it.
    """

    def __init__(self, vehicle: VehicleConfig, wanted: int, steps: int, leg_m: float) -> None:
        """Before the first of so many steps.

        Args:
            vehicle: Section `vehicle`.
            wanted: How many there are to be, if the mission is long enough.
            steps: Steps of the mission.
            leg_m: Length of a leg (m).
        """
        self.legs = math.ceil(vehicle.surfacing_s * vehicle.speed_mps / leg_m)
        self.wanted = wanted if self.legs <= DEAREST * steps else 0
        self.done = 0
        self._steps = steps
        self._start_m = np.array([vehicle.start_north_m, vehicle.start_east_m])

    def due(self, path: PlannedPath) -> bool:
        """Whether the vehicle surfaces where the first leg of `path` ends, its path to the mission's end."""
        end = path.step + 1
        while self.done < self.wanted:
            share = self._steps / self.wanted
            first, last = (round((self.done + part) * share) for part in WINDOW)
            if end > last:
                self.done += 1  # it never was far enough
                continue
            if end < first or not len(path):
                return False
            ahead = path.states[1 : last - path.step + 1, 1:] - self._start_m
            far_m = np.hypot(ahead[:, 0], ahead[:, 1])
            due = bool(far_m[0] >= FAR_M and far_m[0] >= far_m.max())
            self.done += due
            return due
        return False

    def snapshot(self) -> int:
        """How many are decided, for a journal."""
        return self.done

    def restore(self, value: Any) -> None:
        """Goes on from what `snapshot` gave."""
        self.done = int(value)
