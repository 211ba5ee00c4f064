"""What a page has been told of a mission: events in the order in which they became known."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Iterable, Mapping
from typing import Any

Event = dict[str, Any]


class Timeline:
    """An append-only list of events, written by one thread and read by any.

    A page asks for what follows the last event that it has. A new mission begins a new list under a new name, so that
    a page that comes back after a lost connection knows whether it still has the beginning.
    """

    def __init__(self) -> None:
        """Starts without a mission."""
        self._lock = threading.Lock()
        self._events: list[Event] = []
        self._name = uuid.uuid4().hex
        self._state: dict[str, Any] = {}

    def begin(self, facts: Event) -> None:
        """Begins a new mission; `facts` is its first event."""
        with self._lock:
            self._events = [facts]
            self._name = uuid.uuid4().hex

    def add(self, events: Iterable[Event]) -> None:
        """Appends events; their times need not be in order."""
        with self._lock:
            self._events.extend(events)

    def say(self, **state: Any) -> None:
        """Sets what is true of the source now, beside the events: what it is, whether it is still growing."""
        with self._lock:
            self._state = {**self._state, **state}

    @property
    def state(self) -> Mapping[str, Any]:
        """What `say` has set."""
        with self._lock:
            return dict(self._state)

    def since(self, name: str, index: int, most: int) -> tuple[str, int, list[Event]]:
        """The events after those that a page has.

        Args:
            name: The list that the page has a part of; another than the present one means that it has nothing.
            index: How many events it has.
            most: Most events to return.

        Returns:
            The list's name, the index of the first event returned, and at most `most` events.
        """
        with self._lock:
            if name != self._name or not 0 <= index <= len(self._events):
                index = 0
            return self._name, index, self._events[index : index + most]
