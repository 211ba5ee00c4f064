"""What arrivals tell of the team's clocks, and of who uses which number and which slots.

A packet sent at the beginning of its sender's slot arrives, by a clock that agrees with the sender's, between
`guard_s` after the slot's start and `guard_s + send_duration_s + travel_s` after it, or little more: hosts look for
their slots once a second. Packets that keep coming earlier or later show that clocks are apart; so do packets that
arrive in slots of others. A sender that is heard more often than it has slots is two vehicles with one number, or a
babbling transmitter: what is too much is refused, so that it cannot fill the map. What comes outside of a sender's
slots is counted apart: without a tag anybody can send in a mate's name, and must not use up its slots.
"""

from __future__ import annotations

import math
import statistics
from collections import Counter, deque

from auv_lse_comms.tdma import Tdma

#: A host may look for its slot this late (s).
LATE_HOST_S = 1.0
#: Arrivals that are looked at together: one that is off may be an echo, or a late host.
RECENT = 5
#: Refusals that an operator should know of, with what they mean.
_REFUSALS = {
    "tag": "their tag does not fit: another key or another session there, or a forger",
    "stale": "they are of other slots: clocks more than a cycle apart, or somebody replays old packets",
    "replay": "they were received before: an echo, or somebody replays packets",
}
_MOST_REFUSALS = 1000
#: What was found is told for so many cycles after it was seen last.
TOLD_CYCLES = 10.0
#: Packets that a sender may be ahead of its slots: some wait in a receiver and come together.
AHEAD = 3.0


class LinkQuality:
    """Watches the arrivals at one vehicle.

    Attributes:
        counts: Arrivals outside of their sender's slot ("out_of_slot.2"), in whose slot ("in_slot_of.3.from.2"), and
            beyond a sender's slots ("excess.2").
    """

    def __init__(self, tdma: Tdma, address: int) -> None:
        """Watches for vehicle `address` with these slots."""
        self.counts: Counter[str] = Counter()
        self._tdma = tdma
        self._address = address
        self._own_number_s = -math.inf
        self._late_s: dict[int, deque[float]] = {}
        # by sender, and whether in its slots or in all: packets it may send, as of when (s)
        self._allowed: dict[tuple[int, bool], tuple[float, float]] = {}
        self._heard_s: dict[int, float] = {}  # when a sender was last heard
        self._excess_s: dict[int, float] = {}  # when a sender last sent too many
        self._refused_s: dict[tuple[str, int], float] = {}  # when a packet was last refused for a reason, by sender
        self._foreign_s: dict[int, deque[float]] = {}  # by sender: when its last packets came that were far off

    def own_number(self, now_s: float) -> None:
        """Another modem was heard that has this vehicle's number."""
        self._own_number_s = now_s

    def refused(self, now_s: float, reason: str, source: int) -> None:
        """A packet was refused for a reason of `packet.codec.REASONS`."""
        if reason in _REFUSALS and len(self._refused_s) < _MOST_REFUSALS:
            self._refused_s[reason, source] = now_s

    def arrival(self, stamp_s: float, source: int) -> bool:
        """Takes note of a packet of `source` whose reception ended at `stamp_s`; False if it has sent too many."""
        self._heard_s[source] = stamp_s
        late_s = self._off_s(stamp_s, source)
        self._late_s.setdefault(source, deque(maxlen=RECENT)).append(late_s)
        if (owner := self._tdma.slot(stamp_s).owner) != source:
            self.counts[f"out_of_slot.{source}"] += 1
            if owner:
                self.counts[f"in_slot_of.{owner}.from.{source}"] += 1
            self._foreign_s.setdefault(source, deque(maxlen=RECENT)).append(stamp_s)
        if self._may_send(stamp_s, source, late_s == 0.0):
            return True
        self.counts[f"excess.{source}"] += 1
        self._excess_s[source] = stamp_s
        return False

    def problems(self, now_s: float) -> dict[str, str]:
        """What an operator should know, a text for each problem, by its key."""
        found = {}
        tdma = self._tdma.settings(now_s)
        told_s = TOLD_CYCLES * tdma.slot_s * len(tdma.order)
        if now_s - self._own_number_s < told_s:
            text = f"team: another modem has this vehicle's number, {self._address}: each needs its own"
            found["own number"] = text
        for (reason, source), then_s in sorted(self._refused_s.items()):
            if now_s - then_s < told_s:
                found[f"{reason} of {source}"] = f"team: packets of vehicle {source} are refused: {_REFUSALS[reason]}"
        for source, recent in sorted(self._late_s.items()):
            if now_s - self._heard_s[source] >= told_s:
                continue
            late_s = statistics.median(recent)
            if len(recent) == RECENT and recent.count(0.0) <= 1 and late_s != 0.0:
                when = "later" if late_s > 0.0 else "earlier"
                found[f"clock of {source}"] = (
                    f"team: packets of vehicle {source} come {abs(late_s):.1f} s {when} than its slots allow: their "
                    "clocks are apart by as much at least, or two vehicles have that number"
                )
            elif self._comes_in_others_slots(source, now_s - told_s):
                found[f"slots of {source}"] = (
                    f"team: vehicle {source} sends in slots of others: they may drown each other; its tdma settings "
                    "are others, or two vehicles have that number"
                )
            if now_s - self._excess_s.get(source, -math.inf) < told_s:
                count = self.counts[f"excess.{source}"]
                found[f"excess of {source}"] = (
                    f"team: {count} packets of vehicle {source} beyond its slots are refused: "
                    "two vehicles with that number, or a transmitter that babbles"
                )
        return found

    def _comes_in_others_slots(self, source: int, since_s: float) -> bool:
        """Whether packets keep coming in slots of others, though their middle one is in its own slots' time."""
        recent = self._foreign_s.get(source, deque())
        return len(recent) == RECENT and recent[0] > since_s

    def _off_s(self, stamp_s: float, source: int) -> float:
        """How much later (s) than a slot of its sender allows a packet has come; negative: earlier; 0: as it should."""
        tdma = self._tdma.settings(stamp_s)
        latest_s = tdma.guard_s + tdma.send_duration_s + tdma.travel_s + LATE_HOST_S
        cycle_s = tdma.slot_s * len(tdma.order)
        best = math.inf
        for turn, owner in enumerate(tdma.order):
            if owner == source:
                phase_s = math.remainder(stamp_s - tdma.epoch_s - turn * tdma.slot_s - 0.5 * latest_s, cycle_s)
                after_s = phase_s + 0.5 * latest_s  # after the start of that slot, the nearest one
                off_s = max(after_s - latest_s, 0.0) + min(after_s - tdma.guard_s, 0.0)
                best = min(best, off_s, key=abs)
        return 0.0 if math.isinf(best) else best

    def _may_send(self, stamp_s: float, source: int, in_time: bool) -> bool:
        """Takes one from what a sender may send: in its slots, and in all, which alone holds for what comes outside."""
        in_slots, in_all = (self._allowance(stamp_s, source, kind) for kind in (True, False))
        take = (in_slots if in_time else in_all) >= 1.0
        self._allowed[source, True] = (in_slots - (take and in_time), stamp_s)
        self._allowed[source, False] = (max(in_all - take, -AHEAD), stamp_s)
        return take

    def _allowance(self, stamp_s: float, source: int, in_time: bool) -> float:
        tdma = self._tdma.settings(stamp_s)
        a_second = tdma.order.count(source) / (tdma.slot_s * len(tdma.order))
        allowed, since_s = self._allowed.get((source, in_time), (AHEAD, stamp_s))
        return min(AHEAD, allowed + a_second * max(0.0, stamp_s - since_s))
