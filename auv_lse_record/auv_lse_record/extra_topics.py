"""Selects the topics outside of the stack that are recorded, and limits their size."""

from collections.abc import Sequence
from fnmatch import fnmatchcase

#: Recorded besides the stack's own topics: logs, changed parameters, transforms.
_OF_ROS = ("/rosout", "/parameter_events", "/tf", "/tf_static")
_MB = 1e6


class ExtraTopics:
    """The topics that `record.topics` adds, up to a size.

    Attributes:
        problem: Why their messages are not recorded any further; "" while they are.
    """

    def __init__(self, patterns: Sequence[str], most_mb: float) -> None:
        """Starts with nothing recorded.

        Args:
            patterns: Full names, in which * stands for any text: "/camera/*".
            most_mb: Size (MB) of the messages to record, before compression; 0: no limit.
        """
        self.problem = ""
        self._patterns, self._left, self._most_mb = tuple(patterns), most_mb * _MB, most_mb
        self._bytes: dict[str, int] = {}

    def wants(self, topic: str) -> bool:
        """Whether a topic outside of the stack is recorded."""
        return topic in _OF_ROS or self.concerns(topic)

    def concerns(self, topic: str) -> bool:
        """Whether a topic counts towards the limit."""
        return topic not in _OF_ROS and any(fnmatchcase(topic, pattern) for pattern in self._patterns)

    def take(self, topic: str, size: int) -> bool:
        """Counts a message of `size` bytes; returns whether to record it."""
        if not self._most_mb:
            return True
        self._bytes[topic] = self._bytes.get(topic, 0) + size
        self._left -= size
        if self._left < 0.0 and not self.problem:
            largest = max(self._bytes, key=lambda name: self._bytes[name])
            self.problem = (
                f"the topics of record.topics have reached record.topics_mb = {self._most_mb:g} MB, most of it "
                f"{largest}: their messages are not recorded any further. Everything else is"
            )
        return not self.problem
