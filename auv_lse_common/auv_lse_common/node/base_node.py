"""Base of all nodes: checked and declared parameters, steady timers, waiting for readers."""

from __future__ import annotations

import array
import math
import os
import time
from collections.abc import Callable, Mapping
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from auv_lse_common.mission_file.parameters import describe, flatten, merge, nest, to_mapping
from auv_lse_common.mission_file.sections.table import check_sections
from auv_lse_common.node.dive import ForeignMessages, own_dive
from auv_lse_common.node.heartbeat import Heartbeat
from auv_lse_common.node.intra_process import TOGETHER_VARIABLE
from auv_lse_common.node.senders import Senders, take_with_sender
from auv_lse_common.topics.quality import LATCHED_READER, writer_quality
from auv_lse_common.topics.ros_conversions import header, message_class
from auv_lse_common.topics.table import VEHICLE_TOPICS, Topic, full_name
from auv_lse_common.vocabulary.health import NewProblems
from auv_lse_common.vocabulary.vehicle_nodes import vehicle_nodes

#: A clock that is never set back.
_STEADY = Clock(clock_type=ClockType.STEADY_TIME)

_ROS_OWN = ("use_sim_time", "start_type_description_service", "qos_overrides")
#: Period (s) at which a waiting node checks for its readers.
_MATCHED_PERIOD_S = 0.05
#: In lockstep, wall clock (s) without a simulator after which a node warns, and how often it looks before that (s).
_NO_SIMULATOR_S, _LOOK_S = 30.0, 1.0


