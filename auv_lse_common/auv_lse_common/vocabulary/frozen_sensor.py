"""Detects a frozen sensor: one that repeats its value to the last digit while the vehicle moves.

The sensor's resolution is estimated as the smallest difference of two consecutive values, initially `COARSEST_M`. A
repeated value is plausible as long as a sensor of that resolution can repeat itself.
"""

import math

import numpy as np

from auv_lse_common.support.arrays import Array, Mask

#: A frozen sensor repeats its value more often than this, while the vehicle moves at least this far (m).
REPEATS = 10
MOVED_M = 5.0
#: The coarsest resolution (m) of a working sensor.
COARSEST_M = 0.1


class FrozenSensor:
    """The values (m) of one sensor, in order of time.

    Attributes:
        moved_m: Distance (m) the vehicle has moved since the current value first arrived.
        has_varied: Whether two different values have arrived.
    """

    def __init__(self, flattest: float, least_m: float = MOVED_M) -> None:
        """Starts without a value.

        Args:
            flattest: Least change of the measured quantity (m per m travelled).
            least_m: Distance (m) the vehicle has to move in any case.
        """
        self.moved_m = 0.0
        self.has_varied = False
        self._flattest, self._least_m = flattest, least_m
        self._first: tuple[float, float, float] | None = None  # the value, and north, east (m) where it first arrived
        self._repeats = 0
        self._step_m = COARSEST_M

    def update(self, value_m: float, north_m: float, east_m: float) -> bool:
        """Adds a value and the vehicle's position; returns whether the sensor is frozen."""
        if self._first is None or value_m != self._first[0]:
            if self._first is not None:
                self.has_varied = True
                self._step_m = min(self._step_m, abs(value_m - self._first[0]))
            self._first, self._repeats, self.moved_m = (value_m, north_m, east_m), 0, 0.0
            return False
        self._repeats += 1
        self.moved_m = math.hypot(north_m - self._first[1], east_m - self._first[2])
        return self._repeats > REPEATS and self.moved_m > max(self._least_m, self._step_m / self._flattest)


def frozen_values(
    values_m: Array,
    north_m: Array,
    east_m: Array,
    flattest: float,
) -> Mask:
    """The results of a new `FrozenSensor` for many values, shape (n,) each, computed together.

    Raises:
        ValueError: if the arrays differ in length.
    """
    changes = np.diff(values_m)
    is_new = np.append(True, changes != 0.0)[: len(values_m)]
    starts = np.flatnonzero(is_new)
    first = starts[np.cumsum(is_new) - 1]
    steps_m = np.append(COARSEST_M, np.where(changes != 0.0, np.abs(changes), np.inf))[: len(values_m)]
    moved_m = np.hypot(north_m - north_m[first], east_m - east_m[first])
    far_m = np.maximum(MOVED_M, np.minimum.accumulate(steps_m) / flattest)
    frozen: Mask = (np.arange(len(values_m)) - first > REPEATS) & (moved_m > far_m)
    return frozen
