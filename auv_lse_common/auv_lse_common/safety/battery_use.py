"""Predicts how far the battery lasts, from the charge that the autopilot reports. No ROS, no clock.

Theory of operation
-------------------
A way of length l with the displacement (n, e) is expected to cost (a l + b n + c e) (1 + g (1 - q)) of the full charge.
In a current, b and c make a way against it cost more and the way back less, whether the vehicle keeps its speed
through the water or over ground. The factor with g models emptying cells: at a lower voltage the same power takes more
current, and old cells sag more. A Kalman filter estimates q, the present charge, with a, b, c, g and their covariance.
It takes the median reading of each stretch of `STRETCH_M`, or of a stay several times as long.

A reading far from the expected charge is ignored, unless `MOST_OUTLIERS` stretches in a row contradict it: then the
covariance is widened until it fits. So a reading that jumps for a stretch or two changes nothing, and a wrong
expectation is relearned. A charge does not rise under way: after its reboot an autopilot may count from a full battery
again. Such readings are ignored for good.

The way home is possible while the charge expected there exceeds the reserve by `CAUTION` standard deviations. These
contain the uncertainty of a, b, c and g, and the scatter of the way home itself.

The filter begins after `LEAST` stretches; after fewer if the distance that a full battery lasts is stated, or was
learned before a restart.
"""

import math
from collections.abc import Mapping
from statistics import median
from typing import Any

import numpy as np

from auv_lse_common.support.arrays import Array

#: Length of a stretch (m).
STRETCH_M = 25.0
#: Stretches before anything is predicted, with and without a stated distance; one reading in four may jump.
LEAST_STATED, LEAST = 5, 10
#: The same after a restart: only the charge is unknown then.
LEAST_LEARNED = 3
#: Standard deviations that are kept in reserve.
CAUTION = 3.0
#: Charge kept beside these: readings in whole percent are wrong by half of it, and the model by as much.
MARGIN = 0.01
#: Readings are in whole percent unless one is off from that by more than this (percent).
WHOLE_TOLERANCE = 1e-3
#: Standard deviation of the cost of one stretch, and of the change of its parameters over one, in mean costs.
SCATTER, CHANGE = 0.16, 0.005
#: Standard deviation of a at first, as a share of itself: stated, learned from the first stretches.
STATED_STD, LEARNED_STD = 0.15, 0.3
#: Standard deviation of b and c at first, as a share of a.
CURRENT_STD = 0.15
#: Mean and standard deviation of g at first.
AGEING, AGEING_STD = 0.15, 0.12
#: Standard deviation of a stretch's median reading, in whole percent and finer; of the charge at first.
READING_STD, FINE_STD, FIRST_STD = 0.0035, 0.001, 0.01
#: Standard deviations beyond which a reading is ignored; number of such readings in a row after which they count, and
#: the factor by which the covariance of all but the charge then grows.
OUTLIER_STD, MOST_OUTLIERS, WIDENING = 4.0, 5, 4.0
#: A reading is a rise if it exceeds the last accepted ones by this much; their number.
RISE, RECENT = 0.05, 20
#: A vehicle that takes this many times longer than usual for a stretch uses its battery without travelling.
LONG_STRETCH = 2.0
#: A stretch costs at least this much of the charge.
LEAST_COST = 1e-5
#: Number of readings of a stretch, and of stretches whose times are remembered.
MAX_READINGS, MAX_TIMES = 400, 60
#: Length (stretches) of the pieces of a forecast, and their largest number.
PIECE, PIECES = 8.0, 8


