"""Lockstep: when each phase of a tick may begin. The phases are in `auv_lse_common.topics.table`.

In lockstep the simulator announces with each tick how many messages it has published so far. Each node announces, with
every phase of the tick that it has handled, how many messages it has published so far. DDS keeps the order of one topic
but not across topics, so a node counts what has arrived and begins a phase only when every announced message is there.
No clock is involved: a run repeats from its seed whatever the order in which the processes run.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

from auv_lse_common.topics.table import announces, waits_for


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """A node's answer to a tick, as in LockstepDone: the phases handled (joined by "+") and their counts."""

    phase: str
    totals: tuple[int, ...]
    finished: bool


class Answers:
    """Combines the answers of one process's phases that end a tick: the simulator waits for all of them anyway.

    A second answer of a phase, or an unexpected one, is passed on at once.
    """

    def __init__(self) -> None:
        """Expects no phase yet."""
        self._expected: list[str] = []
        self._answers: dict[int, dict[str, Answer]] = {}
        self._complete = 0  # the last tick that was answered by all

    def expect(self, phase: str) -> None:
        """Expects an answer of `phase` to every tick."""
        self._expected.append(phase)

    def add(self, tick: int, answer: Answer) -> Answer | None:
        """Takes a phase's answer to `tick`; returns the answer to pass on, None while others are missing."""
        if answer.phase not in self._expected or tick <= self._complete:
            return answer
        told = self._answers.setdefault(tick, {})
        told[answer.phase] = answer
        if len(told) < len(self._expected):
            return None
        self._complete = tick
        del self._answers[tick]
        return Answer(
            phase="+".join(told),
            totals=tuple(total for each in told.values() for total in each.totals),
            finished=any(each.finished for each in told.values()),
        )


def phases_of(answer: Answer) -> Iterator[Answer]:
    """The answers of the single phases in a combined one."""
    totals = iter(answer.totals)
    for phase in answer.phase.split("+"):
        own = tuple(islice(totals, len(announces(phase)) if answer.totals else 0))
        yield Answer(phase=phase, totals=own, finished=answer.finished)


class Gate:
    """Counts arrivals per input and opens for a tick when every announced count has been reached."""

    def __init__(self, inputs: Sequence[str]) -> None:
        """Args: inputs: names of the inputs whose counts must be announced for each tick."""
        self.inputs = tuple(inputs)
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
        announced = self._announced.get(tick, {})
        if len(announced) < len(self.inputs):
            return None
        if any(self._seen[name] < total for name, total in announced.items()):
            return None
        return tick

    def handled(self, tick: int) -> None:
        """`tick` has been handled; the next one may follow."""
        self.tick = tick
        self._announced.pop(tick, None)

    def missing(self) -> dict[str, str]:
        """What the next tick still waits for, for error messages."""
        announced = self._announced.get(self.tick + 1, {})
        return {
            name: f"{self._seen[name]} of {announced.get(name, 'unannounced')}"
            for name in self.inputs
            if name not in announced or self._seen[name] < announced[name]
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Ready:
    """A phase that may begin: its name, the tick's number, and the tick's stamp (s)."""

    phase: str
    tick: int
    now_s: float


class Ticks:
    """The ticks of one node: what was announced, what has arrived, and which of its phases may begin.

    Attributes:
        now_s: Stamp of the last tick announced (s), or a later time that a message carried; 0 before.
    """

    def __init__(self, phases: Sequence[str]) -> None:
        """Args: phases: the node's own phases, keys of `topics.table.PHASES`, in the order in which it handles them."""
        self.now_s = 0.0
        self._gates = {name: Gate(waits_for(name)) for name in phases}
        self._stamps: dict[int, float] = {}

    def begin(self, tick: int, now_s: float, totals: Mapping[str, int]) -> None:
        """The simulator has announced `tick`.

        Args:
            tick: Its number, from 1.
            now_s: Its stamp (s).
            totals: Messages that the simulator has published so far for this vehicle, {topic: number}.
        """
        self._stamps[tick] = now_s
        self.now_s = max(self.now_s, now_s)
        self._announce(tick, totals)

    def done(self, phase: str, tick: int, totals: Sequence[int]) -> None:
        """Another node has handled its `phase` of `tick`; `totals` as in LockstepDone."""
        self._announce(tick, dict(zip(announces(phase), totals, strict=True)))

    def arrived(self, topic: str, number: int = 1) -> None:
        """`number` more messages of `topic` have arrived."""
        for gate in self._gates.values():
            gate.count(topic, number)

    def arrived_up_to(self, topic: str, total: int) -> None:
        """The messages of `topic` up to number `total` have arrived, or a later one that replaces them."""
        for gate in self._gates.values():
            gate.reach(topic, total)

    def ready(self) -> Ready | None:
        """The first phase that may begin now; None if each still waits."""
        for phase, gate in self._gates.items():
            tick = gate.ready()
            if tick is not None and tick in self._stamps:
                return Ready(phase=phase, tick=tick, now_s=self._stamps[tick])
        return None

    def handled(self, phase: str, tick: int) -> None:
        """The node has handled its `phase` of `tick`."""
        self._gates[phase].handled(tick)
        over = min(gate.tick for gate in self._gates.values())
        for old in [number for number in self._stamps if number <= over]:
            del self._stamps[old]

    def last(self, phase: str) -> int:
        """Number of the last tick whose `phase` was handled; 0 before the first."""
        return self._gates[phase].tick

    def _announce(self, tick: int, totals: Mapping[str, int]) -> None:
        for gate in self._gates.values():
            for topic, total in totals.items():
                if topic in gate.inputs:
                    gate.announce(tick, topic, total)
