"""What lies under the water: the `Ground` that the simulated vehicles sound.

Depth is water depth in metres, positive down, referred to the still surface. NaN means that the ground is unknown
there, or that it is land. `lake.py` draws synthetic ground, `ground_files.py` reads ground from files.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Extent:
    """A north-east rectangle (m, local tangent plane)."""

    north_min_m: float
    north_max_m: float
    east_min_m: float
    east_max_m: float

    def __post_init__(self) -> None:
        """Refuses an empty rectangle."""
        if not (self.north_min_m < self.north_max_m and self.east_min_m < self.east_max_m):
            raise ValueError(f"extent: {self} is empty; expected min < max in north and in east")

    @property
    def height_m(self) -> float:
        """Length from south to north (m)."""
        return self.north_max_m - self.north_min_m

    @property
    def width_m(self) -> float:
        """Length from west to east (m)."""
        return self.east_max_m - self.east_min_m

    @property
    def center(self) -> tuple[float, float]:
        """North and east (m) of the middle."""
        return (self.north_min_m + self.north_max_m) / 2.0, (self.east_min_m + self.east_max_m) / 2.0

    def axes(self, spacing_m: float) -> tuple[Array, Array]:
        """North (ny,) and east (nx,) coordinates of the middles of cells about `spacing_m` wide that tile it."""
        ny = max(1, round(self.height_m / spacing_m))
        nx = max(1, round(self.width_m / spacing_m))
        north = self.north_min_m + (np.arange(ny) + 0.5) * self.height_m / ny
        east = self.east_min_m + (np.arange(nx) + 0.5) * self.width_m / nx
        return north, east

    def grown(self, by_m: float) -> Extent:
        """The rectangle with `by_m` more on every side."""
        return Extent(
            north_min_m=self.north_min_m - by_m,
            north_max_m=self.north_max_m + by_m,
            east_min_m=self.east_min_m - by_m,
            east_max_m=self.east_max_m + by_m,
        )


class Ground(Protocol):
    """Ground that can be sounded."""

    @property
    def extent(self) -> Extent:
        """The rectangle outside which every depth is NaN."""

    @property
    def origin(self) -> tuple[float, float] | None:
        """WGS84 latitude and longitude (deg) of the local origin, None if it is nowhere on Earth."""

    def depth_m(self, north_m: Any, east_m: Any) -> Array:
        """Water depth (m, positive down) at places of any broadcastable shape; NaN where unknown or land."""

    def describe(self) -> str:
        """One or two sentences for the log and the report."""


class GroundError(ValueError):
    """Bathymetry that cannot be used; names the file, the line or array, and what was expected."""
