"""Pings become soundings: the rule that the simulated vehicle and the real vehicle's link share.

A ping is the height over ground at a moment. The vehicle's depth is added to it, and its estimated place: stamp (s),
north and east (m), depth of water (m, positive down), one row (4,), or (6,) with its raw north and east (m) behind,
dead-reckoned without any fix. A ping without an echo gives no row. Time is cut
into periods of `every_s`, counted from 0 s; the pings of a period give one sounding, at their mean time and place, of
their median depth, so that a wrong echo does no harm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def period_of(stamp_s: ArrayLike, every_s: float) -> Array:
    """Number of the period that a time (s) lies in, any shape: period n is ((n - 1) every_s, n every_s]."""
    return np.ceil(np.asarray(stamp_s, float) / every_s - 1e-6)


def by_period(pings: Array, every_s: float) -> list[Array]:
    """Pings (n, 4 or 6) in order of time, cut into those of each period: arrays of k > 0 rows."""
    if not len(pings):
        return []
    periods = period_of(pings[:, 0], every_s)
    return np.split(pings, np.flatnonzero(periods[1:] != periods[:-1]) + 1)


def sounding_of(pings: Array) -> Array:
    """The sounding (4 or 6,) of a period's pings (n, 4 or 6), n > 0: means, but of the depth the median."""
    count = len(pings)
    sounding: Array = pings.sum(axis=0) / count
    depths = np.sort(pings[:, 3])
    sounding[3] = 0.5 * (depths[(count - 1) // 2] + depths[count // 2])
    return sounding
