"""Connects the stack to the autopilot over MAVLink: odometry, altitude, pressure and soundings in, waypoints out."""

import auv_lse_common.node.executable  # noqa: F401  # first: prepares the process

# isort: split

import time

from auv_lse_common.mission_file.parameters import ParameterError, section
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.node.entry_point import Main
from auv_lse_common.node.transforms_node import TransformPublisher
from auv_lse_common.topics.records import Altitude, GeodeticPosition, Pressure, RunReport, Waypoint
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix
from auv_lse_common.vocabulary.mission_run import LONGEST_SILENCE_S, UNWATCHED, RunState, Stop
from auv_lse_common.vocabulary.sounding import Sounding
from auv_lse_comms.driver_node import DriverNode
from auv_lse_comms.packet.key import read_key
from auv_lse_mavlink.dvl_node import listen_to_dvl
from auv_lse_mavlink.messages import events
from auv_lse_mavlink.messages.conversion import Target
from auv_lse_mavlink.messages.datum import Origin
from auv_lse_mavlink.port import AutopilotPort, Event
from auv_lse_mavlink.targets.limits import target_limits
from auv_lse_mavlink.targets.waypoints import ends_to_reach, target_of

#: Period (s) at which the node looks for mission/state.
_WATCH_S = 1.0


