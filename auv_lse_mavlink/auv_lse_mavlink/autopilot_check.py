"""Checks an autopilot before the dive: its messages and their rates, its origin, mode and parameters.

`AutopilotCheck` opens no port and reads no clock: `receive` takes bytes and times, `outgoing` returns datagrams to
send, `findings` lists what was seen and what is missing. It uses a `VehicleLink`, so it finds what the link will find.
"""

from __future__ import annotations

import itertools
import math
import struct
from collections import Counter
from dataclasses import dataclass

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.support.device_findings import Finding
from auv_lse_mavlink.link import LinkState, VehicleLink
from auv_lse_mavlink.messages.conversion import DOWN, Target
from auv_lse_mavlink.messages.events import AutopilotEstimate, Event, LinkUp, Problem
from auv_lse_mavlink.messages.modes import obeying_modes
from auv_lse_mavlink.messages.wire import MavlinkCodec, Message, mavlink

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


@dataclass(frozen=True, slots=True)
class _Parameter:
    """A parameter of an autopilot: its name, the accepted values (None: any), and the reason."""

    name: str
    good: tuple[float, ...] | None
    why: str


def _parameters(kind: tuple[int, int], system_id: int) -> tuple[_Parameter, ...]:
    """The parameters to ask an autopilot of this kind for (docs/guide/mavlink-vehicle.md)."""
    autopilot, vehicle = kind
    own = _Parameter("SYSID_MYGCS", (float(system_id),), "FS_GCS_ENABLE watches this system: link.system_id")
    if autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA and vehicle == mavlink.MAV_TYPE_SUBMARINE:
        return (
            _Parameter("FS_PILOT_INPUT", (0.0, 1.0), "2 disarms after 3 s without a pilot"),
            _Parameter("FS_GCS_ENABLE", None, "what it does when the link is lost"),
            own,
            _Parameter("FS_LEAK_ENABLE", (1.0, 2.0), "0 does not report a leak"),
            _Parameter("RNGFND1_ORIENT", (25.0,), "the range finder looks down"),
            _Parameter("BARO_PRIMARY", None, "the barometer that it zeroes itself: the water's"),
            _Parameter("BARO_SPEC_GRAV", None, "density for its own depth: link.water_density_kgpm3 / 1000"),
            _Parameter("WPNAV_SPEED", None, "cm/s"),
        )
    if autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return (
            _Parameter("FS_THR_ENABLE", (0.0,), "there is no radio"),
            _Parameter("FS_GCS_ENABLE", None, "what it does when the link is lost"),
            own,
            _Parameter("RNGFND1_ORIENT", (25.0,), "the range finder looks down"),
            _Parameter("WP_SPEED", None, "m/s"),
        )
    if autopilot == mavlink.MAV_AUTOPILOT_PX4:
        return (
            _Parameter("COM_OF_LOSS_T", None, "s after the last set-point until Offboard ends"),
            _Parameter("COM_RC_IN_MODE", (4.0,), "no radio is expected"),
            _Parameter("NAV_DLL_ACT", None, "what it does when the link is lost"),
        )
    return ()


