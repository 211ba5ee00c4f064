"""Decides when a vehicle surfaces for a fix: when the fix gains more than the skipped legs are worth.

Dead reckoning errs by a rotation and a scale about the start, so a fix far from the start is the most informative. It
corrects the positions of earlier and later soundings. A vehicle considers a surfacing only if all of these hold:

- At least `FIRST_SHARE` of the mission is over. Each vehicle of a team waits longer than the previous one, by
  `TURN_SHARE`: ranges pass one vehicle's fix on to all, which reduces the gain of the next fix.
- The leg's end is farther from the start than the next `LEGS_AHEAD` legs of the plan.
- A leg is left after it: a mission ends with its last leg, and would not wait for the fix.
- At least `NEXT_SHARE` of the mission has passed since its last surfacing, because a fix changes the map only after
  some time.

`reward/fix.py` computes the gain. The cost is the planned reward of the legs that no longer fit at the mission's end.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_planner.methods.method import Followed
from auv_lse_planner.paths.rollout import PlannedPath, Rollout

#: Shares of the mission: before vehicle 1's first surfacing, delay of each further vehicle, and between two surfacings.
FIRST_SHARE, TURN_SHARE, NEXT_SHARE = 0.3, 0.1, 0.2
#: Number of different delays; vehicles with higher numbers reuse them in turn.
TURNS = 3
#: Legs of the plan that must not lead farther from the start than the current leg.
LEGS_AHEAD = 10


class Surfacings:
    """The surfacings of one vehicle.

    Attributes:
        legs: Duration of a surfacing, in legs.
        most: Largest number of surfacings.
        done: Number of surfacings decided so far.
    """

    def __init__(self, vehicle: int, config: VehicleConfig, most: int, steps: int, leg_m: float) -> None:
        self.legs = math.ceil(config.surfacing_s * config.speed_mps / leg_m)
        self.most = most
        self.done = 0
        self._steps = steps
        self._start_m = np.array([config.start_north_m, config.start_east_m])
        self._earliest = round((FIRST_SHARE + TURN_SHARE * ((vehicle - 1) % TURNS)) * steps)

    def is_considered(self, path: PlannedPath) -> bool:
        """Whether to consider a surfacing at the end of the first leg of `path`, a path to the mission's end."""
        end = path.step + 1
        if self.done >= self.most or end < self._earliest or len(path) <= self.legs + 1:
            return False
        ahead = path.states[1 : LEGS_AHEAD + 2, 1:] - self._start_m
        far_m = np.hypot(ahead[:, 0], ahead[:, 1])
        return bool(far_m[0] >= far_m.max())

    def record(self, step: int) -> None:
        """Records a surfacing at the end of the leg to mission step `step`."""
        self.done += 1
        self._earliest = step + round(NEXT_SHARE * self._steps)

    def snapshot(self) -> list[int]:
        """Number of surfacings decided and earliest step of the next one, for a journal."""
        return [self.done, self._earliest]

    def restore(self, value: Sequence[int]) -> None:
        """Continues from a `snapshot`."""
        self.done, self._earliest = value


def delayed(followed: Followed, legs: int, rollout: Rollout) -> Followed:
    """A followed path, delayed by `legs` steps for a stop; its last legs then end after the mission.

    A naive path may depend on the number of legs left, so that the delayed plan would lead elsewhere. The plan then
    continues with the path's explicit actions. A new choice would restart the lanes and the budget.
    """
    decided, path = followed.plan, followed.path
    rest = path.from_step(path.step + 1)
    plan = dataclasses.replace(decided, step=decided.step + legs)
    later = rollout.follow(plan).from_step(path.step + legs)
    if not np.allclose(later.states[min(1, len(later))], rest.states[0], atol=1e-6):
        actions = tuple(int(action) for action in rest.actions[: max(len(rest) - legs, 0)])
        plan = Plan.at(rest.step + legs, rest.states[0], actions, NONE)
        later = rollout.follow(plan)
    return Followed(plan, later)
