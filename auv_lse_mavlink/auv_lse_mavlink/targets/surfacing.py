"""A surfacing for a fix at the end of a leg: up, wait for a fix, down again; the next leg follows after that.

stage   until                                                              next
UP      shallower than `SURFACED_M`, and GPS has had a fix for `FIX_S`     DOWN
        `LONGEST_S` after its begin, with or without a fix                 DOWN, reported
DOWN    within `AT_DEPTH_M` of the leg's depth                             over
"""

import dataclasses
import enum
import math

from auv_lse_mavlink.messages.conversion import Target

#: Above this depth (m) the vehicle is at the surface.
SURFACED_M = 0.5
#: GPS must have had a fix for this long (s), because its first positions are less accurate.
FIX_S = 20.0
#: The vehicle dives again after this time (s) even without a fix.
LONGEST_S = 120.0
#: Within this distance (m) of its depth the vehicle continues.
AT_DEPTH_M = 0.5


class Stage(enum.Enum):
    """Stage of a surfacing."""

    UP = "up"
    DOWN = "down"
    OVER = "over"


class Surfacing:
    """One surfacing.

    Attributes:
        fixed: Whether GPS had a fix for long enough.
    """

    def __init__(self, end: Target, now_s: float) -> None:
        """Begins at `now_s` (s) at the end of a leg."""
        self.stage = Stage.UP
        self.fixed = False
        self._end = dataclasses.replace(end, surface=False)
        self._begun_s = now_s
        self._fix_s = math.nan  # time since which GPS has a fix

    @property
    def target(self) -> Target:
        """The vehicle's present target."""
        return dataclasses.replace(self._end, depth_m=0.0, at_surface=True) if self.stage is Stage.UP else self._end

    def gps(self, now_s: float, has_fix: bool) -> None:
        """Records whether GPS has a fix at `now_s`."""
        if not has_fix:
            self._fix_s = math.nan
        elif math.isnan(self._fix_s):
            self._fix_s = now_s

    def proceed(self, now_s: float, depth_m: float) -> bool:
        """Updates the stage for a vehicle at a depth (m) at `now_s`; returns whether it has changed."""
        if self.stage is Stage.UP:
            self.fixed = depth_m < SURFACED_M and now_s - self._fix_s >= FIX_S
            if self.fixed or now_s - self._begun_s >= LONGEST_S:
                self.stage = Stage.DOWN
                return True
        elif self.stage is Stage.DOWN and depth_m >= self._end.depth_m - AT_DEPTH_M:
            self.stage = Stage.OVER
            return True
        return False
