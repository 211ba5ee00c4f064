"""Checks an autopilot before the dive: its messages and their rates, its origin, mode and parameters.

`AutopilotCheck` opens no port and reads no clock: `receive` takes bytes and times, `outgoing` returns datagrams to
send, `findings` lists what was seen and what is missing, `changes` the parameters to set. It uses a `VehicleLink`, so
its findings hold for the link.
"""

import itertools
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.support.device_findings import Finding
from auv_lse_common.support.plurals import counted
from auv_lse_mavlink.check.parameters import Change, ParameterReader
from auv_lse_mavlink.check.rules import STREAMS, Setting, after_silence, rules
from auv_lse_mavlink.depth_gauge import LEAST_PA
from auv_lse_mavlink.health import silence_of
from auv_lse_mavlink.link import LinkState, VehicleLink
from auv_lse_mavlink.messages.conversion import DOWN, Target
from auv_lse_mavlink.messages.datum import Origin
from auv_lse_mavlink.messages.events import AutopilotEstimate, Event, LinkUp, Problem, Zeroed
from auv_lse_mavlink.messages.modes import obeying_modes
from auv_lse_mavlink.messages.wire import SIGNING_EPOCH_S, SIGNING_PARTS, MavlinkCodec, Message, mavlink

#: Required messages: their lowest rate (1/s) and their purpose.
NEEDED = {
    "HEARTBEAT": (0.5, "the link, which counts as lost without it"),
    "LOCAL_POSITION_NED": (1.0, "odometry"),
    "ATTITUDE": (1.0, "odometry"),
    "DISTANCE_SENSOR": (0.5, "altitude and soundings (orientation 25: down), unless another node publishes soundings"),
}
#: Optional messages: the consequence of their absence.
USEFUL = {
    "SYSTEM_TIME": "stamps are times of receipt",
    "SYS_STATUS": "the safety watch cannot check the battery",
    "GLOBAL_POSITION_INT": "the origin is not checked against the global position",
}
#: A leg of the flight (m), and how long it may take (s).
LEG_M, LEG_S = 20.0, 60.0


#: Sounder readings beyond the range finder's greatest distance (m) give no soundings.
_REACH = "RNGFND1_MAX_CM (RNGFND1_MAX since 4.8)"


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckOptions:
    """The options of a check.

    Attributes:
        mission: Whether missions are uploaded, which takes another flight mode.
        origin: The mission's origin, which a vehicle without GPS is given; None: none is set.
        depth_m: Greatest water depth to be sounded (m); NaN: unknown.
        port: Number of the autopilot's port, n in SRn_....
    """

    mission: bool = False
    origin: Origin | None = None
    depth_m: float = math.nan
    port: int = 0


