"""All soundings of a vehicle, with their positions in its map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support.growing_rows import GrowingRows
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_gp.places.correction import Correction
from auv_lse_gp.places.track_segments import MAX_SEGMENTS, TrackSegments, segment_track

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]


class SoundingLog:
    """Soundings and samples, in order of arrival.

    A sounding whose raw position or time is unknown (NaN) stays at its estimated position.
    """

    def __init__(self) -> None:
        self._table = GrowingRows(7, 256)  # vehicle, stamp, raw north and east, mapped north and east, depth

    def __len__(self) -> int:
        """Number of soundings."""
        return len(self._table)

    @property
    def vehicles(self) -> Numbers:
        """Number of the vehicle that measured each (n,)."""
        return np.asarray(self._table.rows[:, 0].astype(np.int64))

    @property
    def stamps_s(self) -> Array:
        """Times (n,); NaN if unknown."""
        return self._table.rows[:, 1]

    @property
    def raw_m(self) -> Array:
        """Raw positions (n, 2); NaN if unknown."""
        return self._table.rows[:, 2:4]

    @property
    def mapped_m(self) -> Array:
        """Positions (n, 2) in the map."""
        return self._table.rows[:, 4:6]

    @property
    def depths_m(self) -> Array:
        """Depths (n,)."""
        return self._table.rows[:, 6]

    def add(self, vehicle: int, soundings: Soundings, correction: Correction | None) -> Array:
        """Adds soundings (n) of one vehicle; returns their positions in the map (n, 2).

        Args:
            soundings: The soundings; the estimated position is used where the raw one is unknown.
            correction: The current correction; None before the first.
        """
        raw = soundings.raw_places_m
        mapped = np.where(np.isfinite(raw), raw, soundings.places_m)
        known = np.isfinite(soundings.stamp_s) & np.isfinite(raw).all(axis=1)
        if correction is not None and known.any():
            mapped[known] = correction.places(vehicle, soundings.stamp_s[known], raw[known])
        numbers = np.full(len(soundings), vehicle)
        self._table.append(np.column_stack([numbers, soundings.stamp_s, raw, mapped, soundings.depth_m]))
        return mapped

    def corrected_m(self, correction: Correction) -> Array:
        """Positions (n, 2) of the soundings according to a correction."""
        places, known, numbers = self.mapped_m.copy(), self._correctable, self.vehicles
        for number in np.unique(numbers[known]).tolist():
            rows = np.flatnonzero(known & (numbers == number))
            places[rows] = correction.places(number, self.stamps_s[rows], self.raw_m[rows])
        return places

    def set_mapped(self, places_m: Array) -> None:
        """Moves all soundings to positions (n, 2)."""
        self.mapped_m[:] = places_m

    def derivatives(self, correction: Correction, slopes: Array, index: Numbers) -> Array:
        """Derivatives (m, unknowns) of the expected depths of soundings with respect to the unknowns.

        Args:
            slopes: Slope of the ground at these soundings (m, 2).
            index: Numbers of the soundings (m,).
        """
        rows, numbers, known = np.zeros((len(index), len(correction.theta))), self.vehicles[index], self._correctable
        for number in np.unique(numbers).tolist():
            own = np.flatnonzero(known[index] & (numbers == number))
            jacobian = correction.jacobian(number, self.stamps_s[index[own]], self.raw_m[index[own]])
            rows[own] = np.einsum("nd,ndu->nu", slopes[own], jacobian)
        return rows

    def segments(self, most: int = MAX_SEGMENTS) -> TrackSegments:
        """The correctable soundings, averaged along about `most` segments of track at most."""
        return segment_track(self.vehicles, self.stamps_s, self.raw_m, self.depths_m, most)

    @property
    def _correctable(self) -> NDArray[np.bool_]:
        """Mask (n,) of the soundings whose time and raw position are known."""
        return np.asarray(np.isfinite(self._table.rows[:, 1:4]).all(axis=1))
