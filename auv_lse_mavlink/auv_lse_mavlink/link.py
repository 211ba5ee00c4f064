"""The link to a vehicle's autopilot: bytes and times in; odometry, altitude and pressure out; waypoints back.

Theory of operation
-------------------
The owner (a node) calls `receive` with bytes, `command` with each new leg's end, `stop` to stop the vehicle, and `poll`
often; after each call it takes `outgoing` (datagrams) and `events`. `now_s` is the host's clock, s since 1970 (UTC, or
simulated).

    state   cause                                               next
    DOWN    HEARTBEAT of the autopilot                          UP      requests its origin, sets it if it has none
    UP      no HEARTBEAT for `lost_after_s`                     DOWN    an upload in progress is aborted
    UP      HEARTBEAT                                           UP

The link sends its own heartbeats in both states. Every LOCAL_POSITION_NED gives one odometry if the last ATTITUDE is at
most `stale_after_s` old. Stamps are the autopilot's own (`clock.py`) where its UTC is known, else times of receipt.

Depth comes from pressure, and depth targets are shifted into the autopilot's datum (`depth_gauge.py`).

Until the autopilot's origin is known, and after one that was refused, positions are not in the mission's frame, so
neither odometry nor targets pass (`origin.py`). An autopilot that reboots (its time since boot runs backwards, or the
link is lost) may have another origin and clock: both are requested again.

Waypoints arrive as ends of legs (`targets/sender.py`). While the link is down, targets are kept and the autopilot's own
failsafe acts. When it is up again, the current target, or the mission, is sent again.
"""

import enum
import math
from collections import Counter
from collections.abc import Callable

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.safety.watch import AutopilotReport
from auv_lse_common.topics.records import Altitude, Pressure
from auv_lse_common.vocabulary.mission_run import Stop
from auv_lse_mavlink.depth_gauge import DepthGauge
from auv_lse_mavlink.messages.clock import AutopilotClock, HostClock
from auv_lse_mavlink.messages.conversion import Target, altitude_m, pressure_pa
from auv_lse_mavlink.messages.datum import Datum, Origin
from auv_lse_mavlink.messages.events import AutopilotEstimate, AutopilotState, Event, LinkLost, LinkUp, Problem
from auv_lse_mavlink.messages.modes import obeying_modes
from auv_lse_mavlink.messages.origin import OriginExchange
from auv_lse_mavlink.messages.sender_filter import SenderFilter
from auv_lse_mavlink.messages.sonar_choice import SonarChoice
from auv_lse_mavlink.messages.status import ORIGIN_REFUSED, AutopilotStatus
from auv_lse_mavlink.messages.wire import MavlinkCodec, Message, mavlink
from auv_lse_mavlink.raw_track import RawTrack
from auv_lse_mavlink.targets.limits import TargetLimits
from auv_lse_mavlink.targets.sender import TargetSender


class LinkState(enum.Enum):
    """Whether the autopilot is heard."""

    DOWN = "down"
    UP = "up"