class BatteryUse:
    """The charge of one vehicle's battery over its way.

    Attributes:
        reserve: Charge (0 to 1) that must be left.
    """

    def __init__(self, reserve: float, lasts_m: float | None = None) -> None:
        """Starts without readings.

        Args:
            lasts_m: Way (m) that a full battery is expected to last; None: it is learned.
        """
        self.reserve = reserve
        self._stated = None if lasts_m is None else STRETCH_M / lasts_m  # of a stretch
        self._readings: list[tuple[float, ...]] = []  # charge, time (s), way, north, east (stretches) on this stretch
        self._first: list[tuple[float, ...]] = []  # medians of the first stretches, until the filter begins
        self._state: Array | None = None  # q, a, b, c, g
        self._learned: tuple[Array, Array] | None = None  # state and covariance before a restart
        self._covariance = np.zeros((5, 5))
        self._at: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)  # time, way, north, east of the state
        self._now = self._at  # the same of the last reading
        self._number, self._ignored = -1, 0
        self._accepted: list[float] = []  # the last accepted readings
        self._is_fine = False  # whether readings have fractions of a percent
        self._times: list[float] = []  # of stretches (s)

    def take(self, now_s: float, charge: float, way_m: float, north_m: float, east_m: float) -> None:
        """Adds a charge (0 to 1; NaN: unknown) with its time, the way so far and the position."""
        now = (now_s, way_m / STRETCH_M, north_m / STRETCH_M, east_m / STRETCH_M)
        number = int(now[1])
        if number < self._number or now_s < self._now[0]:  # the way or the clock starts over
            self._readings = []
            self._at = (now_s, *now[1:])
        began_s = self._readings[0][1] if self._readings else now_s
        if number != self._number or now_s - began_s > LONG_STRETCH * self._usual_s:
            self._finish_stretch()
            self._number = number
        self._now = now
        if not 0.0 <= charge <= 1.0:  # no reading: the vehicle is assumed to use the expected charge
            return
        self._is_fine = self._is_fine or abs(charge * 100.0 - round(charge * 100.0)) > WHOLE_TOLERANCE
        self._readings.append((charge, *now))
        del self._readings[:-MAX_READINGS]

    @property
    def is_known(self) -> bool:
        """Whether anything can be predicted."""
        return self._state is not None

    @property
    def charge(self) -> float:
        """The present charge, filtered; NaN while unknown."""
        return math.nan if self._state is None else float(self._forecast(())[0][0])

    @property
    def lasts_m(self) -> tuple[float, float]:
        """Way (m) that a full battery lasts without current, and its standard deviation; NaN while unknown."""
        if self._state is None:
            return math.nan, math.nan
        _, cost, _, _, growth = self._state
        cost = max(float(cost * (1.0 + 0.5 * growth)), LEAST_COST)
        return STRETCH_M / cost, STRETCH_M / cost**2 * math.sqrt(self._covariance[1, 1])

    def surplus(self, way_m: float, home_m: tuple[float, float]) -> float:
        """Charge above the reserve that is almost certainly left after a way and the way home; NaN while unknown.

        Args:
            way_m: Length of the further way (m), which ends where it begins.
            home_m: From there to the recovery position: north, east (m).
        """
        if self._state is None:
            return math.nan
        north, east = home_m[0] / STRETCH_M, home_m[1] / STRETCH_M
        ways = ((way_m / STRETCH_M, 0.0, 0.0), (math.hypot(north, east), north, east))
        state, covariance = self._forecast(ways)
        return float(state[0]) - self.reserve - MARGIN - CAUTION * math.sqrt(covariance[0, 0])

    def must_turn(self, home_m: tuple[float, float]) -> bool:
        """Whether a little more travel and the way home (north, east, m) would use more charge than there is."""
        return self.surplus(2.0, home_m) < 0.0

    def left_m(self, home_m: tuple[float, float]) -> float:
        """Way (m) that the battery lasts before the way home (north, east, m); NaN while unknown, at least 0."""
        if self._state is None:
            return math.nan
        low, high = 0, 1 << 12
        while low < high:
            middle = (low + high + 1) // 2
            low, high = (middle, high) if self.surplus(middle * STRETCH_M, home_m) >= 0.0 else (low, middle - 1)
        return low * STRETCH_M

    def snapshot(self) -> dict[str, Any]:
        """The learned state and its covariance, for a state file."""
        learned = self._learned if self._state is None else (self._state, self._covariance)
        return {} if learned is None else {"state": learned[0].tolist(), "covariance": learned[1].tolist()}

    def restore(self, values: Mapping[str, Any]) -> None:
        """Continues from a `snapshot`, with a charge that is not known."""
        if values:
            self._learned = np.array(values["state"]), np.array(values["covariance"])

    @property
    def _usual_s(self) -> float:
        return median(self._times) if self._times else math.inf

    def _finish_stretch(self) -> None:
        """Ends the stretch with the median of its readings."""
        if not self._readings:
            return
        readings = np.array(self._readings)
        self._readings = []
        point = (float(np.median(readings[:, 0])), *(float(value) for value in readings[:, 1:].mean(axis=0)))
        if self._state is None:
            self._begin(point)
        else:
            self._update(point)

    def _begin(self, point: tuple[float, ...]) -> None:
        """Begins the filter, if enough is known, and takes the first stretches."""
        self._first.append(point)
        if len(self._first) < (LEAST_LEARNED if self._learned else LEAST_STATED if self._stated else LEAST):
            return
        if self._learned:
            self._state, self._covariance = (values.copy() for values in self._learned)
            cost = float(self._state[1])
            self._covariance[0], self._covariance[:, 0] = 0.0, 0.0
            self._covariance[0, 0] = FIRST_STD**2
        else:
            cost, share = (self._stated, STATED_STD) if self._stated else (_slope(self._first), LEARNED_STD)
            self._state = np.array([0.0, cost / (1.0 + 0.5 * AGEING), 0.0, 0.0, AGEING])
            stds = (FIRST_STD, share * cost, CURRENT_STD * cost, CURRENT_STD * cost, AGEING_STD)
            self._covariance = np.diag(np.square(stds))
        began = self._first[0][2]
        self._state[0] = median(point[0] + cost * (point[2] - began) for point in self._first)
        self._at = self._first[0][1:]
        for taken in self._first:
            self._update(taken)
        self._first = []

    def _update(self, point: tuple[float, ...]) -> None:
        """Moves the filter on to a stretch, and takes its reading."""
        assert self._state is not None
        charge, at = point[0], point[1:]
        passed_s, *way = (b - a for a, b in zip(self._at, at, strict=True))
        state, covariance = _moved(self._state, self._covariance, tuple(way))
        if way[0] > 0.5:
            self._times.append(passed_s / way[0])
            del self._times[:-MAX_TIMES]
        stayed = passed_s / self._usual_s - LONG_STRETCH * max(way[0], 0.0) if self._times else 0.0
        covariance[0, 0] += (max(stayed, 0.0) * state[1]) ** 2
        noise = (FINE_STD if self._is_fine else READING_STD) ** 2
        off, variance = charge - state[0], covariance[0, 0] + noise
        is_far = off * off > OUTLIER_STD**2 * variance
        rises = bool(self._accepted) and charge > max(self._accepted) + RISE
        if rises or (is_far and self._ignored < MOST_OUTLIERS):
            self._ignored += not rises
        else:
            self._accepted = [*self._accepted, charge][-RECENT:]
            if is_far:
                covariance *= min(off * off / variance, WIDENING)
                covariance[0, 0] = max(covariance[0, 0], off * off)
                variance = covariance[0, 0] + noise
            self._ignored = 0
            gain = covariance[:, 0] / variance
            state, covariance = state + gain * off, covariance - np.outer(gain, covariance[0])
        state[1] = max(state[1], LEAST_COST)
        self._state, self._covariance, self._at = state, covariance, at

    def _forecast(self, ways: tuple[tuple[float, float, float], ...]) -> tuple[Array, Array]:
        """State and covariance after further ways (length, north, east in stretches)."""
        assert self._state is not None
        state, covariance = _moved(self._state, self._covariance, tuple(np.subtract(self._now[1:], self._at[1:])))
        for way in ways:
            pieces = min(max(math.ceil(way[0] / PIECE), 1), PIECES)
            for _ in range(pieces):
                state, covariance = _moved(state, covariance, tuple(part / pieces for part in way))
        return state, covariance


