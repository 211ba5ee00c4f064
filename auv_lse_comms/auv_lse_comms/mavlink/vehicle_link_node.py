"""Links the stack to the autopilot over MAVLink: odometry, altitude, pressure and soundings in, waypoints out."""

from __future__ import annotations

import math
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from sensor_msgs.msg import FluidPressure, Range

from auv_lse_common.frames import quaternion_from_heading
from auv_lse_common.lockstep import Gate
from auv_lse_common.params import ParameterError, section
from auv_lse_common.ros_conversions import EVERY, ConfiguredNode, diagnostics, header, run, seconds
from auv_lse_comms.mavlink import events
from auv_lse_comms.mavlink.config import LinkConfig
from auv_lse_comms.mavlink.conversion import Target
from auv_lse_comms.mavlink.datum import origin_of
from auv_lse_comms.mavlink.link import LinkState, VehicleLink
from auv_lse_comms.mavlink.sounder import Sounder
from auv_lse_comms.ros_conversions import sounding_message
from auv_lse_comms.transport import Connection, PortWatcher, Transport, open_transport, read_address
from auv_lse_msgs.msg import LockstepDone, LockstepTick, Sounding, Waypoint

_POLL_PERIOD_S = 0.05
_DIAGNOSTICS_PERIOD_S = 5.0
_BAUD = 115200


def odometry_message(odometry: events.AutopilotEstimate, vehicle: int) -> Odometry:
    """The autopilot's estimate as an Odometry in ENU; its covariance is not known (zeros)."""
    message = Odometry(header=header(odometry.stamp_s), child_frame_id=f"auv{vehicle}")
    position, attitude = message.pose.pose.position, message.pose.pose.orientation
    position.x, position.y, position.z = odometry.east_m, odometry.north_m, -odometry.depth_m
    attitude.x, attitude.y, attitude.z, attitude.w = quaternion_from_heading(odometry.heading_rad)
    message.twist.twist.linear.x = odometry.speed_mps
    message.twist.twist.angular.z = -odometry.yaw_rate_radps
    return message


def altitude_message(altitude: events.Altitude, vehicle: int) -> Range:
    """Altitude over ground as a Range; no ground in reach (NaN) is +inf (REP 117)."""
    message = Range(header=header(altitude.stamp_s), radiation_type=Range.ULTRASOUND, field_of_view=0.07)
    message.header.frame_id = f"auv{vehicle}/dvl"
    message.min_range, message.max_range = altitude.min_m, altitude.max_m
    message.range = math.inf if math.isnan(altitude.altitude_m) else altitude.altitude_m
    return message


def pressure_message(pressure: events.Pressure, vehicle: int) -> FluidPressure:
    """The water's absolute pressure."""
    message = FluidPressure(header=header(pressure.stamp_s), fluid_pressure=pressure.pressure_pa)
    message.header.frame_id = f"auv{vehicle}/pressure"
    return message


def target_of_waypoint(message: Waypoint) -> Target:
    """The end of a Waypoint's leg."""
    return Target(
        north_m=message.end_north_m,
        east_m=message.end_east_m,
        depth_m=message.depth_m,
        heading_rad=message.end_heading_rad,
        step=message.step,
    )