class BaseNode(Node):
    """A node whose parameters are checked against the mission file's sections and are all declared.

    Attributes:
        where: Origin of its parameters, for error messages.
        parameters: Its parameters, nested by section.
        dive: Id of the dive or simulation that it belongs to; "" if it was started by hand.
        foreign_messages: Number of ignored messages of other dives.
        gather_s: Time (s) for which messages are collected and then handled together, which costs less.
    """

    gather_s = 0.0

    def __init__(self, name: str) -> None:
        """Reads the node's parameters; rejects unknown top-level sections."""
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        self.dive = own_dive()
        self.foreign_messages, self._new_foreign = ForeignMessages(self.dive), NewProblems()
        self.senders = Senders(self.dive)
        self.where = f"parameters of {self.get_fully_qualified_name()}"
        flat = {key: p.value for key, p in self.get_parameters_by_prefix("").items()}
        own = {key: _plain(v) for key, v in flat.items()}
        self.parameters = nest({k: v for k, v in own.items() if k.split(".")[0] not in _ROS_OWN})
        check_sections(self.parameters, self.where)
        self._tunable: tuple[str, ...] = ()
        self._apply: Callable[[dict[str, Any]], None] | None = None
        if self.lockstep:
            self._alone_since_s = time.monotonic()
            self._simulator_check = self.create_timer(_LOOK_S, self._look_for_simulator)

    def create_timer(self, timer_period_sec: float, callback: Callable[[], None], *others: Any, **options: Any) -> Any:
        """A timer on a steady clock; on the system's clock it would stop when that is set back."""
        options.setdefault("clock", _STEADY)
        return super().create_timer(timer_period_sec, callback, *others, **options)

    def _look_for_simulator(self) -> None:
        """Lockstep: warns once if no simulator appears; one that ends later is no reason to warn."""
        if self.count_publishers("/lockstep/tick"):
            self._simulator_check.cancel()
        elif time.monotonic() - self._alone_since_s >= _NO_SIMULATOR_S:
            self._simulator_check.cancel()
            self.get_logger().warning(
                f"no simulator for {_NO_SIMULATOR_S:g} s although sim.lockstep is true: this node waits for a tick. "
                "On a vehicle, set sim.lockstep: false (or leave out the section sim)."
            )

    @property
    def lockstep(self) -> bool:
        """Whether the simulator drives this node tick by tick (`sim.lockstep`)."""
        return bool(self.parameters.get("sim", {}).get("lockstep", False))

    @property
    def together(self) -> frozenset[str]:
        """Names of the nodes that share a process in each vehicle; empty where each has a process of its own."""
        is_shared = self.lockstep and os.environ.get(TOGETHER_VARIABLE) == "1"
        return frozenset(name for _, name in vehicle_nodes(modem=False, link=False)) if is_shared else frozenset()

    @property
    def recorded(self) -> int:
        """Number of recorders in this mission: 1 if `record.folder` is set, else 0."""
        return int(bool(self.parameters.get("record", {}).get("folder", "")))

    def introduce(self, vehicle: int) -> Publisher:
        """Introduces this node to the readers of the messages of standard types that it publishes for a vehicle.

        Returns:
            The publisher, whose readers must be there before these messages are published.
        """
        topic = VEHICLE_TOPICS["dive"]
        kind, name = message_class(topic.kind), full_name(topic, vehicle)
        publisher = self.create_publisher(kind, name, writer_quality(topic))
        publisher.publish(kind(header=header(self.now_s()), dive=self.dive, node=self.get_name()))
        return publisher

    def get_introduced(self, vehicle: int, then: Callable[[], None] = lambda: None) -> None:
        """Reads the introductions of the nodes that publish for a vehicle; calls `then` after each."""
        topic = VEHICLE_TOPICS["dive"]

        def receive(message: Any, participant: bytes = b"") -> None:
            self.senders.introduce(message, participant)
            then()

        name, kind = full_name(topic, vehicle), message_class(topic.kind)
        self.subscribe_with_sender(kind, name, receive, LATCHED_READER)

    def subscribe_with_sender(
        self, kind: type, name: str, receive: Callable[..., None], quality: QoSProfile, *, raw: bool = False
    ) -> Subscription:
        """Subscribes to a topic; `receive` takes a message, and, from `StandingExecutor`, its sender's participant."""
        return take_with_sender(self.create_subscription(kind, name, receive, quality, raw=raw))

    def ignores(self, topic: Topic, message: Any, participant: bytes | None = None) -> bool:
        """Whether a message must be ignored, because another dive has sent it, or may have.

        Args:
            participant: The participant of the ROS domain that has sent it; None: unknown.
        """
        if hasattr(message, "dive"):
            return self.ignores_dive(topic, message.dive)
        sender = self.senders.sender_of(message.header.frame_id, participant, time.monotonic())
        return sender is None or self.ignores_dive(topic, sender)

    def ignores_dive(self, topic: Topic, sender: str) -> bool:
        """Whether a message of a dive must be ignored; reports a dive that was not present before.

        Args:
            sender: Its id.
        """
        now_s = time.monotonic()
        if not self.foreign_messages.ignores(topic, sender, now_s):
            return False
        for text in self._new_foreign.of(self.foreign_messages.problems(now_s)):
            self.on_foreign_messages(text)
        return True

    def on_foreign_messages(self, text: str) -> None:
        """Reports another dive on the log and on the terminal of the command that has started the node."""
        self.get_logger().warning(text)
        self.report_on_terminal(f"{self.get_fully_qualified_name()}: {text}")

    def report_on_terminal(self, text: str) -> None:
        """Prints a line on the terminal of the command that has started the node."""
        Heartbeat(os.environ).report(text)

    def now_s(self) -> float:
        """Time of the node's ROS clock (s)."""
        return self.get_clock().now().nanoseconds * 1e-9

    def when_matched(
        self, readers: Mapping[Publisher, int], then: Callable[[], None], patience_s: float = math.inf
    ) -> None:
        """Calls `then` once each publisher has at least its number of matched readers (discovery takes up to 3 s).

        Args:
            readers: The number of readers each publisher waits for.
            then: Called once.
            patience_s: Wall clock (s) after which `then` is called without the missing readers.
        """
        checks = 0

        def check() -> None:
            nonlocal checks
            checks += 1
            counts = {p.topic: (p.get_subscription_count(), number) for p, number in readers.items()}
            waiting = {topic: f"{now} of {number}" for topic, (now, number) in counts.items() if now < number}
            if not waiting or checks * _MATCHED_PERIOD_S >= patience_s:
                timer.cancel()
                then()
            elif checks % 200 == 0:  # every 10 s
                self.get_logger().warning(f"waiting for readers: {waiting}")

        timer = self.create_timer(_MATCHED_PERIOD_S, check)

    def show_parameters(
        self,
        sections: Mapping[str, Any],
        tunable: tuple[str, ...] = (),
        apply: Callable[[dict[str, Any]], None] | None = None,
    ) -> None:
        """Declares every parameter of the checked `sections` with its value, and lets the `tunable` ones change.

        A tunable parameter without a value (set by the method) is declared as not set, so that it can be set.

        Args:
            sections: {section: its configuration}.
            tunable: Full names ("planner.iterations") that may change while the node runs.
            apply: Called with all parameters, nested, when tunable ones change; raises ValueError to refuse.
        """
        self._tunable, self._apply = tunable, apply
        descriptors: dict[str, ParameterDescriptor] = {}
        for name, config in sections.items():
            descriptors |= _descriptors(type(config), name, tunable)
            for key, value in flatten(to_mapping(config), f"{name}.").items():
                descriptor = descriptors.get(key, ParameterDescriptor(read_only=key not in tunable))
                if self.has_parameter(key):  # a parameter file gave it
                    given = self.describe_parameter(key)
                    descriptor.type, descriptor.dynamic_typing = given.type, given.dynamic_typing
                    self.set_descriptor(key, descriptor)
                else:
                    self.declare_parameter(key, value, descriptor)
            self.parameters = merge(self.parameters, {name: to_mapping(config)})
        for key in tunable:
            if not self.has_parameter(key):
                descriptor = descriptors.get(key, ParameterDescriptor())
                descriptor.dynamic_typing = True
                self.declare_parameter(key, None, descriptor)
        self.add_on_set_parameters_callback(self._on_set)

    def _on_set(self, changes: list[Parameter]) -> SetParametersResult:
        changed = {p.name: _plain(p.value) for p in changes if p.name.split(".")[0] not in _ROS_OWN}
        for name in changed:
            if name not in self._tunable:
                reason = (
                    f"{name}: takes effect only at the start of the node; tunable: {', '.join(self._tunable) or 'none'}"
                )
                return SetParametersResult(successful=False, reason=reason)
            if changed[name] is None:
                reason = f"{name}: parameters cannot be unset while the node runs; set a value"
                return SetParametersResult(successful=False, reason=reason)
        if changed and self._apply is not None:
            wanted = merge(self.parameters, nest(changed))
            try:
                self._apply(wanted)
            except ValueError as error:  # an exception that leaves this callback would end the node
                return SetParametersResult(successful=False, reason=str(error))
            self.parameters = wanted
            self.note_tuned(changed)
        return SetParametersResult(successful=True)

    def note_tuned(self, changed: Mapping[str, Any]) -> None:
        """Called after parameters have changed while the node runs, {full name: value}."""


def _descriptors(config: type, section: str, tunable: tuple[str, ...]) -> dict[str, ParameterDescriptor]:
    """Descriptions of a section's parameters for `ros2 param describe`: meaning, unit, range, read-only or not.

    The range is given as text: values are checked by the node, whose errors say what was expected.
    """
    return {
        key: ParameterDescriptor(
            name=key,
            description=help + (f" [{unit}]" if unit else ""),
            additional_constraints=allowed,
            read_only=key not in tunable,
        )
        for key, _, unit, allowed, help in describe(config, f"{section}.")
    }


def _plain(value: Any) -> Any:
    """A parameter's value as in a mission file; ROS gives lists of numbers as arrays."""
    return list(value) if isinstance(value, array.array) else value
