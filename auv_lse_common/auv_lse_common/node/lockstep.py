"""Lockstep: decides when each phase of a tick may begin (`auv_lse_common.topics.table` lists the phases).

With each tick, the simulator announces the number of messages it has published so far. So does each node with every
phase it has handled. DDS keeps the order within a topic but not across topics, so a node counts arrivals and begins a
phase only when every announced message has arrived. No clock is involved: a run is repeatable from its seed, whatever
the scheduling of the processes.
"""

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
    """Combines the answers of those phases of one process that end a tick, since the simulator waits for all of them.

    Repeated and unexpected answers of a phase are passed on immediately.
    """

    def __init__(self) -> None:
        self._expected: list[str] = []
        self._answers: dict[int, dict[str, Answer]] = {}
        self._complete = 0  # the last tick that all phases have answered

    def expect(self, phase: str) -> None:
        """Expects an answer of `phase` to every tick."""
        self._expected.append(phase)

    def add(self, tick: int, answer: Answer) -> Answer | None:
        """Records a phase's answer to `tick`; returns the answer to pass on, or None while others are missing."""
        if answer.phase not in self._expected or tick <= self._complete:
            return answer
        given = self._answers.setdefault(tick, {})
        given[answer.phase] = answer
        if len(given) < len(self._expected):
            return None
        self._complete = tick
        del self._answers[tick]
        return Answer(
            phase="+".join(given),
            totals=tuple(total for each in given.values() for total in each.totals),
            finished=any(each.finished for each in given.values()),
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
        """Counts `number` arrived messages of input `name`."""
        self._seen[name] += number

    def reach(self, name: str, total: int) -> None:
        """Records that `total` messages of input `name` have arrived, or a revision that replaces them."""
        self._seen[name] = max(self._seen[name], total)

    def announce(self, tick: int, name: str, total: int) -> None:
        """Records that `total` messages of input `name` were published until `tick`."""
        if tick > self.tick:
            self._announced.setdefault(tick, {})[name] = total

    def ready(self) -> int | None:
        """The next tick, if all its announced messages have arrived; else None."""
        tick = self.tick + 1
        announced = self._announced.get(tick, {})
        if len(announced) < len(self.inputs):
            return None
        if any(self._seen[name] < total for name, total in announced.items()):
            return None
        return tick

    def handled(self, tick: int) -> None:
        """Records that `tick` has been handled."""
        self.tick = tick
        self._announced.pop(tick, None)

    def missing(self) -> dict[str, str]:
        """The missing inputs of the next tick, for error messages."""
        announced = self._announced.get(self.tick + 1, {})
        return {
            name: f"{self._seen[name]}{f' of {announced[name]}' if name in announced else ', then nothing'}"
            for name in self.inputs
            if name not in announced or self._seen[name] < announced[name]
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Ready:
    """A phase that may begin: its name, and the tick's number and stamp (s)."""

    phase: str
    tick: int
    now_s: float


class Ticks:
    """The ticks of one node: announcements, arrivals, and the phases that may begin.

    Attributes:
        now_s: Stamp of the last announced tick (s), or a later time in a message; 0 before the first tick.
    """

    def __init__(self, phases: Sequence[str]) -> None:
        """Args: phases: the node's own phases, keys of `topics.table.PHASES`, in the order in which it handles them."""
        self.now_s = 0.0
        self._gates = {name: Gate(waits_for(name)) for name in phases}
        self._stamps: dict[int, float] = {}

    def begin(self, tick: int, now_s: float, totals: Mapping[str, int]) -> None:
        """Records the simulator's announcement of `tick`.

        Args:
            tick: Its number, from 1.
            now_s: Its stamp (s).
            totals: Messages that the simulator has published so far for this vehicle, {topic: number}.
        """
        self._stamps[tick] = now_s
        self.now_s = max(self.now_s, now_s)
        self._announce(tick, totals)

    def done(self, phase: str, tick: int, totals: Sequence[int]) -> None:
        """Records that another node has handled its `phase` of `tick`; `totals` as in LockstepDone."""
        self._announce(tick, dict(zip(announces(phase), totals, strict=True)))

    def arrived(self, topic: str, number: int = 1) -> None:
        """Counts `number` arrived messages of `topic`."""
        for gate in self._gates.values():
            gate.count(topic, number)

    def arrived_up_to(self, topic: str, total: int) -> None:
        """Records that message number `total` of `topic` has arrived, or a later one that replaces it."""
        for gate in self._gates.values():
            gate.reach(topic, total)

    def ready(self) -> Ready | None:
        """The first phase that may begin; None if all phases wait."""
        for phase, gate in self._gates.items():
            tick = gate.ready()
            if tick is not None and tick in self._stamps:
                return Ready(phase=phase, tick=tick, now_s=self._stamps[tick])
        return None

    def handled(self, phase: str, tick: int) -> None:
        """Records that this node has handled its `phase` of `tick`."""
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
