"""Thins soundings in which some ground has far more of them than the rest, as where a boat lay at anchor."""

import numpy as np

from auv_lse_common.support.arrays import Array, Ints

#: Of soundings in a square cell one counts: a share of the survey's extent, at most the accuracy (m) of its positions.
_SHARE, _LARGEST_CELL_M = 0.005, 1.5


def one_of_each_cell(positions_m: Array, cell_m: float) -> Ints:
    """Numbers of the first position (n, 2) in each square cell that has any."""
    cells = np.floor(positions_m / cell_m).astype(np.int64)
    cells -= cells.min(axis=0)
    first: Ints = np.unique(cells[:, 0] * (int(cells[:, 1].max()) + 1) + cells[:, 1], return_index=True)[1]
    return first


def soundings_to_fit(points_m: Array, most: int, seed: int = 0) -> tuple[Array, int]:
    """At most `most` soundings (n, 3), drawn at random, none of them near another; and how many lie apart.

    A boat that rests for an hour at its pier would otherwise decide length scale and noise alone.
    """
    extent_m = float(np.ptp(points_m[:, :2], axis=0).max()) if len(points_m) else 0.0
    cell_m = min(_SHARE * extent_m, _LARGEST_CELL_M)
    apart = points_m[np.sort(one_of_each_cell(points_m[:, :2], cell_m))] if cell_m > 0.0 else points_m
    return apart[np.random.default_rng(seed).permutation(len(apart))[:most]], len(apart)