def _moved(state: Array, covariance: Array, way: tuple[float, ...]) -> tuple[Array, Array]:
    """State and covariance after a way (length, north, east in stretches)."""
    charge, cost, _, _, growth = state
    length, north, east = max(way[0], 0.0), way[1], way[2]
    factor = 1.0 + growth * (1.0 - charge)
    used = float(state[1:4] @ (length, north, east))
    by = np.array((1.0 + used * growth, -length * factor, -north * factor, -east * factor, -used * (1.0 - charge)))
    state, covariance = state.copy(), covariance.copy()
    state[0] -= used * factor
    row = by @ covariance
    covariance[0], covariance[:, 0], covariance[0, 0] = row, row, row @ by
    covariance[0, 0] += SCATTER**2 * cost**2 * length
    covariance[[1, 2, 3], [1, 2, 3]] += CHANGE**2 * cost**2 * length
    return state, covariance


def _slope(points: list[tuple[float, ...]]) -> float:
    """Median fall of the charge per stretch, over the pairs of points at least a third of the way apart."""
    charges, ways = np.array([(point[0], point[2]) for point in points]).T
    first, second = np.triu_indices(len(ways), max(len(ways) // 3, 1))
    falls = (charges[first] - charges[second]) / (ways[second] - ways[first])
    return max(float(np.median(falls)), LEAST_COST)