class VehicleLinkNode(DriverNode):
    """vehicle_link_node: MAVLink to the autopilot of one vehicle. Namespace: the vehicle's (/auv1)."""

    def __init__(self) -> None:
        """Creates the link from the parameters, wires the topics and begins to open the endpoint."""
        super().__init__("vehicle_link_node", "vehicle_link")
        config = section(LinkConfig, self.parameters, "link", self.where)
        if config.kind != "mavlink":
            raise ParameterError(f"{self.where}: link.kind is {config.kind!r}, but this node drives only 'mavlink'")
        origin = Origin.of(section(AreaConfig, self.parameters, "area", self.where))
        try:
            limits = target_limits(self.parameters, self.where)
            key = read_key(config.key_file) if config.key_file else None
            simulated = self.lockstep or self.get_parameter("use_sim_time").value
            steady = None if simulated else time.monotonic
            self._autopilot = AutopilotPort(config, self.vehicle, origin, limits, key, steady)
        except ValueError as error:
            raise ParameterError(f"{self.where}: link: {error}") from error
        self.show_parameters({"link": config})
        for kind, *values in self.journal.records:
            if kind == "zero":
                self._autopilot.link.gauge.restore(values[0], self.now_s())
        self._waypoints = 0
        self._disobeys = False  # as last reported
        self._status = self.publisher("autopilot")
        self._started_s = self.now_s()
        self._last: tuple[int, float] | None = None  # step and stamp of the last waypoint
        self._then: Stop | None = None  # the stop after it
        self._pending: list[Waypoint] = []  # received after a restart, not commanded yet
        self._has_state = False  # whether mission/state was received
        self._silent_s: float | None = None  # time without mission/state while the vehicle travels; None: it does not
        self._had_ended = False  # whether this node was restarted after the mission's end
        self._odometry = self.publisher("odometry")
        self._origin_deg = (origin.lat_deg, origin.lon_deg) if origin else None
        self._navsat = self.publisher("navsat") if origin else None
        self._transforms = TransformPublisher(self, self.vehicle)
        self._fix = self.publisher("fix")
        self._dead_reckoning = self.publisher("dead_reckoning")
        self._altitude = self.publisher("altitude")
        self._pressure = self.publisher("pressure")
        if config.soundings:
            self._sounding = self.publisher("sounding")
        listen_to_dvl(self, lambda altitude: self._autopilot.link.take_altitude("topic dvl", altitude))
        self.listen("waypoint", self._on_waypoint)
        self.listen("mission/state", self._on_state)
        if not self.lockstep:
            self.create_timer(_WATCH_S, self._watch_state)
        self.drive(self._autopilot, f"link.endpoint {config.endpoint}")

    def _on_waypoint(self, waypoint: Waypoint) -> None:
        self._waypoints += 1
        step = waypoint.leg.step
        decided = step, waypoint.stamp_s
        if decided == self._last:
            return  # planner_node was restarted and has repeated its last waypoint
        first, self._last = self._last is None, decided
        if self._had_ended:
            return
        self._then = waypoint.then
        if self._pending or (first and (step or decided[1] < self._started_s)):
            self._pending.append(waypoint)  # this node was restarted during the mission: wait for position and state
        else:
            self._command(step, [target_of(waypoint)])
        self.answer_again("vehicle_link")  # this tick was answered before the waypoint arrived

    def _on_state(self, report: RunReport) -> None:
        link = self._autopilot.link
        if report.status.state is RunState.ENDED and not link.counts["targets"]:
            self._had_ended, self._then = True, None  # no target after the end: the vehicle may be far away by now
            self._pending.clear()
        try:
            ended = report.status.state is RunState.ENDED
            link.stop(self.now_s(), report.status.stop_after(self._then), ended)
            self._has_state = True
            self._silent_s = 0.0 if report.status.state is RunState.RUNNING else None
        except ValueError as error:
            self.get_logger().error(f"mission/state: {error}")

    def _watch_state(self) -> None:
        """Surfaces a vehicle that travels without safety_node. Counts periods: this process may have been stopped."""
        if self._silent_s is None:
            return
        self._silent_s += _WATCH_S
        if self._silent_s > LONGEST_SILENCE_S:
            self._silent_s = None
            text = f"{UNWATCHED.reason}: the vehicle surfaces and holds until mission/state arrives"
            self.get_logger().error(text)
            self.report_on_terminal(f"auv{self.vehicle}: {text}")
            self._autopilot.link.stop(self.now_s(), UNWATCHED.stop)

    def _command(self, step: int, ends: list[Target]) -> None:
        try:
            for end in ends:
                self._autopilot.link.command(self.now_s(), end)
        except ValueError as error:
            self.get_logger().error(f"waypoint of step {step}: {error}")

    def polls(self) -> bool:
        """Whether the timer advances the link: in lockstep only before the first tick, to find the autopilot."""
        return super().polls() or self.last_tick("vehicle_link") == 0

    def totals(self) -> tuple[int, ...]:
        """Number of messages sent to the autopilot, and of waypoints received."""
        return self._autopilot.sent, self._waypoints

    def on_event(self, event: Event) -> None:
        """Publishes or logs an event of the link."""
        log = self.get_logger()
        match event:
            case events.AutopilotEstimate():
                self._odometry.publish(event)
                if self._navsat is not None and self._origin_deg is not None:
                    self._navsat.publish(GeodeticPosition.of(event, self._origin_deg))
                raw = DeadReckoning(
                    stamp_s=event.stamp_s,
                    heading_rad=event.heading_rad,
                    north_m=event.raw_north_m,
                    east_m=event.raw_east_m,
                    depth_m=event.depth_m,
                )
                self._dead_reckoning.publish(raw)
                self._transforms.publish(event, raw)
                if self._pending and self._has_state:
                    (first, *later), self._pending = self._pending, []
                    self._command(first.leg.step, ends_to_reach(first, event.north_m, event.east_m))
                    for waypoint in later:
                        self._command(waypoint.leg.step, [target_of(waypoint)])
                self.arrived("odometry")
            case events.AutopilotState():
                self._status.publish(event)
                if bool(event.report.disobeys) != self._disobeys:
                    self._disobeys = not self._disobeys
                    self.diagnose()
            case Fix():
                self._fix.publish(event)
            case Altitude():
                self._altitude.publish(event)
            case Pressure():
                self._pressure.publish(event)
            case Sounding():
                self._sounding.publish(event)
            case events.LinkUp():
                log.info(f"autopilot heard: MAV_AUTOPILOT {event.autopilot}, MAV_TYPE {event.vehicle_type}")
                if self._autopilot.link.counts["lost"]:
                    self.report_on_terminal(f"auv{self.vehicle}: the autopilot is heard again")
                self.diagnose()
            case events.LinkLost():
                text = f"link lost: no heartbeat from the autopilot for {event.silent_s:.1f} s"
                log.error(text)
                self.report_on_terminal(f"auv{self.vehicle}: {text}")
                self.diagnose()
            case events.Zeroed():
                self.journal.write("zero", event.pressure_pa)
                log.info(event.text)
            case events.Surfaced():
                log.info(f"at the surface the depth gauge shows {event.drift_m:+z.2f} m")
            case events.Problem():
                log.warning(event.text)
                self.report_on_terminal(f"auv{self.vehicle}: {event.text}")


#: Entry point of `ros2 run auv_lse_mavlink vehicle_link_node`.
main = Main(VehicleLinkNode)
