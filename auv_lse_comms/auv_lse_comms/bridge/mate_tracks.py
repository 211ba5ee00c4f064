"""Checks whether packets without a tag can come from a mate, given its earlier packets.

Anybody can send in a mate's name. But a vehicle moves steadily, so its packets follow one another: from one to the
next it covers no more ground and no more steps than time allows, and its samples lie along its track.
Packets that follow one another are a *track*. The first track of a sender is trusted at once, another one after
`AGREEING` slots. Each must have been received in at least half as many slots as any other track since it began. So a
vehicle that restarts elsewhere is accepted, even if its first packets were forged. A track forks at two packets of a
slot that one vehicle cannot both have sent. Of tracks with packets in the same slots, those that lose the comparison
(`slot_contest.py`) are not trusted. A forger that follows a mate closely is accepted too.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from auv_lse_common.support.arrays import Array, Mask
from auv_lse_comms.packet.codec import Packet

#: Largest speed, and progress in steps, as a multiple of this vehicle's own: mates may be faster, and currents help.
FASTER = 2.0
#: Margin (m) for dead-reckoned positions, which are continuous, and for positions that a fix or a correction may move.
RAW_SPREAD_M, SPREAD_M = 30.0, 60.0
#: Steps by which a plan may jump ahead, beside those of a surfacing.
AHEAD_STEPS = 4
#: Number of slots after which a track that is not its sender's first is trusted.
AGREEING = 4
#: Largest number of slots that a track counts, and limit of its odds, up and down.
MOST_COUNTED, MOST_ODDS = 20, 3
#: A track with these odds or less is not trusted: it has lost two slots more than it has won.
LOST_ODDS = -2
#: Recent packets of a track that another one may follow: their number, and the time (s) from the first to the last.
RECENT, RECENT_S = 8, 60.0
#: Time (s) between two packets, at least, that show where a track leads.
PACE_S = 10.0
#: Largest numbers of tracks that are kept per sender, and of packets (positions) per track.
MAX_TRACKS, MAX_LOCATIONS = 16, 500
#: A track that was silent for this time (s) is dropped.
SILENT_S = 600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """A mate's assumed speed and timing, from this vehicle's parameters.

    Attributes:
        leg_s: Duration of a leg (s).
        surfacing_steps: Steps that a surfacing takes.
    """

    speed_mps: float
    leg_s: float
    surfacing_steps: int = 0


def speeds_apart(speeds_mps: Sequence[float]) -> str:
    """Names vehicles that would refuse a faster mate's packets without a tag as implausible; "" without any.

    Args:
        speeds_mps: Speeds (m/s) of the team, from vehicle 1.
    """
    fastest = max(range(len(speeds_mps)), key=speeds_mps.__getitem__)
    slow = [k for k, speed in enumerate(speeds_mps) if FASTER * speed < speeds_mps[fastest]]
    if not slow:
        return ""
    return (
        f"vehicle.speed_mps: auv{fastest + 1} ({speeds_mps[fastest]:g} m/s) is more than {FASTER:g} times as fast as "
        f"{', '.join(f'auv{k + 1}' for k in slow)} ({min(speeds_mps):g} m/s), which refuse its packets as implausible. "
        "Set packet.tag: true, or choose closer speeds"
    )


@dataclass(frozen=True, slots=True)
class _Sighting:
    """A packet: its time (s), its plan's step and start (north, east; m), and its dead-reckoned position (m) if it has
    one.

    A plan may be sent unchanged for long, and then be replaced by one far ahead: `plan_since_s` is when it was first
    received.
    """

    now_s: float
    step: int
    start_m: tuple[float, float]
    raw_m: tuple[float, float] | None
    plan_since_s: float

    @property
    def position_m(self) -> tuple[float, float]:
        """Position in the frame of the samples."""
        return self.start_m if self.raw_m is None else self.raw_m


@dataclass(slots=True, eq=False)
class Track:
    """Packets that follow one another; `positions` are their times and positions in the samples' frame, or their
    plans'.

    Attributes:
        count: Slots with at least one of its packets.
        odds: Slots in which it has won against other tracks minus those in which it has lost.
        alone: Slots in which it was the only track, since the last one with others.
        slot_s: Start (s) of the slot of its last packet.
        in_slot: Number of its packets in that slot.
    """

    began_s: float
    first: bool
    count: int = 0
    odds: int = 0
    alone: int = 0
    slot_s: float = math.nan
    in_slot: int = 0
    recent: deque[_Sighting] = field(default_factory=lambda: deque(maxlen=RECENT))
    positions: deque[tuple[float, float, float]] = field(default_factory=lambda: deque(maxlen=MAX_LOCATIONS))

    @property
    def last_s(self) -> float:
        """When its last packet was received (s)."""
        return self.recent[-1].now_s

    @property
    def tips(self) -> list[_Sighting]:
        """Its packets that another one may follow."""
        return [seen for seen in self.recent if self.last_s - seen.now_s <= RECENT_S]

    @property
    def is_known(self) -> bool:
        """Whether it has been received in enough slots that no new track can displace it."""
        return self.count >= AGREEING

    def before_slot(self) -> Track:
        """A copy without the packets of its last slot."""
        recent, positions = list(self.recent)[: -self.in_slot], list(self.positions)[: -self.in_slot]
        copy = replace(self, count=self.count - 1, slot_s=math.nan, in_slot=0)
        copy.recent, copy.positions = deque(recent, RECENT), deque(positions, MAX_LOCATIONS)
        return copy

    def add_odds(self, won: int) -> None:
        """Notes that it has won (1) or lost (-1) a slot against other tracks, or neither (0)."""
        self.odds, self.alone = max(-MOST_ODDS, min(MOST_ODDS, self.odds + won)), 0

    def add_alone(self) -> None:
        """Notes that it was the only track in a slot; its odds are forgotten after `AGREEING` of them."""
        self.alone += 1
        if self.alone >= AGREEING:
            self.odds = 0

    def add(self, seen: _Sighting, slot_s: float) -> None:
        """Adds a packet of the slot that starts at `slot_s` (s)."""
        if slot_s != self.slot_s:
            self.count, self.in_slot = min(self.count + 1, MOST_COUNTED), 0
        self.slot_s, self.in_slot = slot_s, self.in_slot + 1
        self.recent.append(seen)
        self.positions.append((seen.plan_since_s if seen.raw_m is None else seen.now_s, *seen.position_m))


class MateTracks:
    """The tracks of all mates.

    Attributes:
        since_s: When this vehicle began to listen (s); infinite before that.
    """

    def __init__(self, pace: Pace) -> None:
        self.since_s = math.inf
        self._pace = pace
        self._tracks: dict[int, list[Track]] = {}

    def take(self, now_s: float, source: int, packet: Packet, slot_s: float | None = None) -> Track:
        """Adds a packet.

        Args:
            now_s: When it was received (s).
            slot_s: Start (s) of the sender's slot to which it belongs; None: one of its own.

        Returns:
            The track that it continues or begins.
        """
        plan, raw = packet.plan, packet.navigation
        seen = _Sighting(now_s, plan.step, (plan.north_m, plan.east_m), None if raw is None else raw.raw_m, now_s)
        return self._add(source, seen, math.nan if slot_s is None else slot_s)

    def is_trusted(self, source: int, track: Track) -> bool:
        """Whether a track of `source` is probably the mate's own."""
        others = [other for other in self._tracks[source] if other is not track]
        most = max((other.count for other in others if other.last_s >= track.began_s), default=0)
        is_accepted = track.first or track.count >= AGREEING or track.odds > 0
        return is_accepted and 2 * track.count >= most and track.odds > LOST_ODDS

    def _add(self, source: int, seen: _Sighting, slot_s: float) -> Track:
        now_s, self.since_s = seen.now_s, min(self.since_s, seen.now_s)
        tracks = [t for t in self._tracks.get(source, []) if abs(now_s - t.last_s) < SILENT_S]
        tracks.sort(key=lambda track: (track.count, track.last_s), reverse=True)
        self._tracks[source] = tracks
        misfits = [self._misfit_m(track, seen) for track in tracks]
        if math.isfinite(least := min(misfits, default=math.inf)):
            track = tracks[misfits.index(least)]
            rivals = list(track.recent)[-track.in_slot :] if track.slot_s == slot_s else []
            if len(rivals) < len(track.recent) and not all(self._follows(rival, seen) for rival in rivals):
                track = track.before_slot()  # two vehicles: either may be the one seen before
                del tracks[MAX_TRACKS - 1 :]
                tracks.append(track)
        else:
            track = Track(now_s, first=not tracks)
            del tracks[MAX_TRACKS - 1 :]
            tracks.append(track)
        known = [last.plan_since_s for last in track.recent if (last.step, last.start_m) == (seen.step, seen.start_m)]
        track.add(replace(seen, plan_since_s=min(known, default=seen.plan_since_s)), slot_s)
        return track

    def last(self, source: int) -> list[Any]:
        """The last packet of a sender as JSON values, for a journal."""
        seen = max((track.recent[-1] for track in self._tracks[source]), key=lambda seen: seen.now_s)
        return [seen.now_s, seen.step, seen.start_m, seen.raw_m, seen.plan_since_s]

    def recall(self, source: int, values: Sequence[Any], slot_s: float | None = None) -> None:
        """Restores a packet that `last` returned before a restart; `slot_s` as for `take`."""
        now_s, step, start_m, raw_m, plan_since_s = values
        seen = _Sighting(now_s, step, tuple(start_m), None if raw_m is None else tuple(raw_m), plan_since_s)
        self._add(source, seen, math.nan if slot_s is None else slot_s)

    def _misfit_m(self, track: Track, seen: _Sighting) -> float:
        """Distance of a packet from a track's extrapolation plus half of the way since (m); infinite if too far off.

        It may follow any recent packet of the track, because others may be forged.
        """
        found = math.inf
        for last in track.tips:
            if self._follows(last, seen):
                later_s, north_m, east_m = seen.now_s - last.now_s, *last.position_m
                before = [other for other in track.recent if last.now_s - other.now_s >= PACE_S]
                if before:
                    times = later_s / (last.now_s - before[-1].now_s)
                    north_m += times * (north_m - before[-1].position_m[0])
                    east_m += times * (east_m - before[-1].position_m[1])
                way_m = 0.5 * self._pace.speed_mps * abs(later_s)
                found = min(found, math.dist((north_m, east_m), seen.position_m) + way_m)
        return found

    def _follows(self, last: _Sighting, seen: _Sighting) -> bool:
        pace, later_s, plan_s = self._pace, abs(seen.now_s - last.now_s), abs(seen.now_s - last.plan_since_s)
        steps = seen.step - last.step
        if steps > FASTER * plan_s / pace.leg_s + AHEAD_STEPS + pace.surfacing_steps:
            return False
        way_m = FASTER * pace.speed_mps * later_s
        raws_m = last.raw_m, seen.raw_m
        if raws_m[0] is not None and raws_m[1] is not None and math.dist(raws_m[0], raws_m[1]) > way_m + RAW_SPREAD_M:
            return False
        ahead_m = FASTER * pace.speed_mps * pace.leg_s * max(steps, 0)
        plan_way_m = FASTER * pace.speed_mps * plan_s
        return math.dist(last.start_m, seen.start_m) <= max(plan_way_m, ahead_m) + SPREAD_M

    def reachable(self, track: Track, samples: Array) -> Mask:
        """Mask (n,) of samples that the vehicle of a track can have measured.

        They lie between two positions of the track, `since_s` and its first, or its last and now."""
        known = np.array(track.positions)
        first_s = float(known[0, 0])
        speed_mps = FASTER * self._pace.speed_mps
        spread_m = SPREAD_M if track.recent[-1].raw_m is None else RAW_SPREAD_M
        away = np.hypot(samples[:, None, 0] - known[None, :, 1], samples[:, None, 1] - known[None, :, 2])
        possible = (away <= spread_m).any(axis=1) | (away[:, 0] <= speed_mps * (first_s - self.since_s) + spread_m)
        possible |= away[:, -1] <= speed_mps * (track.last_s - known[-1, 0]) + spread_m
        if len(known) > 1:
            way_m = speed_mps * np.abs(np.diff(known[:, 0])) + 2.0 * spread_m
            possible |= (away[:, :-1] + away[:, 1:] <= way_m).any(axis=1)
        return np.asarray(possible)
