"""Publishes the standard messages of a mission under /viz, for RViz."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from auv_lse_common.support.ros_logs import init_arguments
from auv_lse_shore.live.viewers.map_panel import GEOJSON
from auv_lse_shore.live.viewers.standard_messages import StandardMessage, StandardMessages

#: Late viewers get the last messages; the depth allows a burst of markers of several vehicles.
_KEPT = QoSProfile(depth=20, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class VizPublisher:
    """Publishes the messages; a viewer that starts late gets the last message of each topic."""

    def __init__(self, domain_of: Callable[[], int]) -> None:
        """Stores `domain_of`, which returns the ROS domain when a mission begins."""
        self._domain_of = domain_of
        self._context: Context | None = None
        self._publishers: dict[str, Publisher] = {}

    def begin(self, messages: StandardMessages, first_s: float, last_s: float) -> None:
        """Joins the domain of a new mission."""
        self.close()
        self._context = Context()
        rclpy.init(
            args=init_arguments(),
            context=self._context,
            domain_id=self._domain_of(),
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self._node = Node("viz", context=self._context, start_parameter_services=False, enable_rosout=False)

    def show(self, message: StandardMessage) -> None:
        """Publishes a message of a ROS type."""
        if message.kind == GEOJSON:
            return
        if message.topic not in self._publishers:
            package, _, name = message.kind.split("/")
            kind = getattr(import_module(f"{package}.msg"), name)
            self._publishers[message.topic] = self._node.create_publisher(kind, message.topic, _KEPT)
        self._publishers[message.topic].publish(message.data)

    def close(self) -> None:
        """Leaves the domain."""
        if self._context is not None:
            self._node.destroy_node()
            self._context.try_shutdown()
            self._context = None
            self._publishers.clear()
