"""Base class of one vehicle's nodes: vehicle number, topics, journal, and phases run by a timer or in lockstep."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.parameter import Parameter
from rclpy.publisher import Publisher

from auv_lse_common.mission_file.parameters import ParameterError, merge, nest
from auv_lse_common.node.base_node import BaseNode
from auv_lse_common.node.dive import tagged
from auv_lse_common.node.intra_process import INTRA_PROCESS, TopicPublisher
from auv_lse_common.node.journal import FOLDER_VARIABLE, Journal
from auv_lse_common.node.lockstep import Answer, Answers, Ticks
from auv_lse_common.node.periodic import Periodic
from auv_lse_common.node.state_file import NODES, StateFile, open_state
from auv_lse_common.support.free_memory import return_free_memory
from auv_lse_common.topics.quality import reader_quality, writer_quality
from auv_lse_common.topics.records import HealthReport
from auv_lse_common.topics.ros_conversions import encoded, message_class
from auv_lse_common.topics.table import MISSION_TOPICS, PHASES, VEHICLE_TOPICS, Topic, reader_count
from auv_lse_common.vocabulary.health import Health, Level
from auv_lse_common.vocabulary.stamps import seconds
from auv_lse_common.vocabulary.vehicle_nodes import vehicle_nodes
from auv_lse_msgs.msg import LockstepDone, LockstepTick

#: Without lockstep, period (s) at which a vehicle's node handles its messages.
_STEP_PERIOD_S = 0.1
#: Without lockstep, longest wait (s) of a recorded node for the recorder before it handles anything: messages published
#: earlier are in no recording, and a planner decides within 0.2 s of its start. The recorder is looked for on topics
#: that no other node reads: a vehicle's other nodes may be absent for longer.
_RECORDER_WAIT_S = 3.0
#: Without lockstep, period (s) at which a node returns freed memory; getting it again takes milliseconds.
_MEMORY_PERIOD_S = 1.0
#: Without lockstep, period (s) at which a node reports missing topics; it logs them once.
_WAITING_PERIOD_S = 4.0


#: The field of LockstepTick that counts the messages of each topic that the simulator writes.
_TICK_COUNTS = {name: topic.tick_count for name, topic in VEHICLE_TOPICS.items() if topic.tick_count}


@dataclass(slots=True)
class _Handler:
    """A node's work in one phase of a tick, and the tick that it has yet to answer."""

    handle: Callable[[float], None]
    totals: Callable[[], tuple[int, ...]]
    finished: Callable[[], bool]
    unanswered: int | None = None


