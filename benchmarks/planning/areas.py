"""Grounds of the studies of planners, by name: synthetic lakes, and windows of a real lake.

The small area (400 m x 500 m) is what one vehicle can just cover in 100 steps, the default mission's (600 m x 700 m)
what three can.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.sections.world import LakeConfig
from auv_lse_sim.ground.lake import SyntheticLake

#: North and east span (m) of the areas, and their margin around the start (0, 0).
AREAS = {"small": (400.0, 500.0, 20.0), "default": (600.0, 700.0, 50.0)}
#: Share of a real lake's window that must be known; over the rest a vehicle measures nothing, and nothing is judged.
KNOWN = 0.9


class Shifted:
    """A gridded real lake, moved so that the window's corner is the local origin's surroundings."""

    def __init__(self, ground: Any, north_m: float, east_m: float) -> None:
        """Adds (north_m, east_m) to every requested location."""
        self._ground, self._north, self._east = ground, north_m, east_m

    def depth_m(self, north_m: Any, east_m: Any) -> Any:
        """Depth at locations relative to the window."""
        return self._ground.depth_m(np.asarray(north_m) + self._north, np.asarray(east_m) + self._east)


def area(name: str) -> tuple[tuple[float, float, float], dict[str, Any]]:
    """Span and the `area` section of the area called `name`."""
    north, east, margin = span = AREAS[name]
    polygon = [-margin, -margin, north - margin, -margin, north - margin, east - margin, -margin, east - margin]
    return span, {"polygon_m": polygon}


def windows(path: Path, where: str) -> Iterator[tuple[str, float, float]]:
    """Windows of a real lake whose ground is mostly known, and 20 to 80 % of that at least 15 m deep."""
    from auv_lse_sim.ground.ground_files import load_ground

    ground = load_ground(path)
    (height, width, margin), _ = area(where)
    e = ground.extent
    for north in np.arange(e.north_min_m, e.north_max_m - height, 50.0):
        for east in np.arange(e.east_min_m, e.east_max_m - width, 50.0):
            grid = np.meshgrid(
                np.arange(north, north + height, 20.0), np.arange(east, east + width, 20.0), indexing="ij"
            )
            depth = ground.depth_m(*grid)
            known = np.isfinite(depth)
            if known.mean() >= KNOWN and 0.2 <= np.mean(depth[known] >= 15.0) <= 0.8:
                yield f"{path.stem}@{north:.0f},{east:.0f}", float(north + margin), float(east + margin)


def spread_windows(path: Path, where: str, most: int) -> list[str]:
    """Names of at most `most` windows, spread over all of them."""
    found = [name for name, _, _ in windows(path, where)]
    return found[:: max(1, len(found) // most)][:most]


def lake(name: str, where: str, real: Path | None) -> Any:
    """The ground called `name`: a seed, or a window of the real lake."""
    (height, width, margin), _ = area(where)
    if name.isdigit():
        north, east = height / 2.0 - margin, width / 2.0 - margin
        return SyntheticLake(LakeConfig(seed=int(name), height_m=height, width_m=width, north_m=north, east_m=east))
    from auv_lse_sim.ground.ground_files import load_ground

    assert real is not None
    north, east = (float(x) for x in name.split("@")[1].split(","))
    return Shifted(load_ground(real), north + margin, east + margin)
