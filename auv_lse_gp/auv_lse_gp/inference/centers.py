"""Kernel centers: the measurements of the depth that the Gaussian process is conditioned on."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, slots=True)
class Centers:
    """The kernel centers.

    Attributes:
        places_m: North, east (n, 2).
        depths_m: Depth (n,).
        noise_std_m: Standard deviation of each depth as a measurement (n,).
        place_effect_m: How much each way in which all their places may be wrong together, at one standard deviation, is
            worth in depth (n, r); None: their places count as known. The first two ways are those that a fix of the
            map's vehicle would take away.
    """

    places_m: Array
    depths_m: Array
    noise_std_m: Array
    place_effect_m: Array | None = None

    def __len__(self) -> int:
        """Number of centers."""
        return len(self.depths_m)

    def slice(self, begin: int, end: int) -> Centers:
        """The centers from number `begin` to `end`, without copying."""
        effect = self.place_effect_m
        return Centers(
            self.places_m[begin:end],
            self.depths_m[begin:end],
            self.noise_std_m[begin:end],
            None if effect is None else effect[begin:end],
        )

    def joined(self, others: Centers) -> Centers:
        """These centers and `others` after them."""
        return Centers(
            np.concatenate([self.places_m, others.places_m]),
            np.concatenate([self.depths_m, others.depths_m]),
            np.concatenate([self.noise_std_m, others.noise_std_m]),
            _joined(self, others),
        )


def _joined(first: Centers, second: Centers) -> Array | None:
    """Place effects of both; centers without any have none of the other's ways."""
    a, b = first.place_effect_m, second.place_effect_m
    if a is None and b is None:
        return None
    if a is None:
        a = np.zeros((len(first), b.shape[1] if b is not None else 0))
    if b is None:
        b = np.zeros((len(second), a.shape[1]))
    return np.concatenate([a, b])


#: No centers at all.
NO_CENTERS = Centers(np.zeros((0, 2)), np.zeros(0), np.zeros(0))


class CenterTable:
    """Centers in arrays that double when they are full."""

    def __init__(self) -> None:
        """Makes an empty table."""
        self._size = 0
        self._rows = np.zeros((64, 4))  # north, east, depth, noise

    def __len__(self) -> int:
        """Number of centers."""
        return self._size

    @property
    def centers(self) -> Centers:
        """The centers: views, overwritten by later changes."""
        rows = self._rows[: self._size]
        return Centers(rows[:, :2], rows[:, 2], rows[:, 3])

    def copy(self) -> CenterTable:
        """The same centers, to be changed on their own."""
        other = CenterTable()
        other._size, other._rows = self._size, self._rows.copy()
        return other

    def append(self, centers: Centers) -> None:
        """Adds centers at the end."""
        begin, end = self._size, self._size + len(centers)
        if end > len(self._rows):
            self._rows = np.pad(self._rows, ((0, max(end, 2 * len(self._rows)) - len(self._rows)), (0, 0)))
        self._rows[begin:end, :2] = centers.places_m
        self._rows[begin:end, 2] = centers.depths_m
        self._rows[begin:end, 3] = centers.noise_std_m
        self._size = end

    def move(self, number: int, place_m: Array, depth_m: float, noise_std_m: float) -> None:
        """Gives center `number` a new place (2,), depth and noise."""
        self._rows[number] = (*place_m, depth_m, noise_std_m)

    def truncate(self, size: int) -> None:
        """Forgets all centers from number `size` on."""
        self._size = min(self._size, size)
