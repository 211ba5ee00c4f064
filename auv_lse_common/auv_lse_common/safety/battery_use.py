"""How far the battery lasts, learned from the charge that the autopilot reports. No ROS, no clock.

Theory of operation
-------------------
The way is counted in stretches of `STRETCH_M`. `take` gets the charge with the way travelled; of each stretch the
median counts. What a stretch costs is the median slope between all pairs of stretches (Theil-Sen), over the whole
mission or over the last `RECENT`, whichever is more: with a rising head current, or with old cells, the charge falls
ever faster. A reading that jumps for one or two stretches changes neither this nor `charge`, the median of the last
`SMOOTHED` stretches moved on by what they have cost since.

The way home may lead against the current: its stretches count with a high quantile of the averages over `WINDOW`
stretches so far. The spread of the stretches and the step of the reading make the sum uncertain; `CAUTION` standard
deviations are added. Fewer than `LEAST` stretches, or no readings, predict nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Length of a stretch (m).
STRETCH_M = 25.0
#: Stretches before anything is predicted, of the recent past, and whose median is the present charge.
LEAST, RECENT, SMOOTHED = 12, 12, 9
#: Stretches over which the cost of the way home is averaged, and the quantile of the averages that it may reach.
WINDOW, HOME_QUANTILE = 6, 0.95
#: Standard deviations that are kept in reserve, and the step of a reading in whole percent.
CAUTION, STEP = 3.0, 0.01
#: The spread of the stretches is measured over this many.
APART = 4
#: A stretch costs at least this much of the charge.
LEAST_COST = 1e-5
#: Number of stretches, and of readings of one, that are remembered.
MOST = 400
#: A vehicle that stays this many times longer than usual on a stretch uses its battery without travelling.
LONG = 4


class BatteryUse:
    """The charge of one vehicle's battery over its way.

    Attributes:
        reserve: Charge (0 to 1) that must be left.
    """

    def __init__(self, reserve: float) -> None:
        """Starts without readings."""
        self.reserve = reserve
        self._stretches: list[tuple[int, float]] = []  # number of a stretch, median charge on it
        self._counts: list[int] = []  # readings on each
        self._readings: list[float] = []  # on the present one
        self._now = -1
        self._cost = self._home_cost = self._spread = math.nan  # of a stretch, as a share of the full charge

    def take(self, charge: float, way_m: float) -> None:
        """Takes a charge (0 to 1; NaN: unknown) after a way (m)."""
        stretch = int(way_m / STRETCH_M)
        if not 0.0 <= charge <= 1.0 or stretch < self._now:
            return
        if stretch > self._now:
            self._finish_stretch()
            self._now = stretch
        self._readings.append(charge)
        del self._readings[:-MOST]

    @property
    def is_known(self) -> bool:
        """Whether enough has been travelled with readings."""
        return len(self._stretches) >= LEAST

    @property
    def charge(self) -> float:
        """The present charge, smoothed; NaN while unknown."""
        if not self.is_known:
            return math.nan
        moved_on = (charge - self._cost * (self._now - number) for number, charge in self._stretches[-SMOOTHED:])
        smoothed = median(moved_on)
        if len(self._readings) <= LONG * median(self._counts):
            return smoothed
        return min(smoothed, median(self._readings[-len(self._readings) // LONG :]))

    def needed(self, way_m: float, home_m: float) -> float:
        """Charge that a further way (m) and the way home (m) take at most, with the reserve; NaN while unknown."""
        if not self.is_known:
            return math.nan
        more, home = way_m / STRETCH_M, home_m / STRETCH_M
        total, span = more + home, self._stretches[-1][0] - self._stretches[0][0]
        of_cost = math.hypot(self._spread / len(self._stretches), 0.7 * STEP / span)
        of_stretches = math.hypot(self._spread * math.sqrt(total), 0.5 * STEP)
        expected = self.reserve + more * self._cost + home * self._home_cost
        return expected + CAUTION * math.hypot(total * of_cost, of_stretches)

    def must_turn(self, home_m: float) -> bool:
        """Whether a further stretch and the way home (m) would take more than there is; False while unknown."""
        return self.is_known and self.charge < self.needed(STRETCH_M, home_m)

    def left_m(self, home_m: float) -> float:
        """Way (m) that the battery lasts before the way home (m); NaN while unknown, at least 0."""
        if not self.is_known:
            return math.nan
        charge, low, high = self.charge, 0, 1 << 16
        while low < high:
            middle = (low + high + 1) // 2
            low, high = (middle, high) if self.needed(middle * STRETCH_M, home_m) <= charge else (low, middle - 1)
        return low * STRETCH_M

    def _finish_stretch(self) -> None:
        if not self._readings:
            return
        self._stretches.append((self._now, median(self._readings)))
        self._counts.append(len(self._readings))
        del self._stretches[:-MOST], self._counts[:-MOST]
        self._readings = []
        if not self.is_known:
            return
        recent = self._stretches[-RECENT:] if len(self._stretches) >= 2 * RECENT else self._stretches
        self._cost = max(_slope(self._stretches), _slope(recent))
        known = self._stretches[-4 * RECENT :]
        # over several stretches, which makes the step of the reading matter less
        pairs = zip(known[:-APART], known[APART:], strict=True)
        off = [abs(one - other - (b - a) * self._cost) / math.sqrt(b - a) for (a, one), (b, other) in pairs]
        self._spread = 1.4826 * median(off)
        self._home_cost = max(self._cost, self._highest_average())

    def _highest_average(self) -> float:
        """High quantile of what a stretch has cost over `WINDOW` of them; jumps of one or two are left out."""
        numbers, charges = np.array(self._stretches[-8 * WINDOW :], dtype=float).T
        charges = np.median(np.lib.stride_tricks.sliding_window_view(charges, 5), axis=1)
        numbers = numbers[2:-2]
        if len(charges) <= WINDOW:
            return 0.0
        averages = (charges[:-WINDOW] - charges[WINDOW:]) / (numbers[WINDOW:] - numbers[:-WINDOW])
        return float(np.quantile(averages, HOME_QUANTILE))


def _slope(points: Sequence[tuple[int, float]]) -> float:
    """Median fall of the charge per stretch over all pairs of points."""
    numbers, charges = np.array(points[:: len(points) // 60 + 1], dtype=float).T
    first, second = np.triu_indices(len(numbers), 1)
    falls = (charges[first] - charges[second]) / (numbers[second] - numbers[first])
    return max(float(np.median(falls)), LEAST_COST)
