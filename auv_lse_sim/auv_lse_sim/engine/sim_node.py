"""Stands in for INS, DVL and acoustic modem of every vehicle, and keeps the mission's time."""

from __future__ import annotations

import sys
import time
from functools import partial
from itertools import pairwise
from pathlib import Path

import rclpy
from nav_msgs.msg import Odometry
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import FluidPressure, Range

from auv_lse_common.base_node import EVERY, LATCHED, STEADY, BaseNode, run
from auv_lse_common.params import ParameterError, read_parameter_file
from auv_lse_common.ros_conversions import header, seconds, sounding_message, stamp
from auv_lse_common.topics import MISSION_TOPICS, TRUTH_TOPIC, VEHICLE_TOPICS, Topic, reader_count
from auv_lse_comms.transport import PortWatcher
from auv_lse_msgs.msg import LockstepDone, LockstepTick, ModemRx, ModemTx, SimStatus, Sounding, Waypoint
from auv_lse_sim.engine.simulation import MissionState, Simulation, Speed
from auv_lse_sim.ros_conversions import (
    altitude_message,
    arrival_message,
    leg_of_waypoint,
    odometry_message,
    pressure_message,
    truth_message,
)
from auv_lse_sim.settings import Settings
from auv_lse_sim.world.ground_source import ground_of
from auv_lse_sim.world.world import VehicleOutput

_STALLED_S = 60.0
_OF_A_VEHICLE = {
    "sounding": Sounding,
    "odometry": Odometry,
    "altitude": Range,
    "pressure": FluidPressure,
    "modem/rx": ModemRx,
}


