"""Runs the guidance of an autopilot along with the simulated vehicle: orders take effect when they were given."""

import math
from collections import deque
from collections.abc import Callable

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_sim.emulated.ardupilot.guidance import Guidance, Pose

#: Legs whose ends are at most this far apart (m) are the same leg.
SAME_LEG_M = 0.5


class OrderedPilot:
    """Hands the trajectory to the vehicle, sub-step by sub-step.

    Attributes:
        step: Number of the present leg, from 0; -1 before the first.
    """

    def __init__(self, guidance: Guidance) -> None:
        self.step = -1
        self._leg_end_m: tuple[float, float] | None = None
        self._guidance = guidance
        self._orders: deque[tuple[float, Callable[[float], None]]] = deque()
        self._now_s = -math.inf

    @property
    def has_arrived(self) -> bool:
        """Whether the vehicle is at its last target, or has a command to stop, and no order waits."""
        return self._guidance.has_arrived and not self._orders

    def begin_leg(self, end_m: tuple[float, float]) -> None:
        """Counts a leg by its end (north, east m), unless it continues after a stop, another mode or a restart."""
        if self._leg_end_m is None or math.dist(self._leg_end_m, end_m) > SAME_LEG_M:
            self.step += 1
        self._leg_end_m = end_m

    def order(self, now_s: float, order: Callable[[float], None]) -> None:
        """Queues a function that is called with the order's time (s)."""
        self._orders.append((now_s, order))

    def at(self, now_s: float) -> Pose:
        """The pose at a time, after the orders until then; a time before the last one counts as that."""
        self._now_s = max(self._now_s, now_s)
        while self._orders and self._orders[0][0] <= self._now_s:
            given_s, order = self._orders.popleft()
            order(given_s)
        return self._guidance.at(self._now_s)

    def poses(self, stamps_s: Array) -> Array:
        """The trajectory at times (n,): north, east, depth (m), heading (rad), velocity north, east (m/s), (n, 6)."""
        rows = np.empty((len(stamps_s), 6))
        for row, stamp_s in zip(rows, stamps_s, strict=True):
            pose = self.at(float(stamp_s))
            row[:3], row[3], row[4:] = pose.position_m, pose.heading_rad, pose.velocity_mps[:2]
        return rows