class VehicleLinkNode(ConfiguredNode):
    """vehicle_link_node: MAVLink to the autopilot of one vehicle. Namespace: the vehicle's (/auv1)."""

    def __init__(self) -> None:
        """Makes the link from the parameters, wires the topics and begins to open the endpoint."""
        super().__init__("vehicle_link_node")
        config = section(LinkConfig, self.parameters, "link", self.where)
        if config.kind != "mavlink":
            raise ParameterError(f"{self.where}: link.kind: got {config.kind!r}; expected 'mavlink'")
        origin = origin_of(self.parameters, self.where)
        try:
            address = read_address(config.endpoint, _BAUD)
            self._link = VehicleLink(config, self.vehicle, origin)
        except ValueError as error:
            raise ParameterError(f"{self.where}: link: {error}") from error
        self.show_parameters({"link": config})
        self._sounder = Sounder(config.sounding_every_s, config.sounding_least_pings) if config.soundings else None
        self._sounded_from = self._link.datum
        self._mission_mode = config.mode == "mission"
        self._connection = Connection(lambda: open_transport(address), config.backoff_min_s, config.backoff_max_s)
        self._watched: tuple[Transport, PortWatcher] | None = None
        self._tick_s = 0.0
        self._handling: int | None = None  # lockstep: tick handled, its answer waits for the autopilot
        self._ticks: dict[int, float] = {}
        self._matched = self._greeted = False
        self._waypoints = 0
        self._gate = Gate(("odometries",))
        self._odometry = self.create_publisher(Odometry, "odometry", EVERY)
        self._altitude = self.create_publisher(Range, "altitude", EVERY)
        self._pressure = self.create_publisher(FluidPressure, "pressure", EVERY)
        self._sounding = self.create_publisher(Sounding, "sounding", EVERY) if config.soundings else None
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", EVERY)
        self.create_subscription(Waypoint, "waypoint", self._on_waypoint, EVERY)
        self._bytes = self.create_guard_condition(self._on_bytes)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_POLL_PERIOD_S, self._on_timer, clock=steady)
        self.create_timer(_DIAGNOSTICS_PERIOD_S, self._diagnose, clock=steady)
        if self.lockstep:
            self._done = self.create_publisher(LockstepDone, "lockstep/done", EVERY)
            self.create_subscription(LockstepTick, "/lockstep/tick", self._on_tick, EVERY)
            readers = {self._done: 4, self._odometry: 1 + self.recorded}
            self.when_matched(readers | {self._altitude: self.recorded}, self._on_matched)

    def _now_s(self) -> float:
        return self._tick_s if self.lockstep else self.now_s()

    def _on_matched(self) -> None:
        self._matched = True

    # ------------------------------------------------------------------ what wakes it

    def _on_timer(self) -> None:
        # in lockstep time passes by ticks alone, once there are ticks
        self._step(poll=not self.lockstep or self._gate.tick == 0)

    def _on_bytes(self) -> None:
        self._step(poll=False)
        if self._watched is not None:
            self._watched[1].handled()

    def _on_waypoint(self, message: Waypoint) -> None:
        try:
            self._link.command(self._now_s(), target_of_waypoint(message))
        except ValueError as error:
            self.get_logger().error(f"waypoint of step {message.step}: {error}")
        self._waypoints += 1
        self._handling = self._gate.tick or None  # lockstep: the answer to that tick is another one now
        self._step(poll=False)

    def _on_tick(self, message: LockstepTick) -> None:
        self._ticks[message.tick] = seconds(message.stamp)
        self._tick_s = max(self._tick_s, seconds(message.stamp))
        self._gate.announce(message.tick, "odometries", message.odometries[self.vehicle - 1])
        self._step(poll=False)

    def _step(self, poll: bool) -> None:
        steady_s = time.monotonic()
        self._connection.poll(steady_s)
        data = self._connection.read(steady_s)
        now_s = self._now_s()
        if data:
            self._link.receive(now_s, data)
        self._tell_all()
        tick = self._gate.ready() if self.lockstep else None
        if tick is not None:
            self._gate.handled(tick)
            self._handling, poll = tick, True
        if poll:
            self._link.poll(now_s)
        for datagram in self._link.outgoing():
            self._connection.write(datagram, steady_s)
        self._tell_all()
        self._watch()
        if self.lockstep:
            self._answer()

    def _answer(self) -> None:
        if not self._greeted and self._matched and self._link.state is LinkState.UP:
            self._greeted = True
            self._done.publish(LockstepDone(node="vehicle_link", vehicle=self.vehicle, tick=0))
        if self._handling is not None and self._link.quiet:
            sent = self._link.counts["uploads" if self._mission_mode else "target_messages"]
            self._done.publish(
                LockstepDone(
                    node="vehicle_link", vehicle=self.vehicle, tick=self._handling, first=sent, second=self._waypoints
                )
            )
            self._handling = None

    def _watch(self) -> None:
        transport = self._connection.transport
        if self._watched is not None and self._watched[0] is not transport:
            self._watched[1].stop()
            self._watched = None
        if self._watched is None and transport is not None:
            self._watched = (transport, PortWatcher(transport, self._bytes.trigger))

    # ------------------------------------------------------------------ what it tells

    def _tell_all(self) -> None:
        for event in self._link.events():
            self._tell(event)

    def _tell(self, event: events.Event) -> None:
        log = self.get_logger()
        match event:
            case events.AutopilotEstimate():
                self._odometry.publish(odometry_message(event, self.vehicle))
                self._gate.count("odometries")
                self._sound(event)
            case events.Altitude():
                self._altitude.publish(altitude_message(event, self.vehicle))
                if self._sounder is not None:
                    self._sounder.altitude(event.stamp_s, event.altitude_m)
            case events.Pressure():
                self._pressure.publish(pressure_message(event, self.vehicle))
            case events.LinkUp():
                log.info(f"autopilot heard: MAV_AUTOPILOT {event.autopilot}, MAV_TYPE {event.vehicle_type}")
                self._diagnose()
            case events.LinkLost():
                log.error(f"link lost: nothing from the autopilot for {event.silent_s:.1f} s")
                self._diagnose()
            case events.Problem():
                log.warning(event.text)

    def _sound(self, odometry: events.AutopilotEstimate) -> None:
        """Publishes the soundings that are complete; none before places are in the mission's frame."""
        if self._sounder is None or self._sounding is None or not self._link.placed:
            return
        if self._sounded_from != self._link.datum:  # places have shifted with the origin
            self._sounded_from = self._link.datum
            self._sounder.reset()
        for sounding in self._sounder.odometry(odometry.stamp_s, odometry.north_m, odometry.east_m, odometry.depth_m):
            self._sounding.publish(sounding_message(sounding))

    def _diagnose(self) -> None:
        link = self._link
        up = link.state is LinkState.UP
        level = DiagnosticStatus.OK if up else DiagnosticStatus.ERROR
        text = ("armed" if link.armed else "not armed") if up else self._connection.problem or "no autopilot heard"
        values = {"mode": link.custom_mode, "targets waiting": len(link.targets), **link.counts}
        values |= {f"wire {name}": count for name, count in link.wire.items()}
        if self._sounder is not None:
            values |= {f"sounder {name}": count for name, count in self._sounder.counts.items()}
            values["sounder waits for origin"] = not link.placed
        self._diagnostics.publish(diagnostics(self.now_s(), "vehicle_link", level, text, values))

    def destroy_node(self) -> None:
        """Stops watching and closes the endpoint."""
        if self._watched is not None:
            self._watched[1].stop()
        self._connection.close(time.monotonic(), "shutting down")
        super().destroy_node()


def main() -> int:
    """Entry point of `ros2 run auv_lse_comms vehicle_link_node`."""
    return run(VehicleLinkNode)