class VehicleNode(BaseNode):
    """A node of one vehicle: its topics, and the phases in which it handles their messages.

    Without lockstep the phases are handled in order every 0.1 s of the node's ROS clock. In lockstep each is handled
    when every message that the tick announces has arrived, and the node then announces what it has published
    (auv_lse_common.node.lockstep).

    Attributes:
        journal: The data that a restarted node continues from. Without lockstep it is kept if the environment names
            a folder. Parameters that were changed while the node ran are in it, and apply again.
        state: The few values that must survive a restart, beside the journal.
    """

    def __init__(self, name: str, replaced: Collection[str] = ()) -> None:
        """Reads parameters and files.

        Args:
            name: The node's name, under which auv_lse_common.topics.table lists it as a reader.
            replaced: As `Journal` takes it.
        """
        super().__init__(name)
        if self.lockstep:
            self._time_source.detach_node()  # ticks carry the time: /clock would only repeat it
        self._role = name
        self._vehicle = self._vehicle_number()
        self.journal, self.state = self._open_files(replaced)
        self._health = Health(level=Level.OK, text="started")  # last published
        self._storage_problem = ""  # last published
        self._hears_foreign = False  # last published
        self._has_logged_waiting = False
        self._unheard: set[str] = set()  # topics that the node needs and has received nothing on
        self._readers: dict[Publisher, int] = {}
        self._only_recorded: list[Publisher] = []  # publishers that only the recorder reads
        self._handlers: dict[str, _Handler] = {}
        self._memory_returns = Periodic(_MEMORY_PERIOD_S)
        self._ticks: Ticks | None = None
        self._matched = self._has_announced = self._is_ready = False
        self._introduction: Publisher | None = None
        self._introducers: set[str] = set()  # nodes that publish messages of standard types for this one
        # lockstep: where the vehicle's other nodes learn of a phase's end
        self._phase_ends: dict[str, TopicPublisher] = {}
        if self.lockstep:
            topic = MISSION_TOPICS["/lockstep/done"]
            self._done = self.create_publisher(LockstepDone, topic.name, writer_quality(topic))
            self._readers[self._done] = len(topic.readers)
        self._answers = INTRA_PROCESS.answers if INTRA_PROCESS.nodes else Answers()
        self._diagnostics = self.publisher("diagnostics")

    @property
    def vehicle(self) -> int:
        """Number of the vehicle, from the namespace (/auv2 -> 2)."""
        return self._vehicle

    def _vehicle_number(self) -> int:
        namespace = self.get_namespace()
        digits = namespace[len(namespace.rstrip("0123456789")) :]
        if not digits or not 1 <= int(digits) <= 255:
            raise ParameterError(
                f"{self.get_name()}: the namespace {namespace!r} does not end in the vehicle's number, 1 to 255. "
                "Start the node with --ros-args -r __ns:=/auv1"
            )
        return int(digits)

    def _open_files(self, replaced: Collection[str]) -> tuple[Journal, StateFile]:
        """Opens journal and state file, and logs what is wrong with them."""
        folder = "" if self.lockstep else os.environ.get(FOLDER_VARIABLE, "")
        path = Path(folder) / f"auv{self._vehicle}.{self._role}.journal" if folder else None
        identity = {"node": self._role, "vehicle": self._vehicle, "parameters": self.parameters}
        beside = None if path is None or self._role not in NODES else path.with_suffix(".state")
        ran_before = path is not None and os.path.lexists(path)
        state = open_state(beside, identity, os.environ, expected=ran_before)
        journal = Journal(path, identity, replaced)
        for kind, *values in journal.records:
            if kind == "tuned":
                self.parameters = merge(self.parameters, nest(values[0]))
                known = [Parameter(key, value=value) for key, value in values[0].items() if self.has_parameter(key)]
                self.set_parameters(known)
        for problem in (state.lost, state.problem, journal.stale, journal.problem):
            if problem:
                self.get_logger().error(problem)
        if journal.records and not journal.problem:
            self.get_logger().info(f"journal {path}: {journal.status}")
        return journal, state

    def note_tuned(self, changed: Mapping[str, Any]) -> None:
        """Enters the changed parameters into the journal."""
        self.journal.write("tuned", dict(changed))

    def publish_health(self, now_s: float, health: Health, name: str = "") -> None:
        """Publishes the health of a device, `name`, or of this node and its files."""
        if name and self._hears_foreign:  # a driver reports its device's health alone
            self.publish_health(now_s, Health(level=Level.OK, text="ok"))
        if not name:
            self._health, self._storage_problem = health, self._find_storage_problem()
            name, health = self.get_fully_qualified_name(), self._with_problems(health)
        self._diagnostics.publish(
            HealthReport(stamp_s=now_s, name=name, level=health.level, text=health.text, values=health.values)
        )

    def on_foreign_messages(self, text: str) -> None:
        """Reports another dive on the log, on the terminal and, with the node's last health, in the diagnostics."""
        super().on_foreign_messages(text)
        self._hears_foreign = True
        self.publish_health(self.now_s(), self._health)

    def _find_storage_problem(self) -> str:
        return "; ".join(filter(None, (self.state.status, self.journal.stale, self.journal.problem)))

    def _with_problems(self, health: Health) -> Health:
        values = {**health.values, "journal": self.journal.status} if self.journal.status else health.values
        foreign = self.foreign_messages.problems(time.monotonic()).values()
        self._hears_foreign = bool(foreign)
        found = "; ".join(filter(None, (self._storage_problem, *foreign, self._waits_for())))
        if not found:
            return dataclasses.replace(health, values=values)
        text = found if health.level is Level.OK else f"{health.text}; {found}"
        bad = self.state.status or self.journal.stale
        return Health(level=max(health.level, Level.ERROR if bad else Level.WARN), text=text, values=values)

    def _check_storage(self, now_s: float) -> None:
        """Reports immediately that a file cannot be written."""
        found = self._find_storage_problem()
        if found != self._storage_problem:
            if found:
                self.get_logger().error(found)
            self.publish_health(now_s, self._health)

    # ------------------------------------------------------------------ topics

    def publisher(self, name: str) -> TopicPublisher:
        """The publisher of a topic of the vehicle. In lockstep the node waits for its readers in other processes."""
        topic = VEHICLE_TOPICS[name]
        publisher = self.create_publisher(message_class(topic.kind), name, writer_quality(topic))
        outside = [node for node in self._possible_readers() if not self._shares_process(node, topic)]
        readers, recorders = reader_count(topic, outside, self.together), self.recorded * topic.recorded
        self._readers[publisher] = readers + recorders
        if recorders and not readers:
            self._only_recorded.append(publisher)
        if topic.is_standard and topic.readers and not self._introduction:
            self._introduction = self.introduce(self._vehicle)
            self._readers[self._introduction] = reader_count(VEHICLE_TOPICS["dive"], self._possible_readers())
        return TopicPublisher(
            publisher, topic, INTRA_PROCESS, lambda value: tagged(encoded(topic, value, self._vehicle), self.dive)
        )

    def _possible_readers(self) -> list[str]:
        """The nodes that may read the vehicle's topics: those of the vehicle, by its parameters, and the simulator."""
        modem, link = (self.parameters.get(name, {}).get("kind") for name in ("modem", "link"))
        return [*(name for _, name in vehicle_nodes(modem == "micromodem", link == "mavlink")), "sim_node"]

    def _shares_process(self, reader: str, topic: Topic) -> bool:
        """Whether `reader` gets the topic's messages without ROS: in lockstep, from a node in the same process."""
        return self.lockstep and reader in INTRA_PROCESS.nodes and INTRA_PROCESS.carries(topic)

    def _waits_for(self) -> str:
        if self.lockstep or not self._unheard:
            return ""
        return f"waiting for a first message on {', '.join(sorted(self._unheard))}"

    def _report_waiting(self) -> None:
        """Publishes the node's health until everything it needs has arrived; the first call logs what is missing."""
        if text := self._waits_for():
            self.publish_health(self.now_s(), self._health)
            if not self._has_logged_waiting:
                self.get_logger().warning(text)
            self._has_logged_waiting = True
        else:
            self._waiting.cancel()

    def listen(self, name: str, take: Callable[[Any], None], *, raw: bool = False, needed: bool = False) -> None:
        """Subscribes to one of the vehicle's topics, or takes it from the node beside this one that alone writes it.

        Args:
            name: A key of `VEHICLE_TOPICS` that has this node among its readers.
            take: Takes the value of each message. In lockstep the message then counts as arrived. A message that
                cannot be decoded is logged and counts as arrived, too. One of another dive is ignored.
            raw: Whether `take` takes the messages themselves.
            needed: Whether the node reports that it waits for the first message (not in lockstep).

        Raises:
            ValueError: if the table does not list the node as a reader; in lockstep no node would wait for it.
        """
        topic = VEHICLE_TOPICS[name]
        self._check_reader(topic)
        decode = None if raw else topic.decode
        if needed:
            self._unheard.add(name)

        def receive(message: Any, participant: bytes | None = None) -> None:
            if self.ignores(topic, message, participant):
                return
            self._unheard.discard(name)
            try:
                value = message if decode is None else decode(message)
            except ValueError as error:
                self.get_logger().error(f"{name}: {error}")
            else:
                take(value)
            self.arrived(name, None if topic.total is None else topic.total(message))
            self.wake()

        self._subscribe(topic, receive)

    def _subscribe(self, topic: Topic, take: Callable[..., None]) -> None:
        if self._shares_process(self._role, topic):
            INTRA_PROCESS.read(topic.name, take)
            return
        if topic.is_standard:
            if not self._introducers:
                self.get_introduced(self._vehicle, self.wake)
            running = self._possible_readers()
            self._introducers.add(next((name for name in topic.writer.split("|") if name in running), topic.writer))
        if self._role in self.together:
            is_first = not INTRA_PROCESS.has_readers(topic.name)
            INTRA_PROCESS.read(topic.name, take)
            if not is_first:
                return
            take = partial(INTRA_PROCESS.receive, topic.name)
        quality = reader_quality(topic, self.lockstep)
        subscribe = self.subscribe_with_sender if topic.is_standard else self.create_subscription
        subscribe(message_class(topic.kind), topic.name, take, quality)

    def _check_reader(self, topic: Topic) -> None:
        if not any(self._role in reader.split("|") for reader in topic.readers):
            raise ValueError(
                f"{self._role} reads {topic.name}, but auv_lse_common.topics.table does not list it as a reader"
            )

    # ------------------------------------------------------------------ phases

    def phase(
        self,
        name: str,
        handle: Callable[[float], None],
        totals: Callable[[], tuple[int, ...]] = tuple,
        finished: Callable[[], bool] = lambda: False,
    ) -> None:
        """Adds a phase; phases are handled in the order of these calls.

        Args:
            name: A key of `auv_lse_common.topics.table.PHASES`.
            handle: Handles the messages that have arrived; takes the time (s).
            totals: The phase's own counts, as `LockstepDone.totals`.
            finished: Whether the vehicle's mission is over, as `LockstepDone.finished`.
        """
        self._handlers[name] = _Handler(handle, totals, finished)
        if self.lockstep and f"lockstep/{name}" in VEHICLE_TOPICS:
            self._phase_ends[name] = self.publisher(f"lockstep/{name}")
        if PHASES[name].ends_tick:
            self._answers.expect(name)

    def begin(self) -> None:
        """Starts handling the phases; to be called when every topic is wired, every phase added and state restored."""
        if self.journal.records:
            self.journal.drop_records()
            return_free_memory()
        if not self.lockstep:
            self.when_matched(dict.fromkeys(self._only_recorded, 1), self._start_timer, _RECORDER_WAIT_S)
            self._waiting = self.create_timer(_WAITING_PERIOD_S, self._report_waiting)
            return
        self._ticks = Ticks(tuple(self._handlers))
        self._check_reader(MISSION_TOPICS["/lockstep/tick"])
        self._subscribe(MISSION_TOPICS["/lockstep/tick"], self._on_tick)
        for topic in VEHICLE_TOPICS.values():
            if topic.lockstep and self._role in topic.readers:
                self._subscribe(topic, partial(self._on_done, topic))
        self.when_matched(self._readers, self._on_matched)

    def now_s(self) -> float:
        """The mission's time (s): in lockstep that of the last tick, 0 before the first; else the node's ROS clock."""
        if self.lockstep:
            return 0.0 if self._ticks is None else self._ticks.now_s
        return super().now_s()

    def reach_time(self, now_s: float) -> None:
        """Lockstep: a message shows that the mission's time is at least `now_s` (s); it may overtake its tick."""
        if self._ticks is not None:
            self._ticks.now_s = max(self._ticks.now_s, now_s)

    def arrived(self, topic: str, total: int | None = None) -> None:
        """Lockstep: counts an arrived message of `topic`, or all messages up to number `total`."""
        if self._ticks is None:
            return
        if total is None:
            self._ticks.arrived(topic)
        else:
            self._ticks.arrived_up_to(topic, total)

    def settled(self) -> bool:
        """Whether the node may answer now for the phases it has handled; hardware may have to answer first."""
        return True

    def answer_again(self, phase: str) -> None:
        """Lockstep: answers for the last tick's `phase` (again), once the node is settled."""
        if self._ticks is not None and self._ticks.last(phase):
            self._handlers[phase].unanswered = self._ticks.last(phase)

    def last_tick(self, phase: str) -> int:
        """Lockstep: number of the last tick whose `phase` was handled; 0 before the first and without lockstep."""
        return 0 if self._ticks is None else self._ticks.last(phase)

    def wake(self) -> None:
        """A message has arrived. In lockstep handles each phase that may begin now, and answers for it.

        Messages for the nodes in the same process are then delivered.
        """
        while self._ticks is not None and (ready := self._ticks.ready()) is not None:
            self._ticks.handled(ready.phase, ready.tick)
            handler = self._handlers[ready.phase]
            handler.handle(ready.now_s)
            handler.unanswered = ready.tick
            self._answer()
        self._answer()
        INTRA_PROCESS.deliver()

    def announce(self, phase: str, tick: int, totals: tuple[int, ...], finished: bool = False) -> None:
        """Lockstep: announces to those who wait for it that `phase` of `tick` is handled, with its counts.

        Tick 0 announces that the node is there, to the simulator alone.
        """
        answer: Answer | None = Answer(phase=phase, totals=totals, finished=finished)
        if tick and phase in self._phase_ends:
            self._phase_ends[phase].publish_message(self._done_message(tick, answer))
        if tick:
            answer = self._answers.add(tick, answer) if PHASES[phase].ends_tick else None
        if answer is not None:
            self._done.publish(self._done_message(tick, answer))

    def _done_message(self, tick: int, answer: Answer) -> LockstepDone:
        fields = {"phase": answer.phase, "totals": answer.totals, "finished": answer.finished, "dive": self.dive}
        return LockstepDone(vehicle=self.vehicle, tick=tick, **fields)

    def _answer(self) -> None:
        if self._ticks is None or not self.settled():
            return
        if self._matched and not self._has_announced and self._introducers <= self.senders.nodes:
            self._has_announced = True
            self.announce(next(iter(self._handlers)), 0, ())
        for phase, handler in self._handlers.items():
            if handler.unanswered is not None:
                tick, handler.unanswered = handler.unanswered, None
                self.announce(phase, tick, handler.totals(), handler.finished())

    def log_ready(self) -> None:
        """Logs once that the node is ready, and how much processor time its start has taken."""
        if not self._is_ready:
            self._is_ready = True
            self.get_logger().info(f"ready after {time.process_time():.2f} s of processor time")

    def _start_timer(self) -> None:
        self.create_timer(_STEP_PERIOD_S, self._handle_all)

    def _handle_all(self) -> None:
        self.log_ready()
        now_s = self.now_s()
        for handler in self._handlers.values():
            handler.handle(now_s)
        self._check_storage(now_s)
        if self._memory_returns.is_due(clock_s := time.monotonic()):
            self._memory_returns.done(clock_s)
            return_free_memory()

    def _on_matched(self) -> None:
        self._matched = True
        self.wake()

    def _on_tick(self, message: LockstepTick) -> None:
        if self.ignores(MISSION_TOPICS["/lockstep/tick"], message):
            return
        totals = {name: getattr(message, counts)[self.vehicle - 1] for name, counts in _TICK_COUNTS.items()}
        self._ticks.begin(message.tick, seconds(message.stamp), totals)
        self.wake()

    def _on_done(self, topic: Topic, message: LockstepDone) -> None:
        if self.ignores(topic, message):
            return
        self._ticks.done(message.phase, message.tick, message.totals)
        self.wake()
