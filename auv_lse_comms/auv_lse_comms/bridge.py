"""One vehicle's side of the acoustic channel: packets out of its plan and soundings, and the team's packets in.

One `ModemBridge` per vehicle. It reads no clock: `now_s` is the vehicle's own time, and must be the same clock as that
of the TDMA epoch.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_comms.link_quality import LinkQuality
from auv_lse_comms.packet.codec import Limits, Packet, PacketError, decode, encode, room_for_samples
from auv_lse_comms.packet.navigation import Navigation
from auv_lse_comms.packet.selection import Receivers, every_nth, most_useful
from auv_lse_comms.packet.tag import Tagger
from auv_lse_comms.ranging import SAME_TIME_S, UNTIMED, Ranging, Timing
from auv_lse_comms.tdma import Slot, Tdma

Array = NDArray[np.float64]

#: Weight of the last slot in the estimate of the loss: a memory of about ten slots.
_LOSS_GAIN = 0.1
#: Packets of which the modem may still report that it did not send them.
_REMEMBERED = 4
#: Cycles before and after an arrival in which the slot of an old packet is looked for, to tell it from a forged one.
_STALE_CYCLES = 100
#: Kinds of the events that `ModemBridge.remember` is told.
EVENTS = ("queued", "plan", "fix", "heard", "sent", "confirmed", "not_sent", "obeyed")
#: The navigation that takes most bytes.
_FULL = Navigation(raw_cm=(0, 0), fix_raw_half_m=(0, 0), fix_off_dm=(0, 0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Received:
    """A packet of a teammate.

    Attributes:
        source: Number of the sender.
        stamp_s: When it was received (s).
        packet: The sender's plan, and its samples, shape (n, 3).
        navigation: What it tells of the sender's navigation, with the packet's travel time; None if it tells nothing.
    """

    source: int
    stamp_s: float
    packet: Packet
    navigation: MateNavigation | None = None


@dataclass(slots=True)
class _Sent:
    """A packet that was given out: when (s), its samples, and whether the modem has said that it has sent it."""

    then_s: float
    samples: Array
    confirmed: bool


class ModemBridge:
    """Between one vehicle's planner and map, and its modem.

    Attributes:
        remember: Told each event that a bridge needs after a restart (`recall`): a kind, and values that JSON holds.
        unconfirmed: Packets in a row that the modem has neither sent nor refused.
    """

    def __init__(
        self,
        tdma: TdmaConfig,
        packet: PacketConfig,
        address: int,
        vehicles: int,
        *,
        limits: Limits | None = None,
        key: bytes | None = None,
        receivers: Receivers | None = None,
        confirm_s: float = math.inf,
        second_lead_s: float | None = None,
        pings: bool = False,
    ) -> None:
        """Starts without a plan and without soundings.

        Args:
            tdma: Slots.
            packet: What goes into a packet and what is refused.
            address: Number of this vehicle, from 1, which is its modem's address.
            vehicles: Number of vehicles of the mission.
            limits: What a mission's packets can hold; None: the ranges of the field table.
            key: The team's key (`tag.read_key`), needed if `packet.tag`.
            receivers: What the receivers are supposed to know, needed if `packet.selection` is "useful".
            confirm_s: A packet that is not confirmed (`confirm`) within this time (s) counts as not sent. Infinite: a
                packet given out counts as sent.
            second_lead_s: See `Ranging`.
            pings: Whether mates are to be pinged (`ping`).

        Raises:
            ValueError: if the key or `receivers` is missing, or the address is not a vehicle.
        """
        if packet.tag and key is None:
            raise ValueError("packet.tag = true: expected a key")
        if packet.selection == "useful" and receivers is None:
            raise ValueError("packet.selection = 'useful': expected `receivers`, which judges what a sample is worth")
        self.tdma = Tdma(tdma, address, vehicles)
        self.quality = LinkQuality(self.tdma, address)
        self.address = address
        self.vehicles = vehicles
        self.counts: Counter[str] = Counter()
        self._abort = False
        self._calling: set[int] = set()  # mates whose last packet called to abort
        self._obeyed: set[int] = set()  # those of them whose call this vehicle has aborted for
        self._config = packet
        self._limits = limits
        self._tagger = Tagger(key, packet.tag_bytes, packet.session) if packet.tag and key is not None else None
        self._receivers = receivers
        self._plan: Plan | None = None
        self._ranging = Ranging(self.tdma, second_lead_s, pings)
        self._fix: Fix | None = None
        # stamp_s, north_m, east_m, depth_m, gain when last computed, and the same before the last packet was made
        self._unsent = np.zeros((0, 6))
        self._queued: list[Array] = []  # soundings not yet among them
        self._last_queued: tuple[float, float] | None = None
        self._sent: list[_Sent] = []  # the last packets
        self._confirm_s = confirm_s
        self.unconfirmed = 0
        self.remember: Callable[..., None] = lambda kind, *values: None
        self._last_sent_s = math.nan
        self._last_slot: tuple[int, float] | None = None  # index and since_s of the slot it went out in
        self._slot: Slot | None = None  # the slot the last poll fell in
        self._used = False  # whether that slot's packet is out
        self._why = "late"  # the reason, if the slot is our own and ends without a packet
        self._heard = False  # whether a packet was accepted since that slot began
        #: Estimated chance that a packet is lost: the share of the others' recent slots in which nothing was received.
        self.loss = packet.expected_loss

    @property
    def abort(self) -> bool:
        """Whether its packets call the team to abort the mission."""
        return self._abort

    @abort.setter
    def abort(self, call: bool) -> None:
        self._abort = call
        if call:
            self._set_obeyed(self._obeyed | self._calling)

    def obeys(self, received: Received) -> bool:
        """Whether a packet calls to abort, and may: with a tag, or by `packet.abort_without_tag`; counts it.

        A mate calls until its own RESET. Its call is obeyed until this vehicle has aborted, and not again after a RESET
        here: only a packet without the call makes the next one a new call.

        Args:
            received: A packet that `receive` has given.
        """
        source = received.source
        if not received.packet.abort:
            self._calling.discard(source)
            self._set_obeyed(self._obeyed - {source})
            return False
        if not self.abort_counts:
            self.counts[f"aborts_refused.{source}"] += 1
            return False
        self.counts[f"aborts.{source}"] += 1
        self._calling.add(source)
        if self._abort:
            self._set_obeyed(self._obeyed | {source})
        return source not in self._obeyed

    def _set_obeyed(self, mates: set[int]) -> None:
        if mates != self._obeyed:
            self._obeyed = mates
            self.remember("obeyed", sorted(mates))

    @property
    def abort_counts(self) -> bool:
        """Whether a call to abort is obeyed in this team: it has a tag, or need not have one."""
        return self._tagger is not None or self._config.abort_without_tag

    @property
    def unsent(self) -> int:
        """Samples waiting to be sent."""
        return len(self._in_time_order())

    def _in_time_order(self) -> Array:
        """The unsent samples, with those queued since the last call."""
        if self._queued:
            rows = np.concatenate(self._queued)
            rows = np.column_stack([rows, np.full((len(rows), 2), np.inf)])
            self._queued.clear()
            self._unsent = np.concatenate([self._unsent, rows])
            if (np.diff(self._unsent[:, 0]) < 0.0).any():
                self._unsent = self._unsent[np.argsort(self._unsent[:, 0], kind="stable")]
        return self._unsent

    def set_plan(self, plan: Plan) -> None:
        """Takes the vehicle's current plan, which the next packets carry until another one comes.

        Raises:
            PacketError: (a ValueError) if no packet can hold it; the plan before it stays.
        """
        navigation = _FULL if self._config.navigation else None
        encode(Packet(plan, navigation=navigation), self._limits, self._config.reserve)
        self._plan = plan
        self.remember("plan", dataclasses.asdict(plan))

    def moved(self, raw: DeadReckoning) -> None:
        """The vehicle's raw place."""
        self._ranging.moved(raw)

    def fixed(self, fix: Fix) -> None:
        """The vehicle has taken a fix under way."""
        self._fix = fix
        self.remember("fix", dataclasses.asdict(fix))

    def add_soundings(self, soundings: ArrayLike) -> int:
        """Queues the vehicle's own soundings for sending.

        Some are dropped and counted: as "samples.bad" those with a number that is not finite; as "samples.outside"
        those outside the limits, with which every receiver would refuse the whole packet; as "samples.thinned" those
        nearer to the last queued one than `min_spacing_m`. With `packet.navigation` they are sent at their raw places,
        and those without one are dropped as "samples.unplaced".

        Args:
            soundings: Stamp (s), north, east (m), water depth (m, positive down), in time order, shape (n, 4), or
                (n, 6) with raw north, east (m).

        Returns:
            How many were queued.

        Raises:
            ValueError: if the shape is neither.
        """
        rows = np.asarray(soundings, dtype=float)
        if rows.size == 0:
            return 0
        if rows.ndim != 2 or rows.shape[1] not in (4, 6):
            raise ValueError(
                f"soundings of shape {rows.shape}: expected (n, 4), stamp, north, east, depth, or (n, 6) with raw "
                "north and east"
            )
        if self._config.navigation:
            if rows.shape[1] == 4:
                rows = np.column_stack([rows, np.full((len(rows), 2), np.nan)])
            placed = np.isfinite(rows[:, 4:]).all(axis=1)
            self.counts["samples.unplaced"] += int((~placed).sum())
            rows = rows[placed][:, [0, 4, 5, 3]]
        else:
            rows = rows[:, :4]
        finite = np.isfinite(rows).all(axis=1)
        if not finite.all():
            self.counts["samples.bad"] += int((~finite).sum())
            rows = rows[finite]
        limits = self._limits or Limits()
        inside = limits.hold(rows[:, 1:])
        self.counts["samples.outside"] += int((~inside).sum())
        rows = rows[inside]
        if self._config.min_spacing_m > 0.0:
            rows = self._thinned(rows)
        if not len(rows):
            return 0
        self._queued.append(rows)
        self.counts["samples.queued"] += len(rows)
        self.remember("queued", rows.tolist())
        return len(rows)

    def _thinned(self, rows: Array) -> Array:
        keep = np.zeros(len(rows), dtype=bool)
        for i, (_, north, east, _) in enumerate(rows.tolist()):
            last = self._last_queued
            if last is None or math.hypot(north - last[0], east - last[1]) >= self._config.min_spacing_m:
                keep[i] = True
                self._last_queued = (north, east)
        self.counts["samples.thinned"] += int((~keep).sum())
        return rows[keep]

    def receive(self, now_s: float, source: int, payload: bytes, timing: Timing = UNTIMED) -> Received | None:
        """Reads a payload that the modem received.

        Args:
            now_s: Time (s).
            source: Sender's number according to the modem.
            payload: Any bytes.
            timing: When it was sent and arrived.

        Returns:
            The packet; None if it was refused, which is counted as "rejected.<reason>" (`packet.codec.REASONS`).
        """
        try:
            if source == self.address:
                self.quality.own_number(now_s)
            if source == self.address or not 1 <= source <= self.vehicles:
                raise PacketError("source", f"source {source}: expected a teammate, 1..{self.vehicles}")
            # the content is checked first, so that the tag remembers only packets that were accepted
            packet = decode(payload, self._limits, self._config.reserve)
            if self._tagger is not None:
                near_s = self.tdma.around(now_s, source)
                self._tagger.check(payload, source, near_s, self.tdma.around(now_s, source, _STALE_CYCLES))
            if not self.quality.arrival(now_s, source):
                raise PacketError("excess", f"source {source}: has sent more packets than it has slots")
        except PacketError as error:
            self.counts[f"rejected.{error.reason}"] += 1
            self.quality.refused(now_s, error.reason, source)
            return None
        self._note_heard(source, packet.samples)
        slot_s = None if self._tagger is None else self._tagger.last_slot_s[source]
        self.remember("heard", source, slot_s, packet.samples.tolist())
        told = self._ranging.told(now_s, source, packet.navigation, timing)
        return Received(source=source, stamp_s=now_s, packet=packet, navigation=told)

    def _note_heard(self, source: int, samples: Array) -> None:
        self._heard = True
        self.counts["received"] += 1
        self.counts[f"received.{source}"] += 1
        self.counts["samples.received"] += len(samples)
        if self._receivers is not None and len(samples):
            self._receivers.hear(samples, self.loss)

    def poll(self, now_s: float) -> bytes | None:
        """The packet to send now, at most one in each own slot.

        Call it at least once in every slot. Own slots that end without a packet are counted as
        "slots.missed.<reason>": "plan" (there is no plan yet), "late" (at the first poll in the slot a
        transmission no longer fitted), "asleep" (no poll came in the whole slot), "modem" (see `not_sent`).

        Args:
            now_s: Time (s).

        Returns:
            252 bytes to send at once, or None.
        """
        self._give_up_unconfirmed(now_s)
        slot = self.tdma.slot(now_s)
        if self._slot is None or (slot.index, slot.since_s) != (self._slot.index, self._slot.since_s):
            self._close(slot)
            self._slot, self._why = slot, "late"
            self._used = (slot.index, slot.since_s) == self._last_slot  # a clock set back sends no slot twice
        if self._used or not self.tdma.may_send(now_s):
            return None
        plan = self._nowhere() if self._plan is None and self.abort else self._plan
        if plan is None:
            self._why = "plan"
            return None
        payload, samples = self._compose(plan, slot.start_s, now_s)
        self._used = True
        self._note_sent(now_s, samples, (slot.index, slot.since_s))
        self.remember("sent", now_s, samples[:, :4].tolist(), [slot.index, slot.since_s], self.loss)
        return payload

    def ping(self, now_s: float) -> int | None:
        """The mate to ping now; mostly None (`Ranging.ping`)."""
        mate = self._ranging.ping(now_s, self._last_sent_s, self._last_slot)
        self.counts["pings"] += mate is not None
        return mate

    def ranged(self, now_s: float, source: int, timing: Timing) -> MateNavigation | None:
        """The range to a mate by a ping that it has answered (`Ranging.pinged`); None, and counted, if it is none."""
        found = self._ranging.pinged(now_s, source, timing)
        self.counts["rejected.source" if found is None else "ranges"] += 1
        return found

    def _note_sent(self, now_s: float, samples: Array, slot: tuple[int, float]) -> None:
        self._sent = [*self._sent[1 - _REMEMBERED :], _Sent(now_s, samples, False)]
        self._last_sent_s, self._last_slot = now_s, slot
        self.counts["slots.used"] += 1
        self.counts["sent"] += 1
        self.counts["samples.sent"] += len(samples)

    def confirm(self, sent_s: float) -> None:
        """The modem has sent the packet that `poll` gave out at `sent_s` (s)."""
        for packet in self._sent:
            if abs(packet.then_s - sent_s) < SAME_TIME_S:
                packet.confirmed = True
                self.unconfirmed = 0
                self.remember("confirmed", sent_s)

    def _give_up_unconfirmed(self, now_s: float) -> None:
        for packet in list(self._sent):
            if not packet.confirmed and now_s - packet.then_s > self._confirm_s:
                self.unconfirmed += 1
                self.counts["unconfirmed"] += 1
                self.not_sent(packet.then_s)

    def _close(self, slot: Slot) -> None:
        """Counts the own slots between the last poll and this one."""
        before = self._slot
        if before is None:
            return
        if before.owner not in (0, self.address):
            self.loss += _LOSS_GAIN * ((0.0 if self._heard else 1.0) - self.loss)
        self._heard = False
        if before.owner == self.address and not self._used:
            self.counts[f"slots.missed.{self._why}"] += 1
        if slot.since_s != before.since_s or slot.index <= before.index + 1:
            return  # settings changed, or the clock was set back
        order = self.tdma.settings(slot.start_s).order
        mine = [i for i, owner in enumerate(order) if owner == self.address]
        turns, rest = divmod(slot.index - before.index - 1, len(order))
        asleep = turns * len(mine) + sum((i - before.index - 1) % len(order) < rest for i in mine)
        if asleep:
            self.counts["slots.missed.asleep"] += asleep

    def _compose(self, plan: Plan, slot_s: float, now_s: float) -> tuple[bytes, Array]:
        """The packet sent at `now_s` in the slot that starts at `slot_s` (s), and the rows of `_unsent` in it."""
        if self.abort:  # it goes nowhere
            plan = dataclasses.replace(plan, actions=(), tour=None, naive_path=NONE)
        navigation = self._navigation(now_s)
        room = room_for_samples(plan, self._config.reserve, navigation)
        if self._config.navigation and navigation is None:
            room = 0  # without the raw place, receivers would take raw samples for others
        unsent = self._in_time_order()
        if self._config.selection == "useful" and self._receivers is not None:
            unsent[:, 5] = unsent[:, 4]
            chosen = most_useful(unsent[:, 1:4], room, self._receivers, unsent[:, 4])
            self._receivers.send(self.loss)
        else:
            chosen = every_nth(len(unsent), room)
        packet = Packet(plan, unsent[chosen, 1:4], self.abort, navigation)
        payload = encode(packet, self._limits, self._config.reserve)
        if self._tagger is not None:
            payload = self._tagger.seal(payload, self.address, slot_s)
        self._unsent = np.delete(unsent, chosen, axis=0)
        return payload, unsent[chosen]

    def _nowhere(self) -> Plan:
        """The plan of a call to abort before the first decision: in the middle of what every receiver accepts."""
        limits = self._limits or Limits()
        return Plan.at(0, np.array([0.0, *np.mean([limits.north_m, limits.east_m], axis=1)]), (), NONE)

    def _navigation(self, now_s: float) -> Navigation | None:
        """What this vehicle tells of its navigation; a fix or raw place that does not fit is left out and counted."""
        raw = self._ranging.raw_at_start(now_s) if self._config.navigation else None
        if raw is None:
            return None
        try:
            return Navigation.of(raw, self._fix)
        except ValueError:
            self.counts["navigation.outside"] += 1
        try:
            return Navigation.of(raw, None)
        except ValueError:
            return None

    def not_sent(self, sent_s: float) -> None:
        """The modem did not send a packet: its samples are unsent again, and its slot counts as missed.

        With `packet.selection` "useful" an earlier packet than the last stays counted as known by the receivers.

        Args:
            sent_s: The time at which `poll` gave that packet out (s). A time at which it gave none, or long ago, or a
                packet that was reported before, is passed over.
        """
        found = [i for i, packet in enumerate(self._sent) if abs(packet.then_s - sent_s) < SAME_TIME_S]
        if not found:
            return
        packet = self._sent.pop(found[-1])
        then_s, samples = packet.then_s, packet.samples
        self.remember("not_sent", then_s)
        unsent = np.concatenate([samples, self._in_time_order()])
        self._unsent = unsent[np.argsort(unsent[:, 0], kind="stable")]
        if self._receivers is not None and then_s == self._last_sent_s:
            self._receivers.take_back()
            # computed while this packet's samples counted as known, which they no longer do
            self._unsent[:, 4] = self._unsent[:, 5]
        self.counts["samples.sent"] -= len(samples)
        self.counts["sent"] -= 1
        self.counts["slots.used"] -= 1
        self.counts["slots.missed.modem"] += 1

    # ------------------------------------------------------------------ after a restart

    def recall(self, events: Iterable[Sequence[Any]]) -> None:
        """Goes on from what `remember` was told before a restart. What was sent and not confirmed is given up in time.

        Args:
            events: Kind and values of each, in their order.
        """
        remember, self.remember = self.remember, lambda kind, *values: None
        for kind, *values in events:
            match kind:
                case "queued":
                    self._queued.append(np.array(values[0]))
                    self._last_queued = tuple(values[0][-1][1:3])
                    self.counts["samples.queued"] += len(values[0])
                case "plan":
                    self._plan = Plan.from_mapping(values[0])
                case "fix":
                    self._fix = Fix(**values[0])
                case "heard":
                    source, slot_s, samples = values
                    self._note_heard(source, np.array(samples).reshape(-1, 3))
                    if self._tagger is not None and slot_s is not None:
                        self._tagger.last_slot_s[source] = slot_s
                case "sent":
                    then_s, samples, (index, since_s), self.loss = values
                    self._recall_sent(then_s, np.array(samples).reshape(-1, 4), (index, since_s))
                case "confirmed":
                    self.confirm(values[0])
                case "not_sent":
                    self.not_sent(values[0])
                case "obeyed":
                    self._obeyed = set(values[0])
        self.remember = remember

    def _recall_sent(self, then_s: float, samples: Array, slot: tuple[int, float]) -> None:
        unsent = self._in_time_order()
        gone = set(map(tuple, samples.tolist()))
        mine = np.array([tuple(row) in gone for row in unsent[:, :4].tolist()], dtype=bool)
        rows, self._unsent = unsent[mine], unsent[~mine]
        if self._receivers is not None and self._config.selection == "useful":
            self._receivers.suppose(rows[:, 1:4])
            self._receivers.send(self.loss)
        self._note_sent(then_s, rows, slot)