class AutopilotCheck:
    """Listens to one autopilot, requests its parameters, and optionally travels three legs.

    Attributes:
        messages: Number of its messages by type; DISTANCE_SENSOR only those that look down.
        problems: Problems that the link has reported.
        parameters: The autopilot's parameters.
    """

    def __init__(
        self,
        config: LinkConfig,
        vehicle: int,
        options: CheckOptions | None = None,
        key: bytes | None = None,
        nonce: int | None = None,
        steady: Callable[[], float] | None = None,
    ) -> None:
        """Prepares the check; arguments as for `VehicleLink`."""
        self._options = options or CheckOptions()
        self.link = VehicleLink(config, vehicle, self._options.origin, key=key, nonce=nonce, steady=steady)
        self._key = key
        self.messages: Counter[str] = Counter()
        self.problems: list[str] = []
        self._config = config
        self._autopilot = config.autopilot_system_id or vehicle, config.autopilot_component_id
        self._reader = MavlinkCodec(config.system_id, config.component_id, key, nonce)
        self._kind = (mavlink.MAV_AUTOPILOT_INVALID, mavlink.MAV_TYPE_GENERIC)
        self._origin = False
        self.parameters = ParameterReader(self.link.send, *self._autopilot)
        self._has_gps: bool | None = None
        self._distance: tuple[float, float] | None = None  # the last one and the greatest possible (m)
        self._since_s = math.nan
        self._now_s = math.nan
        self._position: AutopilotEstimate | None = None
        self._legs: list[Target] = []
        self._leg_since_s = math.nan
        self._flown = 0
        self._flight = ""  # why the legs were not completed

    @property
    def heard(self) -> bool:
        """Whether the autopilot is heard."""
        return self.link.state is LinkState.UP

    @property
    def flying(self) -> bool:
        """Whether legs remain."""
        return bool(self._legs) and not self._flight

    def receive(self, now_s: float, data: bytes) -> None:
        """Processes bytes from the autopilot, possibly none, and lets time pass."""
        self._now_s = now_s
        self._reader.set_time(now_s)
        for message in self._reader.decode(data):
            if (message.get_srcSystem(), message.get_srcComponent()) == self._autopilot:
                self._take(message)
        if data:
            self.link.receive(now_s, data)
        self.link.poll(now_s)
        self._note(self.link.events())
        self._fly(now_s)

    def outgoing(self) -> list[bytes]:
        """The datagrams to send now."""
        return self.link.outgoing()

    def ask(self) -> None:
        """Requests the parameters that are still unknown; call it repeatedly, because datagrams get lost."""
        self.parameters.ask(rules(self._setting))

    def changes(self) -> list[Change]:
        """The parameters to change, in the order of the findings."""
        return self.parameters.judge(rules(self._setting))[1]

    def send_key(self, now_s: float) -> None:
        """Gives the autopilot the key (SETUP_SIGNING): it signs from then on, and accepts signed messages only."""
        if self._key is not None:
            started_at = max(0, int((now_s - SIGNING_EPOCH_S) * SIGNING_PARTS))
            self.link.send(mavlink.MAVLink_setup_signing_message(*self._autopilot, list(self._key), started_at))

    @property
    def _setting(self) -> Setting:
        heard_s = max(self._now_s - self._since_s, 1e-9)
        return Setting(
            kind=self._kind,
            own_id=self._config.system_id,
            density_kgpm3=self._config.water_density_kgpm3,
            depth_m=self._options.depth_m,
            has_gps=self._has_gps,
            port=self._options.port,
            rates_hz={kind: count / heard_s for kind, count in self.messages.items()},
        )

    @property
    def farewell(self) -> str:
        """The vehicle's reaction when this check ends and its heartbeats stop; "" if that is unknown."""
        return after_silence(self._setting, self.parameters.values)

    def fly(self, now_s: float) -> str:
        """Begins three legs: ahead, to starboard, and back.

        Returns:
            Why they cannot begin; "" if they do.
        """
        problem = self.link.report.problem or ("" if self._position is not None else "there is no odometry")
        if problem or self._position is None:
            self._flight = problem
            return problem
        here = self._position
        positions, heading = [(here.north_m, here.east_m)], here.heading_rad
        for turn in (0.0, 0.5 * math.pi):
            north_m, east_m = positions[-1]
            way = heading + turn
            positions.append((north_m + LEG_M * math.cos(way), east_m + LEG_M * math.sin(way)))
        positions.append(positions[0])
        for step, ((n0, e0), (n1, e1)) in enumerate(itertools.pairwise(positions)):
            way = math.atan2(e1 - e0, n1 - n0)
            self._legs.append(Target(north_m=n1, east_m=e1, depth_m=here.depth_m, heading_rad=way, step=step))
        self._leg_since_s = now_s
        self.link.command(now_s, self._legs[0])
        return ""

    def _fly(self, now_s: float) -> None:
        if not self.flying or self._position is None:
            return
        target = self._legs[0]
        off_m = math.hypot(target.north_m - self._position.north_m, target.east_m - self._position.east_m)
        if off_m <= self._config.acceptance_m:
            self._flown += 1
            self._leg_since_s = now_s
            del self._legs[0]
            if self._legs:
                self.link.command(now_s, self._legs[0])
        elif now_s - self._leg_since_s > LEG_S:
            self._flight = f"leg {self._flown + 1}: still {off_m:.0f} m from its end after {LEG_S:g} s"

    def _take(self, message: Message) -> None:
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self._kind = (message.autopilot, message.type)
            if math.isnan(self._since_s):
                self._since_s = self._now_s
        elif kind == "GPS_GLOBAL_ORIGIN":
            self._origin = message.latitude != 0 or message.longitude != 0
        elif kind == "PARAM_VALUE":
            self.parameters.take(message, self._kind[0] == mavlink.MAV_AUTOPILOT_PX4)
        elif kind == "GPS_RAW_INT":
            self._has_gps = bool(self._has_gps) or message.fix_type >= mavlink.GPS_FIX_TYPE_3D_FIX
        elif kind == "DISTANCE_SENSOR" and message.orientation != DOWN:
            return
        elif kind.startswith("SCALED_PRESSURE") and message.press_abs < LEAST_PA / 100.0:
            return  # ArduSub's temperature sensor
        elif kind == "DISTANCE_SENSOR":
            self._distance = message.current_distance / 100.0, message.max_distance / 100.0
        self.messages[kind] += 1

    def _note(self, events: list[Event]) -> None:
        for event in events:
            if isinstance(event, AutopilotEstimate):
                self._position = event
            elif isinstance(event, Problem):
                self.problems.append(event.text)
            elif isinstance(event, LinkUp):
                self.ask()

    def findings(self) -> list[Finding]:
        """The findings: what was seen or is missing."""
        if not self.heard:
            others = ", ".join(
                f"{system} (component {component})" for system, component in sorted(self.link.senders.others)
            )
            text = f"no heartbeat of system {self._autopilot[0]}: {silence_of(self.link)}"
            return [Finding(ok=False, text=f"{text}; heard instead: {others}" if others else text)]
        found = [*self._streams(), *self._depth_findings(), *self._states()]
        return [*found, *self.parameters.judge(rules(self._setting))[0], *self._flight_findings()]

    def _streams(self) -> list[Finding]:
        heard_s = max(self._now_s - self._since_s, 1e-9)
        found = []
        for kind, (least_hz, use) in NEEDED.items():
            rate_hz = self.messages[kind] / heard_s
            text = f"{kind}: {rate_hz:.1f} Hz"
            ok = rate_hz >= least_hz
            short = f"{text}; at least {least_hz:g} Hz are needed for {use}. {self._cure(kind)}"
            found.append(Finding(ok=ok, text=text if ok else short.rstrip()))
        for kind, without in USEFUL.items():
            if not self.messages[kind]:
                found.append(Finding(ok=None, text=f"{kind}: not sent; {without}. {self._cure(kind)}".rstrip()))
        if self._distance is not None and self._distance[0] > self._distance[1]:
            text = "the ground is {:.1f} m below, and distances beyond {:.1f} m give no soundings. Raise " + _REACH
            found.append(Finding(ok=False, text="DISTANCE_SENSOR: " + text.format(*self._distance)))
        return found

    def _cure(self, kind: str) -> str:
        """The parameter that makes an ArduPilot send a message, or what else it waits for."""
        if self._kind[0] != mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
            return ""
        if kind == "LOCAL_POSITION_NED" and not self._origin:
            how = "--origin LAT LON sets one" if self._options.origin is None else "it has not taken that of --origin"
            return f"Without GPS it begins when an origin is set: {how}"
        group = next((group for group, kinds in STREAMS.items() if kind in kinds), "")
        n = self._options.port
        cure = f"Set SR{n}_{group} (MAV{n + 1}_{group} since 4.8), then reboot" if group else ""
        return f"{cure}; check RNGFND1_TYPE" if kind == "DISTANCE_SENSOR" else cure

    def _depth_findings(self) -> list[Finding]:
        """Which pressure is sent and how often, its zero, and how it agrees with the autopilot's own depth."""
        wanted, gauge = self._config.pressure, self.link.gauge
        sent = {kind: count for kind, count in self.messages.items() if kind.startswith("SCALED_PRESSURE")}
        if wanted == "none":
            return [Finding(ok=None, text="link.pressure is none: depth is the autopilot's own")]
        if wanted not in sent:
            text = f"{wanted}: not sent, but depth needs it (link.pressure; none for a boat)"
            text += f". Sent instead: {', '.join(sorted(sent))}" if sent else ""
            return [Finding(ok=False, text=f"{text}. {self._cure(wanted)}".rstrip(". ") if not sent else text)]
        rate_hz = sent[wanted] / max(self._now_s - self._since_s, 1e-9)
        text, ok = f"{wanted}: {rate_hz:.1f} Hz", rate_hz >= 1.0
        short = f"{text}; depth needs at least 1 Hz. {self._cure(wanted)}".rstrip()
        found = [Finding(ok=ok, text=text if ok else short)]
        problem = gauge.problem(self._now_s)
        if problem:
            return [*found, Finding(ok=None if self.link.status.armed else False, text=problem)]
        sensor_m = self._config.sensor_depth_m if self._config.zero_afloat else 0.0
        zero = Zeroed(pressure_pa=gauge.zero_pa, sensor_depth_m=sensor_m)
        agrees = f"the autopilot's own depth is {gauge.offset_m:+z.2f} m off pressure depth; targets are shifted by it"
        return [*found, Finding(ok=True if sensor_m else None, text=zero.text), Finding(ok=True, text=agrees)]

    def _states(self) -> list[Finding]:
        report, depth = self.link.report, self.link.gauge.problem(self._now_s)  # the latter is already reported
        modes = self._config.modes or obeying_modes(*self._kind, self._options.mission)
        obeys = report.mode in modes if modes else None
        followed = "unknown which modes follow targets: set link.modes"
        if modes:
            followed = f"targets are followed in mode {' or '.join(map(str, modes))}"
        first = "" if report.armed or obeys is not False else ". Arm first, then choose it: arming clears it"
        silent = f". If it is armed while no stack runs: {self.farewell}" if self.farewell else ""
        unarmed = f"not armed: the mission waits until it is{silent}"
        origin = "origin known" if self._origin else f"no GPS_GLOBAL_ORIGIN. {self._origin_cure()}"
        return [
            Finding(ok=self._origin, text=origin),
            Finding(ok=report.armed, text="armed" if report.armed else unarmed),
            Finding(ok=obeys, text=f"mode {report.mode}; {followed}{first}"),
            *(Finding(ok=None, text=problem) for problem in dict.fromkeys(self.problems) if problem != depth),
        ]

    def _origin_cure(self) -> str:
        if self._options.origin is not None:
            return "It has not taken that of --origin: it may wait for its GPS"
        return "Wait for GPS; without GPS, --origin LAT LON sets it"

    def _flight_findings(self) -> list[Finding]:
        if self._flight:
            return [Finding(ok=False, text=f"flight: {self._flight}")]
        return [Finding(ok=True, text=f"flight: {counted(self._flown, 'leg')} flown")] if self._flown else []
