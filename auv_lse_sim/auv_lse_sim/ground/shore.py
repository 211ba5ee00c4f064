"""The shore of an operating area that the ground limits: the contour of the least navigable depth."""

import numpy as np
import shapely
from contourpy import contour_generator

from auv_lse_common.support.arrays import Array

#: Distance (m) from the area within which the shore counts.
REACH_M = 40.0
#: Shorter lines (m) are dropped.
LEAST_M = 10.0
#: Tolerance (m) of the lines, and the largest number of their corners: of more, only the longest lines remain.
TOLERANCE_M = 2.0
MAX_CORNERS = 1000


def shore_of(
    north_m: Array, east_m: Array, depth_m: Array, limit_m: float, area: shapely.Geometry
) -> dict[str, list[float]]:
    """Lines along the shore near an area, by name: north, east, north, east, ...

    Only known ground has contours. So there is no shore where a survey ends, or where the requested polygon does.

    Args:
        north_m: Rows (ny,) of a raster that covers the area.
        east_m: Its columns (nx,).
        depth_m: Depths (ny, nx); NaN on land and unknown ground.
        limit_m: The least navigable depth.
        area: The operating area, in (east, north).
    """
    if min(depth_m.shape) < 2:
        return {}
    contours = contour_generator(east_m, north_m, np.ma.masked_invalid(depth_m)).lines(limit_m)
    near = shapely.union_all([shapely.LineString(line) for line in contours]).intersection(area.buffer(REACH_M))
    parts = shapely.get_parts(shapely.line_merge(near)) if not near.is_empty else []
    lines = [part for part in parts if part.geom_type == "LineString" and part.length >= LEAST_M]
    simple = [line.simplify(TOLERANCE_M) for line in sorted(lines, key=lambda line: -line.length)]
    corners = np.cumsum([len(line.coords) for line in simple])
    return {
        f"shore_{number}": [round(float(v), 2) for east, north in line.coords for v in (north, east)]
        for number, line in enumerate(simple, 1)
        if corners[number - 1] <= MAX_CORNERS
    }
