"""What the nodes of one vehicle do alike: its number and topics, a journal, and phases, by a timer or in lockstep."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from auv_lse_common.mission_file.parameter_file import merge, nest
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.node.base_node import BaseNode
from auv_lse_common.node.journal import FOLDER_VARIABLE, Journal
from auv_lse_common.node.local_post import POST, Outlet
from auv_lse_common.node.lockstep import PHASES, TICK_ANNOUNCES, Answer, Answers, Ticks
from auv_lse_common.process.processes import vehicle_nodes
from auv_lse_common.topics.quality import EVERY, quality_of
from auv_lse_common.topics.ros_conversions import seconds
from auv_lse_common.topics.table import MISSION_TOPICS, VEHICLE_TOPICS, Topic, reader_count
from auv_lse_common.vocabulary.health import Health, Level
from auv_lse_msgs.msg import LockstepDone, LockstepTick

#: Without lockstep, how often (s) a vehicle's node handles what has come in.
_STEP_PERIOD_S = 0.1
#: Without lockstep, how long (s) a recorded node waits for the recorder before it handles anything: what a node tells
#: before the recorder hears it is in no recording, and a planner decides within 0.2 s of its start. It is looked for at
#: the topics that nobody else reads: a vehicle's other nodes may be away for longer.
_RECORDER_WAIT_S = 3.0


@dataclass(slots=True)
class _Part:
    """What a node does in one phase of a tick, and the tick whose answer it still owes."""

    handle: Callable[[float], None]
    totals: Callable[[], tuple[int, ...]]
    finished: Callable[[], bool]
    owed: int | None = None


class VehicleNode(BaseNode):
    """A node of one vehicle: its topics, and the phases in which it handles what has come in.

    Without lockstep the phases are handled in order every 0.1 s of the node's ROS clock. In lockstep each is handled
    when everything that the tick announces has arrived, and the node then tells its mates what it has published
    (auv_lse_common.node.lockstep).

    Attributes:
        journal: What a restarted node needs to go on. Without lockstep it is kept if the environment names a folder;
            parameters that were changed while the node ran are in it, and hold again.
    """

    def __init__(self, name: str) -> None:
        """Args: name: the node's name, under which auv_lse_common.topics.table lists it as a reader."""
        super().__init__(name)
        if self.lockstep:
            self._time_source.detach_node()  # time comes with the ticks: /clock would only say it once more
        self._role = name
        self._vehicle = self._number()
        self.journal = self._open_journal()
        self._readers: dict[Publisher, int] = {}
        self._recorder_alone: list[Publisher] = []  # publishers that nobody else reads
        self._parts: dict[str, _Part] = {}
        self._ticks: Ticks | None = None
        self._matched = self._greeted = self._at_work = False
        self._mates: dict[str, Outlet] = {}  # in lockstep, who tells a phase's end to the vehicle's other nodes
        if self.lockstep:
            entry = MISSION_TOPICS["/lockstep/done"]
            self._done = self.create_publisher(LockstepDone, "/lockstep/done", quality_of(entry))
            self._readers[self._done] = len(entry.readers)
        self._answers = POST.answers if POST.nodes else Answers()

    @property
    def vehicle(self) -> int:
        """Number of the vehicle, from the namespace (/auv2 -> 2)."""
        return self._vehicle

    def _number(self) -> int:
        namespace = self.get_namespace()
        digits = namespace[len(namespace.rstrip("0123456789")) :]
        if not digits or not 1 <= int(digits) <= 255:
            raise ParameterError(
                f"namespace {namespace!r} of {self.get_name()}: expected one that ends in the vehicle's number, "
                f"as /auv1 (ros2 run ... --ros-args -r __ns:=/auv1)"
            )
        return int(digits)

    def _open_journal(self) -> Journal:
        folder = "" if self.lockstep else os.environ.get(FOLDER_VARIABLE, "")
        path = Path(folder) / f"auv{self._vehicle}.{self._role}.journal" if folder else None
        identity = {"node": self._role, "vehicle": self._vehicle, "parameters": self.parameters}
        journal = Journal(path, identity)
        for kind, *values in journal.records:
            if kind == "tuned":
                self.parameters = merge(self.parameters, nest(values[0]))
                known = [Parameter(key, value=value) for key, value in values[0].items() if self.has_parameter(key)]
                self.set_parameters(known)
        if journal.problem:
            self.get_logger().warning(journal.problem)
        elif journal.records:
            self.get_logger().info(f"journal {path}: {journal.status}")
        return journal

    def note_tuned(self, changed: Mapping[str, Any]) -> None:
        """Enters the changed parameters into the journal."""
        self.journal.write("tuned", dict(changed))

    def with_journal(self, health: Health) -> Health:
        """The node's health, with that of its journal."""
        if not self.journal.status:
            return health
        values = {**health.values, "journal": self.journal.status}
        if not self.journal.problem:
            return dataclasses.replace(health, values=values)
        text = self.journal.problem if health.level is Level.OK else f"{health.text}; {self.journal.problem}"
        return Health(level=max(health.level, Level.WARN), text=text, values=values)

    # ------------------------------------------------------------------ topics

    def publisher(self, kind: type, topic: str) -> Outlet:
        """Where to publish one of the vehicle's topics. In lockstep its readers in other processes are waited for."""
        entry = VEHICLE_TOPICS[topic]
        publisher = self.create_publisher(kind, topic, quality_of(entry))
        outside = [name for name in self._mates_and_simulator() if not self._is_beside(name, entry)]
        readers, recorders = reader_count(entry, outside), self.recorded * entry.recorded
        self._readers[publisher] = readers + recorders
        if recorders and not readers:
            self._recorder_alone.append(publisher)
        return Outlet(publisher, topic, entry, POST)

    def _mates_and_simulator(self) -> list[str]:
        """The nodes that may read the vehicle's topics: those of the vehicle, by its parameters, and the simulator."""
        modem, link = (self.parameters.get(name, {}).get("kind") for name in ("modem", "link"))
        return [*(name for _, name in vehicle_nodes(modem == "micromodem", link == "mavlink")), "sim_node"]

    def _is_beside(self, reader: str, topic: Topic) -> bool:
        """Whether `reader` gets the topic's messages without ROS: in lockstep, from a node in the same process."""
        return self.lockstep and reader in POST.nodes and POST.carries(topic)

    def listen(
        self,
        kind: type,
        topic: str,
        take: Callable[[Any], None],
        *,
        quality: QoSProfile | None = None,
        total: Callable[[Any], int] | None = None,
    ) -> None:
        """Subscribes to one of the vehicle's topics, or takes it from the node beside this one that alone writes it.

        Args:
            kind: Message type.
            topic: A key of `VEHICLE_TOPICS` that has this node among its readers.
            take: Takes each message. In lockstep the message then counts as arrived.
            quality: Quality of service without lockstep, if it is not the topic's own.
            total: In lockstep, how many messages of the topic a message stands for; None: each counts for itself.

        Raises:
            ValueError: if the node is not among the topic's readers: in lockstep nobody would wait for it.
        """
        entry = VEHICLE_TOPICS[topic]
        self._check_reader(topic, entry)
        quality = quality_of(entry) if self.lockstep or quality is None else quality  # lockstep may miss none

        def arrived(message: Any) -> None:
            take(message)
            self.arrived(topic, None if total is None else total(message))
            self.wake()

        self._subscribe(kind, topic, arrived, quality)

    def _subscribe(self, kind: type, topic: str, take: Callable[[Any], None], quality: QoSProfile) -> None:
        if self._is_beside(self._role, VEHICLE_TOPICS[topic]):
            POST.read(topic, take)
        else:
            self.create_subscription(kind, topic, take, quality)

    def _check_reader(self, name: str, topic: Topic) -> None:
        if not any(self._role in reader.split("|") for reader in topic.readers):
            raise ValueError(f"{self._role} reads {name}, but auv_lse_common.topics.table does not list it as a reader")

    # ------------------------------------------------------------------ phases

    def phase(
        self,
        name: str,
        handle: Callable[[float], None],
        totals: Callable[[], tuple[int, ...]] = tuple,
        finished: Callable[[], bool] = lambda: False,
    ) -> None:
        """Adds a phase; the order of the calls is the order in which the phases are handled.

        Args:
            name: A key of `auv_lse_common.node.lockstep.PHASES`.
            handle: Handles what has come in; takes the time (s).
            totals: The phase's own counts, as `LockstepDone.totals`.
            finished: Whether the vehicle's mission is over, as `LockstepDone.finished`.
        """
        self._parts[name] = _Part(handle, totals, finished)
        if self.lockstep and f"lockstep/{name}" in VEHICLE_TOPICS:
            self._mates[name] = self.publisher(LockstepDone, f"lockstep/{name}")
        if PHASES[name].ends_tick:
            self._answers.expect(name)

    def begin(self) -> None:
        """Starts handling the phases; to be called when every topic is wired and every phase added."""
        if not self.lockstep:
            self.when_matched(dict.fromkeys(self._recorder_alone, 1), self._handle_from_now_on, _RECORDER_WAIT_S)
            return
        self._ticks = Ticks(tuple(self._parts))
        self._check_reader("/lockstep/tick", MISSION_TOPICS["/lockstep/tick"])
        self.create_subscription(LockstepTick, "/lockstep/tick", self._on_tick, EVERY)
        for name, entry in VEHICLE_TOPICS.items():
            if name.startswith("lockstep/") and self._role in entry.readers:
                self._subscribe(LockstepDone, name, self._on_done, EVERY)
        self.when_matched(self._readers, self._on_matched)

    def now_s(self) -> float:
        """The mission's time (s): in lockstep that of the last tick, 0 before the first; else the node's ROS clock."""
        if self.lockstep:
            return 0.0 if self._ticks is None else self._ticks.now_s
        return super().now_s()

    def reach_time(self, now_s: float) -> None:
        """Lockstep: a message tells that the mission's time is `now_s` (s) at least; it may overtake its tick."""
        if self._ticks is not None:
            self._ticks.now_s = max(self._ticks.now_s, now_s)

    def arrived(self, topic: str, total: int | None = None) -> None:
        """Lockstep: a message of `topic` is there, or all up to number `total`."""
        if self._ticks is None:
            return
        if total is None:
            self._ticks.arrived(topic)
        else:
            self._ticks.arrived_up_to(topic, total)

    def settled(self) -> bool:
        """Whether the node may answer now for the phases it has handled; hardware may have to answer first."""
        return True

    def owe(self, phase: str) -> None:
        """Lockstep: the last tick's `phase` has to be answered (again), once the node is settled."""
        if self._ticks is not None and self._ticks.last(phase):
            self._parts[phase].owed = self._ticks.last(phase)

    def last_tick(self, phase: str) -> int:
        """Lockstep: number of the last tick whose `phase` was handled; 0 before the first and without lockstep."""
        return 0 if self._ticks is None else self._ticks.last(phase)

    def wake(self) -> None:
        """Something has come in. In lockstep handles each phase that may begin now, and answers for it.

        What it published for the nodes beside this one is handed over then.
        """
        while self._ticks is not None and (ready := self._ticks.ready()) is not None:
            self._ticks.handled(ready.phase, ready.tick)
            part = self._parts[ready.phase]
            part.handle(ready.now_s)
            part.owed = ready.tick
            self._answer()
        self._answer()
        POST.deliver()

    def tell(self, phase: str, tick: int, totals: tuple[int, ...], finished: bool = False) -> None:
        """Lockstep: tells those who wait for it that `phase` of `tick` is handled, with its counts.

        Tick 0 says that the node is there, to the simulator alone.
        """
        answer: Answer | None = Answer(phase=phase, totals=totals, finished=finished)
        if tick and phase in self._mates:
            self._mates[phase].publish(self._done_message(tick, answer))
        if tick:
            answer = self._answers.add(tick, answer) if PHASES[phase].ends_tick else None
        if answer is not None:
            self._done.publish(self._done_message(tick, answer))

    def _done_message(self, tick: int, answer: Answer) -> LockstepDone:
        fields = {"phase": answer.phase, "totals": answer.totals, "finished": answer.finished}
        return LockstepDone(vehicle=self.vehicle, tick=tick, **fields)

    def _answer(self) -> None:
        if self._ticks is None or not self.settled():
            return
        if self._matched and not self._greeted:
            self._greeted = True
            self.tell(next(iter(self._parts)), 0, ())
        for phase, part in self._parts.items():
            if part.owed is not None:
                tick, part.owed = part.owed, None
                self.tell(phase, tick, part.totals(), part.finished())

    def note_at_work(self) -> None:
        """Says once in the log that the node is at work: what it took to start, or to start again, ends here."""
        if not self._at_work:
            self._at_work = True
            self.get_logger().info(f"at work after {time.process_time():.2f} s of processor time")

    def _handle_from_now_on(self) -> None:
        self.create_timer(_STEP_PERIOD_S, self._handle_all)

    def _handle_all(self) -> None:
        self.note_at_work()
        now_s = self.now_s()
        for part in self._parts.values():
            part.handle(now_s)

    def _on_matched(self) -> None:
        self._matched = True
        self.wake()

    def _on_tick(self, message: LockstepTick) -> None:
        announced = (
            message.soundings,
            message.arrivals,
            message.odometries,
            message.odometries,
            message.commands,
            message.dead_reckonings,
            message.fixes,
        )
        totals = {topic: counts[self.vehicle - 1] for topic, counts in zip(TICK_ANNOUNCES, announced, strict=True)}
        self._ticks.begin(message.tick, seconds(message.stamp), totals)
        self.wake()

    def _on_done(self, message: LockstepDone) -> None:
        self._ticks.done(message.phase, message.tick, message.totals)
        self.wake()
