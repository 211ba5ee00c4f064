"""Limits how many bytes of maps and paths are recorded, which grow with the area and with the mission.

They can be recomputed from what is recorded in full: soundings, positions, packets, plans.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from auv_lse_common.topics.table import VEHICLE_TOPICS, Found
from auv_lse_record.message_types import stamp_of

#: Number of held messages of a follower, a topic recorded with another one: more than come while a map is in transit.
_HELD = 24

#: A message to record: topic, bytes.
Kept = tuple[str, bytes]


@dataclass(slots=True)
class _Leader:
    """A rationed topic: when its next message is due, and its newest omitted message with those of its followers.

    `followers` are the newest messages of the topics that are recorded with it, by topic. `states` has the followers
    with revisions, with the stamp of the message recorded last: their last message up to its stamp goes with a message.
    """

    bytes_per_s: float
    due_s: float = -math.inf
    recorded_s: float = -math.inf
    held_s: float = math.nan
    held: list[Kept] = field(default_factory=list)
    followers: dict[str, deque[tuple[float, bytes]]] = field(default_factory=dict)
    states: dict[str, float] = field(default_factory=dict)

    def is_late(self, topic: str, stamp_s: float) -> bool:
        """Whether a follower's message belongs to the message recorded last, and comes after it."""
        return stamp_s == self.recorded_s or self.states.get(topic, math.inf) < stamp_s <= self.recorded_s

    def add(self, topic: str, stamp_s: float, data: bytes) -> None:
        """Queues a follower's message; one that belongs to a held message is held with it."""
        self.followers.setdefault(topic, deque(maxlen=_HELD)).append((stamp_s, data))
        held_s = max((stamp_of(each) for name, each in self.held if name == topic), default=-math.inf)
        if stamp_s == self.held_s or (topic in self.states and held_s < stamp_s <= self.held_s):
            self.held.append((topic, data))

    def going_with(self, stamp_s: float) -> Iterator[Kept]:
        """The followers' messages so far that go with a message of this stamp."""
        for topic, each in self.followers.items():
            last_s = max((s for s, _ in each if s <= stamp_s), default=stamp_s)
            wanted_s = last_s if topic in self.states else stamp_s
            yield from [(topic, data) for s, data in each if s == wanted_s]

    def record(self, stamp_s: float, messages: list[Kept]) -> list[Kept]:
        """Counts the bytes of messages that are recorded; returns the messages."""
        if stamp_s != self.recorded_s:
            self.states = dict.fromkeys(self.states, -math.inf)
        self.recorded_s, self.held_s, self.held = stamp_s, math.nan, []
        for topic, data in messages:
            if topic in self.states:
                self.states[topic] = stamp_of(data)
        self.due_s = max(self.due_s, stamp_s) + sum(len(data) for _, data in messages) / self.bytes_per_s
        return messages


class Ration:
    """Chooses the messages of rationed topics that are recorded.

    The first message is recorded. After a message of n bytes the next one is recorded n / ration seconds later.
    A topic with `recorded_with` is recorded at the stamps of that topic, and its bytes count, too. Of a topic with
    revisions (`total`), which is published when it changes, this is the last message up to that stamp.
    """

    def __init__(self, bytes_per_s: float) -> None:
        """Args: bytes_per_s: rate of a topic with a ration of 1, each vehicle; 0: every message is recorded."""
        self._bytes_per_s = bytes_per_s
        self._leaders: dict[tuple[str, int], _Leader] = {}

    def concerns(self, found: Found | None) -> bool:
        """Whether messages of a topic may be left out."""
        return self._bytes_per_s > 0.0 and found is not None and bool(found.topic.ration or found.topic.recorded_with)

    def take(self, topic: str, found: Found, data: bytes) -> list[Kept]:
        """Adds a message of a topic that is concerned; returns the messages to record now.

        Args:
            topic: Full name.
            data: The message (CDR), beginning with a header.
        """
        row, stamp_s = found.topic, stamp_of(data)
        ration = VEHICLE_TOPICS[row.recorded_with].ration if row.recorded_with else row.ration
        key = (row.recorded_with or row.name, found.vehicle)
        leader = self._leaders.setdefault(key, _Leader(self._bytes_per_s * ration))
        if row.recorded_with:
            if row.total is not None:
                leader.states.setdefault(topic, -math.inf)
            if leader.is_late(topic, stamp_s):
                return leader.record(leader.recorded_s, [(topic, data)])
            leader.add(topic, stamp_s, data)
            return []
        messages = [(topic, data), *leader.going_with(stamp_s)]
        if stamp_s < leader.due_s and stamp_s >= leader.recorded_s:  # earlier than the last: another mission
            leader.held_s, leader.held = stamp_s, messages
            return []
        leader.due_s = stamp_s
        return leader.record(stamp_s, messages)

    def rest(self) -> list[Kept]:
        """The last state of every rationed topic, for the end of a recording."""
        return [kept for leader in self._leaders.values() for kept in leader.held]
