"""Stands in for INS, DVL and acoustic modem of every vehicle, and keeps the mission's time."""

from __future__ import annotations

import sys
import time
from functools import partial
from itertools import pairwise
from pathlib import Path

import rclpy
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import FluidPressure, Range

from auv_lse_common.leg import Leg
from auv_lse_common.lockstep import Gate
from auv_lse_common.params import ParameterError, read_parameter_file
from auv_lse_common.ros_conversions import EVERY, LATCHED, ConfiguredNode, header, run, seconds, stamp
from auv_lse_comms.transport import PortWatcher
from auv_lse_msgs.msg import LockstepDone, LockstepTick, ModemRx, ModemTx, SimStatus, Sounding, Waypoint
from auv_lse_sim.emulated.links import EmulatedLinks
from auv_lse_sim.engine.processes import RECORDER_LAG_TICKS
from auv_lse_sim.ros_conversions import (
    altitude_message,
    arrival_message,
    leg_of_waypoint,
    odometry_message,
    pressure_message,
    sounding_message,
    truth_message,
)
from auv_lse_sim.settings import Settings
from auv_lse_sim.world.ground_source import ground_of
from auv_lse_sim.world.world import VehicleOutput, World

_STEADY = Clock(clock_type=ClockType.STEADY_TIME)
_STALLED_S = 60.0
#: Losses of the channel that a modem notices: it hears a packet and cannot decode it.
_HEARD_ALL_THE_SAME = ("noise", "interference", "random")


