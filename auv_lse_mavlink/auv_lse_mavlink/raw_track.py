"""The dead-reckoned position of a vehicle with an autopilot: its estimate without the corrections by GPS fixes.

At the surface an autopilot's estimator jumps or drifts to the GPS position. The dead-reckoned position follows the
estimate's steps with two exceptions, which are replaced by velocity times time: steps that the reported velocity does
not explain, and all steps at the surface after the first dive. When the vehicle dives after a GPS fix, estimate and
dead-reckoned position are reported as a fix.
"""

import math

from auv_lse_common.vocabulary.dead_reckoning import Fix

#: Largest deviation of a step from velocity times time: in m, plus a share of the distance. An estimator that corrects
#: its heading far from its start moves by a metre or two, which is dead reckoning and not a jump.
JUMP_M = 3.0
JUMP_SHARE = 0.2
#: Above this depth (m) GPS may be received.
SURFACE_M = 0.5
#: Below this depth (m) the vehicle has dived.
DIVED_M = 1.0
#: After a gap of this length (s) the vehicle may have turned back: the deviation may be twice the distance.
GAP_S = 5.0
TURNED_BACK_SHARE = 2.0
#: Standard deviation of a fix if GPS does not report it (m).
FIX_STD_M = 2.5


class RawTrack:
    """One vehicle's dead-reckoned position.

    Attributes:
        north_m: North of the dead-reckoned position; NaN before the first estimate.
        east_m: East of it.
        jumps: Number of steps that were replaced because velocity does not explain them.
    """

    def __init__(self) -> None:
        self.north_m = self.east_m = math.nan
        self.jumps = 0
        self._last: tuple[float, float, float, float, float] | None = None  # stamp, position, velocity
        self._dived = False
        self._std_m = math.nan  # of GPS in this surfacing; NaN without a fix

    def gps(self, std_m: float) -> None:
        """GPS has a fix with this standard deviation (m; not positive: unknown)."""
        self._std_m = std_m if std_m > 0.0 else FIX_STD_M

    def interrupt(self) -> None:
        """The next estimate is in another frame, or follows a restart: its step is ignored."""
        self._last = None

    def move(
        self, stamp_s: float, north_m: float, east_m: float, depth_m: float, north_mps: float, east_mps: float
    ) -> Fix | None:
        """Adds an estimate of position (m), depth (m) and velocity (m/s); returns the fix that it completes, if any."""
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
