"""The events of a mission, in order of arrival."""

import threading
import uuid
from collections.abc import Iterable, Mapping
from typing import Any

Event = dict[str, Any]


class Timeline:
    """An append-only list of events, written by one thread and read by any.

    A page requests the events after its last one. A new mission begins a new list under a new name, so that a page
    that reconnects can decide whether its events are still valid.
    """

    def __init__(self) -> None:
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

    def set_state(self, **state: Any) -> None:
        """Updates the state of the source, which pages get beside the events: kind, whether it still grows, problem."""
        with self._lock:
            self._state = {**self._state, **state}

    @property
    def state(self) -> Mapping[str, Any]:
        """The values that `set_state` has set."""
        with self._lock:
            return dict(self._state)

    def since(self, name: str, index: int, most: int) -> tuple[str, int, list[Event]]:
        """The events that follow those that a page has.

        Args:
            name: The list that the page has; for another name than the current one all events are new.
            index: Number of events that it has.
            most: Maximum number of events to return.

        Returns:
            The list's name, the index of the first event returned, and at most `most` events.
        """
        with self._lock:
            if name != self._name or not 0 <= index <= len(self._events):
                index = 0
            return self._name, index, self._events[index : index + most]
