"""The link to a vehicle's autopilot: bytes and times in; odometry, altitude and pressure out; waypoints back.

Theory of operation
-------------------
The owner (a node) calls `receive` with bytes, `command` with each new leg's end, and `poll` often; after each it takes
`outgoing` (datagrams) and `events`. `now_s` is the host's clock, s since 1970 (UTC, or simulated).

    state   cause                                               next
    DOWN    HEARTBEAT of the autopilot                          UP      asks for its origin, sets it if it has none
    UP      no HEARTBEAT for `lost_after_s`                     DOWN    the upload under way is dropped
    UP      HEARTBEAT                                           UP

Own heartbeats go out in both states. Every LOCAL_POSITION_NED gives one odometry if an ATTITUDE not older than
`stale_after_s` is there. Stamps are the autopilot's own times (time_boot_ms) carried over to UTC by its SYSTEM_TIME,
if that agrees with the host's clock within `MAX_CLOCK_OFFSET_S`; else the time of receipt.

Nothing is said of places before they are in the mission's frame: until the autopilot's origin is known (asked for every
`ORIGIN_PERIOD_S`), and after one that was refused, neither odometry nor targets pass. An autopilot that reboots (its
time since boot runs backwards, or the link is lost) may have another origin and clock: both are asked for anew.

Waypoints come as ends of legs, in order, each before the one before it is reached; one with the step of an earlier
one replaces it and all after it. In mode "position_target" the
current end is sent as SET_POSITION_TARGET_LOCAL_NED, at once and every `target_period_s`; the next one replaces it when
the vehicle is within `acceptance_m` of it or has passed it. In mode "mission" all ends not yet reached are
uploaded as a mission whenever one is added; the first then becomes the current item, for autopilots keep their index.
While the link is down targets are kept; the vehicle does what its
autopilot's own failsafe says, and when the link is up again the current target, or the mission, is sent again.
"""

from __future__ import annotations

import enum
import math
from collections import Counter, deque
from collections.abc import Callable

from auv_lse_comms.mavlink.config import LinkConfig
from auv_lse_comms.mavlink.conversion import Target, altitude_m, mission_item, position_target, pressure_pa
from auv_lse_comms.mavlink.datum import Datum, Origin
from auv_lse_comms.mavlink.events import (
    Altitude,
    AutopilotEstimate,
    Event,
    LinkLost,
    LinkUp,
    Pressure,
    Problem,
    TargetSent,
)
from auv_lse_comms.mavlink.upload import MissionUpload, UploadState
from auv_lse_comms.mavlink.wire import MavlinkCodec, Message, mavlink

#: The autopilot's UTC is believed if it is within this of the host's clock (s).
MAX_CLOCK_OFFSET_S = 2.0
#: The autopilot's origin is asked for this often until it is known (s).
ORIGIN_PERIOD_S = 2.0
#: The autopilot's origin may lie this far from the mission's before it is reported (m).
ORIGIN_TOLERANCE_M = 1.0
#: An origin of the autopilot's farther than this from the mission's is refused (m): garbage, or another place.
MAX_ORIGIN_OFFSET_M = 10_000.0
#: A time since boot this much less than the last one means a reboot; less than that, a datagram out of order (ms).
REBOOT_MS = 1000
#: Legs' ends kept while the link is down or the vehicle slow; a mission has at most this many ahead.
MAX_TARGETS = 64


class LinkState(enum.Enum):
    """Whether the autopilot is heard."""

    DOWN = "down"
    UP = "up"


