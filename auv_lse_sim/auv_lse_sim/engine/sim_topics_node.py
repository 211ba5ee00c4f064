"""The simulator's topics of one vehicle; a part of `sim_node`."""

from __future__ import annotations

from nav_msgs.msg import Odometry
from rclpy.publisher import Publisher
from sensor_msgs.msg import FluidPressure, Range

from auv_lse_common.node.base_node import BaseNode
from auv_lse_common.topics.quality import quality_of
from auv_lse_common.topics.ros_conversions import dead_reckoning_message, fix_message, sounding_message
from auv_lse_common.topics.table import TRUTH_TOPIC, VEHICLE_TOPICS, Topic, reader_count
from auv_lse_msgs.msg import Fix, MissionCommand, ModemRx, Sounding
from auv_lse_sim.engine.ros_conversions import (
    altitude_message,
    arrival_message,
    odometry_message,
    pressure_message,
    truth_message,
)
from auv_lse_sim.engine.simulation import Simulation
from auv_lse_sim.world import VehicleOutput


class VehicleTopics:
    """What a tick brings for one vehicle, on its topics or to its emulated hardware.

    Attributes:
        readers: How many readers each publisher has to wait for.
    """

    def __init__(self, node: BaseNode, vehicle: int, simulation: Simulation) -> None:
        """Makes the publishers on `node`."""
        self.readers: dict[Publisher, int] = {}
        self._vehicle = vehicle
        self._sim = simulation
        self._node = node
        self._soundings = self._of_vehicle(Sounding, "sounding")
        self._odometry = self._of_vehicle(Odometry, "odometry")
        self._dead_reckoning = self._of_vehicle(Odometry, "dead_reckoning")
        self._fixes = self._of_vehicle(Fix, "fix")
        self._altitude = self._of_vehicle(Range, "altitude")
        self._pressure = self._of_vehicle(FluidPressure, "pressure")
        self._commands = self._of_vehicle(MissionCommand, "mission/command")
        self._received = self._of_vehicle(ModemRx, "modem/rx")
        self._truth = self._publisher(Odometry, f"/truth/auv{vehicle}/odometry", TRUTH_TOPIC)

    def _of_vehicle(self, kind: type, name: str) -> Publisher:
        return self._publisher(kind, f"/auv{self._vehicle}/{name}", VEHICLE_TOPICS[name])

    def _publisher(self, kind: type, name: str, topic: Topic) -> Publisher:
        publisher = self._node.create_publisher(kind, name, quality_of(topic))
        nodes = self._sim.nodes(self._vehicle)
        self.readers[publisher] = reader_count(topic, nodes) + self._node.recorded * topic.recorded
        return publisher

    def command(self, message: MissionCommand) -> None:
        """Gives the vehicle's mission a command."""
        self._commands.publish(message)

    def publish(self, output: VehicleOutput) -> None:
        """Publishes what the last tick brought for the vehicle's nodes, unless emulated hardware brings it."""
        k, now_s, links = self._vehicle, self._sim.now_s, self._sim.links
        for row in output.soundings:
            self._soundings.publish(sounding_message(row))
        if k not in links.modems:
            for arrival in output.arrivals:
                self._received.publish(arrival_message(arrival))
        if k not in links.autopilots:
            self._dead_reckoning.publish(dead_reckoning_message(output.dead_reckoning, k))
            for fix in output.fixes:
                self._fixes.publish(fix_message(fix))
            self._altitude.publish(altitude_message(now_s, output.altitude_m, k))
            self._odometry.publish(odometry_message(output.odometry, output.pressure_depth_m, k))

    def publish_unread(self, output: VehicleOutput) -> None:
        """Publishes what none of the vehicle's nodes waits for."""
        if self._vehicle not in self._sim.links.autopilots:
            self._pressure.publish(pressure_message(self._sim.now_s, output.pressure_depth_m, self._vehicle))
        self._truth.publish(truth_message(output.truth, self._vehicle))
