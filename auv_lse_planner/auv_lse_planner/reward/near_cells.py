"""Finds the cells that a path can change, among many.

A measurement changes the depth's variance only near its location. In a large area, most cells lie far from all
locations of a path.
"""

import numpy as np

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_gp.covariance.kernels import Kernel

#: Number of cells up to which finding those near a path saves nothing.
FEW_CELLS = 2000
#: Range of a measurement, in the kernel's lengths: beyond it, it removes less than 1e-3 of the variance.
RANGE = 3.0
#: Tiles along the range.
TILES = 4


class NearCells:
    """The cells near paths, by square tiles."""

    def __init__(self, kernel: Kernel, scaled: Array) -> None:
        """For cells at locations (M, 2) in the kernel's axes and lengths."""
        self._side = min(RANGE, kernel.support_m / kernel.length_m) / TILES
        self._begin = scaled.min(axis=0)
        tile = self._tiles(scaled)
        self._shape = int(tile[:, 0].max()) + 1, int(tile[:, 1].max()) + 1
        self._tile = tile[:, 0] * self._shape[1] + tile[:, 1]
        steps = np.arange(-TILES - 1, TILES + 2)
        north, east = (axis.ravel() for axis in np.meshgrid(steps, steps, indexing="ij"))
        near = np.hypot(np.maximum(np.abs(north) - 1, 0), np.maximum(np.abs(east) - 1, 0)) <= TILES
        self._around = np.column_stack([north[near], east[near]])

    def of(self, scaled: Array) -> Ints:
        """Numbers of the cells within range of any of the locations (P, 2), ascending."""
        tiles = (self._tiles(scaled)[:, None] + self._around).reshape(-1, 2)
        row, column = tiles[((tiles >= 0) & (tiles < self._shape)).all(axis=1)].T
        near = np.zeros(self._shape, dtype=bool)
        near[row, column] = True
        return np.asarray(np.flatnonzero(near.ravel()[self._tile]))

    def _tiles(self, scaled: Array) -> Ints:
        return np.asarray(np.floor((scaled - self._begin) / self._side).astype(np.int64))
