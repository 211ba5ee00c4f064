"""The minimum spacing of kernel centers: which of the places that are kept is too close to a new one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support import compiled
from auv_lse_gp.compiled.modules import compiled_gp

Array = NDArray[np.float64]


class SpacingIndex:
    """Finds kept places within the minimum spacing of a new one.

    All are looked at: up to some thousand that costs less than keeping them in order.
    """

    def __init__(self, spacing_m: float) -> None:
        """Starts without places; a spacing of 0 finds none too close."""
        self._spacing_m = spacing_m
        self._places_m = np.zeros((64, 2))
        self._size = 0

    def __len__(self) -> int:
        """Number of places."""
        return self._size

    def add(self, north_m: float, east_m: float) -> None:
        """Adds a place; its number is how many there were before."""
        self._reserve(self._size + 1)
        self._places_m[self._size] = north_m, east_m
        self._size += 1

    def truncate(self, size: int) -> None:
        """Forgets all places from number `size` on."""
        self._size = min(self._size, size)

    def too_close(self, north_m: float, east_m: float) -> int | None:
        """Number of the nearest place that is closer than the spacing, None if there is none."""
        near = int(self._near(np.array([[north_m, east_m]]), 0)[0])
        return near if near >= 0 else None

    def take(self, places_m: Array, most_new: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Keeps those of places (n, 2), one after another, that no kept one is too close to.

        Args:
            places_m: North, east (n, 2).
            most_new: So many are kept at most.

        Returns:
            Number of the kept place that each is too close to, or of itself where it is kept, -1 where it would be one
            more than `most_new`, (n,); and which are kept, (n,).
        """
        self._reserve(self._size + len(places_m))
        before = self._size
        near = self._near(places_m, most_new)
        first = np.full(len(places_m), -1)
        first[1:] = np.maximum.accumulate(near)[:-1]
        new = near > np.maximum(first, before - 1)
        self._size = before + int(new.sum())
        return near, new

    def _near(self, places_m: Array, most_new: int) -> NDArray[np.int64]:
        """As `take`'s first answer; the table then has the new places after those that count."""
        near = np.empty(len(places_m), dtype=np.int64)
        if compiled.USE_NUMBA:
            compiled_gp().take_spaced(self._places_m, self._size, self._spacing_m, places_m, most_new, near)
        else:
            take_spaced_numpy(self._places_m, self._size, self._spacing_m, places_m, most_new, near)
        return near

    def _reserve(self, size: int) -> None:
        if size > len(self._places_m):
            grown = np.zeros((max(size, 2 * len(self._places_m)), 2))
            grown[: self._size] = self._places_m[: self._size]
            self._places_m = grown


def take_spaced_numpy(
    kept: Array, size: int, spacing_m: float, places: Array, most_new: int, near: NDArray[np.int64]
) -> None:
    """`SpacingIndex.take` with NumPy alone: the reference of the compiled one.

    Args:
        kept: Kept places, `size` of them and room for those of `places` that are new.
        size: How many are kept.
        spacing_m: The spacing.
        places: Places (n, 2).
        most_new: So many are kept at most.
        near: Where the numbers (n,) go.
    """
    full = size + most_new
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
