"""One simulated ArduPilot on the bench: a ground station, the link's system, and a vehicle that follows exactly.

Also what tests of simulated autopilots share: flat ground, the target at a leg's end, a free port.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Iterable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink
from sim_helpers import FunctionGround

from auv_lse_common.vocabulary.extent import Extent
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_mavlink.messages.conversion import Target, mission_item, position_target
from auv_lse_mavlink.messages.datum import Datum, Origin
from auv_lse_sim.emulated.ardupilot.autopilot import ArduPilot
from auv_lse_sim.emulated.ardupilot.personality import SUB, Personality
from auv_lse_sim.emulated.ardupilot.setup import Setup, recommended_parameters
from auv_lse_sim.emulated.autopilot_report import Report

ORIGIN = Origin(lat_deg=46.5, lon_deg=6.6)
#: System ids of the link and of the operator's ground station.
LINK, OPERATOR = 245, 255
#: Ground 20 m deep.
FLAT_GROUND = FunctionGround(
    lambda north, east: 20.0 + 0.0 * north, Extent(north_min_m=-1e4, north_max_m=1e4, east_min_m=-1e4, east_max_m=1e4)
)


def end_of(leg: Leg) -> Target:
    """The target at the end of a leg, 4 m deep."""
    heading, north, east = leg.state_at(leg.length_m)
    return Target(
        north_m=float(north),
        east_m=float(east),
        depth_m=4.0,
        heading_rad=float(heading),
        step=leg.step,
        begins_m=(leg.north_m, leg.east_m),
    )


def free_udp_port() -> int:
    """A UDP port of this computer that nobody uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Bench:
    """An autopilot of system 1 and everything it has sent, with its time."""

    def __init__(self, personality: Personality = SUB, *, guided: bool = False, **setup: Any) -> None:
        """`guided`: armed and in GUIDED, heard by the link."""
        values = {"parameters": recommended_parameters(personality, LINK), "feeds": False} | setup
        self.autopilot = ArduPilot(
            1, (0.0, 0.0, 0.0), ORIGIN, lambda pilot: None, Setup(personality=personality, **values)
        )
        self.now_s, self.beats, self.gps = 1000.0, True, True
        self.said: list[tuple[float, Any]] = []
        self.depth_m, self._beat_s = 0.0, -math.inf
        self._packers: dict[int, Any] = {}
        self._reader = mavlink.MAVLink(None)
        self.pass_s(1.0)
        if guided:
            self.arm()
            self.mode(personality.guided)

    # ------------------------------------------------------------------ in

    def send(self, message: Any, system: int = LINK) -> None:
        """Sends a message of a system to the autopilot."""
        packer = self._packers.setdefault(system, mavlink.MAVLink(None, srcSystem=system, srcComponent=191))
        data = message.pack(packer)
        packer.seq = (packer.seq + 1) % 256
        self.autopilot.receive(self.now_s, data)
        self._listen()

    def command(self, number: int, *params: float) -> int:
        """Sends COMMAND_LONG; returns the acknowledged result."""
        values = [*params, *(0.0,) * (7 - len(params))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *values), OPERATOR)
        return int(self.of("COMMAND_ACK")[-1].result)

    def arm(self, on: bool = True) -> int:
        return self.command(400, float(on))

    def mode(self, number: int) -> int:
        return self.command(176, 1.0, float(number))

    def target(self, north_m: float, east_m: float, depth_m: float, heading_rad: float = 0.0) -> None:
        target = Target(north_m=north_m, east_m=east_m, depth_m=depth_m, heading_rad=heading_rad)
        self.send(position_target(target, Datum(ORIGIN, ORIGIN), 0, 1, 1))

    def upload(self, positions: Iterable[tuple[float, float]], depth_m: float = 0.0) -> None:
        """Uploads a mission, the home first, as the autopilot requests it; then selects its first item."""
        ends = [Target(north_m=n, east_m=e, depth_m=depth_m, heading_rad=0.0) for n, e in positions]
        ends = [ends[0], *ends]
        self.send(mavlink.MAVLink_mission_count_message(1, 1, len(ends), 0))
        for number, end in enumerate(ends):
            assert self.of("MISSION_REQUEST")[-1].seq == number
            self.send(mission_item(end, Datum(ORIGIN, ORIGIN), number, 2.0, 1, 1))
        self.send(mavlink.MAVLink_mission_set_current_message(1, 1, 1))

    # ------------------------------------------------------------------ time

    def pass_s(self, duration_s: float, step_s: float = 0.25) -> None:
        """Lets time pass: the vehicle follows exactly, and the link's heartbeat comes once a second."""
        for _ in range(round(duration_s / step_s)):
            self.now_s += step_s
            if self.beats and self.now_s - self._beat_s > 1.0 - 1e-6:
                self._beat_s = self.now_s
                kind = mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID
                self.send(mavlink.MAVLink_heartbeat_message(*kind, 0, 0, 4, 3))
            pose = self.autopilot.pilot.at(self.now_s)
            north_m, east_m, self.depth_m = map(float, pose.position_m)
            vn, ve = pose.velocity_mps[:2]
            self.autopilot.report(
                self.now_s,
                Report(
                    heading_rad=pose.heading_rad,
                    north_m=north_m,
                    east_m=east_m,
                    depth_m=self.depth_m,
                    speed_mps=math.hypot(vn, ve),
                    drift_rad=math.remainder(math.atan2(ve, vn) - pose.heading_rad, 2 * math.pi),
                    altitude_m=8.85 - self.depth_m,
                    gps_m=(north_m, east_m) if self.gps and self.depth_m < 0.3 else None,
                ),
            )
            self._listen()

    # ------------------------------------------------------------------ out

    def _listen(self) -> None:
        for datagram in self.autopilot.outgoing():
            self.said += [(self.now_s, m) for m in self._reader.parse_buffer(datagram) or ()]

    def of(self, kind: str, since_s: float = -math.inf, system: int = 1) -> list[Any]:
        """Messages of a kind, in order."""
        return [m for t, m in self.said if t >= since_s and m.get_type() == kind and m.get_srcSystem() == system]

    def texts(self, since_s: float = -math.inf) -> list[tuple[int, str]]:
        """Severity and text of each status text, without the one that repeats every second."""
        texts = [(m.severity, m.text) for m in self.of("STATUSTEXT", since_s)]
        return [entry for entry in texts if "Field Elevation" not in entry[1]]

    @property
    def beat(self) -> tuple[int, int, int]:
        """base_mode, custom_mode, system_status of the last heartbeat."""
        last = self.of("HEARTBEAT")[-1]
        return last.base_mode, last.custom_mode, last.system_status

    @property
    def position(self) -> tuple[float, float, float]:
        """North, east, depth (m)."""
        return tuple(map(float, self.autopilot.pilot.at(self.now_s).position_m))