class VehicleLink:
    """One vehicle's link to its autopilot.

    Attributes:
        state: Whether the autopilot is heard.
        status: What the autopilot reports about itself.
        gauge: Depth of the vehicle.
        senders: Who sends on its port.
        counts: Event counts by name.
    """

    def __init__(
        self,
        config: LinkConfig,
        vehicle: int,
        origin: Origin | None,
        limits: TargetLimits | None = None,
        key: bytes | None = None,
        nonce: int | None = None,
        steady: Callable[[], float] | None = None,
    ) -> None:
        """Starts in state DOWN.

        Args:
            config: Section `link`.
            origin: The mission's origin; None: local positions only, no missions.
            limits: Limits of targets; None: any target passes.
            key: Key with which messages are signed, both ways; None: they are not signed.
            nonce: With a key: a random number that the autopilot must repeat before it counts as heard, so that no
                recorded message does (`wire.py`).
            steady: A clock (s) that is never set, which times all waits; None: time is simulated.

        Raises:
            ValueError: if missions are to be uploaded and there is no origin, or the key has a wrong length.
        """
        if config.mode == "mission" and origin is None:
            raise ValueError(
                "link.mode: 'mission' needs area.origin_lat_deg and area.origin_lon_deg, because mission items "
                "are geodetic"
            )
        self.state = LinkState.DOWN
        self.status = AutopilotStatus(config.battery_wh)
        self.counts: Counter[str] = Counter()
        self._config = config
        self._autopilot = (config.autopilot_system_id or vehicle, config.autopilot_component_id)
        self._codec = MavlinkCodec(config.system_id, config.component_id, key, nonce)
        self.senders = SenderFilter(
            self._codec, self._autopilot, config.lost_after_s, self.counts, self._report_problem
        )
        self._out: list[bytes] = []
        self._events: list[Event] = []
        self._clock = AutopilotClock()
        self._origin = OriginExchange(
            origin, self._autopilot, config.set_origin, self.send, self._report_problem, self.counts
        )
        limits = limits or TargetLimits()
        self._targets = TargetSender(config, self._autopilot, limits, self.send, self._report_event, self.counts)
        latitude_deg = None if origin is None else origin.lat_deg
        self.gauge = DepthGauge(config, latitude_deg, self._report_event, self.counts, limits.is_afloat)
        self._fix_s = -math.inf  # when GPS last had a fix
        self._received_s = -math.inf  # when the last message of the autopilot arrived
        self._utc_s, self._host_clock = -math.inf, HostClock(steady)
        self._heard_s = self._beat_s = self._now_s = self._attitude_s = self._placed_s = -math.inf
        self._heard_utc_s = -math.inf
        self._attitude: Message | None = None
        self._sonar = SonarChoice(config.stale_after_s, self._report_problem, self.counts)
        self._position: AutopilotEstimate | None = None
        self._problem = (0.0, "")  # time (s) for which the autopilot has refused or ignored its targets, and how
        self._raw, self._raw_in = RawTrack(), self.datum

    # ------------------------------------------------------------------ calls of the owner

    def receive(self, now_s: float, data: bytes) -> None:
        """Processes bytes from the endpoint."""
        self._tick(now_s)
        for message in self._codec.decode(data):
            sender = message.get_srcSystem(), message.get_srcComponent()
            if sender != self._autopilot:
                self.senders.heard(sender)
                self.counts["from_others"] += 1
                continue
            if not self._codec.is_addressed(message):
                self.counts["to_others"] += 1
                continue
            self._received_s = self._now_s
            self.senders.heard(sender)
            handler = HANDLERS.get(message.get_type())
            if handler is not None:
                handler(self, message)
        self._advance()

    def command(self, now_s: float, target: Target) -> None:
        """Queues the end of the next leg; it replaces a queued end of the same step, and all that follow.

        Raises:
            ValueError: if a number in it is not finite, or it is too deep or too far outside the area.
        """
        self._tick(now_s)
        self._origin.has_targets = True
        self._targets.add(target, self._position)
        self._advance()

    def stop(self, now_s: float, stop: Stop | None, ended: bool = False) -> None:
        """Stops the vehicle, or lets it continue (None); `ended`: after the mission's end."""
        self._tick(now_s)
        self._targets.stop(stop, ended)
        self._advance()

    def send(self, message: Message) -> None:
        """Sends a message to the autopilot."""
        self._out.append(self._codec.encode(message))

    def take_altitude(self, sensor: str, altitude: Altitude) -> None:
        """Uses a height over ground, of the autopilot or of another sensor, unless another sensor is in use."""
        if self._sonar.takes(self._now_s, sensor):
            self._targets.lift.keeper.ping(altitude.altitude_m)
            self._events.append(altitude)

    def poll(self, now_s: float) -> None:
        """Lets time pass: heartbeats, link loss, repeats. Call at least ten times a second, or once per tick."""
        self._tick(now_s)
        if self._now_s - self._beat_s >= self._config.heartbeat_period_s:
            self._beat_s = self._now_s
            kind = mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID
            self.send(mavlink.MAVLink_heartbeat_message(*kind, 0, 0, mavlink.MAV_STATE_ACTIVE, 3))
            if not self._codec.proven(self._autopilot):
                self.send(self._codec.challenge)
        if self.state is LinkState.UP and self._now_s - self._heard_s >= self._config.lost_after_s:
            self.state = LinkState.DOWN
            self.counts["lost"] += 1
            self._events += [LinkLost(silent_s=self._now_s - self._heard_s), self._autopilot_state()]
            self._forget_autopilot(rebooted=False)
        if self.state is LinkState.UP:
            self._origin.poll(self._now_s)
            self._targets.poll(self._now_s)
        self._judge()
        self._advance()

    def recognizes(self, datagram: bytes) -> bool:
        """Whether a new sender's datagram contains a message of this vehicle's autopilot; counts it if not."""
        return self.senders.recognizes(datagram)

    def outgoing(self) -> list[bytes]:
        """The datagrams to send now, one message each; each is returned once."""
        data, self._out = self._out, []
        return data

    def events(self) -> list[Event]:
        """The events since the last call."""
        events, self._events = self._events, []
        return events

    @property
    def quiet(self) -> bool:
        """Whether origin and zero of depth are known and no answer is pending: a lockstep tick may end."""
        return self.state is LinkState.UP and self.placed and self.gauge.is_ready and self._targets.settled

    @property
    def targets(self) -> tuple[Target, ...]:
        """Ends of legs not yet reached, the current one first."""
        return self._targets.targets

    @property
    def datum(self) -> Datum:
        """The mission's origin and the autopilot's."""
        return self._origin.datum

    @property
    def placed(self) -> bool:
        """Whether positions are in the mission's frame: the autopilot's origin is known, or the mission has none."""
        return self._origin.placed

    @property
    def origin_problem(self) -> str:
        """Why positions are not in the mission's frame; "" if they are."""
        return self._origin.problem

    @property
    def obeying_modes(self) -> tuple[int, ...]:
        """The flight modes in which the autopilot follows targets; empty: unknown, any may be right."""
        return self._config.modes or obeying_modes(*self.status.kind, self._config.mode == "mission")

    @property
    def report(self) -> AutopilotReport:
        """The autopilot's state as it reports it."""
        modes = self.obeying_modes
        return AutopilotReport(
            heard=self.state is LinkState.UP,
            armed=self.status.armed,
            mode=self.status.mode,
            mode_obeys=not modes or self.status.mode in modes,
            battery=self.status.charge_at(self._now_s),
            leak=1 if self.status.leaks(self._now_s) else -1,
            disobeys=self._origin.contradiction or (self._problem[1] if self._problem[0] else ""),
            depth_problem=self._depth_problem,
            stamp_s=self._heard_utc_s,
        )

    @property
    def _depth_problem(self) -> str:
        """Reason not to trust the depth, apart from silence of the whole autopilot."""
        return self.gauge.problem(min(self._now_s, self._received_s)) if self.state is LinkState.UP else ""

    @property
    def problem(self) -> tuple[float, str]:
        """Time (s) for which the autopilot has refused or ignored its targets, and how; 0, "" if it follows them."""
        return self._problem

    @property
    def refused_speed(self) -> str:
        """The result of DO_CHANGE_SPEED if the autopilot refused the last one."""
        return self._targets.refused_speed

    @property
    def under_way(self) -> bool:
        """Whether targets wait and the mission's last one is not among them."""
        return self._targets.under_way

    @property
    def wire(self) -> Counter[str]:
        """Counts of messages, bad bytes and gaps on the wire."""
        return self._codec.counts

    # ------------------------------------------------------------------ helpers

    def _tick(self, now_s: float) -> None:
        """Advances to the host's clock. If that is set, `_now_s`, which times all waits, does not jump with it."""
        if self._host_clock.advance(now_s):
            self.counts["clock_steps"] += 1
            self._clock.forget_utc()
        self._utc_s, self._now_s = now_s, self._host_clock.now_s
        self.senders.renew(self._now_s)
        self._codec.set_time(now_s)

    def _forget_autopilot(self, rebooted: bool) -> None:
        """Discards what a reboot of the autopilot invalidates: its clock, its origin, its position."""
        self._clock.forget_utc()
        self._origin.forget(rebooted)
        self._attitude, self._position = None, None
        self._raw.interrupt()
        self.gauge.forget()
        self._targets.resend(rebooted)

    def _watch_boot(self, boot_ms: int) -> None:
        """Detects a reboot of the autopilot from its time since boot."""
        if self._clock.detect_reboot(boot_ms):
            self.counts["reboots"] += 1
            self._report_problem(f"the autopilot rebooted: its time since boot went back to {boot_ms / 1000.0:.1f} s")
            self._forget_autopilot(rebooted=True)

    def _report_event(self, event: Event) -> None:
        self._events.append(event)

    def _report_problem(self, text: str) -> None:
        self._events.append(Problem(text=text))

    def _advance(self) -> None:
        for text in self.status.texts(self._now_s):
            self._report_problem(f"autopilot: {text}")
        self._targets.pass_reached(self._now_s, self._position)
        if self.state is LinkState.UP and self.placed and not self.gauge.settling(self._now_s):
            boot_ms = self._clock.boot_ms_at(self._utc_s)
            self._targets.send(self._now_s, boot_ms, self.datum, self.gauge.own_target_m)

    def _judge(self) -> None:
        """Judges whether the autopilot carries out its targets; reports it when that changes."""
        known_s, known = self._problem
        ready = self.placed and not self.report.problem
        if not ready or self._now_s - self._placed_s > self._config.stale_after_s:
            self._targets.watch(self._now_s, None)
        self._problem = self._targets.problem(self._now_s) if ready else (0.0, "")
        ignored_s, text = self._problem
        if (bool(known), known_s > 0.0) != (bool(text), ignored_s > 0.0):
            self.counts["disobeyed"] += ignored_s > 0.0
            self._report_problem(text or f"over: {known}")
            self._events.append(self._autopilot_state())

    def _autopilot_state(self) -> AutopilotState:
        return AutopilotState(stamp_s=self._heard_utc_s, report=self.report, battery_v=self.status.battery_v)

    # ------------------------------------------------------------------ messages

    def _on_heartbeat(self, message: Message) -> None:
        self._heard_s, self._heard_utc_s = self._now_s, self._utc_s
        self.status.heartbeat(message)
        if self.state is LinkState.DOWN:
            self.state = LinkState.UP
            self.counts["up"] += 1
            self._events.append(LinkUp(autopilot=message.autopilot, vehicle_type=message.type))
            self._origin.ask_at_once(self._now_s)
        report = self.report
        self._targets.set_state(self.status.is_ardupilot, report.armed, report.mode, report.mode_obeys)
        self._events.append(self._autopilot_state())

    def _on_system_time(self, message: Message) -> None:
        self._watch_boot(message.time_boot_ms)
        if not self._clock.set_utc(self._utc_s, message.time_unix_usec, message.time_boot_ms):
            self.counts["clock_off"] += message.time_unix_usec != 0  # 0: unknown

    def _on_attitude(self, message: Message) -> None:
        self._watch_boot(message.time_boot_ms)
        if math.isfinite(message.yaw):
            self._attitude = message
            self._attitude_s = self._now_s

    def _on_local_position(self, message: Message) -> None:
        if not all(map(math.isfinite, (message.x, message.y, message.z, message.vx, message.vy))):
            self.counts["bad_positions"] += 1
            return
        self._watch_boot(message.time_boot_ms)
        if self._config.mode == "position_target":
            self.gauge.own_depth(self._now_s, float(message.z))
        if not self.placed:
            self.counts["unplaced_positions"] += 1
            return
        if self._attitude is None or self._now_s - self._attitude_s > self._config.stale_after_s:
            self.counts["stale_attitude"] += 1
            return
        north_m, east_m = self.datum.from_local_ned(message.x, message.y)
        stamp_s = self._clock.stamp_s(self._utc_s, message.time_boot_ms)
        if self.datum != self._raw_in:  # positions have shifted with the origin
            self._raw_in = self.datum
            self._raw.interrupt()
        depth_m = self.gauge.depth_m(self._now_s, float(message.z))
        fix = self._raw.move(stamp_s, north_m, east_m, depth_m, float(message.vx), float(message.vy))
        if self._raw.jumps > self.counts["jumps_undone"]:
            self.counts["jumps_undone"] = self._raw.jumps
            self._targets.doubt(self._now_s)
        self._position = AutopilotEstimate(
            stamp_s=stamp_s,
            heading_rad=float(self._attitude.yaw),
            north_m=north_m,
            east_m=east_m,
            depth_m=depth_m,
            speed_mps=math.hypot(message.vx, message.vy),
            yaw_rate_radps=float(self._attitude.yawspeed) if math.isfinite(self._attitude.yawspeed) else 0.0,
            raw_north_m=self._raw.north_m,
            raw_east_m=self._raw.east_m,
        )
        self._placed_s = self._now_s
        self._targets.lift.keeper.move(self._now_s, north_m, east_m, depth_m, self._position.speed_mps)
        if not self.report.problem:
            self._targets.watch(self._now_s, self._position)
        self.counts["odometries"] += 1
        if fix is not None:
            self.counts["fixes"] += 1
            self._events.append(fix)
        self._events.append(self._position)

    def _on_gps(self, message: Message) -> None:
        fixed = message.fix_type >= mavlink.GPS_FIX_TYPE_3D_FIX
        self._targets.gps(self._now_s, fixed)
        if fixed:
            self._fix_s = self._now_s
            self._raw.gps(message.h_acc / 1000.0)

    def _on_global_position(self, message: Message) -> None:
        """Records the depth that mission items count from; checks that local and global position agree."""
        if self._config.mode == "mission":
            self.gauge.own_depth(self._now_s, -message.relative_alt / 1000.0)
        if self._position is not None:
            moved_m = 2.0 * self._config.stale_after_s * self._position.speed_mps
            self._origin.check(
                self._now_s, message.lat, message.lon, (self._position.north_m, self._position.east_m), moved_m
            )

    def _on_origin(self, message: Message) -> None:
        datum = self.datum
        self._origin.take(message.latitude, message.longitude)
        if self.datum != datum:
            self.gauge.forget()
            self._targets.origin_moved()

    def _on_distance(self, message: Message) -> None:
        altitude = altitude_m(message)
        if altitude is not None:
            stamp_s = self._clock.stamp_s(self._utc_s, message.time_boot_ms)
            least_m, most_m = message.min_distance / 100.0, message.max_distance / 100.0
            taken = Altitude(stamp_s=stamp_s, altitude_m=altitude, min_m=least_m, max_m=most_m)
            self.take_altitude(f"DISTANCE_SENSOR {message.id}", taken)

    def _on_pressure(self, message: Message) -> None:
        if message.get_type() != self._config.pressure:
            return
        has_fix = self._now_s - self._fix_s <= self._config.stale_after_s
        armed = self.status.armed
        self.gauge.set_state(not armed or (has_fix and self._targets.stopped), has_fix, armed)
        self.gauge.pressure(self._now_s, pressure_pa(message))
        if math.isfinite(message.press_abs):
            stamp_s = self._clock.stamp_s(self._utc_s, message.time_boot_ms)
            self._events.append(Pressure(stamp_s=stamp_s, pressure_pa=pressure_pa(message)))

    def _on_power(self, message: Message) -> None:
        self.status.power(self._now_s, message)

    def _on_navigation(self, message: Message) -> None:
        if self._position is not None and not self.report.problem:
            self._targets.feedback(self._now_s, float(message.wp_dist), self._position)

    def _on_command_ack(self, message: Message) -> None:
        if message.command == mavlink.MAV_CMD_DO_CHANGE_SPEED:  # requests for the origin are answered by its message
            self._targets.speed_answered(message.result)
        elif message.command == mavlink.MAV_CMD_DO_SET_MISSION_CURRENT:
            self._targets.restart_answered(self._now_s, message.result)

    def _on_mission_request(self, message: Message) -> None:
        self._targets.requested(self._now_s, message.seq)

    def _on_mission_ack(self, message: Message) -> None:
        if message.mission_type == mavlink.MAV_MISSION_TYPE_MISSION:
            self._targets.acknowledged(self._now_s, message.type)

    def _on_mission_current(self, message: Message) -> None:
        self._targets.now_at_item(message.seq, message.mission_state)

    def _on_text(self, message: Message) -> None:
        if ORIGIN_REFUSED in message.text:
            self._origin.setting_refused(self._now_s)
        self.status.text(self._now_s, message)


