"""One vehicle's side of the acoustic channel: packets with its plan and samples, and the team's packets received.

One `ModemBridge` per vehicle. It reads no clock: `now_s` is the vehicle's own time, and must be the same clock as that
of the TDMA epoch.
"""

import dataclasses
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation
from auv_lse_common.vocabulary.mission_run import RunState, RunStatus
from auv_lse_common.vocabulary.naive_ids import id_in_packet, id_in_plan
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_common.vocabulary.sounding import Sounding, Soundings
from auv_lse_comms.bridge.abort_calls import AbortCalls
from auv_lse_comms.bridge.mate_tracks import MateTracks
from auv_lse_comms.bridge.sample_queue import SampleQueue
from auv_lse_comms.bridge.slot_contest import Candidate, SlotContest
from auv_lse_comms.bridge.slot_usage import SlotUsage
from auv_lse_comms.link_quality import LinkQuality
from auv_lse_comms.packet.codec import Limits, Packet, PacketError, check_plan, decode, encode, room_for_samples
from auv_lse_comms.packet.navigation import MAX_BYTES, Navigation
from auv_lse_comms.packet.tag import TRAILER_BYTES, Tagger
from auv_lse_comms.ranging import SAME_TIME_S, UNTIMED, Ranging, Timing
from auv_lse_comms.tdma import SlotKey, Tdma

#: Number of last packets that the modem may still report as not sent.
_REMEMBERED = 4
#: Kinds of the events that are passed to `ModemBridge.remember`.
EVENTS = ("queued", "plan", "fix", "heard", "sent", "confirmed", "not_sent", "obeyed", "era", "since")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModemFeatures:
    """The features of a modem beyond sending packets.

    Attributes:
        confirm_s: A packet that the modem has not confirmed within this time (s) counts as not sent. Infinite: it
            confirms none, and a packet given out counts as sent.
        second_lead_s: See `Ranging`.
        pings: Whether it pings mates (`ModemBridge.ping`).
        on_air_s: How long it transmits a packet (s).
    """

    confirm_s: float = math.inf
    second_lead_s: float | None = None
    pings: bool = False
    on_air_s: float = 0.0


_PLAIN = ModemFeatures()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Received:
    """A packet of a team mate.

    Attributes:
        source: Number of the sender.
        stamp_s: When it was received (s).
        packet: The sender's plan, and its samples, shape (n, 3).
        navigation: The sender's navigation, with the packet's travel time; None if the packet has none.
        again: Whether it was returned before, without its samples.
    """

    source: int
    stamp_s: float
    packet: Packet
    navigation: MateNavigation | None = None
    again: bool = False


@dataclass(slots=True)
class _Sent:
    """A packet that was given out: when (s), its rows of the sample queue, and whether the modem has confirmed it."""

    then_s: float
    samples: Array
    confirmed: bool


