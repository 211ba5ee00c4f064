"""Every sounding that a vehicle knows, where it was booked, and how to book it anew."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auv_lse_gp.places.correction import Correction
from auv_lse_gp.places.track_segments import MAX_SEGMENTS, TrackSegments, segment_track

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]


class SoundingLog:
    """Soundings and samples, in the order in which they came.

    A sounding whose raw place or time is not known (NaN) stays where it was told.
    """

    def __init__(self) -> None:
        """Nothing is booked yet."""
        self._rows = np.zeros((256, 7))  # vehicle, stamp, raw north and east, booked north and east, depth
        self._size = 0

    def __len__(self) -> int:
        """Number of soundings."""
        return self._size

    @property
    def vehicles(self) -> Numbers:
        """Number of the vehicle that took each (n,)."""
        return np.asarray(self._rows[: self._size, 0].astype(np.int64))

    @property
    def stamps_s(self) -> Array:
        """When (n,); NaN if unknown."""
        return self._rows[: self._size, 1]

    @property
    def raw_m(self) -> Array:
        """Raw places (n, 2); NaN if unknown."""
        return self._rows[: self._size, 2:4]

    @property
    def mapped_m(self) -> Array:
        """Places (n, 2) where they are booked."""
        return self._rows[: self._size, 4:6]

    @property
    def depths_m(self) -> Array:
        """Depths (n,)."""
        return self._rows[: self._size, 6]

    def add(
        self, vehicle: int, stamps_s: Array, raw_m: Array, told_m: Array, depths_m: Array, correction: Correction | None
    ) -> Array:
        """Books soundings (n) of a vehicle; returns where (n, 2).

        Args:
            vehicle: Number of the vehicle.
            stamps_s: When (n,).
            raw_m: Raw places (n, 2).
            told_m: Places (n, 2) to book them at where the raw ones are not known.
            depths_m: Depths (n,).
            correction: What is known of places; None: nothing yet.
        """
        end = self._size + len(depths_m)
        while end > len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        rows = self._rows[self._size : end]
        rows[:, 0], rows[:, 1], rows[:, 2:4], rows[:, 6] = vehicle, stamps_s, raw_m, depths_m
        rows[:, 4:6] = np.where(np.isfinite(raw_m), raw_m, told_m)
        known = np.isfinite(rows[:, 1:4]).all(axis=1)
        if correction is not None and known.any():
            rows[known, 4:6] = correction.places(vehicle, rows[known, 1], rows[known, 2:4])
        self._size = end
        return rows[:, 4:6].copy()

    def corrected_m(self, correction: Correction) -> Array:
        """Where the soundings belong (n, 2) by a correction."""
        places = self.mapped_m.copy()
        for number, rows in self._by_vehicle():
            places[rows] = correction.places(number, self.stamps_s[rows], self.raw_m[rows])
        return places

    def set_mapped(self, places_m: Array) -> None:
        """Books all soundings at other places (n, 2)."""
        self._rows[: self._size, 4:6] = places_m

    def derivatives(self, correction: Correction, slopes: Array, index: Numbers) -> Array:
        """What each unknown changes of the depth that soundings (m,) should have measured, (m, unknowns).

        Args:
            correction: The places.
            slopes: Slope of the ground at these soundings (m, 2).
            index: Which soundings (m,).
        """
        rows = np.zeros((len(index), len(correction.theta)))
        known = np.isfinite(self._rows[index, 1:4]).all(axis=1)
        for number in np.unique(self._rows[index, 0]).astype(int):
            own = np.flatnonzero(known & (self._rows[index, 0] == number))
            jacobian = correction.jacobian(int(number), self.stamps_s[index[own]], self.raw_m[index[own]])
            rows[own] = np.einsum("nd,ndu->nu", slopes[own], jacobian)
        return rows

    def segments(self, most: int = MAX_SEGMENTS) -> TrackSegments:
        """The soundings whose places can be corrected, in pieces of track: `most` at most, or little more."""
        return segment_track(self.vehicles, self.stamps_s, self.raw_m, self.depths_m, most)

    def _by_vehicle(self) -> list[tuple[int, Numbers]]:
        """The soundings of each vehicle that can be corrected."""
        known = np.isfinite(self._rows[: self._size, 1:4]).all(axis=1)
        numbers = self.vehicles
        return [(int(k), np.flatnonzero(known & (numbers == k))) for k in np.unique(numbers[known])]
