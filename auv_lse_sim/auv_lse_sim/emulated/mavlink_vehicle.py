"""A simulated vehicle's autopilot as seen over MAVLink: telemetry out, position targets and missions in.

The simulation reports the vehicle's state once a tick (`report`) and gets each leg to travel (`follow`);
`mavlink_dock.py` connects one autopilot per vehicle to its UDP port. It sends and accepts what an AUV's autopilot does
towards a companion computer or ground station: heartbeat, ATTITUDE, LOCAL_POSITION_NED, GLOBAL_POSITION_INT,
GPS_RAW_INT, DISTANCE_SENSOR, SCALED_PRESSURE2, SYSTEM_TIME; the mission protocol both ways; GPS_GLOBAL_ORIGIN,
REQUEST_MESSAGE, TIMESYNC. Its estimate jumps when GPS returns at the surface. Like ArduPilot, it keeps the index of the
current mission item when a new mission is uploaded, and continues from there unless MISSION_SET_CURRENT changes it.

Rules for targets:

- The vehicle travels to a new target or mission item after the previous one, by the shortest arc and straight of its
  turn radius. For the ends of the planner's legs this reproduces the leg, up to the rounding of the message (float32:
  0.03 mm at 500 m; mission items: 1 cm).
- It turns more tightly for a target inside its turning circle, as far as it can. Such targets occur because leg ends
  move by metres when the map's positions are corrected.
- It turns at once to a position target that comes long before it reaches the previous one, or after it has passed it.
- It dives to a target's depth, in its own datum, and ignores a commanded speed. A target at the surface makes it
  surface where it is.
- A new target at a recent position of the vehicle stops it there. The next different target lets it continue.
"""

import math
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import Action, Stop
from auv_lse_mavlink.messages.conversion import Target, target_of_item, target_of_position
from auv_lse_mavlink.messages.datum import Datum, Origin
from auv_lse_mavlink.messages.wire import MavlinkCodec, Message, mavlink
from auv_lse_sim.emulated.autopilot_report import AIR_PA, Report
from auv_lse_sim.emulated.fault import Fault
from auv_lse_sim.emulated.mavlink_telemetry import depth_telemetry, heartbeat, telemetry, version
from auv_lse_sim.emulated.mission_protocol import MissionProtocol
from auv_lse_sim.vehicle.target_leg import leg_to

#: A target within this distance (m) of an earlier one repeats it; allows for the rounding of mission items.
SAME_M = 0.05
#: A target's heading replaces the heading at the leg's end if they differ by at most this (rad).
SAME_RAD = 0.1
#: A position target that arrives when the vehicle is this far (m) from the previous one replaces it.
REPLACED_M = 8.0
#: A vehicle this far (m) past the end of its leg has passed it and circles.
AT_END_M = 0.5
#: A new target within `SAME_M` of one of this many last reported positions stops the vehicle there.
REPORTS = 8
#: A target shallower than this (m) makes the vehicle surface.
SURFACE_M = 0.5
#: Numbers of targets remembered to recognize repetitions: mission items, which return with each upload; and position
#: targets, only a few, because four quarter turns lead back to a position that is then a new target.
REMEMBERED = 8
REPEATED = 3
#: Number of pressures that are sent on deck, at once.
ON_DECK = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotSetup:
    """Where an autopilot's positions and depths count from, and how it dives.

    Attributes:
        origin_height_m: Height of its estimator's origin, and of home, above the surface.
        pressure: Message with the water's pressure, as in `link.pressure`.
        dive: Called with the depth (m) of each target.
        is_boat: Whether it travels at the surface, so that a target there is a position to go to.
        component_id: MAVLink component id.
    """

    origin_height_m: float = 0.0
    pressure: str = "SCALED_PRESSURE2"
    dive: Callable[[float], None] = lambda depth_m: None
    is_boat: bool = False
    component_id: int = 1


