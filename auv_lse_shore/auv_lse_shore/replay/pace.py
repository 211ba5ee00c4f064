"""Time of a replay as a function of the wall clock, with pauses, steps and rate changes; selection of topics."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from auv_lse_common.topics.table import find_topic
from auv_lse_record.recording import RecordedTopic

#: Topics that carry the mission's time.
CLOCK = "/clock"
#: The rate changes by this factor with each key press, as in `ros2 bag play`.
RATE_STEP = 1.1


class Pace:
    """The recording's time as a function of the wall clock, which comes in as an argument.

    Attributes:
        rate: Seconds of the recording per second of wall clock.
    """

    def __init__(self, start_ns: int, rate: float, wall_s: float, paused: bool = False) -> None:
        """Starts at `start_ns` of the recording, at `wall_s` of the wall clock."""
        self.rate, self.paused = rate, paused
        self._at_ns, self._at_wall_s = start_ns, wall_s

    def now_ns(self, wall_s: float) -> int:
        """The recording's time at `wall_s` of the wall clock."""
        if self.paused:
            return self._at_ns
        return self._at_ns + round((wall_s - self._at_wall_s) * self.rate * 1e9)

    def wait_s(self, stamp_ns: int, wall_s: float) -> float:
        """Wall clock (s) until a message is due; 0 if it is, infinite in a pause."""
        if self.paused:
            return float("inf")
        return max(0.0, (stamp_ns - self.now_ns(wall_s)) * 1e-9 / self.rate)

    def toggle(self, wall_s: float) -> None:
        """Pauses or resumes."""
        self._settle(wall_s)
        self.paused = not self.paused

    def step_to(self, stamp_ns: int, wall_s: float) -> None:
        """Jumps to a message during a pause."""
        self._at_ns, self._at_wall_s = max(self._at_ns, stamp_ns), wall_s

    def change_rate(self, factor: float, wall_s: float) -> None:
        """Multiplies the rate."""
        self._settle(wall_s)
        self.rate *= factor

    def _settle(self, wall_s: float) -> None:
        self._at_ns, self._at_wall_s = self.now_ns(wall_s), wall_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """Topics to play, and topics left out.

    Attributes:
        played: Topics to play, in the recording's order.
        commands: Topics left out because vehicles and modems act on them.
        unknown: Patterns that match no topic.
    """

    played: tuple[RecordedTopic, ...]
    commands: tuple[str, ...]
    unknown: tuple[str, ...]


def select_topics(
    topics: Mapping[str, RecordedTopic], patterns: Sequence[str] | None = None, commands: bool = False
) -> Selection:
    """Chooses the topics to play.

    Args:
        topics: The recording's.
        patterns: Names to choose, with wildcards (`/auv1/*`); None: all. The clock is always played.
        commands: Whether commands are played too.
    """
    wanted = [
        topic
        for name, topic in topics.items()
        if patterns is None or name == CLOCK or any(fnmatchcase(name, pattern) for pattern in patterns)
    ]
    left_out = [] if commands else [topic.name for topic in wanted if is_command(topic.name)]
    return Selection(
        played=tuple(topic for topic in wanted if topic.name not in left_out),
        commands=tuple(left_out),
        unknown=tuple(p for p in patterns or () if not any(fnmatchcase(name, p) for name in topics)),
    )


def is_command(name: str) -> bool:
    """Whether a vehicle or a modem acts on a topic."""
    found = find_topic(name)
    return found is not None and found.vehicle > 0 and found.topic.command


def last_of_each(messages: Iterable[tuple[str, int, bytes]]) -> list[tuple[str, int, bytes]]:
    """The last message of each topic, in order of time, for late readers of latched topics."""
    last = {message[0]: message for message in messages}
    return sorted(last.values(), key=lambda message: message[1])
