"""Combines pings into soundings, for simulated and real vehicles.

A ping is a row of stamp (s), north, east (m) and water depth (m, positive down), optionally followed by the raw north
and east (m). Pings without an echo have no row. The pings of each period of `every_s` (from 0 s) give one sounding:
their mean time and position, and their median depth, which is robust against wrong echoes.
"""

import numpy as np
from numpy.typing import ArrayLike

from auv_lse_common.support.arrays import Array


def period_of(stamp_s: ArrayLike, every_s: float) -> Array:
    """Number of the period of a time (s) of any shape: period n is ((n - 1) every_s, n every_s]."""
    return np.ceil(np.asarray(stamp_s, float) / every_s - 1e-6)


def by_period(pings: Array, every_s: float) -> list[Array]:
    """Pings (n, 4 or 6) in order of time, split by period into arrays of at least one row."""
    if not len(pings):
        return []
    periods = period_of(pings[:, 0], every_s)
    return np.split(pings, np.flatnonzero(periods[1:] != periods[:-1]) + 1)


def sounding_of(pings: Array) -> Array:
    """The sounding (4 or 6,) of a period's pings (n, 4 or 6), n > 0: the median depth, and means of the rest."""
    count = len(pings)
    sounding: Array = pings.sum(axis=0) / count
    depths = np.sort(pings[:, 3])
    sounding[3] = 0.5 * depths[(count - 1) // 2] + 0.5 * depths[count // 2]
    return sounding
