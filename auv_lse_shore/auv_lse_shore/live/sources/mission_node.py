"""Subscribes to a running mission on its ROS domain, from outside the mission."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import rclpy
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from auv_lse_common.node.executor import make_executor
from auv_lse_common.node.senders import Senders, take_with_sender
from auv_lse_common.support.ros_logs import init_arguments
from auv_lse_common.topics.quality import LATCHED_READER, reader_quality
from auv_lse_common.topics.ros_conversions import message_class
from auv_lse_common.topics.table import VEHICLE_TOPICS, find_topic, full_name
from auv_lse_msgs.msg import Dive, SimStatus
from auv_lse_shore.live.sources.command_calls_node import QueuedCalls
from auv_lse_shore.live.sources.command_queue import CommandQueue
from auv_lse_shore.live.sources.events import topics_of

#: Wall clock (s) without a simulator's status after which it subscribes to the vehicles anyway (real vehicles).
_NO_SIMULATOR_S = 5.0
#: Topics read from recordings only: a vehicle that publishes its map need not send its soundings.
_LEFT_OUT = ("sounding",)


class MissionListener:
    """A node that passes on the messages of every topic that the page shows; a context manager.

    In lockstep each publisher counts its readers before the first tick. Therefore this node subscribes to the vehicles'
    topics only when the simulator reports that the mission runs.

    Attributes:
        heard_s: Monotonic clock (s) of the last message, or of the start.
        state: The simulator's last reported state, None before its first report.
    """

    def __init__(
        self,
        vehicles: int,
        domain: int,
        take: Callable[[str, Any], None],
        dive: str | None = None,
        commands: CommandQueue | None = None,
    ) -> None:
        """Stores its arguments.

        Args:
            take: Called with a topic's full name and a message, on the thread that calls `serve`.
            dive: The id of the simulation, whose messages alone are taken; None: any.
            commands: The queue of commands to send; None: none are sent.
        """
        self._vehicles, self._domain, self._take, self._dive = vehicles, domain, take, dive
        self._senders = Senders(dive or "")
        self._commands = commands
        self._calls: QueuedCalls | None = None
        self._joined = False
        self.state: int | None = None

    def __enter__(self) -> MissionListener:
        """Joins the domain; leaves Ctrl-C to the caller."""
        rclpy.init(args=init_arguments(), domain_id=self._domain, signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node("live_view", start_parameter_services=False, enable_rosout=False)
        self._executor: Executor = make_executor()
        self._executor.add_node(self._node)
        self.heard_s = self._began_s = time.monotonic()
        self._node.create_subscription(SimStatus, "/sim/status", self._on_status, LATCHED_READER)
        if self._commands is not None:
            self._calls = QueuedCalls(self._node, self._commands, self._vehicles)
        return self

    def __exit__(self, *_: object) -> None:
        """Leaves the domain."""
        if self._calls is not None:
            self._calls.close()
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def serve(self, seconds_: float) -> None:
        """Handles messages and commands for about `seconds_` of wall clock."""
        until = time.monotonic() + seconds_
        while (left := until - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)
        if self._calls is not None:
            self._calls.step()
        alone = self.state is None and time.monotonic() - self._began_s > _NO_SIMULATOR_S
        if not self._joined and (alone or self.state not in (None, SimStatus.WAITING)):
            self._join()

    def _on_status(self, message: SimStatus) -> None:
        if self._is_foreign(message):
            return
        self.state = message.state
        self._receive("/sim/status", message)

    def _is_foreign(self, message: Any, participant: bytes | None = None) -> bool:
        if self._dive is None:
            return False
        if hasattr(message, "dive"):
            return bool(message.dive != self._dive)
        sender = self._senders.sender_of(message.header.frame_id, participant, time.monotonic())
        return sender not in (None, "", self._dive)  # "": the sender publishes only its health

    def _receive(self, topic: str, message: Any, participant: bytes | None = None) -> None:
        if self._is_foreign(message, participant):
            return
        self.heard_s = time.monotonic()
        self._take(topic, message)

    def _join(self) -> None:
        self._joined = True
        for vehicle in range(1, self._vehicles + 1):
            name = full_name(VEHICLE_TOPICS["dive"], vehicle)
            take_with_sender(self._node.create_subscription(Dive, name, self._senders.introduce, LATCHED_READER))
        for topic in topics_of(self._vehicles):
            row, vehicle = find_topic(topic) or (None, 0)
            if row is None or not vehicle or row.name in _LEFT_OUT:
                continue
            # A driver may publish its odometry best effort; the simulator's is reliable.
            quality = reader_quality(row, lockstep=self.state is not None)
            kind, receive = message_class(row.kind), partial(self._receive, topic)
            take_with_sender(self._node.create_subscription(kind, topic, receive, quality))
