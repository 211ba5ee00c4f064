"""The number of legs for which a team's tours are planned if `mission.until` asks for a share found.

A tour spreads its lines over all legs that it plans for. Planned for the whole budget, it finds most of the isobath
late. So it plans for the *horizon*, the step at which the share asked for is expected to be found:

- At the start, the legs with which parallel lanes over the whole area are expected to find it (`lanes_share`).
- In the last `LATE_SHARE` of the horizon, it is extended if the map lacks the quality. The share found is expected to
  grow in proportion to the legs. If extended earlier, a tour would visit the best ground later.
- The horizon never lies beyond the mission's last step.

A vehicle judges its own map, so horizons differ within a team. Every plan states its legs, so no receiver needs them.
"""

from __future__ import annotations

import math

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_gp.map.quality import lanes_share
from auv_lse_planner.paths.motion import MotionTable

#: Last share of the horizon, in which it can be extended, and the least extension (legs).
LATE_SHARE, LEAST_LEGS = 0.2, 5


class Horizon:
    """The step at which a vehicle plans to end.

    Attributes:
        end: That step; the mission's last one unless `mission.until` asks for a share found.
    """

    def __init__(self, settings: PlannerSettings, area: OperatingArea, asked: float | None) -> None:
        """Starts without a judgement.

        Args:
            asked: Share found of `mission.until`; None: the vehicle plans for the whole mission.
        """
        self._steps, self._asked = settings.mission.steps, asked
        self.end = self._steps if asked is None else _legs_of_lanes(settings, area, asked)

    @property
    def is_whole(self) -> bool:
        """Whether the vehicle plans for the whole mission."""
        return self.end >= self._steps

    def is_near(self, step: int) -> bool:
        """Whether the horizon is near at `step`, and not the mission's last step."""
        return not self.is_whole and step >= (1.0 - LATE_SHARE) * self.end

    def judged(self, step: int, found_share: float) -> None:
        """Updates the horizon with the share found (0 to 1) of a map that lacks the quality, at `step`."""
        if self._asked is None or not self.is_near(step):
            return
        needed = math.ceil(step * self._asked / max(found_share, 1e-3))
        if needed >= self.end + LEAST_LEGS:
            self.end = min(needed, self._steps)

    def extend(self, step: int) -> None:
        """Extends the horizon if fewer than two legs remain before it at `step`."""
        if self.end - step < 2:
            self.end = min(step + LEAST_LEGS, self._steps)


def _legs_of_lanes(settings: PlannerSettings, area: OperatingArea, share: float) -> int:
    """Least number of legs of each vehicle whose lanes over the area are expected to find a share of the isobath."""
    mission, cells = settings.mission, area.grid(settings.planner.complete().map_spacing_m, "planner.map_spacing_m")
    area_m2 = float(np.count_nonzero(cells.inside)) * cells.resolution_m**2
    leg_m = MotionTable(settings.motion).leg_length_m
    low, high = 0, mission.steps
    while high - low > 1:
        legs = (low + high) // 2
        if lanes_share(settings.gp, area_m2 / (mission.vehicles * legs * leg_m), leg_m) < share:
            low = legs
        else:
            high = legs
    return high
