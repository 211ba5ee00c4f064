"""Checks the arrival times of packets: reveals clock offsets, duplicate vehicle numbers and wrong slots.

A packet sent at the beginning of its sender's slot arrives, by a clock that agrees with the sender's, between
`guard_s` and `guard_s + send_duration_s + travel_s` after the slot's start, or slightly later, because hosts check for
their slots once a second. Packets that keep arriving earlier or later, or in slots of others, reveal a clock offset. A
sender that is heard more often than it has slots is two vehicles with one number, or a transmitter that sends too much:
its excess packets are refused, so that it cannot fill the map. Packets outside their sender's slots are counted
separately: without a tag anyone can send under a mate's number, and must not use up that mate's slots.
"""

import math
import statistics
from collections import Counter, deque

from auv_lse_common.support.plurals import counted
from auv_lse_comms.tdma import Tdma

#: A host may notice its slot this late (s).
LATE_HOST_S = 1.0
#: Number of arrivals that are judged together: a single late one may be an echo, or a late host.
RECENT = 5
#: Reasons of refusals that are reported, with their possible causes.
_REFUSALS = {
    "tag": "their tag does not match: another key or session on that vehicle, a clock that is far off, or forged "
    "packets",
    "stale": "they belong to other slots: its clock is about {off} this vehicle's, or old packets are replayed; "
    "correct the clock that is wrong",
    "replay": "they were received before: an echo, or packets are replayed",
    "implausible": "position or step does not follow its last packets: two vehicles have that number, it started "
    "again, or forged packets",
    "unproven": "a clock was set back by about {off_s:.0f} s; they are accepted once they echo a packet of this "
    "vehicle, which takes some cycles",
}
_MAX_REFUSALS = 1000
#: A problem is reported for this many cycles after it was last seen.
REPORTED_CYCLES = 10.0
#: Packets by which a sender may exceed its slots: a receiver may deliver several at once.
AHEAD = 3.0


