"""A rectangle on the map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auv_lse_common.support.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Extent:
    """A north-east rectangle (m, local tangent plane)."""

    north_min_m: float
    north_max_m: float
    east_min_m: float
    east_max_m: float

    def __post_init__(self) -> None:
        """Rejects an empty rectangle."""
        if not (self.north_min_m < self.north_max_m and self.east_min_m < self.east_max_m):
            raise ValueError(f"extent: {self} is empty; min must be below max in north and in east")

    @classmethod
    def around(cls, center: tuple[float, float], height_m: float, width_m: float) -> Extent:
        """The rectangle with a center (north, east) and sides (m)."""
        north, east = center
        return cls(
            north_min_m=north - height_m / 2.0,
            north_max_m=north + height_m / 2.0,
            east_min_m=east - width_m / 2.0,
            east_max_m=east + width_m / 2.0,
        )

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
        """North (ny,) and east (nx,) of the centers of cells about `spacing_m` wide that tile it."""
        ny = max(1, round(self.height_m / spacing_m))
        nx = max(1, round(self.width_m / spacing_m))
        north = self.north_min_m + (np.arange(ny) + 0.5) * self.height_m / ny
        east = self.east_min_m + (np.arange(nx) + 0.5) * self.width_m / nx
        return north, east

    def grown(self, by_m: float) -> Extent:
        """The rectangle extended by `by_m` on every side."""
        return Extent(
            north_min_m=self.north_min_m - by_m,
            north_max_m=self.north_max_m + by_m,
            east_min_m=self.east_min_m - by_m,
            east_max_m=self.east_max_m + by_m,
        )
