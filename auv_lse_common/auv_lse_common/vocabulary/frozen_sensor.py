"""A sensor that hangs: the same value to the last digit, again and again, while the vehicle moves on.

How fine the sensor's steps are shows in the smallest difference of two values in a row; until there is one they count
as `COARSEST_M`. A value that repeats itself is believed as far as honest steps of that size can last.
"""

from __future__ import annotations

import math

#: A value that comes this often in a row, while the vehicle moves as far (m) at least, may be a sensor's that hangs.
REPEATS = 10
MOVED_M = 5.0
#: The coarsest steps (m) of an honest sensor.
COARSEST_M = 0.1


class HangingSensor:
    """The values (m) of one sensor, in the order in which they come.

    Attributes:
        moved_m: How far (m) the vehicle has moved since the present value came first.
        has_varied: Whether there have been two different values.
    """

    def __init__(self, flattest: float, least_m: float = MOVED_M) -> None:
        """Knows no value.

        Args:
            flattest: What is measured changes by this much (m per m of way) at least.
            least_m: So far (m) the vehicle has to move at least, however fine the sensor is.
        """
        self.moved_m = 0.0
        self.has_varied = False
        self._flattest, self._least_m = flattest, least_m
        self._first: tuple[float, float, float] | None = None  # the value, and north, east (m) where it came first
        self._repeats = 0
        self._step_m = COARSEST_M

    def hangs(self, value_m: float, north_m: float, east_m: float) -> bool:
        """Takes a value, and where the vehicle is; returns whether the sensor hangs."""
        if self._first is None or value_m != self._first[0]:
            if self._first is not None:
                self.has_varied = True
                self._step_m = min(self._step_m, abs(value_m - self._first[0]))
            self._first, self._repeats, self.moved_m = (value_m, north_m, east_m), 0, 0.0
            return False
        self._repeats += 1
        self.moved_m = math.hypot(north_m - self._first[1], east_m - self._first[2])
        return self._repeats > REPEATS and self.moved_m > max(self._least_m, self._step_m / self._flattest)