class SimNode(ConfiguredNode):
    """sim_node: the simulated world of all vehicles. Namespace: none; needs the whole file (--params-file)."""

    def __init__(self) -> None:
        """Makes the world from the mission file, wires every vehicle's topics, and waits for the nodes."""
        super().__init__("sim_node")
        path = _parameter_file(sys.argv)
        settings = Settings.load(path)
        self._settings = settings
        self._world = World.of(settings, ground_of(settings))
        self._vehicles = range(1, settings.mission.vehicles + 1)
        self._tick = 0
        self._now_s = 0.0
        self._steps = [0] * len(self._vehicles)
        self._finished = [False] * len(self._vehicles)
        self._sent = self._received = self._lost = 0
        self._soundings = [0] * len(self._vehicles)
        self._arrivals = [0] * len(self._vehicles)
        self._transmissions: list[ModemTx] = []
        self._recorded_tick = 0
        self._links = EmulatedLinks(settings, self._on_emulated_packet, self._on_target)
        self._waiting_since_s = time.monotonic()
        self._speed = _Speed()

        self._clock = self.create_publisher(ClockMessage, "/clock", EVERY)
        self._status = self.create_publisher(SimStatus, "/sim/status", LATCHED)
        names = [f"/auv{k}/" for k in self._vehicles]
        self._sounding = [self.create_publisher(Sounding, n + "sounding", EVERY) for n in names]
        self._odometry = [self.create_publisher(Odometry, n + "odometry", EVERY) for n in names]
        self._altitude = [self.create_publisher(Range, n + "altitude", EVERY) for n in names]
        self._pressure = [self.create_publisher(FluidPressure, n + "pressure", EVERY) for n in names]
        self._rx = [self.create_publisher(ModemRx, n + "modem/rx", EVERY) for n in names]
        self._truth = [self.create_publisher(Odometry, f"/truth{n}odometry", EVERY) for n in names]
        for k, n in zip(self._vehicles, names, strict=True):
            if k not in self._links.modems:
                self.create_subscription(ModemTx, n + "modem/tx", partial(self._on_transmission, k), EVERY)
            if k not in self._links.autopilots:
                self.create_subscription(Waypoint, n + "waypoint", partial(self._on_waypoint, k), EVERY)
        self._bytes = self.create_guard_condition(self._on_bytes)
        ports = [port for port in (self._links.rack, self._links.dock) if port is not None]
        self._watchers = [PortWatcher(port, self._bytes.trigger) for port in ports]
        self._wire_time(names)
        self._publish_status(SimStatus.WAITING, "for the mission's nodes")

    def _wire_time(self, names: list[str]) -> None:
        """Lockstep: the gates of a tick. Otherwise: a timer. Either begins once every reader is matched."""
        drivers = len(self._links.modems) + len(self._links.autopilots)
        self._nodes = 3 * len(self._vehicles) + drivers
        readers = {self._clock: self._nodes + self.recorded, self._status: self.recorded}
        for k in self._vehicles:
            i = k - 1
            readers |= {self._sounding[i]: 2 + self.recorded, self._odometry[i]: 1 + self.recorded}
            readers |= {self._rx[i]: 1 + self.recorded, self._truth[i]: self.recorded}
            readers |= {self._altitude[i]: self.recorded, self._pressure[i]: self.recorded}
        inputs = [f"packets of auv{k}" for k in self._vehicles]
        inputs += [f"waypoints of auv{k}" for k in self._vehicles]
        inputs += [f"targets of auv{k}" for k in self._links.autopilots]
        inputs += [f"modem of auv{k}" for k in self._links.modems]
        self._lost_by_modem = [0] * len(self._vehicles)
        self._heard = [0] * len(self._vehicles)
        self._gate = Gate(tuple(inputs))
        if self.lockstep:
            self._tick_topic = self.create_publisher(LockstepTick, "/lockstep/tick", EVERY)
            readers[self._tick_topic] = self._nodes + self.recorded
            for k, n in zip(self._vehicles, names, strict=True):
                self.create_subscription(LockstepDone, n + "lockstep/done", partial(self._on_done, k), EVERY)
            self.create_subscription(LockstepDone, "/lockstep/done", self._on_recorded, EVERY)
            self._ready: set[tuple[int, str]] = set()
            self._begun = False
            self.create_timer(1.0, self._watch, clock=_STEADY)
        self.when_matched(readers, self._begin)
        if drivers:
            self.create_timer(0.2, self._greet, clock=_STEADY)

    # ------------------------------------------------------------------ time

    def _begin(self) -> None:
        self.get_logger().info(f"every node is there; {self._world.ground.describe()}")
        if not self.lockstep:
            factor = self._settings.sim.real_time_factor or 1.0
            self.create_timer(self._settings.sim.tick_s / factor, self._run_tick, clock=_STEADY)
            return
        self._begun = True
        self._start_lockstep()

    def _start_lockstep(self) -> None:
        if self._begun and self._tick == 0 and len(self._ready) == self._nodes:
            self._run_tick()

    def _run_tick(self) -> None:
        """One tick: advance the world, publish what it brings and, in lockstep, announce it."""
        for message in self._transmissions:
            self._transmit(message)
        self._transmissions.clear()
        if all(self._finished):
            self._publish_status(SimStatus.FINISHED, "every vehicle has travelled its last leg")
            if self._settings.sim.shutdown_at_end:
                self.create_timer(1.0, rclpy.try_shutdown, clock=_STEADY)
            return
        self._tick += 1
        self._now_s = self._tick * self._settings.sim.tick_s
        if self._now_s > self._settings.longest_s:
            slow = [k for k in self._vehicles if not self._finished[k - 1]]
            self._publish_status(SimStatus.FAILED, f"vehicles {slow} have not finished by {self._now_s:.0f} s")
            return
        self._links.poll(self._now_s)
        outputs = self._world.tick(self._now_s)
        self._lost += len(self._world.lost)
        self._clock.publish(ClockMessage(clock=stamp(self._now_s)))
        for k, output in outputs.items():
            self._publish(k, output)
        if self.lockstep:
            tick = LockstepTick(stamp=stamp(self._now_s), tick=self._tick)
            tick.soundings, tick.arrivals = self._soundings, self._arrivals
            for k in self._links.modems:
                self._gate.announce(self._tick, f"modem of auv{k}", self._tick)
            tick.odometries = [self._tick] * len(self._vehicles)
            self._waiting_since_s = time.monotonic()
            self._tick_topic.publish(tick)
        self._speed.note(self._now_s)
        self._publish_status(SimStatus.RUNNING, "")

    def _publish(self, k: int, output: VehicleOutput) -> None:
        i = k - 1
        for row in output.soundings:
            self._sounding[i].publish(sounding_message(row))
        self._soundings[i] += len(output.soundings)
        if k in self._links.modems:
            heard = [a for a in self._world.lost if a.receiver == k and a.why in _HEARD_ALL_THE_SAME]
            for arrival in sorted((*output.arrivals, *heard), key=lambda a: a.arrival_s):
                self._links.arrive(k, arrival)
        else:
            for arrival in output.arrivals:
                self._rx[i].publish(arrival_message(arrival))
        self._arrivals[i] += len(output.arrivals)
        self._received += len(output.arrivals)
        if k in self._links.autopilots:
            self._links.report(k, self._now_s, output)
        else:
            self._odometry[i].publish(odometry_message(output.odometry, output.pressure_depth_m, k))
            self._altitude[i].publish(altitude_message(self._now_s, output.altitude_m, k))
            self._pressure[i].publish(pressure_message(self._now_s, output.pressure_depth_m, k))
        self._truth[i].publish(truth_message(output.truth, k))
        steps = self._settings.mission.steps
        if not self.lockstep:
            self._finished[i] = output.truth.step >= steps - 1 and output.truth.loitering
        self._steps[i] = steps if self._finished[i] else max(output.truth.step, 0)

    # ------------------------------------------------------------------ what the vehicles do

    def _on_waypoint(self, k: int, message: Waypoint) -> None:
        try:
            self._world.command(k, leg_of_waypoint(message))
        except ValueError as error:
            self.get_logger().error(f"auv{k}: {error}")
        self._gate.count(f"waypoints of auv{k}")
        self._advance()

    # ------------------------------------------------------------------ emulated modems and autopilots

    def _greet(self) -> None:
        if self._tick == 0:
            self._links.greet(self._now_s)

    def _on_bytes(self) -> None:
        self._links.serve(self._now_s)
        for watcher in self._watchers:
            watcher.handled()
        for k in self._links.autopilots:
            targets, missions = self._links.heard(k)
            heard = missions if self._settings.vehicle(k).link.mode == "mission" else targets
            self._gate.count(f"targets of auv{k}", heard - self._heard[k - 1])
            self._heard[k - 1] = heard
        self._advance()

    def _on_emulated_packet(self, k: int, start_s: float, payload: bytes) -> float:
        self._on_transmission(k, ModemTx(header=header(start_s), source=k, payload=payload))
        return self._world.channel.duration_s(len(payload))

    def _on_target(self, k: int, leg: Leg) -> None:
        self._world.command(k, leg)

    def destroy_node(self) -> None:
        """Takes the emulated hardware away."""
        for watcher in self._watchers:
            watcher.stop()
        self._links.close()
        super().destroy_node()

    def _on_transmission(self, k: int, message: ModemTx) -> None:
        self._gate.count(f"packets of auv{k}")
        self._transmissions.append(message)
        self._transmissions.sort(key=lambda m: (seconds(m.header.stamp), m.source))
        self._advance()

    def _transmit(self, message: ModemTx) -> None:
        try:
            self._world.transmit(
                message.source, max(seconds(message.header.stamp), self._now_s), bytes(message.payload)
            )
            self._sent += 1
        except ValueError as error:
            self.get_logger().error(f"packet of auv{message.source} at {seconds(message.header.stamp):.1f} s: {error}")

    # ------------------------------------------------------------------ lockstep

    def _on_done(self, k: int, message: LockstepDone) -> None:
        if message.tick == 0:
            self._ready.add((k, message.node))
            self._start_lockstep()
        elif message.node == "planner":
            self._finished[k - 1] = message.finished
            if message.finished:
                self._steps[k - 1] = self._settings.mission.steps
            self._gate.announce(message.tick, f"waypoints of auv{k}", message.second)
        elif message.node == "vehicle_link":  # what it has sent to the autopilot, once it has that many waypoints
            self._gate.announce(message.tick, f"targets of auv{k}", message.first)
            self._gate.reach(f"waypoints of auv{k}", message.second)
        elif message.node == "micromodem":
            self._gate.count(f"modem of auv{k}")
        elif message.node == "micromodem_lost":  # a packet that its driver could not send: nothing to wait for
            self._gate.count(f"packets of auv{k}", message.first - self._lost_by_modem[k - 1])
            self._lost_by_modem[k - 1] = message.first
        elif message.node == "modem_sent":
            self._gate.announce(message.tick, f"packets of auv{k}", message.first)
        self._advance()

    def _on_recorded(self, message: LockstepDone) -> None:
        self._recorded_tick = max(self._recorded_tick, message.tick)
        self._advance()

    def _advance(self) -> None:
        """The next tick, once every vehicle has handled this one and the recorder is not far behind."""
        if not self.lockstep or self._tick == 0:
            return
        tick = self._gate.ready()
        if tick is None or (self.recorded and self._recorded_tick < self._tick - RECORDER_LAG_TICKS):
            return
        self._gate.handled(tick)
        self._run_tick()

    def _watch(self) -> None:
        """Lockstep: a node that does not answer is named, instead of waiting in silence for ever."""
        if self._tick and not all(self._finished) and time.monotonic() - self._waiting_since_s > _STALLED_S:
            text = ", ".join(f"{name}: {count}" for name, count in self._gate.missing().items())
            self._publish_status(
                SimStatus.FAILED, f"tick {self._tick}: no answer for {_STALLED_S:.0f} s; missing {text}"
            )
            self._waiting_since_s = time.monotonic()

    def _publish_status(self, state: int, message: str) -> None:
        self._status.publish(
            SimStatus(
                header=header(self._now_s),
                state=state,
                message=message,
                steps=self._steps,
                steps_total=self._settings.mission.steps,
                packets_sent=self._sent,
                packets_received=self._received,
                packets_lost=self._lost,
                speed=self._speed.value,
            )
        )


class _Speed:
    """Simulated seconds per second of wall clock, over the last few seconds."""

    def __init__(self) -> None:
        self._marks: list[tuple[float, float]] = []
        self.value = 0.0

    def note(self, sim_s: float) -> None:
        now = time.monotonic()
        if self._marks and now - self._marks[-1][0] < 0.2:
            return
        self._marks = [*self._marks[-25:], (now, sim_s)]
        (wall_0, sim_0), (wall_1, sim_1) = self._marks[0], self._marks[-1]
        if wall_1 > wall_0:
            self.value = (sim_1 - sim_0) / (wall_1 - wall_0)


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
