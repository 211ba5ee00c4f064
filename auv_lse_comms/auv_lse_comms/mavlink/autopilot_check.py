"""Looks over an autopilot before the dive: what it sends and how often, its origin, its mode, its parameters.

`AutopilotCheck` knows no port and no clock: `receive` takes bytes and times, `outgoing` has what to send, `findings`
says what was seen and what is missing. It owns a `VehicleLink`, so that what it finds is what the link will find.
"""

from __future__ import annotations

import itertools
import math
import struct
from collections import Counter
from dataclasses import dataclass

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_comms.mavlink.link import LinkState, VehicleLink
from auv_lse_comms.mavlink.messages.conversion import DOWN, Target
from auv_lse_comms.mavlink.messages.events import AutopilotEstimate, Event, LinkUp, Problem
from auv_lse_comms.mavlink.messages.modes import obeying_modes
from auv_lse_comms.mavlink.messages.wire import MavlinkCodec, Message, mavlink

#: Messages that the link needs, with the least rate (1/s) at which they must come, and what they are for.
NEEDED = {
    "HEARTBEAT": (0.5, "the link counts as lost without it"),
    "LOCAL_POSITION_NED": (1.0, "odometry"),
    "ATTITUDE": (1.0, "odometry"),
    "DISTANCE_SENSOR": (0.5, "altitude and soundings (orientation 25: down); without it another node has to sound"),
}
#: Messages that are of use: what is not there without them.
USEFUL = {
    "SYSTEM_TIME": "stamps are times of receipt",
    "SYS_STATUS": "the safety watch does not know the battery",
    "SCALED_PRESSURE2": "no pressure is published",
    "GLOBAL_POSITION_INT": "the origin is not checked against the global position",
}
#: A leg of the flight (m), and how long it may take (s).
LEG_M, LEG_S = 20.0, 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        ok: Whether it is as it should be; None: a hint.
        text: What was seen, and what was expected if it is not.
    """

    ok: bool | None
    text: str


@dataclass(frozen=True, slots=True)
class _Parameter:
    """A parameter of an autopilot: its name, the values that will do (None: any), why."""

    name: str
    good: tuple[float, ...] | None
    why: str


def _parameters(kind: tuple[int, int], system_id: int) -> tuple[_Parameter, ...]:
    """The parameters to ask an autopilot of this kind for (docs/guide/mavlink-vehicle.md)."""
    autopilot, vehicle = kind
    own = _Parameter("SYSID_MYGCS", (float(system_id),), "whose silence FS_GCS_ENABLE acts on: link.system_id")
    if autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA and vehicle == mavlink.MAV_TYPE_SUBMARINE:
        return (
            _Parameter("FS_PILOT_INPUT", (0.0, 1.0), "2 disarms after 3 s without a pilot"),
            _Parameter("FS_GCS_ENABLE", None, "what it does when the link is lost"),
            own,
            _Parameter("FS_LEAK_ENABLE", (1.0, 2.0), "0 says nothing of a leak"),
            _Parameter("RNGFND1_ORIENT", (25.0,), "the range finder looks down"),
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
    """Listens to one autopilot, asks it, and flies three legs with it if told to.

    Attributes:
        link: The link to it.
        messages: Messages of the autopilot, by type; DISTANCE_SENSOR only those that look down.
        problems: What the link has reported.
    """

    def __init__(self, config: LinkConfig, vehicle: int, mission: bool = False, key: bytes | None = None) -> None:
        """For the autopilot of vehicle number `vehicle`.

        Args:
            config: Section `link`; legs are flown by position targets.
            vehicle: Number of the vehicle.
            mission: Whether missions are to be uploaded to it later: another mode is expected then.
            key: Key with which messages are signed; None: they are not.
        """
        self.link = VehicleLink(config, vehicle, None, key=key)
        self._mission = mission
        self.messages: Counter[str] = Counter()
        self.problems: list[str] = []
        self._config = config
        self._system = config.autopilot_system_id or vehicle
        self._reader = MavlinkCodec(config.system_id, config.component_id, key)
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
        self._flight = ""  # why the flight has ended before its end

    @property
    def heard(self) -> bool:
        """Whether the autopilot is heard."""
        return self.link.state is LinkState.UP

    @property
    def flying(self) -> bool:
        """Whether legs are left to fly."""
        return bool(self._legs) and not self._flight

    def receive(self, now_s: float, data: bytes) -> None:
        """Takes bytes of the autopilot (none, too: time passes)."""
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
        """Asks for the parameters that are not known yet; several times, since datagrams get lost."""
        for parameter in _parameters(self._kind, self._config.system_id):
            if parameter.name not in self._values:
                request = mavlink.MAVLink_param_request_read_message(
                    self._system, self._config.autopilot_component_id, parameter.name.encode(), -1
                )
                self.link.say(request)

    def fly(self, now_s: float) -> str:
        """Begins three legs: ahead, to starboard, and back to here.

        Returns:
            Why it cannot begin; "" if it does.
        """
        problem = self.link.says.problem or ("" if self._place is not None else "there is no odometry")
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
            self._legs.append(
                Target(
                    north_m=n1,
                    east_m=e1,
                    depth_m=here.depth_m,
                    heading_rad=math.atan2(e1 - e0, n1 - n0),
                    step=step,
                )
            )
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
        return [*self._streams(), *self._states(), *self._parameter_findings(), *self._flight_findings()]

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

    def _states(self) -> list[Finding]:
        says = self.link.says
        modes = self._config.modes or obeying_modes(*self._kind, self._mission)
        obeys = says.mode in modes if modes else None
        expected = f"expected one of {list(modes)}" if modes else "which modes obey is not known: set link.modes"
        return [
            Finding(ok=self._origin, text="origin known" if self._origin else "no GPS_GLOBAL_ORIGIN: expected one"),
            Finding(ok=says.armed, text="armed" if says.armed else "not armed: the mission waits until it is"),
            Finding(ok=obeys, text=f"mode {says.mode}; {expected}"),
            *(Finding(ok=None, text=problem) for problem in dict.fromkeys(self.problems)),
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
    """The value of a PARAM_VALUE; PX4 puts an integer's bytes into the float."""
    if autopilot == mavlink.MAV_AUTOPILOT_PX4 and message.param_type == mavlink.MAV_PARAM_TYPE_INT32:
        return float(int.from_bytes(struct.pack("<f", message.param_value), "little", signed=True))
    return float(message.param_value)
