"""Values that stand for missing data in grids and tables of depths."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from auv_lse_common.support.arrays import Array, Mask

#: Values that commonly mark missing data, with either sign.
NO_DATA = (9999.0, 99999.0, 32767.0, 32768.0)
#: Values that often do, but may be depths: see `fill_values`.
OFTEN_NO_DATA = (99.0, 99.9, 99.99, 999.0, 999.9, 999.99)
#: Multiples of the others' span by which missing data are apart from them: in grids and tables, where a basin may have
#: one depth, and in logs, where the depth of a moving vehicle does not repeat. At least this span (m) counts.
APART_IN_GRIDS, APART_IN_LOGS, _LEAST_SPAN_M = 20.0, 3.0, 1.0
#: A value marks missing data if it is at least this share of all values, or repeated this often. For those of
#: `OFTEN_NO_DATA`, the distance from the others as a multiple of their span, and the least number of other values.
_FILL_SHARE, _FILL_COUNT, _APART_OFTEN, _OTHERS = 0.005, 4, 0.1, 5
#: Values from which the span of the others is found.
_SAMPLED = 100_000


def is_no_data(values: ArrayLike) -> Mask:
    """Mask of the values that usually mark missing data."""
    return np.isin(np.abs(values), NO_DATA)


def fill_values(
    values: ArrayLike, often: Sequence[float] = OFTEN_NO_DATA, apart: float = APART_IN_GRIDS
) -> list[float]:
    """Values that mark missing data by how they occur: the least or the largest, repeated, and far from all others.

    Args:
        values: Depths or elevations, any shape; those that are not finite do not count.
        often: Absolute values that need less distance, because they often mark missing data.
        apart: Multiple of the others' span by which missing data are apart from them.
    """
    known = np.asarray(values, dtype=float)
    known, found = known[np.isfinite(known)], list[float]()
    while len(known):
        for mark in (float(known.max()), float(known.min())):
            others = known[known != mark]
            is_usual = np.isclose(abs(mark), often, 1e-6).any()
            if _is_fill(mark, len(known) - len(others), others, _APART_OFTEN if is_usual else apart):
                found.append(mark)
                known = others
                break
        else:
            break
    return found


def _is_fill(mark: float, count: int, others: Array, apart: float) -> bool:
    """Whether a value that occurs `count` times beside the others, all on one side of it, marks missing data."""
    if count < max(_FILL_COUNT, _FILL_SHARE * (count + len(others))) or not len(others):
        return False
    sample = others[:: len(others) // _SAMPLED + 1]
    if len(np.unique(sample)) < _OTHERS:
        return False
    low, high = np.quantile(sample, (0.01, 0.99))
    gap = max(mark - others.max(), others.min() - mark)
    return bool(gap > apart * max(float(high - low), _LEAST_SPAN_M))
