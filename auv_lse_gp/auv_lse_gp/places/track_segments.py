"""Soundings along tracks, gathered into pieces: what the terrain compares, wherever the map keeps its centers.

The map's own spacing rule drops a sounding that is near another one, and so drops exactly the crossings of tracks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Length of a piece of track (m).
SEGMENT_M = 10.0
#: TrackSegments that the terrain compares, at most, or little more; with more track they are longer.
MAX_SEGMENTS = 400


@dataclass(frozen=True, slots=True)
class TrackSegments:
    """TrackSegments of all tracks.

    Attributes:
        vehicles: Number of the vehicle that sounded (n,).
        stamps_s: Mean times (n,).
        raw_m: Mean raw places (n, 2).
        depths_m: Mean depths (n,).
    """

    vehicles: NDArray[np.int64]
    stamps_s: Array
    raw_m: Array
    depths_m: Array

    def __len__(self) -> int:
        """Number of pieces."""
        return len(self.depths_m)


def segment_track(
    vehicles: NDArray[np.int64], stamps_s: Array, raw_m: Array, depths_m: Array, most: int = MAX_SEGMENTS
) -> TrackSegments:
    """Gathers soundings (n) of several vehicles, in any order; one with a number that is not finite is left out.

    Args:
        vehicles: Number of the vehicle that took each (n,).
        stamps_s: When (n,).
        raw_m: Raw places (n, 2).
        depths_m: Depths (n,).
        most: So many pieces at most, or little more.
    """
    rows = np.column_stack([vehicles, stamps_s, raw_m, depths_m])
    rows = rows[np.isfinite(rows).all(axis=1)]
    rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
    if not len(rows):
        return TrackSegments(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 2)), np.zeros(0))
    way = np.diff(rows[:, 2:4], axis=0)
    step = np.sqrt(np.einsum("nd,nd->n", way, way))
    other = np.diff(rows[:, 0]) != 0.0
    gone = np.concatenate([[0.0], np.cumsum(np.where(other, 0.0, step))])
    length = max(SEGMENT_M, float(gone[-1]) / most)
    begins = np.concatenate([[0.0], np.where(other, gone[1:], 0.0)])
    piece = np.floor((gone - np.maximum.accumulate(begins)) / length)
    # A piece ends where the next begins, where another vehicle's soundings begin, and at a gap longer than it.
    ends = other | (np.diff(piece) != 0.0) | (step > length)
    number = np.concatenate([[0], np.cumsum(ends)])
    count = np.bincount(number)
    means = [np.bincount(number, rows[:, c]) / count for c in range(5)]
    return TrackSegments(np.rint(means[0]).astype(np.int64), means[1], np.column_stack(means[2:4]), means[4])
