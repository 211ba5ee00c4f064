"""Averages soundings along segments of track, for terrain matching.

The kernel centers are unsuitable: their minimum spacing drops soundings where tracks cross.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.support.growing_rows import GrowingRows

#: Length of a segment (m).
SEGMENT_M = 10.0
#: Approximate maximum number of segments; longer tracks get longer segments.
MAX_SEGMENTS = 400
#: Largest length of a segment (m). Over longer ones, the mean depth is not the depth at the mean position. Of still
#: longer tracks, every second, fourth... segment is kept: the ground between them is correlated.
MAX_SEGMENT_M = 30.0


@dataclass(frozen=True, slots=True)
class TrackSegments:
    """Segments of all tracks.

    Attributes:
        vehicles: Number of the vehicle (n,).
        stamps_s: Mean times (n,).
        raw_m: Mean dead-reckoned positions (n, 2).
        depths_m: Mean depths (n,).
    """

    vehicles: Ints
    stamps_s: Array
    raw_m: Array
    depths_m: Array

    def __len__(self) -> int:
        """Number of segments."""
        return len(self.depths_m)


class SegmentedTrack:
    """One vehicle's soundings by time, averaged along segments of its track.

    Segments that have ended are kept: as long as length and stride stay, only later soundings are averaged.
    """

    def __init__(self) -> None:
        self._rows = GrowingRows(5)  # time, raw north and east, depth, distance along the track
        self._lengths = (0.0, 0)  # length and stride of the kept segments
        self._ended = np.zeros((0, 4))  # means of the segments that have ended
        self._open = 0  # number of the first sounding after them

    @property
    def length_m(self) -> float:
        """Length of the track."""
        return float(self._rows.rows[-1, 4]) if len(self._rows) else 0.0

    def add(self, rows: Array) -> None:
        """Adds soundings: time, raw north and east, depth (n, 4), finite. Fast if they are later than all others."""
        if not len(rows):
            return
        old = self._rows.rows
        if len(old) and rows[:, 0].min() < old[-1, 0]:
            rows = np.concatenate([old[:, :4], rows])
            self._rows, self._lengths = GrowingRows(5), (0.0, 0)
            old = self._rows.rows
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        way = np.diff(np.concatenate([old[-1:, 1:3], rows[:, 1:3]]), axis=0)
        step = np.sqrt(np.einsum("nd,nd->n", way, way))
        distance = np.cumsum(np.concatenate([old[-1:, 4] if len(old) else np.zeros(1), step]))
        self._rows.append(np.column_stack([rows, distance[-len(rows) :]]))

    def segments(self, length_m: float, stride: int) -> Array:
        """Means of time, raw north and east, and depth (k, 4) of each `stride`th segment."""
        if self._lengths != (length_m, stride):
            self._lengths, self._ended, self._open = (length_m, stride), np.zeros((0, 4)), 0
        rows = self._rows.rows[self._open :]
        if not len(rows):
            return self._ended
        segment, way = np.floor(rows[:, 4] / length_m), np.diff(rows[:, 1:3], axis=0)
        # A segment also ends at a gap longer than its length.
        ends = (np.diff(segment) != 0.0) | (np.sqrt(np.einsum("nd,nd->n", way, way)) > length_m)
        begins = np.concatenate([[0], np.flatnonzero(ends) + 1])
        number = np.concatenate([[0], np.cumsum(ends)])
        count = np.bincount(number)
        means = np.stack([np.bincount(number, rows[:, c]) / count for c in range(4)], axis=1)
        kept = segment[begins] % stride == 0.0
        self._ended = np.concatenate([self._ended, means[:-1][kept[:-1]]])
        self._open += int(begins[-1])
        return np.concatenate([self._ended, means[-1:][kept[-1:]]])


def segment_tracks(tracks: Mapping[int, SegmentedTrack], most: int = MAX_SEGMENTS) -> TrackSegments:
    """Segments of the tracks of several vehicles, by number.

    Args:
        most: Approximate maximum number of segments.
    """
    length, stride = max(SEGMENT_M, sum(track.length_m for track in tracks.values()) / most), 1
    if length > MAX_SEGMENT_M:
        stride, length = 2 ** math.ceil(math.log2(length / MAX_SEGMENT_M)), MAX_SEGMENT_M
    parts = {number: tracks[number].segments(length, stride) for number in sorted(tracks)}
    means = np.concatenate([np.zeros((0, 4)), *parts.values()])
    vehicles = np.repeat(np.array(list(parts), dtype=np.int64), [len(part) for part in parts.values()])
    return TrackSegments(vehicles, means[:, 0], means[:, 1:3], means[:, 3])


def segment_track(
    vehicles: Ints, stamps_s: Array, raw_m: Array, depths_m: Array, most: int = MAX_SEGMENTS
) -> TrackSegments:
    """Averages soundings (n) of several vehicles, in any order; rows that are not finite are dropped.

    Args:
        vehicles: Number of the vehicle (n,).
        stamps_s: Times (n,).
        raw_m: Dead-reckoned positions (n, 2).
        depths_m: Depths (n,).
        most: Approximate maximum number of segments.
    """
    tracks: dict[int, SegmentedTrack] = {}
    add_to_tracks(tracks, vehicles, np.column_stack([stamps_s, raw_m, depths_m]))
    return segment_tracks(tracks, most)


def add_to_tracks(tracks: dict[int, SegmentedTrack], vehicles: Ints, rows: Array) -> None:
    """Adds soundings of several vehicles: time, raw north and east, depth (n, 4); those not finite are dropped."""
    finite = np.isfinite(rows).all(axis=1)
    for number in np.unique(vehicles[finite]).tolist():
        tracks.setdefault(number, SegmentedTrack()).add(rows[finite & (vehicles == number)])
