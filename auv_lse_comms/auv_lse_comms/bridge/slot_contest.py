"""Decides which of several packets of one slot is its sender's, if packets carry no tag.

A vehicle sends one packet in each of its slots, at its start. So of several packets of a slot the sender's own arrives
on time, and no other packet of its track (`mate_tracks.py`) comes in that slot. A packet that is on time and alone is
used at once. Samples and navigation of any other wait until the slot is over. Then the packet that fits best is used,
and the odds of its track rise against those of the others in that slot.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from auv_lse_common.vocabulary.dead_reckoning import MateNavigation
from auv_lse_comms.bridge.mate_tracks import Track
from auv_lse_comms.packet.codec import Packet

#: Packets of a slot that are compared at most; a modem receives fewer.
MAX_CANDIDATES = 16
#: Odds by which a track must be better to decide.
CLEAR_ODDS = 2
#: After a slot with several packets, those of this many slots of the same sender wait for their slot's end.
WARY_SLOTS = 10


@dataclass(slots=True, eq=False)
class Candidate:
    """A packet that may be its sender's packet of a slot.

    Attributes:
        stamp_s: When it was received (s).
        navigation: Its sender's navigation; None if it has none.
        on_time: Whether it arrived when its sender's own packet does.
        within: Whether it is within its sender's packet limit (`LinkQuality.accept_arrival`).
        waits: Whether its samples wait for the end of the slot.
    """

    stamp_s: float
    payload: bytes
    packet: Packet
    navigation: MateNavigation | None
    track: Track
    on_time: bool
    within: bool = True
    waits: bool = True


@dataclass(slots=True)
class _Slot:
    start_s: float = -math.inf
    candidates: list[Candidate] = field(default_factory=list)
    wary: int = 0  # slots whose packets still have to wait


class SlotContest:
    """The packets of the current slot of each sender."""

    def __init__(self) -> None:
        self._slots: dict[int, _Slot] = {}

    def add(self, source: int, start_s: float, candidate: Candidate) -> list[Candidate]:
        """Adds a packet of the slot of `source` that starts at `start_s` (s), and sets whether it `waits`.

        Returns:
            The packets of an earlier slot whose samples have waited and are used now.
        """
        slot = self._slots.setdefault(source, _Slot())
        found = _ended(slot) if start_s != slot.start_s else []
        slot.start_s = start_s
        if len(slot.candidates) < MAX_CANDIDATES and all(candidate.payload != c.payload for c in slot.candidates):
            candidate.waits = not candidate.on_time or bool(slot.candidates) or slot.wary > 0
            slot.candidates.append(candidate)
        return found

    def ended(self, is_over: Callable[[float], bool]) -> list[tuple[int, Candidate]]:
        """Ends the slots of which `is_over` is true, given their start (s).

        Returns:
            Senders and packets whose samples have waited and are used now.
        """
        over = [(source, slot) for source, slot in self._slots.items() if slot.candidates and is_over(slot.start_s)]
        return [(source, candidate) for source, slot in over for candidate in _ended(slot)]


def _ended(slot: _Slot) -> list[Candidate]:
    candidates, slot.candidates = slot.candidates, []
    if not candidates:
        return []
    tracks = list({id(candidate.track): candidate.track for candidate in candidates}.values())
    best = fittest(candidates)
    slot.wary = WARY_SLOTS if len(candidates) > 1 else max(slot.wary - 1, 0)
    for track in tracks:
        if len(tracks) == 1:
            track.add_alone()
        else:
            is_judged = bool(best) and best[0].track.is_known == track.is_known
            track.add_odds((1 if best[0].track is track else -1) if is_judged else 0)
    return [candidate for candidate in best if candidate.waits and (candidate.within or len(best) == 1)]


def fittest(candidates: Sequence[Candidate]) -> list[Candidate]:
    """The packets of a slot that their sender really sent; none if that is uncertain.

    A known track counts before a new one, then a packet on time before others, then one that is its track's only one,
    then one whose track has clearly better odds.
    Late packets of a single track are all of that sender: a modem may deliver several at once.
    """
    pool = [c for c in candidates if c.track.is_known] or list(candidates)
    pool = [c for c in pool if c.on_time] or pool
    if len(pool) > 1:
        pool = [c for c in pool if sum(other.track is c.track for other in candidates) == 1] or pool
    if pool[0].on_time:
        pool = [c for c in pool if c.track.odds > max(other.track.odds for other in pool) - CLEAR_ODDS]
    late = not pool[0].on_time and all(c.track is pool[0].track for c in pool)
    return pool if len(pool) == 1 or late else []
