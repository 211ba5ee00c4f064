"""Draws a plan as lines on the map: its actions, and their continuation to the mission's end."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.naive_ids import HOLD, STRAIGHT_ON
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.paths.naive import NaivePaths
from auv_lse_planner.paths.rollout import Rollout

#: Points on each leg of a plan.
POINTS_PER_LEG = 4


class PlanLines:
    """Follows the plans of one vehicle."""

    def __init__(self, settings: PlannerSettings, area: OperatingArea) -> None:
        """Prepares the computation of paths; the first plan compiles the inner loops if needed."""
        self._motion = MotionTable(settings.motion)
        space = FreeSpace(area, self._motion, settings.area.raster_m)
        naive = NaivePaths(space, settings.planner, area.polygon, settings.mission.vehicles)
        self._rollout = Rollout(self._motion, naive, settings.mission.steps, settings.planner.samples_per_leg)

    def lines(self, plan: Plan) -> dict[str, Any]:
        """The plan's legs as one line of points, `POINTS_PER_LEG` to a leg after the first point.

        Returns:
            "step" of the first point, "own": how many legs are the plan's own actions, "line": north, east, north, ...
            in decimetres, "waypoints" of the plan's tour likewise, and "continued": what continues the actions.
        """
        if not self._rollout.can_follow(plan):
            return {"step": plan.step, "own": 0, "line": [], "waypoints": [], "continued": "unknown"}
        path = self._rollout.follow(plan)
        points = self._motion.line(path.states, path.actions, POINTS_PER_LEG)
        own = min(len(plan.actions), len(path))  # `path.own` has the tour's legs, too
        waypoints = np.empty((0, 2))
        if plan.tour is not None:
            waypoints = plan.tour.waypoints_m(path.states[own, 1:], self._motion.leg_length_m)
        return {
            "step": plan.step,
            "own": own,
            "line": decimetres(points),
            "waypoints": decimetres(waypoints),
            "continued": _continued(plan),
        }


#: Names of the naive paths that are not lanes.
_NAIVE = {STRAIGHT_ON: "a straight line", HOLD: "a loop"}


def _continued(plan: Plan) -> str:
    """Describes the continuation of a plan's actions."""
    parts = []
    if plan.tour is not None:
        parts.append(f"a tour of {len(plan.tour.bearings)} segments")
    if plan.naive_path != NONE:
        parts.append(_NAIVE.get(plan.naive_path, "lanes of a lawnmower"))
    return ", then ".join(parts)


def decimetres(points_m: Array | Sequence[Any]) -> list[int]:
    """Positions (n, 2) as whole decimetres: north, east, north, east, ..."""
    flat: list[int] = np.round(10.0 * np.asarray(points_m)).astype(int).ravel().tolist()
    return flat
