"""The minimum spacing of kernel centers: finds the kept location that is too close to a new one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support import compiled
from auv_lse_common.support.growing_rows import GrowingRows
from auv_lse_gp.compiled.modules import compiled_gp

Array = NDArray[np.float64]


class SpacingIndex:
    """Finds kept locations within the minimum spacing of a new one, by comparison with all of them.

    Up to a few thousand locations, this is faster than a sorted index.
    """

    def __init__(self, spacing_m: float) -> None:
        self._spacing_m = spacing_m
        self._locations = GrowingRows(2)

    def __len__(self) -> int:
        """Number of locations."""
        return len(self._locations)

    def shift(self, by_m: Array) -> None:
        """Moves all locations by (n, 2)."""
        self._locations.rows[:] += by_m

    def truncate(self, size: int) -> None:
        """Drops all locations from number `size` on."""
        self._locations.resize(min(len(self), size))

    def take(self, locations_m: Array, max_new: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Keeps, one after another, the locations that no kept location is too close to.

        Args:
            locations_m: North, east (n, 2).
            max_new: Largest number of locations to keep.

        Returns:
            For each location (n,): the number of the kept location that is too close, its own number if it is kept, or
                -1 if
            `max_new` are kept already; and a mask (n,) of the kept ones.
        """
        before = len(self)
        self._locations.reserve(before + len(locations_m))
        near = self._near(locations_m, max_new)
        first = np.full(len(locations_m), -1)
        first[1:] = np.maximum.accumulate(near)[:-1]
        new = near > np.maximum(first, before - 1)
        self._locations.resize(before + int(new.sum()))
        return near, new

    def _near(self, locations_m: Array, max_new: int) -> NDArray[np.int64]:
        """As `take`'s first result; writes new locations into the spare rows of the buffer."""
        near = np.empty(len(locations_m), dtype=np.int64)
        take = compiled_gp().take_spaced if compiled.USE_NUMBA else take_spaced_numpy
        take(self._locations.buffer, len(self), self._spacing_m, locations_m, max_new, near)
        return near


def take_spaced_numpy(
    kept: Array, size: int, spacing_m: float, locations: Array, max_new: int, near: NDArray[np.int64]
) -> None:
    """`SpacingIndex.take` in NumPy: the reference for the compiled version.

    Args:
        kept: `size` kept locations, then room for new ones.
        locations: Locations (n, 2).
        near: Receives the numbers (n,).
    """
    full = size + max_new
    for i, location in enumerate(locations):
        near[i] = -1
        if size and spacing_m > 0.0:
            apart = kept[:size] - location
            squares = apart[:, 0] * apart[:, 0] + apart[:, 1] * apart[:, 1]
            number = int(np.argmin(squares))
            if math.sqrt(squares[number]) < spacing_m:
                near[i] = number
        if near[i] < 0 and size < full:
            kept[size] = location
            near[i] = size
            size += 1
