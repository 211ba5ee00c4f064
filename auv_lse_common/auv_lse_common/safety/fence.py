"""The fence: the operating area's polygon plus a margin."""

import math
from collections.abc import Sequence


class Fence:
    """A polygon with a margin that vehicles and waypoints must not leave."""

    def __init__(self, polygon_m: Sequence[float], margin_m: float) -> None:
        """Builds the fence from corners in order: north, east (m), north, ...; drops a last one equal to the first.

        Raises:
            ValueError: if there are fewer than three finite corners.
        """
        flat = [float(x) for x in polygon_m]
        corners = list(zip(flat[::2], flat[1::2], strict=False))
        if corners and corners[0] == corners[-1]:
            corners.pop()
        if len(flat) % 2 or len(corners) < 3 or not all(map(math.isfinite, flat)):
            raise ValueError(
                f"area.polygon_m: {list(polygon_m)} is not a polygon; give north, east (m) of at least 3 corners"
            )
        self.margin_m = margin_m
        self._edges = list(zip(corners, [*corners[1:], corners[0]], strict=True))

    def outside_m(self, north_m: float, east_m: float) -> float:
        """Distance (m) of a position outside the polygon; 0 inside. More than the margin is beyond the fence."""
        inside, nearest = False, math.inf
        for (n0, e0), (n1, e1) in self._edges:
            if (n0 > north_m) != (n1 > north_m) and east_m < e0 + (north_m - n0) / (n1 - n0) * (e1 - e0):
                inside = not inside
            along_n, along_e = n1 - n0, e1 - e0
            length_2 = along_n * along_n + along_e * along_e
            part = ((north_m - n0) * along_n + (east_m - e0) * along_e) / length_2 if length_2 else 0.0
            part = min(max(part, 0.0), 1.0)
            nearest = min(nearest, math.hypot(north_m - n0 - part * along_n, east_m - e0 - part * along_e))
        return 0.0 if inside else nearest
