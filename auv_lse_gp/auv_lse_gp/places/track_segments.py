"""Averages soundings along segments of track, for terrain matching.

The kernel centers are unsuitable: their minimum spacing drops soundings where tracks cross.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Length of a segment (m).
SEGMENT_M = 10.0
#: Approximate maximum number of segments; longer tracks get longer segments.
MAX_SEGMENTS = 400
#: Largest length of a segment (m). Over longer ones, the mean depth is not the depth at the mean place. Of still longer
#: tracks, every second, fourth... segment is kept: the ground between them is correlated.
MAX_SEGMENT_M = 30.0


@dataclass(frozen=True, slots=True)
class TrackSegments:
    """Segments of all tracks.

    Attributes:
        vehicles: Number of the vehicle (n,).
        stamps_s: Mean times (n,).
        raw_m: Mean raw positions (n, 2).
        depths_m: Mean depths (n,).
    """

    vehicles: NDArray[np.int64]
    stamps_s: Array
    raw_m: Array
    depths_m: Array

    def __len__(self) -> int:
        """Number of segments."""
        return len(self.depths_m)


def segment_track(
    vehicles: NDArray[np.int64], stamps_s: Array, raw_m: Array, depths_m: Array, most: int = MAX_SEGMENTS
) -> TrackSegments:
    """Averages soundings (n) of several vehicles, in any order; rows that are not finite are dropped.

    Args:
        vehicles: Number of the vehicle (n,).
        stamps_s: Times (n,).
        raw_m: Raw positions (n, 2).
        depths_m: Depths (n,).
        most: Approximate maximum number of segments.
    """
    rows = np.column_stack([vehicles, stamps_s, raw_m, depths_m])
    rows = rows[np.isfinite(rows).all(axis=1)]
    rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
    if not len(rows):
        return TrackSegments(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 2)), np.zeros(0))
    way = np.diff(rows[:, 2:4], axis=0)
    step = np.sqrt(np.einsum("nd,nd->n", way, way))
    other = np.diff(rows[:, 0]) != 0.0
    distance = np.concatenate([[0.0], np.cumsum(np.where(other, 0.0, step))])
    length = max(SEGMENT_M, float(distance[-1]) / most)
    stride = 1
    if length > MAX_SEGMENT_M:
        stride, length = 2 ** math.ceil(math.log2(length / MAX_SEGMENT_M)), MAX_SEGMENT_M
    begins = np.concatenate([[0.0], np.where(other, distance[1:], 0.0)])
    segment = np.floor((distance - np.maximum.accumulate(begins)) / length)
    # A segment also ends where another vehicle's soundings begin, and at a gap longer than its length.
    ends = other | (np.diff(segment) != 0.0) | (step > length)
    number = np.concatenate([[0], np.cumsum(ends)])
    count = np.bincount(number)
    means = [np.bincount(number, rows[:, c]) / count for c in range(5)]
    kept = segment[np.concatenate([[True], np.diff(number) > 0])] % stride == 0.0
    means = [mean[kept] for mean in means]
    return TrackSegments(np.rint(means[0]).astype(np.int64), means[1], np.column_stack(means[2:4]), means[4])
