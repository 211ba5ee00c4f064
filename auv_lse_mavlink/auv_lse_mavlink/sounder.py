"""Soundings from a vehicle's odometry and altitudes: water depth = vehicle depth + altitude, at the vehicle's position.

Time is cut into periods of `every_s`, counted from 0 s. A ping is an altitude; its position and vehicle depth are
interpolated between the odometries before and after it. Each period with enough pings gives one sounding: their median
water depth at their mean position and time, as the simulator makes them (docs/design/simulation.md). A period is over
once odometry is `LATE_S` past its end, so that altitudes may come that much later than odometry.
"""

import bisect
import math
from collections import Counter, deque

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.vocabulary.frames import is_possible
from auv_lse_common.vocabulary.frozen_sensor import FrozenSensor
from auv_lse_common.vocabulary.pings import by_period, period_of, sounding_of
from auv_lse_common.vocabulary.sounding import DEEPEST_M, Sounding
from auv_lse_common.vocabulary.sounding_gate import FLATTEST

Array = NDArray[np.float64]

#: A ping needs odometry before and after it, not farther apart than this (s): 1 Hz with some jitter suffices.
MAX_GAP_S = 1.5
#: Altitudes may arrive this much later than odometry of the same time (s).
LATE_S = 0.25
#: Number of pings and odometries kept; more than arrive in the longest period.
MAX_KEPT = 10_000


class Sounder:
    """Turns one vehicle's pings into soundings.

    Attributes:
        counts: "soundings"; "periods_short" had too few pings; "pings_blind" saw no ground, "pings_unplaced" had no
            odometry around them, "pings_frozen" repeated one altitude, "pings_late" came after their period,
            "pings_dropped" exceeded the limit; "bad_odometry", and "clock_steps" of odometry back in time.
    """

    def __init__(self, every_s: float, least_pings: int) -> None:
        """Gives one sounding per `every_s` (s) with at least `least_pings` echoes."""
        self.counts: Counter[str] = Counter()
        self._every_s = every_s
        self._least_pings = least_pings
        # stamp, north, east, depth, raw north, raw east
        self._odometry: deque[tuple[float, float, float, float, float, float]] = deque(maxlen=MAX_KEPT)
        self._pings: list[tuple[float, float]] = []  # stamp, altitude, of unfinished periods
        self._over = -math.inf  # number of the last finished period
        self._altimeter = FrozenSensor(FLATTEST)

    def reset(self) -> None:
        """Discards unfinished periods: positions before and after this must not be mixed."""
        self._odometry.clear()
        self._pings.clear()
        self._over = -math.inf

    def altitude(self, stamp_s: float, altitude_m: float) -> None:
        """Adds a height over ground (m); a value that is not positive, or deeper than any sea, means no echo."""
        if not (math.isfinite(stamp_s / self._every_s) and 0.0 < altitude_m <= DEEPEST_M):
            self.counts["pings_blind"] += 1
        elif self._period(stamp_s) <= self._over:
            self.counts["pings_late"] += 1
        elif len(self._pings) >= MAX_KEPT:
            self.counts["pings_dropped"] += 1
        else:
            bisect.insort(self._pings, (stamp_s, altitude_m))

    def odometry(
        self,
        stamp_s: float,
        north_m: float,
        east_m: float,
        depth_m: float,
        raw_m: tuple[float, float] = (math.nan, math.nan),
    ) -> list[Sounding]:
        """Adds the vehicle's position (m; depth positive down), and its dead-reckoned position: north, east (m), NaN if
        unknown.

        Returns:
            The soundings of the periods that are finished now.
        """
        possible = is_possible(0.0, north_m, east_m) and abs(depth_m) <= DEEPEST_M
        if not (possible and math.isfinite(stamp_s / self._every_s)):
            self.counts["bad_odometry"] += 1
            return []
        if self._odometry and stamp_s < self._odometry[-1][0]:
            self.counts["clock_steps"] += 1
            self.reset()
        self._odometry.append((stamp_s, north_m, east_m, depth_m, *raw_m))
        over = self._period(stamp_s - LATE_S) - 1
        if over <= self._over:
            return []
        self._over = over
        count = bisect.bisect_right(self._pings, over, key=lambda ping: self._period(ping[0]))
        pings, self._pings = self._pings[:count], self._pings[count:]
        found = [row for ping in pings if (row := self._placed(*ping)) is not None]
        if len(found) < len(pings):
            self.counts["pings_unplaced"] += len(pings) - len(found)
        placed = [row[:6] for row in found if not self._altimeter.update(row[6], row[1], row[2])]
        if len(placed) < len(found):
            self.counts["pings_frozen"] += len(found) - len(placed)
        # the last odometry before the end of the last finished period is the first one that is still needed
        while len(self._odometry) > 1 and self._odometry[1][0] <= over * self._every_s:
            self._odometry.popleft()
        periods = by_period(np.array(placed).reshape(-1, 6), self._every_s)
        return [sounding for period in periods if (sounding := self._sounding(period)) is not None]

    def _period(self, stamp_s: float) -> int:
        return int(period_of(stamp_s, self._every_s))

    def _placed(self, stamp_s: float, altitude_m: float) -> tuple[float, ...] | None:
        """Stamp, north, east, water depth, raw north, east, altitude of a ping; None without odometry around it."""
        after = bisect.bisect_left(self._odometry, stamp_s, key=lambda row: row[0])
        if after == len(self._odometry):
            return None
        b = self._odometry[after]
        a = b if b[0] == stamp_s else self._odometry[after - 1]
        if a[0] > stamp_s or b[0] - a[0] > MAX_GAP_S:
            return None
        part = (stamp_s - a[0]) / (b[0] - a[0]) if b[0] > a[0] else 0.0
        north, east, depth, *raw = (x + part * (y - x) for x, y in zip(a[1:], b[1:], strict=True))
        return stamp_s, north, east, depth + altitude_m, *raw, altitude_m

    def _sounding(self, pings: Array) -> Sounding | None:
        if len(pings) < self._least_pings:
            self.counts["periods_short"] += 1
            return None
        self.counts["soundings"] += 1
        return Sounding._make((*sounding_of(pings).tolist(), 0))
