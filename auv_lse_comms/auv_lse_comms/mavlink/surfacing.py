"""A surfacing for a fix where a leg ends: up, a fix for some time, down again, and only then on to the next leg.

stage   until                                                              next
UP      shallower than `SURFACED_M`, and GPS has had a fix for `FIX_S`     DOWN
        `LONGEST_S` after its begin, fix or none                           DOWN, reported
DOWN    within `AT_DEPTH_M` of the leg's depth                             over
"""

from __future__ import annotations

import dataclasses
import enum
import math

from auv_lse_comms.mavlink.messages.conversion import Target

#: Shallower than this (m) the vehicle is at the surface.
SURFACED_M = 0.5
#: GPS has told of a fix for so long (s): what it says first is worth less.
FIX_S = 20.0
#: A vehicle dives again after so long (s) even without a fix.
LONGEST_S = 120.0
#: So near to its depth (m) it travels on.
AT_DEPTH_M = 0.5


class Stage(enum.Enum):
    """Where a surfacing is."""

    UP = "up"
    DOWN = "down"
    OVER = "over"


class Surfacing:
    """One surfacing.

    Attributes:
        stage: Where it is.
        fixed: Whether GPS had a fix for long enough.
    """

    def __init__(self, end: Target, now_s: float) -> None:
        """Begins at `now_s` (s) at the end of a leg."""
        self.stage = Stage.UP
        self.fixed = False
        self._end = dataclasses.replace(end, surface=False)
        self._begun_s = now_s
        self._fix_s = math.nan  # since when GPS has a fix

    @property
    def target(self) -> Target:
        """Where the vehicle is to go now."""
        return dataclasses.replace(self._end, depth_m=0.0) if self.stage is Stage.UP else self._end

    def host_stepped(self, now_s: float) -> None:
        """The host's clock was set back to `now_s`."""
        self._begun_s, self._fix_s = min(self._begun_s, now_s), math.nan

    def gps(self, now_s: float, has_fix: bool) -> None:
        """What GPS says at `now_s`: whether it has a fix."""
        if not has_fix:
            self._fix_s = math.nan
        elif math.isnan(self._fix_s):
            self._fix_s = now_s

    def proceed(self, now_s: float, depth_m: float) -> bool:
        """The vehicle is at a depth (m) at `now_s`; returns whether the stage has changed."""
        if self.stage is Stage.UP:
            self.fixed = depth_m < SURFACED_M and now_s - self._fix_s >= FIX_S
            if self.fixed or now_s - self._begun_s >= LONGEST_S:
                self.stage = Stage.DOWN
                return True
        elif self.stage is Stage.DOWN and depth_m >= self._end.depth_m - AT_DEPTH_M:
            self.stage = Stage.OVER
            return True
        return False
