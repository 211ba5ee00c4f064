"""The raw place of a vehicle with an autopilot: its estimate without what fixes did to it.

An autopilot's estimator moves with the vehicle, and jumps or creeps to the place that GPS says at the surface. The raw
place takes the estimate's steps, but for these: a step that the reported velocity does not explain, and all steps at
the surface after the first dive, are replaced by velocity times time. When the vehicle dives again after GPS had a fix,
estimate and raw place are told as a fix.
"""

from __future__ import annotations

import math

from auv_lse_common.vocabulary.dead_reckoning import Fix

#: What a step may be off from velocity times time (m), and as a share of it. An estimator that learns of its heading
#: far from its start moves by a metre or two, which is its dead reckoning and no jump.
JUMP_M = 3.0
JUMP_SHARE = 0.2
#: Shallower than this (m) GPS may be heard.
SURFACE_M = 0.5
#: Deeper than this (m) the vehicle has dived.
DIVED_M = 1.0
#: After a gap like this (s) velocity says too little: the vehicle may have turned back, which is off by twice its way.
GAP_S = 5.0
TURNED_BACK_SHARE = 2.0
#: Standard deviation of a fix that GPS says nothing about (m).
FIX_STD_M = 2.5


class RawTrack:
    """One vehicle's raw place.

    Attributes:
        north_m: North of the raw place; NaN before the first estimate.
        east_m: East of it.
        jumps: Steps that were undone.
    """

    def __init__(self) -> None:
        """Nothing is known yet."""
        self.north_m = self.east_m = math.nan
        self.jumps = 0
        self._last: tuple[float, float, float, float, float] | None = None  # stamp, place, velocity
        self._dived = False
        self._std_m = math.nan  # of GPS in this surfacing; NaN: it had no fix

    def gps(self, std_m: float) -> None:
        """GPS has a fix, of this standard deviation (m; not positive: it does not say)."""
        self._std_m = std_m if std_m > 0.0 else FIX_STD_M

    def interrupt(self) -> None:
        """The next estimate has another frame, or comes after another start: its step is none."""
        self._last = None

    def move(
        self, stamp_s: float, north_m: float, east_m: float, depth_m: float, north_mps: float, east_mps: float
    ) -> Fix | None:
        """Takes an estimate of place (m), depth (m) and velocity (m/s); gives the fix that is complete with it."""
        if math.isnan(self.north_m):
            self.north_m, self.east_m = north_m, east_m
        elif self._last is not None:
            then_s, north_0, east_0, north_mps_0, east_mps_0 = self._last
            step = (north_m - north_0, east_m - east_0)
            took_s = max(stamp_s - then_s, 0.0)
            expected = 0.5 * (north_mps_0 + north_mps) * took_s, 0.5 * (east_mps_0 + east_mps) * took_s
            off_m = math.hypot(step[0] - expected[0], step[1] - expected[1])
            share = JUMP_SHARE if took_s <= GAP_S else TURNED_BACK_SHARE
            jump = off_m > JUMP_M + share * math.hypot(*expected)
            self.jumps += jump
            if jump or (self._dived and depth_m < SURFACE_M):
                step = expected
            self.north_m += step[0]
            self.east_m += step[1]
        self._last = (stamp_s, north_m, east_m, north_mps, east_mps)
        if depth_m < SURFACE_M or not self._dived:
            if depth_m > DIVED_M:
                self._dived, self._std_m = True, math.nan
            return None
        if math.isnan(self._std_m):
            return None
        std_m, self._std_m = self._std_m, math.nan
        return Fix(
            stamp_s=stamp_s,
            north_m=north_m,
            east_m=east_m,
            raw_north_m=self.north_m,
            raw_east_m=self.east_m,
            std_m=std_m,
        )
