"""Finds what no kill may cause: a leg decided twice, a counter used again, a lost journal or map.

Nothing here depends on the speed of the machine, on a clock, or on ROS.
"""

import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from auv_lse_common.support.plurals import counted
from auv_lse_comms.packet.tag import TRAILER_BYTES, Tagger
from auv_lse_comms.tdma import Tdma

#: A leg that is published again ends at the same position within this distance (m); a journal keeps all digits.
SAME_LEG_M = 1e-6
_READ_BACK = re.compile(r"journal \S+: ([\d,]+) records? read back(?:, ([\d,]+) damaged)?")


class Ledger:
    """What the nodes of one vehicle have published, and which requirements that violates.

    Attributes:
        broken: Violated requirements, one sentence each.
        last_step: Last step decided; -1 before the first.
        slots: Counters used by the packets: slot (s) and era.
        map_sizes: Soundings in the map, each time that the vehicle has reported them.
    """

    def __init__(self, vehicle: int, tdma: Tdma, tagger: Tagger) -> None:
        """Args: tdma: the team's slots. tagger: with the team's key and session."""
        self.vehicle = vehicle
        self.broken: list[str] = []
        self.slots: set[tuple[float, bytes]] = set()
        self._tdma, self._tagger = tdma, tagger
        self.new_dive()

    def new_dive(self) -> None:
        """Begins a dive: steps count from 0 again."""
        self.last_step = self._last_record = -1
        self._ends_m: dict[int, tuple[float, float]] = {}
        self._recorded: set[int] = set()
        self.map_sizes: list[int] = []

    def take_record(self, step: int) -> None:
        """Adds the record of a decision, which is published once."""
        if step <= self._last_record:
            self.broken.append(f"step {step} decided after step {self._last_record}")
        self._last_record = max(self._last_record, step)
        self.last_step = max(self.last_step, step)
        self._recorded.add(step)

    def take_leg(self, step: int, end_m: tuple[float, float]) -> None:
        """Adds the leg of a step, with its end: north, east (m). A restarted planner publishes its last one again."""
        known_m = self._ends_m.setdefault(step, end_m)
        if max(abs(known_m[0] - end_m[0]), abs(known_m[1] - end_m[1])) > SAME_LEG_M:
            self.broken.append(f"the leg of step {step} was decided twice, with different ends")
        self.last_step = max(self.last_step, step)

    def lost_steps(self, legs: int) -> list[int]:
        """The steps of a mission of `legs` legs without a published leg or record."""
        return sorted(set(range(legs)) - set(self._ends_m) - self._recorded)

    def lost_soundings(self) -> list[int]:
        """How many soundings the map lost, for each time that it had fewer than before."""
        return [before - after for before, after in pairwise(self.map_sizes) if after < before]

    def take_packet(self, stamp_s: float, payload: bytes) -> None:
        """Adds a packet sent at `stamp_s`, which must be in a slot of its sender and have a counter of its own."""
        if self._tdma.slot(stamp_s).owner != self.vehicle:
            self.broken.append(f"a packet at {stamp_s:.2f} s is outside of the vehicle's slots")
        body, tag = payload[: -self._tagger.size], payload[-self._tagger.size :]
        found = self._tagger._slot_of(self.vehicle, body, tag, self._tdma.around(stamp_s, self.vehicle))
        if found is None:
            self.broken.append("a packet's tag is that of no slot")
            return
        key = (found[0], body[-TRAILER_BYTES:][:4] if found[1] else b"")
        if key in self.slots:
            self.broken.append(f"counter {key} used twice")
        self.slots.add(key)


def journal_problem(journal: bytes, log: str, kills: int) -> str:
    """The part of its journal that a restarted node has not read back; "" if it has read everything.

    Args:
        journal: The file just before it was killed.
        log: The node's log since then.
        kills: How often the node has been killed; each kill may tear one line.
    """
    records = sum(map(bool, journal.split(b"\n")[1:]))  # the first line names the mission
    found = _READ_BACK.findall(log)
    read, damaged = (int(number.replace(",", "") or 0) for number in (found[-1] if found else ("", "")))
    if read + damaged < records:
        return f"{read + damaged} of the journal's {counted(records, 'record')} read back"
    return f"{counted(damaged, 'line')} of the journal damaged by {counted(kills, 'kill')}" if damaged > kills else ""


def lost_positions(before_m: ArrayLike, after_m: ArrayLike, within_m: float) -> int:
    """How many of a map's centers (n, 2) have no center (m, 2) of a later map within a distance (m)."""
    before, after = np.reshape(before_m, (-1, 2)), np.reshape(after_m, (-1, 2))
    if not len(before) or not len(after):
        return len(before)
    far_m: Sequence[float] = cKDTree(after).query(before)[0]
    return int(np.count_nonzero(np.asarray(far_m) > within_m))
