"""All soundings of a vehicle, with their positions in its map."""

from collections.abc import Iterator

import numpy as np

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.support.growing_rows import GrowingRows
from auv_lse_common.vocabulary.frames import FARTHEST_M
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_gp.positions.correction import Correction
from auv_lse_gp.positions.track_segments import (
    MAX_SEGMENTS,
    SegmentedTrack,
    TrackSegments,
    add_to_tracks,
    segment_tracks,
)


class SoundingLog:
    """Soundings and samples, in order of arrival.

    A sounding whose dead-reckoned position or time is unknown (NaN) stays at its estimated position, and so does one
    whose dead-reckoned position is impossible.
    """

    def __init__(self) -> None:
        # vehicle, stamp, raw north and east, mapped north and east, depth, packet
        self._table = GrowingRows(8, 256)
        self._tracks: dict[int, SegmentedTrack] = {}
        self._segmented = 0  # number of soundings in `_tracks`

    def __len__(self) -> int:
        """Number of soundings."""
        return len(self._table)

    @property
    def vehicles(self) -> Ints:
        """Number of the vehicle that measured each (n,)."""
        return np.asarray(self._table.rows[:, 0].astype(np.int64))

    @property
    def stamps_s(self) -> Array:
        """Times (n,); NaN if unknown."""
        return self._table.rows[:, 1]

    @property
    def raw_m(self) -> Array:
        """Dead-reckoned positions (n, 2); NaN if unknown."""
        return self._table.rows[:, 2:4]

    @property
    def mapped_m(self) -> Array:
        """Positions (n, 2) in the map."""
        return self._table.rows[:, 4:6]

    @property
    def depths_m(self) -> Array:
        """Depths (n,)."""
        return self._table.rows[:, 6]

    @property
    def packets(self) -> Ints:
        """Number of the packet of each (n,), in order of arrival; this vehicle's have that of the last packet."""
        return np.asarray(self._table.rows[:, 7].astype(np.int64))

    def add(self, vehicle: int, soundings: Soundings, correction: Correction | None, is_packet: bool = False) -> Array:
        """Adds soundings (n) of one vehicle; returns their positions in the map (n, 2).

        Args:
            soundings: The soundings; the estimated position is used where the raw one is unknown.
            correction: The current correction; None before the first.
            is_packet: Whether they are the samples of a packet.
        """
        raw = soundings.raw_positions_m
        raw = np.where((np.abs(raw) <= FARTHEST_M).all(axis=1, keepdims=True), raw, np.nan)
        mapped = np.where(np.isfinite(raw), raw, soundings.locations_m)
        known = np.isfinite(soundings.stamp_s) & np.isfinite(raw).all(axis=1)
        if correction is not None and known.any():
            mapped[known] = correction.positions(vehicle, soundings.stamp_s[known], raw[known])
        number, packet = np.full(len(soundings), vehicle), self._table.rows[-1:, 7].max(initial=0.0) + is_packet
        packets = np.full(len(soundings), packet)
        self._table.append(np.column_stack([number, soundings.stamp_s, raw, mapped, soundings.depth_m, packets]))
        return mapped

    def corrected_m(self, correction: Correction, index: Ints | None = None) -> Array:
        """Positions (m, 2) according to a correction, of the soundings with numbers `index` (m,); None: of all."""
        index = np.arange(len(self)) if index is None else index
        positions = self.mapped_m[index]
        for number, own in self.by_vehicle(index):
            positions[own] = correction.positions(number, self.stamps_s[index[own]], self.raw_m[index[own]])
        return positions

    def set_mapped(self, locations_m: Array, index: Ints | None = None) -> None:
        """Moves the soundings with numbers `index` (m,) to positions (m, 2); None: all."""
        self.mapped_m[slice(None) if index is None else index] = locations_m

    def by_vehicle(self, index: Ints) -> Iterator[tuple[int, Ints]]:
        """Each vehicle's number, and which of the soundings `index` are its own and correctable."""
        rows = self._table.rows[index, :4]
        numbers, known = rows[:, 0].astype(np.int64), np.isfinite(rows[:, 1:]).all(axis=1)
        for number in np.unique(numbers[known]).tolist():
            yield number, np.flatnonzero(known & (numbers == number))

    def segments(self, most: int = MAX_SEGMENTS) -> TrackSegments:
        """The correctable soundings, averaged along about `most` segments of track at most."""
        new = self._table.rows[self._segmented :]
        add_to_tracks(self._tracks, new[:, 0].astype(np.int64), new[:, [1, 2, 3, 6]])
        self._segmented = len(self)
        return segment_tracks(self._tracks, most)
