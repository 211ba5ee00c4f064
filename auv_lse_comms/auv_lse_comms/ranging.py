"""Ranges to team mates: from the times at which their packets were sent and arrived, and from pings.

Modems measure travel times in two ways (docs/reference/hardware.md). One-way: transmissions start on a full second of
a PPS that all vehicles share, and the modem reports the travel time without its whole seconds. Two-way: a ping, which
the mate's modem answers without its host.
"""

import dataclasses
import math
from dataclasses import dataclass

from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, MateNavigation
from auv_lse_comms.packet.navigation import Navigation
from auv_lse_comms.tdma import SlotKey, Tdma

#: A dead-reckoned position older than this is too old for a transmission (s).
FRESH_S = 2.0
#: Times closer than this (s) are equal: a message's stamp has nanoseconds, UTC as a float has less resolution.
SAME_TIME_S = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """When a packet was sent and arrived, according to the modem; NaN where unknown.

    Attributes:
        sent_s: Start of transmission, by the sender's clock (s).
        arrival_s: Start of reception, by the receiver's clock (s).
        travel_s: One-way travel time (s), measured with both clocks, or by a ping.
    """

    sent_s: float = math.nan
    arrival_s: float = math.nan
    travel_s: float = math.nan


#: All times unknown.
UNTIMED = Timing()


class Ranging:
    """The ranges of one vehicle, and its own dead-reckoned position, which is needed to resolve them."""

    def __init__(self, tdma: Tdma, second_lead_s: float | None = None, pings: bool = False) -> None:
        """Starts without a dead-reckoned position.

        Args:
            second_lead_s: If given, all transmissions of the team start on a full second, at least this long (s) after
                their packets are given out, and modems report travel times without their whole seconds.
            pings: Whether mates are to be pinged.
        """
        self._tdma, self._second_lead_s, self._pings = tdma, second_lead_s, pings
        self._raw: DeadReckoning | None = None
        self._before: DeadReckoning | None = None  # the dead-reckoned position before that
        self._pinged = 0  # the mate pinged last
        self._slot: SlotKey | None = None  # the slot of that ping

    def set_dead_reckoning(self, raw: DeadReckoning) -> None:
        """Sets the vehicle's dead-reckoned position."""
        self._before, self._raw = self._raw, raw

    def raw_at_start(self, now_s: float) -> DeadReckoning | None:
        """The dead-reckoned position at the transmission's start of a packet that is given out now; None if it is not
        known."""
        raw, before = self._raw, self._before
        if raw is None or now_s - raw.stamp_s > FRESH_S:
            return None
        if self._second_lead_s is None or before is None or not 0.0 < raw.stamp_s - before.stamp_s <= FRESH_S:
            return raw
        start_s = math.ceil(now_s + self._second_lead_s - SAME_TIME_S)
        share = (start_s - raw.stamp_s) / (raw.stamp_s - before.stamp_s)
        north_m = raw.north_m + share * (raw.north_m - before.north_m)
        east_m = raw.east_m + share * (raw.east_m - before.east_m)
        return dataclasses.replace(raw, stamp_s=start_s, north_m=north_m, east_m=east_m)

    def mate_navigation(
        self, stamp_s: float, source: int, navigation: Navigation | None, timing: Timing
    ) -> MateNavigation | None:
        """The sender's navigation and range, from a packet that was received at `stamp_s` (s); None if it has none."""
        if navigation is None:
            return None
        timing = self._with_whole_seconds(timing, navigation)
        (raw_north_m, raw_east_m), (fix_raw_north_m, fix_raw_east_m) = navigation.raw_m, navigation.fix_raw_m
        fix_north_m, fix_east_m = navigation.fix_m
        return MateNavigation(
            stamp_s=stamp_s if math.isnan(timing.arrival_s) else timing.arrival_s,
            source=source,
            sent_s=timing.sent_s,
            raw_north_m=raw_north_m,
            raw_east_m=raw_east_m,
            fix_raw_north_m=fix_raw_north_m,
            fix_raw_east_m=fix_raw_east_m,
            fix_north_m=fix_north_m,
            fix_east_m=fix_east_m,
            travel_s=timing.travel_s,
        )

    def _with_whole_seconds(self, timing: Timing, navigation: Navigation) -> Timing:
        """The timing with the whole seconds of travel time that the modem cannot measure.

        They follow from the dead-reckoned positions of both vehicles, whose error is far below the 1.5 km of a second.
        """
        if self._second_lead_s is None or self._raw is None or not math.isfinite(timing.travel_s):
            return timing
        apart_m = math.dist(navigation.raw_m, (self._raw.north_m, self._raw.east_m))
        more_s = round(apart_m / self._tdma.settings(timing.arrival_s).sound_speed_mps - timing.travel_s)
        return dataclasses.replace(timing, sent_s=timing.sent_s - more_s, travel_s=timing.travel_s + more_s)

    def ping(self, now_s: float, sent_s: float, sent_in: SlotKey | None) -> int | None:
        """The mate to ping now: in each own slot one mate in turn, after the slot's packet; mostly None.

        Args:
            sent_s: When the last packet was given out (s).
            sent_in: That packet's slot; None if there was none.
        """
        slot, vehicles = self._tdma.slot(now_s), self._tdma.vehicles
        if not self._pings or vehicles == 1 or slot.key == self._slot or slot.key != sent_in:
            return None
        tdma = self._tdma.settings(now_s)
        if not sent_s + tdma.send_duration_s <= now_s <= slot.end_s - tdma.guard_s - tdma.ping_s:
            return None
        self._slot = slot.key
        self._pinged = self._pinged % vehicles + 1
        if self._pinged == self._tdma.address:
            self._pinged = self._pinged % vehicles + 1
        return self._pinged

    def ping_range(self, now_s: float, source: int, timing: Timing) -> MateNavigation | None:
        """The range at `now_s` (s) to a mate that answered a ping; None if `source` is not a mate."""
        mate = 1 <= source <= self._tdma.vehicles and source != self._tdma.address
        if not mate or not math.isfinite(timing.travel_s):
            return None
        unknown = math.nan
        return MateNavigation(
            stamp_s=now_s, source=source, sent_s=unknown, raw_north_m=unknown, raw_east_m=unknown,
            travel_s=timing.travel_s,
        )  # fmt: skip
