"""The lockstep gate: may a node handle a tick yet?

In lockstep the simulator announces with each tick how many messages it has published so far, and each node
announces how many it has. DDS keeps the order of one topic but not across topics, so a node counts what has
arrived and handles the tick only when every announced message is here. No clock is involved: a run repeats
from its seed however the processes are scheduled.
"""

from __future__ import annotations

from collections import Counter


class Gate:
    """Counts arrivals per input and opens for a tick when every announced count has been reached."""

    def __init__(self, inputs: tuple[str, ...]) -> None:
        """Args: inputs: names of the inputs whose counts must be announced for each tick."""
        self._inputs = inputs
        self._seen: Counter[str] = Counter()
        self._announced: dict[int, dict[str, int]] = {}
        self.tick = 0  # last tick handled

    def count(self, name: str, number: int = 1) -> None:
        """One more message (or `number`) of input `name` has arrived."""
        self._seen[name] += number

    def reach(self, name: str, total: int) -> None:
        """`total` messages of input `name` have arrived by now, or a revision that stands for as many."""
        self._seen[name] = max(self._seen[name], total)

    def announce(self, tick: int, name: str, total: int) -> None:
        """For `tick`, `total` messages of input `name` have been published since the start."""
        if tick > self.tick:
            self._announced.setdefault(tick, {})[name] = total

    def ready(self) -> int | None:
        """The next tick to handle, if everything it announces has arrived; else None."""
        tick = self.tick + 1
        announced = self._announced.get(tick)
        if announced is None or len(announced) < len(self._inputs):
            return None
        if any(self._seen[name] < total for name, total in announced.items()):
            return None
        return tick

    def handled(self, tick: int) -> None:
        """`tick` has been handled; the next one may follow."""
        self.tick = tick
        self._announced.pop(tick, None)

    def missing(self) -> dict[str, str]:
        """For messages to people: what the next tick still waits for."""
        announced = self._announced.get(self.tick + 1, {})
        return {
            name: f"{self._seen[name]} of {announced.get(name, 'unannounced')}"
            for name in self._inputs
            if name not in announced or self._seen[name] < announced[name]
        }
