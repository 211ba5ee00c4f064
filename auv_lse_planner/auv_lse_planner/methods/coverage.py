"""Decides whether a single vehicle follows the isobath: it does among shores, on ground that it cannot cover.

Parallel lanes over the whole area, made of all legs, lie

    d = a / (l s)     apart: a the size of the area, l legs (paper), s the length of a leg.

If d is larger than `MAX_LANES_APART` length scales, most ground between them stays unknown. A path that lowers the
map's risk everywhere then runs along the middle of a lake, whose isobath lies along its shores, and locates hardly any
of it (docs/evidence/planner.md). Land shows in the area's shape: the area fills less than its convex hull. Where the
mission file has the shore, planning by risk alone ends with less risk and loss, so the vehicle does not follow.

The mission file alone decides, so the planner and the report agree.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from auv_lse_common.mission_file.operating_area import Grid, OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_planner.methods import stages
from auv_lse_planner.paths.motion import MotionTable

#: Largest distance between lanes that cover the ground, in length scales of the kernel.
MAX_LANES_APART = 2.0
#: Least share of its convex hull that an area without land fills.
OPEN_SHARE = 0.9


def follows_isobath(settings: PlannerSettings) -> bool:
    """Whether the vehicle follows the isobath: alone, with a tour that is optimized again, where that pays.

    A team, a mission that is planned in stages, and one with a known shore (`area.shore`) lower the risk instead.
    """
    planner, mission, gp = settings.planner.complete(), settings.mission, settings.gp
    if planner.family.bound_of != "map" or not planner.tour_interval:
        return False
    if settings.area.shore or mission.vehicles > 1 or stages.is_staged(mission):
        return False
    cells = OperatingArea(settings.area).grid(planner.map_spacing_m, "planner.map_spacing_m")
    scale_m = max(gp.length_scale_m, gp.length_scale_2_m)
    return lanes_apart_m(settings, cells) > MAX_LANES_APART * scale_m and share_of_hull(cells) < OPEN_SHARE


def lanes_apart_m(settings: PlannerSettings, cells: Grid) -> float:
    """Distance (m) between the lanes of a vehicle that mows all cells: d above."""
    area_m2 = float(np.count_nonzero(cells.inside)) * cells.resolution_m**2
    return area_m2 / (settings.mission.steps * MotionTable(settings.motion).leg_length_m)


def share_of_hull(cells: Grid) -> float:
    """Share of the cells' convex hull that they fill."""
    half = 0.5 * cells.resolution_m
    corners = half * np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
    hull = ConvexHull((cells.locations_m[:, None] + corners).reshape(-1, 2))
    return float(np.count_nonzero(cells.inside)) * cells.resolution_m**2 / float(hull.volume)  # of two dimensions: area
