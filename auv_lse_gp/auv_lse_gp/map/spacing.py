"""The minimum spacing of kernel centers: finds the kept place that is too close to a new one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support import compiled
from auv_lse_common.support.growing_rows import GrowingRows
from auv_lse_gp.compiled.modules import compiled_gp

Array = NDArray[np.float64]


class SpacingIndex:
    """Finds kept places within the minimum spacing of a new one, by comparison with all of them.

    Up to a few thousand places, this is faster than a sorted index.
    """

    def __init__(self, spacing_m: float) -> None:
        self._spacing_m = spacing_m
        self._places = GrowingRows(2)

    def __len__(self) -> int:
        """Number of places."""
        return len(self._places)

    def shift(self, by_m: Array) -> None:
        """Moves all places by (n, 2)."""
        self._places.rows[:] += by_m

    def truncate(self, size: int) -> None:
        """Drops all places from number `size` on."""
        self._places.resize(min(len(self), size))

    def take(self, places_m: Array, max_new: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Keeps, one after another, the places that no kept place is too close to.

        Args:
            places_m: North, east (n, 2).
            max_new: Largest number of places to keep.

        Returns:
            For each place (n,): the number of the kept place that is too close, its own number if it is kept, or -1 if
            `max_new` are kept already; and a mask (n,) of the kept ones.
        """
        before = len(self)
        self._places.reserve(before + len(places_m))
        near = self._near(places_m, max_new)
        first = np.full(len(places_m), -1)
        first[1:] = np.maximum.accumulate(near)[:-1]
        new = near > np.maximum(first, before - 1)
        self._places.resize(before + int(new.sum()))
        return near, new

    def _near(self, places_m: Array, max_new: int) -> NDArray[np.int64]:
        """As `take`'s first result; writes new places into the spare rows of the buffer."""
        near = np.empty(len(places_m), dtype=np.int64)
        take = compiled_gp().take_spaced if compiled.USE_NUMBA else take_spaced_numpy
        take(self._places.buffer, len(self), self._spacing_m, places_m, max_new, near)
        return near


def take_spaced_numpy(
    kept: Array, size: int, spacing_m: float, places: Array, max_new: int, near: NDArray[np.int64]
) -> None:
    """`SpacingIndex.take` in NumPy: the reference for the compiled version.

    Args:
        kept: `size` kept places, then room for new ones.
        places: Places (n, 2).
        near: Receives the numbers (n,).
    """
    full = size + max_new
    for i, place in enumerate(places):
        near[i] = -1
        if size and spacing_m > 0.0:
            apart = kept[:size] - place
            squares = apart[:, 0] * apart[:, 0] + apart[:, 1] * apart[:, 1]
            number = int(np.argmin(squares))
            if math.sqrt(squares[number]) < spacing_m:
                near[i] = number
        if near[i] < 0 and size < full:
            kept[size] = place
            near[i] = size
            size += 1