class MavlinkVehicle:
    """One vehicle's autopilot.

    Attributes:
        counts: "targets" (position targets received, repeated ones too), "missions" (accepted), "legs" (handed out),
            "refused".
        current: Index of the current mission item; the number of items at the end.
        datum: The mission's origin and this autopilot's own.
        fault: How it misbehaves; may be set at any time.
        mission: Items of the last accepted mission.
    """

    def __init__(
        self,
        system_id: int,
        start: tuple[float, float, float],
        radius_m: float,
        origin: Origin | None,
        follow: Callable[[Leg], None],
        *,
        obey: Callable[[Stop | None], None] = lambda stop: None,
        tightest_m: float | None = None,
        setup: AutopilotSetup | None = None,
    ) -> None:
        """Starts armed, in guided flight, without a ground station.

        Args:
            system_id: MAVLink system id (the vehicle's number).
            start: Heading (rad), north, east (m) where the first leg begins.
            origin: The mission's origin; None: no geodetic positions.
            follow: Called with each leg, which follows the earlier ones.
            obey: Called with a stop; None: the vehicle continues.
            tightest_m: Radius of the vehicle's tightest turn, for targets inside the turning circle; None: `radius_m`.
            setup: Where its positions and depths count from, and how it dives.
        """
        self.counts: Counter[str] = Counter()
        self.fault = Fault.NONE
        self._setup = setup or AutopilotSetup()
        self.datum = Datum(origin, origin)
        self.mission: tuple[Message, ...] = ()
        self.current = 0
        self._id = system_id, self._setup.component_id
        self._codec = MavlinkCodec(*self._id)
        self._state = start  # at the end of the last leg
        self._last_leg: Leg | None = None
        self._here = start  # last reported pose
        self._passed = False  # whether the vehicle has passed that end
        self._radius_m, self._tightest_m = radius_m, tightest_m
        self._follow, self._obey = follow, obey
        self._stopped: Stop | None = None
        self._reported: deque[tuple[float, float]] = deque(maxlen=REPORTS)  # north, east (m)
        self._recent: deque[Target] = deque(maxlen=REMEMBERED)
        self._out: list[bytes] = []
        self._now_s = 0.0
        self._beat_s = -math.inf
        self._upload = MissionProtocol(self._send, self._accept)

    def receive(self, now_s: float, data: bytes) -> None:
        """Handles bytes from a companion or ground station."""
        self._now_s = now_s
        for message in self._codec.decode(data):
            if not self._is_for_us(message) or self._upload.handle(now_s, message, self.fault is Fault.REFUSES):
                continue
            handler = HANDLERS.get(message.get_type())
            if handler is not None:
                handler(self, message)

    def report(self, now_s: float, report: Report) -> None:
        """Sends the telemetry of one tick."""
        self._now_s = now_s
        self._reported.append((report.north_m, report.east_m))
        self._here = report.heading_rad, report.north_m, report.east_m
        last = self._last_leg
        if last is not None and last.progress_m(report.north_m, report.east_m) > last.length_m + AT_END_M:
            self._passed = True
        if now_s - self._beat_s >= 1.0 or now_s < self._beat_s:
            self._beat_s = now_s
            self._send(heartbeat())
        self._send(mavlink.MAVLink_system_time_message(round(now_s * 1e6), self._boot_ms))
        own_depth = self._setup.origin_height_m, self._setup.pressure
        for message in telemetry(self._boot_ms, report, self.datum, *own_depth):
            self._send(message)
        self._upload.poll(now_s)

    def send_on_deck(self, now_s: float, pressure_pa: float = AIR_PA) -> None:
        """Sends what the other side needs before the mission: heartbeats, and the pressure (Pa) on deck, disarmed."""
        self._now_s = now_s
        heading, north_m, east_m = self._here
        report = Report(heading_rad=heading, north_m=north_m, east_m=east_m, depth_m=0.0, pressure_pa=pressure_pa)
        self._send(heartbeat(armed=False))
        for _ in range(ON_DECK):
            for message in depth_telemetry(
                self._boot_ms, report, self.datum, self._setup.origin_height_m, self._setup.pressure
            ):
                self._send(message)
        self._send(heartbeat())

    def move_origin(self, up_m: float) -> None:
        """Moves the estimator's origin up (m), as a correction by GPS or a ground station does."""
        self._setup = replace(self._setup, origin_height_m=self._setup.origin_height_m + up_m)

    def outgoing(self) -> list[bytes]:
        """The datagrams to send; returns each once."""
        data, self._out = self._out, []
        return data

    # ------------------------------------------------------------------ output

    @property
    def _boot_ms(self) -> int:
        return round(self._now_s * 1000.0) % 2**32

    def _send(self, message: Message) -> None:
        self._out.append(self._codec.encode(message))

    def _is_for_us(self, message: Message) -> bool:
        system = getattr(message, "target_system", 0)
        sender = message.get_srcSystem(), message.get_srcComponent()
        return sender != self._id and system in (0, self._id[0])

    # ------------------------------------------------------------------ targets

    def _go(self, target: Target, remembered: int = REMEMBERED, replaces_m: float = math.inf) -> None:
        """Goes to a target unless it repeats one of the last `remembered`; at once if `replaces_m` from the last."""
        if self.fault in (Fault.REFUSES, Fault.IGNORES):
            return
        depth_m = target.depth_m - self._setup.origin_height_m
        recent = list(self._recent)[-remembered:]
        known = any(_apart_m(target, (last.north_m, last.east_m)) <= SAME_M for last in recent)
        if depth_m <= SURFACE_M and not self._setup.is_boat:  # wherever it surfaces
            self._set_stop(Stop(action=Action.SURFACE))
            return
        self._setup.dive(depth_m)
        if not known and self._stops(target):
            return
        self._set_stop(None)
        if known:
            return
        position_m = (target.north_m, target.east_m)
        _, north_m, east_m = self._here
        at_once = self._last_leg is not None and math.dist((north_m, east_m), self._state[1:]) > replaces_m
        begin = self._here if at_once or self._passed else self._state
        leg = leg_to(*begin, position_m, self._radius_m, self.counts["legs"], self._tightest_m)
        self._recent.append(target)
        # The next leg begins at the target itself, not at the computed end of this leg: heading errors would add up.
        heading = float(leg.end_state[0])
        if abs(math.remainder(target.heading_rad - heading, 2.0 * math.pi)) <= SAME_RAD:
            heading = target.heading_rad
        self._state = (heading, *position_m)
        self._last_leg, self._passed = leg, False
        self.counts["legs"] += 1
        self._follow(leg)

    def _stops(self, target: Target) -> bool:
        """Stops if a target repeats the stop or a recent position; returns whether it does."""
        positions = self._reported if self._stopped is None else [*self._reported, self._stopped.position_m]
        if not any(_apart_m(target, position) <= SAME_M for position in positions):
            return False
        self._set_stop(Stop(action=Action.HOLD, position_m=(target.north_m, target.east_m)))
        return True

    def _set_stop(self, stop: Stop | None) -> None:
        if stop is not None and self.fault is Fault.NEVER_STOPS:
            return
        if stop != self._stopped:
            self._obey(stop)
        self._stopped = stop

    def _send_text(self, severity: int, text: str) -> None:
        self._send(mavlink.MAVLink_statustext_message(severity, text.encode("ascii", "replace")[:50]))

    def _on_position_target(self, message: Message) -> None:
        self.counts["targets"] += 1
        try:
            target = target_of_position(message, self.datum)
        except ValueError as error:
            self.counts["refused"] += 1
            self._send_text(mavlink.MAV_SEVERITY_WARNING, f"position target: {error}")
            return
        self._go(target, REPEATED, REPLACED_M)

    # ------------------------------------------------------------------ missions

    def _accept(self, items: tuple[Message, ...]) -> int:
        """Accepts a complete mission, or not; returns MAV_MISSION_RESULT."""
        if not items:
            self.mission, self.current = (), 0
            return int(mavlink.MAV_MISSION_ACCEPTED)
        for item in items:
            if item.command != mavlink.MAV_CMD_NAV_WAYPOINT:
                continue  # for a camera or gimbal
            try:
                target_of_item(item, self.datum)
            except ValueError as error:
                self.counts["refused"] += 1
                self._send_text(mavlink.MAV_SEVERITY_WARNING, f"item {item.seq}: {error}")
                return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
        self.mission = items
        self.counts["missions"] += 1
        self._travel_mission()
        return int(mavlink.MAV_MISSION_ACCEPTED)

    def _travel_mission(self) -> None:
        """Goes to the current item and the following ones."""
        for item in self.mission[self.current :]:
            if item.command == mavlink.MAV_CMD_NAV_WAYPOINT:
                self._go(target_of_item(item, self.datum))
        self.current = max(self.current, len(self.mission))

    def _on_mission_set_current(self, message: Message) -> None:
        if message.seq < len(self.mission):
            self.current = message.seq
            self._send(mavlink.MAVLink_mission_current_message(message.seq))
            self._travel_mission()
        else:
            self._send_text(mavlink.MAV_SEVERITY_WARNING, f"no item {message.seq}: mission has {len(self.mission)}")

    # ------------------------------------------------------------------ commands, origin, time

    def _on_command(self, message: Message) -> None:
        handler = MESSAGES_ON_REQUEST.get(int(message.param1))
        if message.command == mavlink.MAV_CMD_REQUEST_MESSAGE and handler is not None:
            known = handler(self)
        else:
            known = message.command in (
                mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
                mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
                mavlink.MAV_CMD_MISSION_START,
                mavlink.MAV_CMD_DO_CHANGE_SPEED,
            )
        result = mavlink.MAV_RESULT_ACCEPTED if known else mavlink.MAV_RESULT_UNSUPPORTED
        if self.fault is Fault.REFUSES and handler is None:
            result = mavlink.MAV_RESULT_DENIED
        sender = (message.get_srcSystem(), message.get_srcComponent())
        self._send(mavlink.MAVLink_command_ack_message(message.command, result, 0, 0, *sender))

    def _send_version(self) -> bool:
        self._send(version(self._id[0]))
        return True

    def _send_origin(self) -> bool:
        origin = self.datum.autopilot
        if origin is None:
            return False
        lat, lon = round(origin.lat_deg * 1e7), round(origin.lon_deg * 1e7)
        self._send(mavlink.MAVLink_gps_global_origin_message(lat, lon, 0, round(self._now_s * 1e6)))
        return True

    def _on_set_origin(self, message: Message) -> None:
        if self.datum.autopilot is None:
            own = Origin(lat_deg=message.latitude * 1e-7, lon_deg=message.longitude * 1e-7)
            self.datum = Datum(self.datum.mission, own)
        self._send_origin()

    def _on_timesync(self, message: Message) -> None:
        if message.tc1 == 0:
            self._send(mavlink.MAVLink_timesync_message(round(self._now_s * 1e9), message.ts1))


def _apart_m(target: Target, position_m: tuple[float, float]) -> float:
    return math.hypot(target.north_m - position_m[0], target.east_m - position_m[1])


#: Messages that `MAV_CMD_REQUEST_MESSAGE` can request.
MESSAGES_ON_REQUEST: dict[int, Callable[[MavlinkVehicle], bool]] = {
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: MavlinkVehicle._send_version,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: MavlinkVehicle._send_origin,
}

#: Handler of each message; others are ignored.
HANDLERS: dict[str, Callable[[MavlinkVehicle, Message], None]] = {
    "SET_POSITION_TARGET_LOCAL_NED": MavlinkVehicle._on_position_target,
    "MISSION_SET_CURRENT": MavlinkVehicle._on_mission_set_current,
    "COMMAND_LONG": MavlinkVehicle._on_command,
    "SET_GPS_GLOBAL_ORIGIN": MavlinkVehicle._on_set_origin,
    "TIMESYNC": MavlinkVehicle._on_timesync,
}
