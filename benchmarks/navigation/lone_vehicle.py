"""One simulated vehicle, its autopilot and the link to it, joined by bytes in one process: for tests and faults."""

import math
from collections.abc import Callable, Mapping
from typing import Any

from auv_lse_common.mission_file.settings import Settings
from auv_lse_mavlink.link import VehicleLink
from auv_lse_mavlink.messages.conversion import Target
from auv_lse_mavlink.messages.datum import Origin
from auv_lse_mavlink.messages.events import Event
from auv_lse_mavlink.targets.limits import TargetLimits
from auv_lse_sim.emulated.autopilot_report import Report, autopilot_of, measured_pressure_pa, report_of
from auv_lse_sim.emulated.autopilots import autopilot_for
from auv_lse_sim.ground.ground import Ground
from auv_lse_sim.world import VehicleOutput, World


class LoneVehicle:
    """Vehicle 1 of a mission along straight legs, one tick a second; bytes arrive at once.

    Attributes:
        vehicle: The autopilot.
        events: The link's events.
        distort: Changes what the autopilot measures: (time (s), report) -> report.
        passes: Whether a datagram of the autopilot arrives.
    """

    def __init__(self, ground: Ground, origin: Origin, parameters: Mapping[str, Any]) -> None:
        """Starts on deck: the link finds its autopilot, which is at `origin`, and zeroes its depth."""
        given = {"mission.vehicles": 1, "sim.current.ideal": True, "auv1.link.kind": "mavlink", **parameters}
        position = {"area.origin_lat_deg": origin.lat_deg, "area.origin_lon_deg": origin.lon_deg}
        self.settings = Settings.load(None, {**position, **given})
        own, sim = self.settings.vehicle(1), self.settings.sim
        self.world = World.of(self.settings, ground)
        self._end = (own.vehicle.start_heading_rad, own.vehicle.start_north_m, own.vehicle.start_east_m)
        self._latitude_deg = origin.lat_deg
        self._instruments = autopilot_of(sim)
        self.vehicle: Any = autopilot_for(self.settings, 1, origin, self.world)
        least_m = own.safety.kept_altitude_m(own.vehicle.min_altitude_m)
        self.link = VehicleLink(own.link, 1, origin, TargetLimits(least_altitude_m=least_m))
        self.now_s = 0.0
        self.events: list[Event] = []
        self.distort: Callable[[float, Report], Report] = lambda now_s, report: report
        self.passes: Callable[[bytes], bool] = lambda datagram: True
        for _ in range(2):  # the origin is known after the first
            self.vehicle.send_on_deck(0.0, self._pressure_pa(0.0))
            self.flow()

    def leg(self, step: int, length_m: float, surface: bool = False) -> None:
        """Commands the next leg straight ahead, at the vehicle's depth."""
        heading, north, east = self._end
        north, east = north + length_m * math.cos(heading), east + length_m * math.sin(heading)
        self._end = (heading, north, east)
        depth_m = self.settings.vehicle(1).vehicle.depth_m
        target = Target(north_m=north, east_m=east, depth_m=depth_m, heading_rad=heading, step=step, surface=surface)
        self.link.command(self.now_s, target)
        self.flow()

    def flow(self) -> None:
        """Passes datagrams both ways until none is left."""
        for _ in range(20):
            for datagram in self.link.outgoing():
                self.vehicle.receive(self.now_s, datagram)
            for datagram in filter(self.passes, self.vehicle.outgoing()):
                self.link.receive(self.now_s, datagram)
            self.events += self.link.events()

    def tick(self) -> VehicleOutput:
        """Advances everything by a second; returns what the vehicle did."""
        self.now_s += 1.0
        output = self.world.tick(self.now_s)[1]
        pressure_pa = self._pressure_pa(output.pressure_depth_m)
        report = report_of(output, self.settings.sim.gps.noise_m, pressure_pa)
        self.vehicle.report(self.now_s, self.distort(self.now_s, report))
        self.link.poll(self.now_s)
        self.flow()
        return output

    def _pressure_pa(self, depth_m: float) -> float:
        return measured_pressure_pa(self._instruments, self.now_s, depth_m, self._latitude_deg)
