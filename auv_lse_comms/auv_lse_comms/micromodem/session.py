"""The state that the parts of a Micromodem driver share: time and waits, outgoing bytes, and events."""

import math
from collections import Counter

from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_comms.micromodem.events import Event, Problem
from auv_lse_comms.micromodem.sentences.wire import Sentence
from auv_lse_comms.micromodem.state import TRANSITIONS, Cause, State


class Session:
    """The shared state of one driver. Its only decision is when to reopen the port of a silent modem.

    Waits have names. Each runs from its `start`, and all of them restart when the clock is stepped back.

    Attributes:
        address: The modem's address, which is the vehicle's number.
        version: The modem's firmware, "" until it has reported it.
        now_s: Time of the call being handled (s since 1970).
        counts: Event counts by name.
        wants_reopen: Whether the modem is silent and the port must be closed and opened again.
        strikes: Commands in a row without an answer.
    """

    def __init__(self, config: ModemConfig, address: int) -> None:
        self.config = config
        self.address = address
        self.state = State.CLOSED
        self.version = ""
        self.now_s = -math.inf
        self.counts: Counter[str] = Counter()
        self.wants_reopen = False
        self.strikes = 0
        self._numbers = 0
        self._since_s: dict[str, float] = {}
        self._out = bytearray()
        self._events: list[Event] = []

    def move(self, cause: Cause) -> None:
        """Changes the state.

        Raises:
            RuntimeError: if the table of transitions has no such entry.
        """
        try:
            self.state = TRANSITIONS[self.state, cause]
        except KeyError:
            raise RuntimeError(f"no transition from {self.state.name} by {cause.name}") from None

    def next_number(self) -> int:
        """A number for another packet or ping, which the events about it carry."""
        self._numbers += 1
        return self._numbers

    # ------------------------------------------------------------------ time

    def tick(self, now_s: float) -> None:
        """Sets the time."""
        if now_s < self.now_s:  # the clock was stepped back: every running wait restarts
            self.counts["clock_steps"] += 1
            self._since_s = dict.fromkeys(self._since_s, now_s)
        self.now_s = now_s

    def start(self, wait: str, since: str | None = None) -> None:
        """Starts a wait now, or when the wait `since` was started."""
        self._since_s[wait] = self.now_s if since is None else self._since_s[since]

    def waited_s(self, wait: str) -> float:
        """Duration of a wait so far (s); 0 if it was never started."""
        return self.now_s - self._since_s.get(wait, self.now_s)

    # ------------------------------------------------------------------ output

    def write(self, sentence: Sentence) -> None:
        """Queues a sentence for the modem."""
        self._out += sentence.encode()

    def report(self, event: Event) -> None:
        """Queues an event for the owner."""
        self._events.append(event)

    def take_outgoing(self) -> bytes:
        """Removes and returns the bytes queued for the modem."""
        data = bytes(self._out)
        self._out.clear()
        return data

    def take_events(self) -> list[Event]:
        """Removes and returns the events queued for the owner."""
        events, self._events = self._events, []
        return events

    @property
    def activity(self) -> tuple[object, ...]:
        """Changes whenever something was written or reported, or a wait started."""
        waits = tuple(self._since_s.values())
        return (self.state, len(self._out), len(self._events), self.strikes, waits)

    # ------------------------------------------------------------------ answers

    def strike(self) -> None:
        """Counts an answer that did not come in time; after `retries` in a row the port is to be reopened."""
        self.strikes += 1
        self.counts["unanswered"] += 1
        if self.strikes > self.config.retries and not self.wants_reopen:
            self.wants_reopen = True
            self.counts["abandoned"] += 1
            self.report(Problem(text=f"no answer from the modem to {self.strikes} commands: reopening"))
