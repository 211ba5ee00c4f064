"""The simulator's topics of one vehicle; a part of `sim_node`."""

from __future__ import annotations

from typing import Any

from rclpy.publisher import Publisher

from auv_lse_common.node.base_node import BaseNode
from auv_lse_common.node.dive import tagged
from auv_lse_common.node.transforms_node import TransformPublisher
from auv_lse_common.topics.quality import writer_quality
from auv_lse_common.topics.records import Altitude, GeodeticPosition, Pressure
from auv_lse_common.topics.ros_conversions import encoded, message_class
from auv_lse_common.topics.table import TRUTH_TOPIC, VEHICLE_TOPICS, Topic, full_name, reader_count
from auv_lse_msgs.msg import MissionCommand
from auv_lse_sim.engine.conversions import odometry_of, pressure_pa, reception_of
from auv_lse_sim.engine.simulation import Simulation
from auv_lse_sim.world import VehicleOutput


class VehicleTopics:
    """Publishes the output of a tick on one vehicle's topics.

    Attributes:
        readers: Number of readers that each publisher waits for.
    """

    def __init__(self, node: BaseNode, vehicle: int, simulation: Simulation) -> None:
        """Creates the publishers on `node`."""
        self.readers: dict[Publisher, int] = {}
        self._vehicle = vehicle
        self._sim = simulation
        self._node = node
        names = ("sounding", "odometry", "dead_reckoning", "fix", "altitude", "pressure", "mission/command", "modem/rx")
        if simulation.origin_deg is not None and vehicle not in simulation.links.autopilots:
            names += ("navsat",)
        self._publishers = {name: self._publisher(VEHICLE_TOPICS[name]) for name in names}
        introduction = VEHICLE_TOPICS["dive"]  # each node reads it for itself
        readers = reader_count(introduction, simulation.nodes(vehicle)) + node.recorded * introduction.recorded
        self.readers[node.introduce(vehicle)] = readers
        self._truth = self._publisher(TRUTH_TOPIC)
        self._transforms = TransformPublisher(node, vehicle)

    def _publisher(self, topic: Topic) -> Publisher:
        name = full_name(topic, self._vehicle)
        publisher = self._node.create_publisher(message_class(topic.kind), name, writer_quality(topic))
        self.readers[publisher] = self._reader_count(topic)
        return publisher

    def _reader_count(self, topic: Topic) -> int:
        nodes, together = self._sim.nodes(self._vehicle), self._node.together
        return reader_count(topic, nodes, together) + self._node.recorded * topic.recorded

    def _publish(self, name: str, value: Any) -> None:
        self._publishers[name].publish(self._message(VEHICLE_TOPICS[name], value))

    def _message(self, topic: Topic, value: Any) -> Any:
        return tagged(encoded(topic, value, self._vehicle), self._node.dive)

    def command(self, message: MissionCommand) -> None:
        """Sends a command to the vehicle's mission."""
        self._publishers["mission/command"].publish(tagged(message, self._node.dive))

    def publish(self, output: VehicleOutput) -> None:
        """Publishes the last tick's output for the vehicle's nodes, except what emulated hardware delivers."""
        k, now_s, links = self._vehicle, self._sim.now_s, self._sim.links
        for sounding in output.soundings:
            self._publish("sounding", sounding)
        if k not in links.modems:
            for arrival in output.arrivals:
                self._publish("modem/rx", reception_of(arrival))
        if k not in links.autopilots:
            self._publish("dead_reckoning", output.dead_reckoning)
            for fix in output.fixes:
                self._publish("fix", fix)
            self._publish("altitude", Altitude(stamp_s=now_s, altitude_m=output.altitude_m))
            self._publish("odometry", odometry_of(output.odometry, output.pressure_depth_m))

    def publish_unread(self, output: VehicleOutput) -> None:
        """Publishes the topics that no node of the vehicle waits for."""
        if "navsat" in self._publishers:
            estimate = odometry_of(output.odometry, output.pressure_depth_m)
            self._publish("navsat", GeodeticPosition.of(estimate, self._sim.origin_deg))
        if self._vehicle not in self._sim.links.autopilots:
            pressure = Pressure(stamp_s=self._sim.now_s, pressure_pa=pressure_pa(output.pressure_depth_m))
            self._publish("pressure", pressure)
            self._transforms.publish(output.odometry, output.dead_reckoning)
        self._truth.publish(self._message(TRUTH_TOPIC, output.truth))