class LinkQuality:
    """Watches the arrivals at one vehicle.

    Attributes:
        counts: Arrivals outside their sender's slots ("out_of_slot.2"), in another's slot ("in_slot_of.3.from.2"), and
            beyond the number of a sender's slots ("excess.2").
    """

    def __init__(self, tdma: Tdma, address: int) -> None:
        """Starts without arrivals, for vehicle `address`."""
        self.counts: Counter[str] = Counter()
        self._tdma = tdma
        self._address = address
        self._own_number_s = -math.inf
        self._late_s: dict[int, deque[float]] = {}
        # by sender, and whether in its slots or overall: packets that it may still send, and when (s) that was counted
        self._allowed: dict[tuple[int, bool], tuple[float, float]] = {}
        # by sender: a slot, and packets in it beyond the sender's slots
        self._candidates: dict[int, tuple[int, int]] = {}
        self._heard_s: dict[int, float] = {}  # when a sender was last heard
        self._excess_s: dict[int, float] = {}  # when a sender last sent too many
        # by reason and sender: when a packet was last refused, and by how much clocks seemed to be off (s)
        self._refused_s: dict[tuple[str, int], tuple[float, float]] = {}
        self._foreign_s: dict[int, deque[float]] = {}  # by sender: when its last packets outside its slots arrived

    def note_own_number(self, now_s: float) -> None:
        """Records that another modem with this vehicle's number was heard."""
        self._own_number_s = now_s

    def note_refusal(self, now_s: float, reason: str, source: int, clock_s: float = math.nan) -> None:
        """Records a packet refused for a reason of `packet.codec.REASONS`; clocks seem to be off by `clock_s` (s)."""
        if reason in _REFUSALS and len(self._refused_s) < _MAX_REFUSALS:
            self._refused_s[reason, source] = now_s, clock_s

    def accept_arrival(self, stamp_s: float, source: int) -> bool:
        """Records a packet of `source` whose reception ended at `stamp_s` (s); False if it has sent too many."""
        self._heard_s[source] = stamp_s
        late_s = self._lateness_s(stamp_s, source)
        self._late_s.setdefault(source, deque(maxlen=RECENT)).append(late_s)
        if (owner := self._tdma.slot(stamp_s).owner) != source:
            self.counts[f"out_of_slot.{source}"] += 1
            if owner:
                self.counts[f"in_slot_of.{owner}.from.{source}"] += 1
            self._foreign_s.setdefault(source, deque(maxlen=RECENT)).append(stamp_s)
        if self._use_allowance(stamp_s, source, late_s == 0.0):
            return True
        self.counts[f"excess.{source}"] += 1
        self._excess_s[source] = stamp_s
        return False

    def accept_candidate(self, stamp_s: float, source: int) -> bool:
        """Whether an excess packet may be one of several candidates in its sender's slot.

        A forged packet that comes first must not shut out the true one. Accepts as many as a modem can send in a slot.
        """
        tdma, slot = self._tdma.settings(stamp_s), self._tdma.slot(stamp_s)
        index, count = self._candidates.get(source, (-1, 0))
        count = count + 1 if slot.index == index else 1
        self._candidates[source] = slot.index, count
        return self._lateness_s(stamp_s, source) == 0.0 and count <= tdma.slot_s / tdma.send_duration_s

    def slot_of(self, stamp_s: float, source: int, on_air_s: float) -> tuple[float, bool]:
        """The slot to which a packet of `source` belongs, and whether it arrived when a packet of that slot does.

        Args:
            stamp_s: End of its reception (s).
            on_air_s: Duration (s) of a transmission.

        Returns:
            Start of the sender's nearest slot (s); `stamp_s` and False if the sender has none.
        """
        tdma = self._tdma.settings(stamp_s)
        latest_s = 2.0 * tdma.guard_s + tdma.send_duration_s + tdma.travel_s + LATE_HOST_S
        starts = self._tdma.around(stamp_s, source)
        if not starts:
            return stamp_s, False
        start_s = min(starts, key=lambda start_s: abs(stamp_s - start_s - 0.5 * latest_s))
        return start_s, on_air_s <= stamp_s - start_s <= latest_s

    def problems(self, now_s: float) -> dict[str, str]:
        """Problems for the operator: texts by key."""
        found = {}
        tdma = self._tdma.settings(now_s)
        reported_s = REPORTED_CYCLES * tdma.slot_s * len(tdma.order)
        if abs(now_s - self._own_number_s) < reported_s:  # later than now: the clock was set back
            found["own number"] = f"team: another modem has this vehicle's number, {self._address}; numbers must differ"
        for (reason, source), (then_s, off_s) in sorted(self._refused_s.items()):
            if abs(now_s - then_s) < reported_s:
                off = f"{abs(off_s):.0f} s {'ahead of' if off_s > 0.0 else 'behind'}"
                why = _REFUSALS[reason].format(off=off, off_s=abs(off_s))
                found[f"{reason} of {source}"] = f"team: packets of vehicle {source} are refused: {why}"
        for source, recent in sorted(self._late_s.items()):
            if abs(now_s - self._heard_s[source]) >= reported_s:
                continue
            late_s = statistics.median(recent)
            if len(recent) == RECENT and recent.count(0.0) <= 1 and late_s != 0.0:
                when = "later" if late_s > 0.0 else "earlier"
                found[f"clock of {source}"] = (
                    f"team: packets of vehicle {source} arrive {abs(late_s):.1f} s {when} than its slots allow: the "
                    "clocks differ by at least as much, or two vehicles have that number"
                )
            elif self._uses_others_slots(source, now_s - reported_s):
                found[f"slots of {source}"] = (
                    f"team: vehicle {source} sends in slots of others, which causes collisions: its tdma settings "
                    "differ, or two vehicles have that number"
                )
            if abs(now_s - self._excess_s.get(source, -math.inf)) < reported_s:
                count = self.counts[f"excess.{source}"]
                found[f"excess of {source}"] = (
                    f"team: {counted(count, 'packet')} of vehicle {source} beyond its slots: two vehicles have that "
                    "number, a transmitter sends too much, or forged packets"
                )
        return found

    def _uses_others_slots(self, source: int, since_s: float) -> bool:
        """Whether packets keep arriving in slots of others, although the median one is on time."""
        recent = self._foreign_s.get(source, deque())
        return len(recent) == RECENT and recent[0] > since_s

    def _lateness_s(self, stamp_s: float, source: int) -> float:
        """Delay (s) of a packet beyond what its sender's nearest slot allows; negative: early; 0: in time."""
        tdma = self._tdma.settings(stamp_s)
        latest_s = tdma.guard_s + tdma.send_duration_s + tdma.travel_s + LATE_HOST_S
        cycle_s = tdma.slot_s * len(tdma.order)
        best = math.inf
        for turn, owner in enumerate(tdma.order):
            if owner == source:
                phase_s = math.remainder(stamp_s - tdma.epoch_s - turn * tdma.slot_s - 0.5 * latest_s, cycle_s)
                after_s = phase_s + 0.5 * latest_s  # time after the start of the nearest such slot
                off_s = max(after_s - latest_s, 0.0) + min(after_s - tdma.guard_s, 0.0)
                best = min(best, off_s, key=abs)
        return 0.0 if math.isinf(best) else best

    def _use_allowance(self, stamp_s: float, source: int, in_time: bool) -> bool:
        """Uses one packet of a sender's two allowances: of the one in its slots if `in_time`, and of the overall one.

        Returns:
            Whether the packet may be accepted; if not `in_time`, the overall allowance decides.
        """
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