class VehicleLink:
    """One vehicle's link to its autopilot; see the module's text for how it works.

    Attributes:
        state: Whether the autopilot is heard.
        armed: Whether it reports to be armed.
        custom_mode: Its flight mode's number, by its own numbering; -1 while unknown.
        counts: What happened, by name.
        datum: The mission's origin and the autopilot's.
    """

    def __init__(self, config: LinkConfig, vehicle: int, origin: Origin | None) -> None:
        """For vehicle number `vehicle`, whose mission has `origin` (None: local places only, no missions).

        Raises:
            ValueError: if missions are to be uploaded and there is no origin.
        """
        if config.mode == "mission" and origin is None:
            raise ValueError(
                "link.mode 'mission' needs area.origin_lat_deg and area.origin_lon_deg: items are geodetic"
            )
        self.state = LinkState.DOWN
        self.armed = False
        self.custom_mode = -1
        self.counts: Counter[str] = Counter()
        self.datum = Datum(origin)
        self._config = config
        self._autopilot = (config.autopilot_system_id or vehicle, config.autopilot_component_id)
        self._codec = MavlinkCodec(config.system_id, config.component_id)
        self._out: list[bytes] = []
        self._events: list[Event] = []
        self._upload = MissionUpload(
            self._send, *self._autopilot, timeout_s=config.upload_timeout_s, retries=config.upload_retries
        )
        self._ardupilot = False
        self._heard_s = -math.inf
        self._beat_s = -math.inf
        self._origin_asked_s = -math.inf
        self._refused_origin: Origin | None = None  # the last one refused
        self._target_s = -math.inf
        self._now_s = -math.inf
        self._boot_offset_s: float | None = None
        self._boot_ms = 0  # the autopilot's latest time since boot
        self._attitude: Message | None = None
        self._attitude_s = -math.inf
        self._place: AutopilotEstimate | None = None
        self._targets: deque[Target] = deque(maxlen=MAX_TARGETS)
        self._unsent = False  # the first target, or the mission, has not been sent as it is now
        self._uploading: tuple[Target, ...] = ()

    # ------------------------------------------------------------------ calls of the owner

    def receive(self, now_s: float, data: bytes) -> None:
        """Takes bytes that came from the endpoint."""
        self._tick(now_s)
        for message in self._codec.decode(data):
            if (message.get_srcSystem(), message.get_srcComponent()) != self._autopilot:
                self.counts["from_others"] += 1
                continue
            handler = HANDLERS.get(message.get_type())
            if handler is not None:
                handler(self, message)
        self._advance()

    def command(self, now_s: float, target: Target) -> None:
        """Queues the end of the next leg; it replaces a queued end of the same step, and all that follow.

        Raises:
            ValueError: if a number in it is not finite.
        """
        self._tick(now_s)
        if not all(map(math.isfinite, (target.north_m, target.east_m, target.depth_m, target.heading_rad))):
            raise ValueError(f"target {target}: expected finite numbers")
        while self._targets and self._targets[-1].step >= target.step:
            self._targets.pop()
            self.counts["targets_replaced"] += 1
        if len(self._targets) == MAX_TARGETS:
            self.counts["targets_dropped"] += 1
            self._events.append(Problem(text=f"more than {MAX_TARGETS} legs wait: the oldest is dropped"))
        self._targets.append(target)
        self.counts["targets"] += 1
        if self._config.mode == "mission" or len(self._targets) == 1:
            self._unsent = True
        self._advance()

    def poll(self, now_s: float) -> None:
        """Lets time pass: heartbeats, link loss, repeats. Call at least ten times a second, or once a tick."""
        self._tick(now_s)
        if now_s - self._beat_s >= self._config.heartbeat_period_s:
            self._beat_s = now_s
            self._send(
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
                    mavlink.MAV_AUTOPILOT_INVALID,
                    0,
                    0,
                    mavlink.MAV_STATE_ACTIVE,
                    3,
                )
            )
        if self.state is LinkState.UP and now_s - self._heard_s >= self._config.lost_after_s:
            self.state = LinkState.DOWN
            self.counts["lost"] += 1
            self._events.append(LinkLost(silent_s=now_s - self._heard_s))
            self._upload.abandon("link lost")
            self._watch_upload()
            self._forget_autopilot()
        if self.state is LinkState.UP:
            self._poll_origin()
            self._upload.poll(now_s)
            self._watch_upload()
        self._advance()

    def recognizes(self, datagram: bytes) -> bool:
        """Whether a datagram holds a whole message of this vehicle's autopilot; counts it if not."""
        senders = {(m.get_srcSystem(), m.get_srcComponent()) for m in MavlinkCodec(0, 0).decode(datagram)}
        self.counts["strangers"] += self._autopilot not in senders
        return self._autopilot in senders

    def outgoing(self) -> list[bytes]:
        """The datagrams to send now, one message each; they are handed out once."""
        data, self._out = self._out, []
        return data

    def events(self) -> list[Event]:
        """What has happened since the last call."""
        events, self._events = self._events, []
        return events

    @property
    def quiet(self) -> bool:
        """No answer of the autopilot is awaited that would come at once (so a lockstep tick may end)."""
        return self.state is LinkState.UP and not self._upload.busy and not self._unsent

    @property
    def targets(self) -> tuple[Target, ...]:
        """Ends of legs not yet reached, the current one first."""
        return tuple(self._targets)

    @property
    def placed(self) -> bool:
        """AutopilotEstimate is in the mission's frame: the autopilot's origin is known, or the mission has none."""
        return self.datum.mission is None or self.datum.autopilot is not None

    @property
    def wire(self) -> Counter[str]:
        """What the wire did: messages, bad bytes, gaps."""
        return self._codec.counts

    # ------------------------------------------------------------------ helpers

    def _tick(self, now_s: float) -> None:
        if now_s < self._now_s:  # the clock was stepped back: waits start anew
            self.counts["clock_steps"] += 1
            self._heard_s = min(self._heard_s, now_s)
            self._beat_s = min(self._beat_s, now_s)
            self._target_s = min(self._target_s, now_s)
            self._origin_asked_s = min(self._origin_asked_s, now_s)
            self._attitude_s = min(self._attitude_s, now_s)
            self._boot_offset_s = None
        self._now_s = now_s

    def _forget_autopilot(self) -> None:
        """Drops what holds only until the autopilot reboots: its clock, its origin, where it said to be."""
        self._boot_offset_s = None
        self._boot_ms = 0
        self._attitude, self._place = None, None
        self.datum = Datum(self.datum.mission)
        self._refused_origin = None
        self._origin_asked_s = -math.inf
        self._unsent = bool(self._targets)

    def _watch_boot(self, boot_ms: int) -> None:
        """Notices by its time since boot that the autopilot has rebooted."""
        if boot_ms < self._boot_ms - REBOOT_MS:
            self.counts["reboots"] += 1
            text = f"the autopilot has rebooted: its time since boot went back to {boot_ms / 1000.0:.1f} s"
            self._events.append(Problem(text=text))
            self._upload.abandon("the autopilot has rebooted")
            self._watch_upload()
            self._forget_autopilot()
        self._boot_ms = max(self._boot_ms, boot_ms)

    def _send(self, message: Message) -> None:
        self._out.append(self._codec.encode(message))

    def _stamp_s(self, boot_ms: int) -> float:
        if self._boot_offset_s is None:
            return self._now_s
        return boot_ms / 1000.0 + self._boot_offset_s

    def _poll_origin(self) -> None:
        if self.datum.autopilot is not None or self._now_s - self._origin_asked_s < ORIGIN_PERIOD_S:
            return
        first = math.isinf(self._origin_asked_s)
        self._origin_asked_s = self._now_s
        mission = self.datum.mission
        if not first and self._config.set_origin and mission is not None and self._refused_origin is None:
            # it did not answer: it has none yet
            self.counts["origin_set"] += 1
            if self.counts["origin_set"] == 1:
                text = (
                    "the autopilot has no origin: the mission's is set; without GPS the place where its estimator "
                    f"started is then taken for latitude {mission.lat_deg:.7f}, longitude {mission.lon_deg:.7f} deg "
                    "(fix: start it there, or wait for its GPS and set link.set_origin to false)"
                )
                self._events.append(Problem(text=text))
            self._send(
                mavlink.MAVLink_set_gps_global_origin_message(
                    self._autopilot[0], round(mission.lat_deg * 1e7), round(mission.lon_deg * 1e7), 0
                )
            )
        self._send(
            mavlink.MAVLink_command_long_message(
                *self._autopilot,
                mavlink.MAV_CMD_REQUEST_MESSAGE,
                0,
                mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
                *(0.0,) * 6,
            )
        )

    # ------------------------------------------------------------------ waypoints

    def _reached(self, target: Target) -> bool:
        place = self._place
        if place is None:
            return False
        north, east = target.north_m - place.north_m, target.east_m - place.east_m
        ahead_m = north * math.cos(target.heading_rad) + east * math.sin(target.heading_rad)
        aside_m = abs(east * math.cos(target.heading_rad) - north * math.sin(target.heading_rad))
        # near it, or past the line across its end at no more than twice the acceptance to the side
        acceptance_m = self._config.acceptance_m
        return math.hypot(north, east) <= acceptance_m or (ahead_m <= 0.0 and aside_m <= 2.0 * acceptance_m)

    def _advance(self) -> None:
        while len(self._targets) > 1 and self._reached(self._targets[0]):
            self._targets.popleft()
            self.counts["reached"] += 1
            if self._config.mode == "position_target":
                self._unsent = True
        if self.state is LinkState.DOWN or not self.placed or not self._targets:
            return
        if self._config.mode == "position_target":
            self._advance_position_target()
        else:
            self._advance_mission()

    def _advance_position_target(self) -> None:
        if not self._unsent and self._now_s - self._target_s < self._config.target_period_s:
            return
        target = self._targets[0]
        boot_ms = max(0, int((self._now_s - (self._boot_offset_s or 0.0)) * 1000.0))
        self._send(position_target(target, self.datum, boot_ms, *self._autopilot))
        self.counts["target_messages"] += 1
        if self._unsent:
            self.counts["targets_sent"] += 1
            self._events.append(TargetSent(target=target))
        self._unsent = False
        self._target_s = self._now_s

    def _advance_mission(self) -> None:
        if self._upload.busy or not self._unsent:
            return
        if self._upload.state is UploadState.FAILED and self._now_s - self._target_s < self._config.upload_timeout_s:
            return
        self._unsent = False
        self._target_s = self._now_s
        self._uploading = tuple(self._targets)
        ends = list(self._uploading)
        if self._ardupilot:
            ends.insert(0, ends[0])  # ArduPilot keeps its home in item 0 and flies from item 1
        items = [
            mission_item(end, self.datum, number, self._config.acceptance_m, *self._autopilot)
            for number, end in enumerate(ends)
        ]
        self._upload.start(self._now_s, items, first=int(self._ardupilot))

    def _watch_upload(self) -> None:
        """Reports an upload that has just ended."""
        if not self._uploading or self._upload.busy:
            return
        if self._upload.state is UploadState.DONE:
            self.counts["uploads"] += 1
            self._events.append(TargetSent(target=self._uploading[-1]))
        else:
            self.counts["uploads_failed"] += 1
            self._events.append(Problem(text=f"mission upload: {self._upload.problem}"))
            self._unsent = True  # tried again after upload_timeout_s, with what is then to be flown
        self._uploading = ()

    # ------------------------------------------------------------------ messages

    def _on_heartbeat(self, message: Message) -> None:
        self._heard_s = self._now_s
        self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self.custom_mode = int(message.custom_mode)
        self._ardupilot = message.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        if self.state is LinkState.DOWN:
            self.state = LinkState.UP
            self.counts["up"] += 1
            self._origin_asked_s = -math.inf
            self._events.append(LinkUp(autopilot=message.autopilot, vehicle_type=message.type))
            self._poll_origin()

    def _on_system_time(self, message: Message) -> None:
        self._watch_boot(message.time_boot_ms)
        if message.time_unix_usec == 0:  # it does not know: it has rebooted, or has never had a fix
            self._boot_offset_s = None
            return
        utc_s = message.time_unix_usec * 1e-6
        if abs(utc_s - self._now_s) <= MAX_CLOCK_OFFSET_S:
            self._boot_offset_s = utc_s - message.time_boot_ms / 1000.0
        else:
            self._boot_offset_s = None
            self.counts["clock_off"] += 1

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
        if not self.placed:
            self.counts["unplaced_positions"] += 1
            return
        if self._attitude is None or self._now_s - self._attitude_s > self._config.stale_after_s:
            self.counts["stale_attitude"] += 1
            return
        north_m, east_m = self.datum.from_local_ned(message.x, message.y)
        self._place = AutopilotEstimate(
            stamp_s=self._stamp_s(message.time_boot_ms),
            heading_rad=float(self._attitude.yaw),
            north_m=north_m,
            east_m=east_m,
            depth_m=float(message.z),
            speed_mps=math.hypot(message.vx, message.vy),
            yaw_rate_radps=float(self._attitude.yawspeed),
        )
        self.counts["odometries"] += 1
        self._events.append(self._place)

    def _on_global_position(self, message: Message) -> None:
        """A second opinion on the datum: the two positions must agree."""
        if self._place is None or self.datum.mission is None:
            return
        north_m, east_m = self.datum.from_geodetic(message.lat, message.lon)
        apart_m = math.hypot(north_m - self._place.north_m, east_m - self._place.east_m)
        moved_m = 2.0 * self._config.stale_after_s * self._place.speed_mps
        if apart_m > ORIGIN_TOLERANCE_M + moved_m + 1e-3 * math.hypot(north_m, east_m):
            self.counts["datum_mismatch"] += 1
            if self.counts["datum_mismatch"] == 1:
                text = f"local and global position are {apart_m:.1f} m apart: another origin? (datum {self.datum})"
                self._events.append(Problem(text=text))

    def _on_origin(self, message: Message) -> None:
        if message.latitude == 0 and message.longitude == 0:
            return
        origin = Origin(lat_deg=message.latitude * 1e-7, lon_deg=message.longitude * 1e-7)
        if self.datum.autopilot == origin:
            return
        datum = Datum(self.datum.mission, origin)
        valid = abs(origin.lat_deg) <= 90.0 and abs(origin.lon_deg) <= 180.0
        north_m, east_m = datum.from_local_ned(0.0, 0.0) if valid else (math.inf, math.inf)
        if not valid or not math.hypot(north_m, east_m) <= MAX_ORIGIN_OFFSET_M:
            self._refuse_origin(origin, math.hypot(north_m, east_m))
            return
        self.datum = datum
        self._refused_origin = None
        if self.datum.mission is not None and math.hypot(north_m, east_m) > ORIGIN_TOLERANCE_M:
            text = (
                f"the autopilot's origin lies {north_m:.1f} m north, {east_m:.1f} m east of the mission's: allowed for"
            )
            self._events.append(Problem(text=text))

    def _refuse_origin(self, origin: Origin, offset_m: float) -> None:
        """Counts an origin that cannot be right, and reports it once; the autopilot's frame is not known then."""
        self.counts["origins_refused"] += 1
        self.datum = Datum(self.datum.mission)
        if origin == self._refused_origin:
            return
        self._refused_origin = origin
        where = f", {offset_m / 1000.0:.1f} km from the mission's" if math.isfinite(offset_m) else ""
        text = (
            f"the autopilot's origin is refused: latitude {origin.lat_deg:.7f}, longitude {origin.lon_deg:.7f} deg"
            f"{where}; expected a place within {MAX_ORIGIN_OFFSET_M / 1000.0:g} km of the mission's origin"
        )
        self._events.append(Problem(text=text))

    def _on_distance(self, message: Message) -> None:
        altitude = altitude_m(message)
        if altitude is not None:
            self._events.append(
                Altitude(
                    stamp_s=self._stamp_s(message.time_boot_ms),
                    altitude_m=altitude,
                    min_m=message.min_distance / 100.0,
                    max_m=message.max_distance / 100.0,
                )
            )

    def _on_pressure(self, message: Message) -> None:
        self._events.append(Pressure(stamp_s=self._stamp_s(message.time_boot_ms), pressure_pa=pressure_pa(message)))

    def _on_mission_request(self, message: Message) -> None:
        self._upload.request(self._now_s, message.seq)
        self._watch_upload()

    def _on_mission_ack(self, message: Message) -> None:
        if message.mission_type != mavlink.MAV_MISSION_TYPE_MISSION or not self._upload.busy:
            return
        self._upload.acknowledge(self._now_s, message.type)
        self._watch_upload()

    def _on_mission_current(self, message: Message) -> None:
        self._upload.current(message.seq)
        self._watch_upload()

    def _on_text(self, message: Message) -> None:
        if message.severity <= mavlink.MAV_SEVERITY_WARNING:
            self._events.append(Problem(text=f"autopilot: {message.text}"))


#: What is done with each message of the autopilot; others are ignored.
HANDLERS: dict[str, Callable[[VehicleLink, Message], None]] = {
    "HEARTBEAT": VehicleLink._on_heartbeat,
    "SYSTEM_TIME": VehicleLink._on_system_time,
    "ATTITUDE": VehicleLink._on_attitude,
    "LOCAL_POSITION_NED": VehicleLink._on_local_position,
    "GLOBAL_POSITION_INT": VehicleLink._on_global_position,
    "GPS_GLOBAL_ORIGIN": VehicleLink._on_origin,
    "DISTANCE_SENSOR": VehicleLink._on_distance,
    "SCALED_PRESSURE2": VehicleLink._on_pressure,
    "MISSION_REQUEST_INT": VehicleLink._on_mission_request,
    "MISSION_REQUEST": VehicleLink._on_mission_request,
    "MISSION_ACK": VehicleLink._on_mission_ack,
    "MISSION_CURRENT": VehicleLink._on_mission_current,
    "STATUSTEXT": VehicleLink._on_text,
}
