"""Altitude keeping of a simulated vehicle without an autopilot."""

import math

import numpy as np

from auv_lse_common.safety.altitude_keeper import AltitudeKeeper
from auv_lse_common.support.arrays import Array
from auv_lse_sim.vehicle.records import Results

#: Depth control ignores smaller changes (m), upwards and downwards.
RAISED_M, LOWERED_M = 0.05, 0.3


class KeptAltitude:
    """Limits the depth of one vehicle so that it keeps its altitude."""

    def __init__(self, least_m: float) -> None:
        """Keeps `least_m` (m) above the ground; 0: does nothing."""
        self._keeper, self._depth_m = AltitudeKeeper(least_m), math.inf

    def take(self, stamps_s: Array, results: Results, echoes_m: Array, wanted_m: float) -> float:
        """Adds the sub-steps of a tick; returns the depth (m) to keep, infinite if nothing limits it.

        Args:
            stamps_s: Their ends (n,).
            results: Of the motion model.
            echoes_m: Altitudes (n,), NaN without an echo.
            wanted_m: Depth at which the vehicle travels if the ground allows it.
        """
        keeper = self._keeper
        if keeper.least_m <= 0.0:
            return math.inf
        columns = (stamps_s, results.est_north, results.est_east, results.depth, results.est_speed, echoes_m)
        for *state, echo_m in np.column_stack(columns).tolist():
            keeper.move(*state)
            keeper.ping(echo_m)
        depth_m = keeper.limited_m(wanted_m)
        if not -RAISED_M <= depth_m - self._depth_m <= LOWERED_M or depth_m == wanted_m:
            self._depth_m = depth_m
        return self._depth_m