class AutopilotCheck:
    """Listens to one autopilot, requests its parameters, and optionally travels three legs.

    Attributes:
        link: The link to it.
        messages: Number of its messages by type; DISTANCE_SENSOR only those that look down.
        problems: Problems that the link has reported.
    """

    def __init__(
        self,
        config: LinkConfig,
        vehicle: int,
        mission: bool = False,
        key: bytes | None = None,
        nonce: int | None = None,
    ) -> None:
        """Prepares the check; arguments as for `VehicleLink`, `mission`: uploads are used, in another flight mode."""
        self.link = VehicleLink(config, vehicle, None, key=key, nonce=nonce)
        self._mission = mission
        self.messages: Counter[str] = Counter()
        self.problems: list[str] = []
        self._config = config
        self._system = config.autopilot_system_id or vehicle
        self._reader = MavlinkCodec(config.system_id, config.component_id, key, nonce)
        self._others: Counter[int] = Counter()
        self._kind = (mavlink.MAV_AUTOPILOT_INVALID, mavlink.MAV_TYPE_GENERIC)
        self._origin = False
        self._values: dict[str, float] = {}
        self._since_s = math.nan
        self._now_s = math.nan
        self._place: AutopilotEstimate | None = None
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
            if message.get_srcSystem() != self._system:
                self._others[message.get_srcSystem()] += 1
                continue
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
        for parameter in _parameters(self._kind, self._config.system_id):
            if parameter.name not in self._values:
                request = mavlink.MAVLink_param_request_read_message(
                    self._system, self._config.autopilot_component_id, parameter.name.encode(), -1
                )
                self.link.send(request)

    def fly(self, now_s: float) -> str:
        """Begins three legs: ahead, to starboard, and back.

        Returns:
            Why they cannot begin; "" if they do.
        """
        problem = self.link.report.problem or ("" if self._place is not None else "there is no odometry")
        if problem or self._place is None:
            self._flight = problem
            return problem
        here = self._place
        places, heading = [(here.north_m, here.east_m)], here.heading_rad
        for turn in (0.0, 0.5 * math.pi):
            north_m, east_m = places[-1]
            way = heading + turn
            places.append((north_m + LEG_M * math.cos(way), east_m + LEG_M * math.sin(way)))
        places.append(places[0])
        for step, ((n0, e0), (n1, e1)) in enumerate(itertools.pairwise(places)):
            way = math.atan2(e1 - e0, n1 - n0)
            self._legs.append(Target(north_m=n1, east_m=e1, depth_m=here.depth_m, heading_rad=way, step=step))
        self._leg_since_s = now_s
        self.link.command(now_s, self._legs[0])
        return ""

    def _fly(self, now_s: float) -> None:
        if not self.flying or self._place is None:
            return
        target = self._legs[0]
        off_m = math.hypot(target.north_m - self._place.north_m, target.east_m - self._place.east_m)
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
            self._values[message.param_id] = _value(message, self._kind[0])
        elif kind == "DISTANCE_SENSOR" and message.orientation != DOWN:
            return
        self.messages[kind] += 1

    def _note(self, events: list[Event]) -> None:
        for event in events:
            if isinstance(event, AutopilotEstimate):
                self._place = event
            elif isinstance(event, Problem):
                self.problems.append(event.text)
            elif isinstance(event, LinkUp):
                self.ask()

    def findings(self) -> list[Finding]:
        """What was seen, and what is missing."""
        if not self.heard:
            others = ", ".join(map(str, sorted(self._others)))
            text = f"no heartbeat of system {self._system} (link.autopilot_system_id, or the vehicle's number)"
            return [Finding(ok=False, text=f"{text}; heard instead: {others}" if others else text)]
        found = [*self._streams(), *self._depth_findings(), *self._states()]
        return [*found, *self._parameter_findings(), *self._flight_findings()]

    def _streams(self) -> list[Finding]:
        heard_s = max(self._now_s - self._since_s, 1e-9)
        found = []
        for kind, (least_hz, use) in NEEDED.items():
            rate_hz = self.messages[kind] / heard_s
            text = f"{kind}: {rate_hz:.1f} Hz"
            ok = rate_hz >= least_hz
            found.append(Finding(ok=ok, text=text if ok else f"{text}; expected at least {least_hz:g} Hz for {use}"))
        for kind, without in USEFUL.items():
            if not self.messages[kind]:
                found.append(Finding(ok=None, text=f"{kind}: not sent; {without}"))
        return found

    def _depth_findings(self) -> list[Finding]:
        """Which pressure is sent and how often, its zero, and how it agrees with the autopilot's own depth."""
        wanted, gauge = self._config.pressure, self.link.gauge
        sent = {kind: count for kind, count in self.messages.items() if kind.startswith("SCALED_PRESSURE")}
        if wanted == "none":
            return [Finding(ok=None, text="link.pressure is none: depth is the autopilot's own")]
        if wanted not in sent:
            text = f"{wanted}: not sent; expected it for depth (link.pressure; none for a boat)"
            return [Finding(ok=False, text=f"{text}. Sent instead: {', '.join(sorted(sent))}" if sent else text)]
        rate_hz = sent[wanted] / max(self._now_s - self._since_s, 1e-9)
        text = f"{wanted}: {rate_hz:.1f} Hz"
        found = [Finding(ok=rate_hz >= 1.0, text=text if rate_hz >= 1.0 else f"{text}; expected at least 1 Hz")]
        problem = gauge.problem(self._now_s)
        if problem:
            return [*found, Finding(ok=None if self.link.status.armed else False, text=problem)]
        zero = f"depth is zeroed at {gauge.zero_pa / 100.0:.1f} hPa"
        agrees = f"the autopilot's own depth is {gauge.offset_m:+.2f} m off pressure depth; targets are shifted by it"
        return [*found, Finding(ok=True, text=f"{zero}; {agrees}")]

    def _states(self) -> list[Finding]:
        report, depth = self.link.report, self.link.gauge.problem(self._now_s)  # that one is reported already
        modes = self._config.modes or obeying_modes(*self._kind, self._mission)
        obeys = report.mode in modes if modes else None
        expected = f"expected one of {list(modes)}" if modes else "unknown which modes follow targets: set link.modes"
        return [
            Finding(ok=self._origin, text="origin known" if self._origin else "no GPS_GLOBAL_ORIGIN: expected one"),
            Finding(ok=report.armed, text="armed" if report.armed else "not armed: the mission waits until it is"),
            Finding(ok=obeys, text=f"mode {report.mode}; {expected}"),
            *(Finding(ok=None, text=problem) for problem in dict.fromkeys(self.problems) if problem != depth),
        ]

    def _parameter_findings(self) -> list[Finding]:
        found = []
        for parameter in _parameters(self._kind, self._config.system_id):
            value = self._values.get(parameter.name)
            if value is None:
                found.append(Finding(ok=None, text=f"{parameter.name}: no answer ({parameter.why})"))
            elif parameter.good is None or value in parameter.good:
                found.append(Finding(ok=True, text=f"{parameter.name} = {value:g} ({parameter.why})"))
            else:
                good = " or ".join(f"{v:g}" for v in parameter.good)
                found.append(Finding(ok=False, text=f"{parameter.name} = {value:g}; expected {good}: {parameter.why}"))
        return found

    def _flight_findings(self) -> list[Finding]:
        if self._flight:
            return [Finding(ok=False, text=f"flight: {self._flight}")]
        return [Finding(ok=True, text=f"flight: {self._flown} legs flown")] if self._flown else []


def _value(message: Message, autopilot: int) -> float:
    """The value of a PARAM_VALUE; PX4 stores an integer's bytes in the float."""
    if autopilot == mavlink.MAV_AUTOPILOT_PX4 and message.param_type == mavlink.MAV_PARAM_TYPE_INT32:
        return float(int.from_bytes(struct.pack("<f", message.param_value), "little", signed=True))
    return float(message.param_value)
