"""Dead-reckoned positions, and the measurements that can correct them afterwards.

After a fix, a navigation filter no longer contains the drift of dead reckoning, which displaced the earlier soundings.
So each vehicle also keeps its *raw* position: dead-reckoned from its start, without any fix under way. Vehicles send
dead-reckoned positions and measurements, not estimates, which receivers would count twice. All positions are north,
east (m) in the local tangent plane.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from auv_lse_common.support.arrays import Array

#: Covariance of heading (rad), north and east (m): rows and columns.
Covariance = Sequence[Sequence[float]] | Array
#: All zeros, as in nav_msgs.
UNKNOWN: Covariance = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def raw_position(north_m: float, east_m: float) -> tuple[float, float]:
    """The dead-reckoned position (m) of a message; NaN, NaN if the driver has left both fields exactly 0."""
    return (math.nan, math.nan) if north_m == 0.0 and east_m == 0.0 else (north_m, east_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class DeadReckoning:
    """The dead-reckoned position of a vehicle: dead-reckoned from its start, without any fix under way.

    Attributes:
        north_m, east_m: Dead-reckoned position.
        depth_m: Depth of the vehicle below the surface.
    """

    stamp_s: float
    heading_rad: float
    north_m: float
    east_m: float
    depth_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CorrectedPosition(DeadReckoning):
    """The position of a vehicle as its map corrects it, with the raw heading.

    Attributes:
        covariance: Rows and columns: heading (not corrected: 0), north, east (m2); all zeros if unknown.
    """

    covariance: Covariance = UNKNOWN


@dataclass(frozen=True, slots=True, kw_only=True)
class Fix:
    """A GPS position, taken at the surface under way.

    Attributes:
        north_m, east_m: GPS position.
        raw_north_m, raw_east_m: Dead-reckoned position at the same time.
        std_m: Standard deviation of the GPS position, each axis.
    """

    stamp_s: float
    north_m: float
    east_m: float
    raw_north_m: float
    raw_east_m: float
    std_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MateNavigation:
    """The navigation data in a packet with its travel time, or a range measured by a ping.

    A ping carries no position: the dead-reckoned position and `sent_s` are NaN, and the receiver's clock alone measures
    the travel time.

    Attributes:
        stamp_s: Start of reception by the receiver's clock (s); for a ping the time of the range.
        source: Number of the sender.
        sent_s: Start of transmission, by the sender's clock (s); NaN if unknown.
        raw_north_m, raw_east_m: The sender's dead-reckoned position at transmission; NaN for a ping.
        fix_raw_north_m, fix_raw_east_m: Its dead-reckoned position at its last fix under way; NaN without a fix.
        fix_north_m, fix_east_m: The GPS position of that fix; NaN without a fix.
        travel_s: One-way travel time (s), measured with both clocks or by a ping; NaN if unknown.
    """

    stamp_s: float
    source: int
    sent_s: float
    raw_north_m: float
    raw_east_m: float
    fix_raw_north_m: float = math.nan
    fix_raw_east_m: float = math.nan
    fix_north_m: float = math.nan
    fix_east_m: float = math.nan
    travel_s: float = math.nan

    @property
    def by_ping(self) -> bool:
        """Whether it is a range measured by a ping."""
        return math.isnan(self.raw_north_m) and math.isnan(self.sent_s) and math.isfinite(self.travel_s)

    @property
    def has_fix(self) -> bool:
        """Whether the sender has taken a fix under way."""
        return not math.isnan(self.fix_north_m)