#: Handler of each message of the autopilot; others are ignored.
HANDLERS: dict[str, Callable[[VehicleLink, Message], None]] = {
    "HEARTBEAT": VehicleLink._on_heartbeat,
    "SYSTEM_TIME": VehicleLink._on_system_time,
    "SYS_STATUS": VehicleLink._on_power,
    "BATTERY_STATUS": VehicleLink._on_power,
    "ATTITUDE": VehicleLink._on_attitude,
    "LOCAL_POSITION_NED": VehicleLink._on_local_position,
    "GLOBAL_POSITION_INT": VehicleLink._on_global_position,
    "GPS_RAW_INT": VehicleLink._on_gps,
    "GPS_GLOBAL_ORIGIN": VehicleLink._on_origin,
    "DISTANCE_SENSOR": VehicleLink._on_distance,
    **dict.fromkeys(("SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3"), VehicleLink._on_pressure),
    "NAV_CONTROLLER_OUTPUT": VehicleLink._on_navigation,
    "COMMAND_ACK": VehicleLink._on_command_ack,
    "MISSION_REQUEST_INT": VehicleLink._on_mission_request,
    "MISSION_REQUEST": VehicleLink._on_mission_request,
    "MISSION_ACK": VehicleLink._on_mission_ack,
    "MISSION_CURRENT": VehicleLink._on_mission_current,
    "STATUSTEXT": VehicleLink._on_text,
}
