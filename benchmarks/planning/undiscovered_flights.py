"""Missions over lakes of several kinds, whose soundings `undiscovered.py` evaluates.

Kinds of ground: `valley`, the simulator's lakes; `rough`, the same with more relief, islands and shoals; `gaussian`,
Gaussian fields of random length scale, standard deviation and mean; and windows of a real lake. One vehicle maps
400 m x 500 m, teams map 600 m x 700 m.
"""

import functools
import math
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.mission_file.sections.world import LakeConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_sim.ground.lake import SyntheticLake
from benchmarks.planning.areas import area, lake
from benchmarks.planning.planner_loop import light_mission

#: Share of packets lost.
LOSS = 0.07
#: Least depth (m) of made-up ground: a shoal does not become land.
LEAST_M = 1.0


class Waves:
    """A Gaussian field: Matern 5/2 with a length scale of 50 to 120 m and 4 to 9 m about a mean of 12 to 18 m."""

    def __init__(self, seed: int) -> None:
        rng = stream(seed, "gaussian field")
        length, self._std, self._mean = rng.uniform(50.0, 120.0), rng.uniform(4.0, 9.0), rng.uniform(12.0, 18.0)
        # The spectrum of a Matern kernel of order nu is that of a multivariate t with 2 nu degrees of freedom.
        chi = np.sqrt(5.0 / rng.chisquare(5.0, 1500))
        self._waves = rng.standard_normal((1500, 2)) * chi[:, None] / length
        self._phases = rng.uniform(0.0, 2.0 * math.pi, 1500)

    def depth_m(self, north_m: Any, east_m: Any) -> Array:
        """Depth (m) at locations."""
        locations = np.stack(np.broadcast_arrays(np.asarray(north_m, float), np.asarray(east_m, float)), axis=-1)
        rows = locations.reshape(-1, 2)
        values = [
            np.cos(part @ self._waves.T + self._phases).sum(axis=1)
            for part in np.array_split(rows, 1 + len(rows) // 4096)
        ]
        field = self._std * math.sqrt(2.0 / 1500) * np.concatenate(values)
        depth_m: Array = np.maximum(self._mean + field, LEAST_M).reshape(locations.shape[:-1])
        return depth_m


class Shoals:
    """A lake of the simulator with six shoals and two holes of 12 to 35 m in it."""

    def __init__(self, seed: int, ground: Any, span: tuple[float, float, float]) -> None:
        """Draws the shoals over the area of `span` (`areas.AREAS`)."""
        rng = stream(seed, "shoals")
        height, width, margin = span
        self._ground = ground
        self._locations = rng.uniform([-margin, -margin], [height - margin, width - margin], (8, 2))
        self._size = rng.uniform(12.0, 35.0, 8)
        self._rise = rng.uniform(4.0, 14.0, 8) * np.array([1.0] * 6 + [-1.0] * 2)

    def depth_m(self, north_m: Any, east_m: Any) -> Array:
        """Depth (m) at locations."""
        north, east = np.asarray(north_m, float), np.asarray(east_m, float)
        depth = np.asarray(self._ground.depth_m(north, east), float)
        for (n, e), size, rise in zip(self._locations, self._size, self._rise, strict=True):
            depth = depth - rise * np.exp(-0.5 * ((north - n) ** 2 + (east - e) ** 2) / size**2)
        return np.asarray(np.maximum(depth, LEAST_M))  # NaN stays NaN


def where_of(vehicles: int) -> str:
    """The area that a team of this size maps."""
    return "small" if vehicles == 1 else "default"


@functools.lru_cache(maxsize=4)
def ground_of(kind: str, name: str, where: str, real: str) -> Any:
    """The ground of a mission: `name` is a seed, or a window of the real lake."""
    span, _ = area(where)
    if kind == "gaussian":
        return Waves(int(name))
    if kind == "rough":
        height, width, margin = span
        config = LakeConfig(
            seed=int(name), height_m=height, width_m=width, north_m=height / 2.0 - margin, east_m=width / 2.0 - margin,
            roughness_m=1.5, roughness_scale_m=40.0, islands=4, deep_share_low=0.3, deep_share_high=0.8,
        )  # fmt: skip
        return Shoals(int(name), SyntheticLake(config), span)
    return lake(name, where, Path(real) if real else None)


def settings(vehicles: int) -> PlannerSettings:
    """Settings of a mission. No vehicle surfaces: positions are exact."""
    return PlannerSettings.from_parameters(
        {
            "area": area(where_of(vehicles))[1],
            "vehicle": {"surfacings": 0},
            "mission": {"vehicles": vehicles},
            "planner": {"method": "tour"},
        },
        "benchmark",
    )


def mission(kind: str, vehicles: int, name: str, real: str) -> dict[str, Any]:
    """Simulates one mission; returns its line, with all soundings as rows of time (s), north, east, depth (m)."""
    ground = ground_of(kind, name, where_of(vehicles), real)
    seed = int(name) if name.isdigit() else sum(name.encode())
    rows = light_mission(settings(vehicles), ground, seed, LOSS)
    return {
        "kind": kind,
        "vehicles": vehicles,
        "lake": name,
        "real": real,
        "soundings": np.round(rows, 2).tolist(),
    }