class ModemBridge:
    """Between one vehicle's planner and map, and its modem.

    Attributes:
        remember: Receives each event that a bridge needs after a restart (`recall`): a kind, and JSON values.
        unconfirmed: Number of successive packets that the modem has neither confirmed nor refused.
        abort_calls: This vehicle's own call to abort the mission, and those of its mates.
        tracks: Plausibility check of packets without a tag; None: all are plausible.
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
        modem: ModemFeatures = _PLAIN,
    ) -> None:
        """Starts without a plan and without soundings.

        Args:
            tdma: Slots.
            packet: The content of packets, and the checks of received ones.
            address: Number of this vehicle, from 1, which is its modem's address.
            vehicles: Number of vehicles of the mission.
            limits: What a mission's packets can hold; None: the ranges of the field table.
            key: The team's key (`key.read_key`), required if `packet.tag`.
            modem: The modem's features.

        Raises:
            ValueError: if the key is missing, or the address is not a vehicle.
        """
        if packet.tag and key is None:
            raise ValueError("packet.tag is true, but there is no key")
        self.tdma = Tdma(tdma, address, vehicles)
        self.quality = LinkQuality(self.tdma, address)
        self.address = address
        self.vehicles = vehicles
        self.counts: Counter[str] = Counter()
        self.unconfirmed = 0
        self.remember: Callable[..., None] = lambda kind, *values: None
        self.tracks: MateTracks | None = None
        self._config = packet
        self._limits = limits
        self._tagger = Tagger(key, packet.tag_bytes, packet.session) if packet.tag and key is not None else None
        if self._tagger is not None:
            self._tagger.began = lambda era: self.remember("era", era.hex())
        self.abort_calls = AbortCalls(
            packet.tag or packet.abort_without_tag, self.counts, lambda mates: self.remember("obeyed", mates)
        )
        self._samples = SampleQueue(packet, limits, self.counts)
        self._slots = SlotUsage(self.tdma, self.counts)
        self._ranging = Ranging(self.tdma, modem.second_lead_s, modem.pings)
        self._plan: Plan | None = None
        self._is_aborted = False  # the mission: mates must not count on the rest of the plan
        self._fix: Fix | None = None
        self._sent: list[_Sent] = []  # the last packets
        self._confirm_s, self._on_air_s = modem.confirm_s, modem.on_air_s
        self._contest = SlotContest()
        self._waited: list[tuple[int, Candidate]] = []  # senders and packets whose samples have waited
        self._last_sent_s = math.nan
        self._last_payload: dict[int, bytes] = {}  # last accepted, by sender

    @property
    def loss(self) -> float:
        """Estimated chance that a packet is lost: the share of the others' recent slots without a reception."""
        return self._slots.loss

    @property
    def unsent(self) -> int:
        """Number of samples waiting to be sent."""
        return len(self._samples)

    def set_plan(self, plan: Plan) -> None:
        """Sets the vehicle's current plan, which the next packets carry.

        Raises:
            PacketError: (a ValueError) if no packet can hold it; the previous plan stays.
        """
        reserve = self._config.reserve + (TRAILER_BYTES if self._tagger is not None else 0)
        own, plan = plan.naive_path, dataclasses.replace(plan, naive_path=id_in_packet(plan.naive_path))
        if id_in_plan(plan.naive_path, self.address) != own:
            raise PacketError("naive_path", f"naive_path = {own}: lanes of a strip of another group of vehicles")
        check_plan(plan, self._limits, reserve, MAX_BYTES if self._config.navigation else 0)
        self._plan = plan
        self.remember("plan", dataclasses.asdict(plan))

    def set_run_status(self, status: RunStatus) -> None:
        """Sets the status of the vehicle's mission: an aborted vehicle's packets hold no actions; after a team abort
        they carry the call."""
        self._is_aborted = status.state is RunState.ABORTED
        self.abort_calls.own = status.team_abort

    def set_dead_reckoning(self, raw: DeadReckoning) -> None:
        """Sets the vehicle's dead-reckoned position."""
        self._ranging.set_dead_reckoning(raw)

    def set_fix(self, fix: Fix) -> None:
        """Sets the last fix that the vehicle has taken under way."""
        self._fix = fix
        self.remember("fix", dataclasses.asdict(fix))

    def add_soundings(self, soundings: ArrayLike | Soundings | Sequence[Sounding]) -> int:
        """Queues the vehicle's own soundings for sending.

        With `packet.navigation` their dead-reckoned positions are sent. Unusable soundings are dropped and counted:
        "samples.bad" have a number that is not finite; "samples.outside" are outside the limits, with which every
        receiver would refuse the whole packet; "samples.unplaced" lack a dead-reckoned position that
        `packet.navigation` needs.

        Args:
            soundings: Soundings in time order, or rows as `Soundings.from_rows` reads them.

        Returns:
            How many were queued.

        Raises:
            ValueError: if the rows have another number of columns.
        """
        rows = self._samples.add(soundings)
        if len(rows):
            self.remember("queued", rows.tolist())
        return len(rows)

    def receive(self, now_s: float, source: int, payload: bytes, timing: Timing = UNTIMED) -> Received | None:
        """Reads a payload that the modem received.

        Args:
            source: Sender's number according to the modem.
            payload: Any bytes.
            timing: When it was sent and arrived.

        Returns:
            The packet; None if it was refused, which is counted as "rejected.<reason>" (`packet.codec.REASONS`).
        """
        try:
            if source == self.address:
                self.quality.note_own_number(now_s)
            if source == self.address or not 1 <= source <= self.vehicles:
                raise PacketError(
                    "source", f"source {source} is not a team mate; they are 1..{self.vehicles}, without this vehicle"
                )
            reserve = 0
            if self._tagger is not None:
                near_s = self.tdma.around(now_s, source)
                reserve = self._tagger.accept(payload, source, near_s, self.tdma.other_slots(now_s, source))
            packet = decode(payload, self._limits, reserve)
            naive_path = id_in_plan(packet.plan.naive_path, source)
            packet = dataclasses.replace(packet, plan=dataclasses.replace(packet.plan, naive_path=naive_path))
            navigation = self._ranging.mate_navigation(now_s, source, packet.navigation, timing)
            candidate = self._candidate(now_s, source, payload, packet, navigation)
            if not self.quality.accept_arrival(now_s, source):
                is_echo = candidate is None or payload == self._last_payload.get(source)
                if candidate is not None:
                    candidate.within = False
                if is_echo or not self.quality.accept_candidate(now_s, source):
                    raise PacketError("excess", f"source {source} has sent more packets than it has slots")
            if candidate is not None:
                packet = self._possible(candidate)
                if candidate.waits:
                    packet, navigation = dataclasses.replace(packet, samples=packet.samples[:0]), None
        except PacketError as error:
            self.counts[f"rejected.{error.reason}"] += 1
            self.quality.note_refusal(now_s, error.reason, source, error.clock_s)
            return None
        self._last_payload[source] = payload
        self._note_heard(source, len(packet.samples))
        slot_s, era = None, b""
        if self._tagger is not None:
            slot_s, era = self._tagger.last_slot_s[source], self._tagger.eras[source]
        seen = None if self.tracks is None else self.tracks.last(source)
        self.remember("heard", source, slot_s, len(packet.samples), era.hex(), seen)
        return Received(source=source, stamp_s=now_s, packet=packet, navigation=navigation)

    def _candidate(
        self, now_s: float, source: int, payload: bytes, packet: Packet, navigation: MateNavigation | None
    ) -> Candidate | None:
        """Compares a packet with others of its sender (`tracks`, `SlotContest`); None if packets have tags."""
        if self.tracks is None:
            return None
        slot_s, on_time = self.quality.slot_of(now_s, source, self._on_air_s)
        track = self.tracks.take(now_s, source, packet, slot_s)
        candidate = Candidate(now_s, payload, packet, navigation, track, on_time)
        self._waited += [(source, waited) for waited in self._contest.add(source, slot_s, candidate)]
        if not self.tracks.is_trusted(source, candidate.track):
            raise PacketError("implausible", f"source {source}: position or step does not follow its last packets")
        return candidate

    def _possible(self, candidate: Candidate) -> Packet:
        """The packet without samples that its sender cannot have measured."""
        assert self.tracks is not None
        packet = candidate.packet
        possible = self.tracks.reachable(candidate.track, packet.samples)
        self.counts["samples.implausible"] += int((~possible).sum())
        return packet if possible.all() else dataclasses.replace(packet, samples=packet.samples[possible])

    def waited(self) -> list[Received]:
        """Packets without a tag that have waited for the end of their slot, with their samples; each once."""
        waited, self._waited = self._waited, []
        found = []
        for source, candidate in waited:
            if self.tracks is not None and self.tracks.is_trusted(source, candidate.track):
                packet = dataclasses.replace(self._possible(candidate), abort=False)
                self.counts["samples.received"] += len(packet.samples)
                stamp_s, navigation = candidate.stamp_s, candidate.navigation
                again = Received(source=source, stamp_s=stamp_s, packet=packet, navigation=navigation, again=True)
                found.append(again)
        return found

    def _note_heard(self, source: int, samples: int) -> None:
        self._slots.heard()
        self.counts["received"] += 1
        self.counts[f"received.{source}"] += 1
        self.counts["samples.received"] += samples

    def must_abort(self, received: Received) -> bool:
        """Records an accepted packet's call to abort, if it has one; returns whether this vehicle must abort."""
        return not received.again and self.abort_calls.take(received.source, received.packet.abort)

    def poll(self, now_s: float) -> bytes | None:
        """The packet to send now, at most one in each own slot.

        Call it at least once in every slot. Own slots that end without a packet are counted as
        "slots.missed.<reason>": "plan" (there is no plan yet), "late" (at the first poll in the slot a
        transmission no longer fitted), "asleep" (no poll came in the whole slot), "modem" (see `not_sent`).

        Returns:
            252 bytes to send at once, or None.
        """
        self._requeue_unconfirmed(now_s)
        if self.tracks is not None and math.isinf(self.tracks.since_s):
            self.tracks.since_s = now_s
            self.remember("since", now_s)
        self._waited += self._contest.ended(lambda start_s: now_s >= start_s + self.tdma.settings(start_s).slot_s)
        slot = self.tdma.slot(now_s)
        self._slots.enter(slot)
        if self._slots.used or not self.tdma.may_send(now_s):
            return None
        if self._tagger is not None and slot.start_s == self._tagger.sealed_s:  # by an earlier process
            self._slots.used = True
            return None
        aborted = self._is_aborted or self.abort_calls.own
        plan = self._abort_plan() if self._plan is None and aborted else self._plan
        if plan is None:
            self._slots.reason = "plan"
            return None
        payload, samples = self._compose(plan, slot.start_s, now_s)
        self._slots.used = True
        self._note_sent(now_s, samples, slot.key)
        self.remember("sent", now_s, samples.tolist(), list(slot.key), self.loss)
        return payload

    def counters(self) -> dict[str, Any]:
        """The state of authentication and of obeyed aborts that must survive a restart, as JSON values.

        A packet from `poll` may be given to the modem once they are on the disk.
        """
        tags = {} if self._tagger is None else self._tagger.snapshot()
        return {"tags": tags, "obeyed": sorted(self.abort_calls.obeyed)}

    def restore_counters(self, values: Mapping[str, Any]) -> None:
        """Continues from `counters`; call it after `recall`."""
        if self._tagger is not None and values["tags"]:
            self._tagger.restore(values["tags"])
        self.abort_calls.obeyed = set(values["obeyed"])

    def begin_era(self) -> None:
        """Starts a new era, because the record of used slots may be lost."""
        if self._tagger is not None:
            self._tagger.begin_era(anew=True)

    def ping(self, now_s: float) -> int | None:
        """The mate to ping now; mostly None (`Ranging.ping`)."""
        mate = self._ranging.ping(now_s, self._last_sent_s, self._slots.last)
        self.counts["pings"] += mate is not None
        return mate

    def ranged(self, now_s: float, source: int, timing: Timing) -> MateNavigation | None:
        """The range to a mate that answered a ping (`Ranging.ping_range`); None, and counted, if it is unusable."""
        found = self._ranging.ping_range(now_s, source, timing)
        self.counts["rejected.source" if found is None else "ranges"] += 1
        return found

    def _note_sent(self, now_s: float, samples: Array, slot: SlotKey) -> None:
        self._sent = [*self._sent[1 - _REMEMBERED :], _Sent(now_s, samples, False)]
        self._last_sent_s = now_s
        self._slots.sent(slot)
        self.counts["sent"] += 1
        self.counts["samples.sent"] += len(samples)

    def confirm(self, sent_s: float) -> None:
        """Records that the modem has sent the packet that `poll` gave out at `sent_s` (s)."""
        for packet in self._sent:
            if abs(packet.then_s - sent_s) < SAME_TIME_S:
                packet.confirmed = True
                self.unconfirmed = 0
                self.remember("confirmed", sent_s)

    def _requeue_unconfirmed(self, now_s: float) -> None:
        for packet in list(self._sent):
            if not packet.confirmed and abs(now_s - packet.then_s) > self._confirm_s:
                self.unconfirmed += 1
                self.counts["unconfirmed"] += 1
                self.not_sent(packet.then_s)

    def not_sent(self, sent_s: float) -> None:
        """The modem did not send a packet: its samples are requeued, and its slot counts as missed.

        Args:
            sent_s: Time at which `poll` gave that packet out (s). It is ignored if no packet was given out then, or
                long ago, or if the packet was reported before.
        """
        found = [i for i, packet in enumerate(self._sent) if abs(packet.then_s - sent_s) < SAME_TIME_S]
        if not found:
            return
        packet = self._sent.pop(found[-1])
        self.remember("not_sent", packet.then_s)
        self._samples.put_back(packet.samples)
        self.counts["samples.sent"] -= len(packet.samples)
        self.counts["sent"] -= 1
        self.counts["slots.used"] -= 1
        self.counts["slots.missed.modem"] += 1

    def _compose(self, plan: Plan, slot_s: float, now_s: float) -> tuple[bytes, Array]:
        """The packet sent at `now_s` in the slot that starts at `slot_s` (s), and its rows of the sample queue."""
        abort = self.abort_calls.own
        if abort or self._is_aborted:
            reached = plan.quality_reached and not abort
            plan = dataclasses.replace(plan, actions=(), tour=None, naive_path=NONE, quality_reached=reached)
        navigation = self._navigation(now_s)
        reserve = 0
        if self._tagger is not None:
            self._tagger.enter(slot_s)
            reserve = self._tagger.reserve
        room = room_for_samples(plan, reserve, navigation)
        if self._config.navigation and navigation is None:
            room = (
                0  # without a dead-reckoned position in the packet, receivers would not take the samples for raw ones
            )
        samples = self._samples.take(room)
        payload = encode(Packet(plan, samples[:, 1:4], abort, navigation), self._limits, reserve)
        if self._tagger is not None:
            payload = self._tagger.seal(payload, self.address, slot_s)
        return payload, samples

    def _abort_plan(self) -> Plan:
        """The plan of a call to abort before the first decision: the middle of the area, which no receiver refuses."""
        limits = self._limits or Limits()
        return Plan.at(0, np.array([0.0, *np.mean([limits.north_m, limits.east_m], axis=1)]), (), NONE)

    def _navigation(self, now_s: float) -> Navigation | None:
        """The packet's navigation; a fix or dead-reckoned position that does not fit is left out and counted."""
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

    def recall(self, events: Iterable[Sequence[Any]]) -> None:
        """Restores the state from the events passed to `remember` before a restart.

        A packet that was sent and not confirmed is requeued after `confirm_s`.

        Args:
            events: Kind and values of each, in their order.
        """
        remember, self.remember = self.remember, lambda kind, *values: None
        for kind, *values in events:
            match kind:
                case "queued":
                    self._samples.restore(np.array(values[0]))
                case "plan":
                    self._plan = Plan.from_mapping(values[0])
                case "fix":
                    self._fix = Fix(**values[0])
                case "heard":
                    source, slot_s, samples, era, seen = values
                    self._note_heard(source, samples)
                    if self._tagger is not None and slot_s is not None:
                        self._tagger.last_slot_s[source], self._tagger.eras[source] = slot_s, bytes.fromhex(era)
                    if self.tracks is not None and seen is not None:
                        self.tracks.recall(source, seen, self.quality.slot_of(seen[0], source, 0.0)[0])
                case "sent":
                    then_s, samples, (index, since_s), self._slots.loss = values
                    rows = self._samples.restore_taken(np.array(samples).reshape(-1, 4))
                    self._note_sent(then_s, rows, (index, since_s))
                    if self._tagger is not None:
                        self._tagger.sealed_s = self.tdma.slot(then_s).start_s
                case "confirmed":
                    self.confirm(values[0])
                case "not_sent":
                    self.not_sent(values[0])
                case "obeyed":
                    self.abort_calls.obeyed = set(values[0])
                case "era":
                    if self._tagger is not None:
                        self._tagger.era = bytes.fromhex(values[0])
                case "since":
                    if self.tracks is not None:
                        self.tracks.since_s = values[0]
        self.remember = remember