class SimNode(BaseNode):
    """sim_node: the simulated world of all vehicles. Namespace: none; needs the whole file (--params-file)."""

    def __init__(self) -> None:
        """Makes the world from the mission file, wires every vehicle's topics, and waits for the nodes."""
        super().__init__("sim_node")
        settings = Settings.load(_parameter_file(sys.argv))
        self._settings = settings
        self._sim = Simulation(settings, ground_of(settings), self.lockstep, bool(self.recorded))
        self._waiting_since_s = time.monotonic()
        self._speed = Speed()
        self._begun = False
        self._readers: dict[Publisher, int] = {}
        self._nodes = [name for k in self._sim.vehicles for name in self._sim.nodes(k)]
        self._nodes += ["recorder_node"] * self.recorded
        self._clock_topic = self._mission_publisher(ClockMessage, "/clock")
        self._status = self._mission_publisher(SimStatus, "/sim/status", LATCHED)
        self._of = {k: self._wire(k) for k in self._sim.vehicles}
        self._bytes = self.create_guard_condition(self._on_bytes)
        ports = [port for port in (self._sim.links.rack, self._sim.links.dock) if port is not None]
        self._watchers = [PortWatcher(port, self._bytes.trigger) for port in ports]
        if ports:
            self.create_timer(0.2, self._sim.greet, clock=STEADY)
        if self.lockstep:
            self._tick = self._mission_publisher(LockstepTick, "/lockstep/tick")
            self.create_subscription(LockstepDone, "/lockstep/done", self._on_recorded, EVERY)
            self.create_timer(1.0, self._watch, clock=STEADY)
        self.when_matched(self._readers, self._begin)
        self._publish_status(self._sim.state, self._sim.message)

    def _mission_publisher(self, kind: type, topic: str, quality: object = EVERY) -> Publisher:
        return self._publisher(kind, topic, MISSION_TOPICS[topic], self._nodes, quality)

    def _publisher(self, kind: type, name: str, topic: Topic, nodes: list[str], quality: object = EVERY) -> Publisher:
        publisher = self.create_publisher(kind, name, quality)
        self._readers[publisher] = reader_count(topic, nodes) + self.recorded * topic.recorded
        return publisher

    def _wire(self, k: int) -> dict[str, Publisher]:
        """The publishers of vehicle `k` by topic, "truth" among them; subscribes to what it sends."""
        space, nodes = f"/auv{k}/", list(self._sim.nodes(k))
        if k not in self._sim.links.modems:
            self.create_subscription(ModemTx, space + "modem/tx", partial(self._on_packet, k), EVERY)
        if k not in self._sim.links.autopilots:
            self.create_subscription(Waypoint, space + "waypoint", partial(self._on_waypoint, k), EVERY)
        if self.lockstep:
            self.create_subscription(LockstepDone, space + "lockstep/done", partial(self._on_done, k), EVERY)
        publishers = {
            name: self._publisher(kind, space + name, VEHICLE_TOPICS[name], nodes)
            for name, kind in _OF_A_VEHICLE.items()
        }
        return publishers | {"truth": self._publisher(Odometry, f"/truth{space}odometry", TRUTH_TOPIC, nodes)}

    # ------------------------------------------------------------------ time

    def _begin(self) -> None:
        self.get_logger().info(f"every node is there; {self._sim.world.ground.describe()}")
        self._begun = True
        if not self.lockstep:
            factor = self._settings.sim.real_time_factor or 1.0
            self.create_timer(self._settings.sim.tick_s / factor, self._run_tick, clock=STEADY)
        self._advance()

    def _advance(self) -> None:
        """Lockstep: runs the next tick once everything that it waits for is there."""
        first = self.lockstep and self._begun and self._sim.tick == 0 and self._sim.greeted
        if first or self._sim.ready():
            self._run_tick()

    def _run_tick(self) -> None:
        """One tick: advances the world, publishes what it brings and, in lockstep, announces it."""
        sim = self._sim
        outputs = sim.advance()
        for problem in sim.take_problems():
            self.get_logger().error(problem)
        if sim.state is MissionState.FINISHED and self._settings.sim.shutdown_at_end:
            self.create_timer(1.0, rclpy.try_shutdown, clock=STEADY)
        if outputs:
            self._clock_topic.publish(ClockMessage(clock=stamp(sim.now_s)))
            for k, output in outputs.items():
                self._publish(k, output)
            if self.lockstep:
                tick = LockstepTick(stamp=stamp(sim.now_s), tick=sim.tick)
                tick.soundings, tick.arrivals = sim.soundings, sim.arrivals
                tick.odometries = [sim.tick] * len(sim.vehicles)
                self._waiting_since_s = time.monotonic()
                self._tick.publish(tick)
            self._speed.note(sim.now_s, time.monotonic())
        self._publish_status(sim.state, sim.message)

    def _publish(self, k: int, output: VehicleOutput) -> None:
        to, links = self._of[k], self._sim.links
        for row in output.soundings:
            to["sounding"].publish(sounding_message(row))
        for arrival in output.arrivals if k not in links.modems else ():
            to["modem/rx"].publish(arrival_message(arrival))
        self._sim.deliver(k, output)
        if k not in links.autopilots:
            to["odometry"].publish(odometry_message(output.odometry, output.pressure_depth_m, k))
            to["altitude"].publish(altitude_message(self._sim.now_s, output.altitude_m, k))
            to["pressure"].publish(pressure_message(self._sim.now_s, output.pressure_depth_m, k))
        to["truth"].publish(truth_message(output.truth, k))

    def _watch(self) -> None:
        """Lockstep: names a node that does not answer, instead of waiting in silence for ever."""
        sim = self._sim
        if sim.tick and not sim.finished and time.monotonic() - self._waiting_since_s > _STALLED_S:
            text = f"tick {sim.tick}: no answer for {_STALLED_S:.0f} s; missing {sim.missing()}"
            self._publish_status(MissionState.FAILED, text)
            self._waiting_since_s = time.monotonic()

    def _publish_status(self, state: MissionState, message: str) -> None:
        sim = self._sim
        self._status.publish(
            SimStatus(
                header=header(sim.now_s),
                state=getattr(SimStatus, state.name),
                message=message,
                steps=sim.steps,
                steps_total=self._settings.mission.steps,
                packets_sent=sim.sent,
                packets_received=sim.received,
                packets_lost=sim.lost,
                speed=self._speed.value,
            )
        )

    # ------------------------------------------------------------------ what comes in

    def _on_waypoint(self, k: int, message: Waypoint) -> None:
        try:
            leg = leg_of_waypoint(message)
        except ValueError as error:
            self.get_logger().error(f"auv{k}: {error}")
            leg = None
        self._sim.take_waypoint(k, leg)
        self._advance()

    def _on_packet(self, k: int, message: ModemTx) -> None:
        self._sim.take_packet(k, seconds(message.header.stamp), bytes(message.payload))
        self._advance()

    def _on_bytes(self) -> None:
        self._sim.serve()
        for watcher in self._watchers:
            watcher.handled()
        self._advance()

    def _on_done(self, k: int, message: LockstepDone) -> None:
        totals = (message.first, message.second)
        self._sim.take_done(k, message.phase, message.tick, totals, message.finished)
        self._advance()

    def _on_recorded(self, message: LockstepDone) -> None:
        self._sim.take_recorded(message.tick)
        self._advance()

    def destroy_node(self) -> None:
        """Takes the emulated hardware away."""
        for watcher in self._watchers:
            watcher.stop()
        self._sim.links.close()
        super().destroy_node()


def _parameter_file(arguments: list[str]) -> Path:
    """The mission file among the --params-file arguments: the simulator needs every vehicle's part of it.

    Raises:
        ParameterError: if there is none.
    """
    given = [Path(b) for a, b in pairwise(arguments) if a == "--params-file"]
    for path in given:
        if "mission" in read_parameter_file(path).get("/**", {}):
            return path
    raise ParameterError(
        f"sim_node: expected --params-file MISSION.yaml with a 'mission' section under '/**'; got "
        f"{', '.join(map(str, given)) or 'no --params-file'} (any run's mission.yaml will do)"
    )


def main() -> int:
    """Entry point of `ros2 run auv_lse_sim sim_node`."""
    return run(SimNode)
