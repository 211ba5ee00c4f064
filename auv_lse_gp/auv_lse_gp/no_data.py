"""Values that stand for missing data in grids and tables of depths."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: Values that commonly mark missing data, with either sign.
NO_DATA = (9999.0, 99999.0, 32767.0, 32768.0)
#: Values that often do, but may be depths: see `fill_values`.
OFTEN_NO_DATA = (99.0, 99.9, 99.99, 999.0, 999.9, 999.99)
#: Missing data repeat one value at this share of all, or so often, apart from the others by this multiple of their
#: span; the second holds for the values of `OFTEN_NO_DATA`. The others have so many values.
_FILL_SHARE, _FILL_COUNT, _APART, _APART_OFTEN, _OTHERS = 0.005, 4, 3.0, 0.1, 5
#: Values from which the span of the others is found.
_SAMPLED = 100_000


def is_no_data(values: ArrayLike) -> NDArray[np.bool_]:
    """Mask of the values that usually mark missing data."""
    return np.isin(np.abs(values), NO_DATA)


def fill_values(values: ArrayLike, often: Sequence[float] = OFTEN_NO_DATA) -> list[float]:
    """Values that mark missing data by how they occur: the least or the largest, repeated, and far from all others.

    Args:
        values: Depths or elevations, any shape; those that are not finite do not count.
        often: Absolute values that need less distance, because they often mark missing data.
    """
    known = np.asarray(values, dtype=float)
    known, found = known[np.isfinite(known)], list[float]()
    while len(known):
        for mark in (float(known.max()), float(known.min())):
            others = known[known != mark]
            if _is_fill(mark, len(known) - len(others), others, often):
                found.append(mark)
                known = others
                break
        else:
            break
    return found


def _is_fill(mark: float, count: int, others: Array, often: Sequence[float]) -> bool:
    """Whether a value that occurs `count` times beside the others, all on one side of it, marks missing data."""
    if count < max(_FILL_COUNT, _FILL_SHARE * (count + len(others))) or not len(others):
        return False
    sample = others[:: len(others) // _SAMPLED + 1]
    if len(np.unique(sample)) < _OTHERS:
        return False
    low, high = np.quantile(sample, (0.01, 0.99))
    gap = max(mark - others.max(), others.min() - mark)
    return bool(gap > (_APART_OFTEN if np.isclose(abs(mark), often, 1e-6).any() else _APART) * (high - low))
