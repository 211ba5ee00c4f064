"""Emulated modems and autopilots between the simulated world and the vehicles' hardware drivers.

Each vehicle's sections select them: `modem.kind: micromodem` gives it an emulated Micromodem-2 on the
port that `modem.port` names (a link to a pty, or a TCP port of this machine); `link.kind: mavlink` gives it a simulated
autopilot that calls the UDP port on which `link.endpoint` listens. No ROS, no clock and no threads.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.mission_file.sections.world import AutopilotConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import Stop
from auv_lse_comms.mavlink.messages.datum import Origin
from auv_lse_comms.mavlink.water import MEAN_LATITUDE_DEG, gauge_pressure_pa
from auv_lse_comms.transport import AddressError, read_address
from auv_lse_sim.emulated.host_ports import HostPort, PtyPort, TcpServerPort
from auv_lse_sim.emulated.mavlink_dock import MavlinkDock
from auv_lse_sim.emulated.mavlink_telemetry import AIR_PA, Report
from auv_lse_sim.emulated.mavlink_vehicle import SURFACE_M, AutopilotSetup, MavlinkVehicle
from auv_lse_sim.emulated.modem_packets import HeardPacket
from auv_lse_sim.emulated.modem_rack import ModemRack
from auv_lse_sim.vehicle.vehicle import tightest_radius_m
from auv_lse_sim.water.channel import Arrival
from auv_lse_sim.world import VehicleOutput

_LOCAL_HOSTS = ("127.0.0.1", "localhost", "::1")


class EmulatedLinks:
    """The emulated modems and autopilots of one mission.

    Attributes:
        rack: The modems, None if no vehicle has one.
        dock: The autopilots, None if no vehicle has one.
        modems: Numbers of the vehicles with an emulated modem.
        autopilots: Numbers of those with a simulated autopilot.
    """

    def __init__(
        self,
        settings: Settings,
        transmit: Callable[[int, float, bytes], float],
        follow: Callable[[int, Leg], None],
        obey: Callable[[int, Stop | None], None],
        dive: Callable[[int, float], None],
    ) -> None:
        """Opens the ports.

        Args:
            settings: The mission.
            transmit: Sends (vehicle, start (s), payload) into the water; returns the transmission's duration (s).
            follow: Takes (vehicle, leg); the leg follows the earlier ones.
            obey: Takes (vehicle, stop); None: the vehicle continues.
            dive: Takes (vehicle, depth (m)).

        Raises:
            ParameterError: if a port cannot be opened; names it and the reason.
        """
        numbers = range(1, settings.mission.vehicles + 1)
        self.modems = tuple(k for k in numbers if settings.vehicle(k).modem.kind == "micromodem")
        self.autopilots = tuple(k for k in numbers if settings.vehicle(k).link.kind == "mavlink")
        self.rack: ModemRack | None = None
        self.dock: MavlinkDock | None = None
        self._settings = settings
        self._begun_s = math.inf
        try:
            if self.modems:
                ports = {k: _host_port(settings.vehicle(k).modem.port) for k in self.modems}
                self.rack = ModemRack(ports, lambda k, packet: transmit(k, packet.start_s, packet.payload))
            if self.autopilots:
                autopilots = {k: self._autopilot(k, follow, obey, dive) for k in self.autopilots}
                self.dock = MavlinkDock(
                    autopilots, {k: _autopilot_endpoint(settings.vehicle(k).link.endpoint) for k in self.autopilots}
                )
        except (OSError, AddressError) as error:
            self.close()
            raise ParameterError(f"{settings.where}: emulated links: {error}") from error

    def _autopilot(
        self,
        k: int,
        follow: Callable[[int, Leg], None],
        obey: Callable[[int, Stop | None], None],
        dive: Callable[[int, float], None],
    ) -> MavlinkVehicle:
        vehicle, area = self._settings.vehicle(k).vehicle, self._settings.area
        origin = None
        if area.origin_lat_deg is not None and area.origin_lon_deg is not None:
            origin = Origin(lat_deg=area.origin_lat_deg, lon_deg=area.origin_lon_deg)
        start = (vehicle.start_heading_rad, vehicle.start_north_m, vehicle.start_east_m)
        radius_m = self._settings.motion.turn_radius_m
        link = self._settings.vehicle(k).link
        system_id = link.autopilot_system_id or k
        height_m = autopilot_of(self._settings.sim).origin_height_m if link.pressure != "none" else 0.0
        return MavlinkVehicle(
            system_id,
            start,
            radius_m,
            origin,
            lambda leg: follow(k, leg),
            obey=lambda stop: obey(k, stop),
            tightest_m=tightest_radius_m(vehicle, self._settings.sim),
            setup=AutopilotSetup(
                origin_height_m=height_m,
                pressure=link.pressure,
                dive=lambda depth_m: dive(k, depth_m),
                is_boat=vehicle.depth_m <= SURFACE_M,
            ),
        )

    def send_on_deck(self, now_s: float) -> None:
        """Lets the drivers find their autopilots and the zero of depth before the first tick."""
        if self.dock is not None:
            for k in self.autopilots:
                self.dock.send_on_deck(k, now_s, self._pressure_pa(now_s, 0.0))

    def serve(self, now_s: float) -> None:
        """Reads and answers the drivers' bytes; never blocks."""
        if self.rack is not None:
            self.rack.serve(now_s)
        if self.dock is not None:
            self.dock.serve(now_s)

    def poll(self, now_s: float) -> None:
        """Advances the modems: ends transmissions."""
        if self.rack is not None:
            self.rack.poll(now_s)

    def arrive(self, now_s: float, k: int, arrival: Arrival) -> None:
        """Delivers a packet, readable or not, to a vehicle's modem."""
        assert self.rack is not None
        self.rack.arrive(
            now_s,
            k,
            HeardPacket(
                start_s=arrival.start_s,
                measured_s=arrival.heard_s,
                source=arrival.source,
                destination=0,
                payload=arrival.payload if arrival.ok else None,
                snr_db=arrival.snr_db,
                rate=self._settings.sim.channel.rate,
            ),
        )

    def report(self, k: int, now_s: float, output: VehicleOutput) -> None:
        """Sends the telemetry of a vehicle's autopilot."""
        assert self.dock is not None
        pressure_pa = self._pressure_pa(now_s, output.pressure_depth_m)
        self.dock.report(k, now_s, report_of(output, self._settings.sim.gps.noise_m, pressure_pa))

    def _pressure_pa(self, now_s: float, depth_m: float) -> float:
        """What the barometers measure at a depth (m)."""
        self._begun_s = min(self._begun_s, now_s)
        latitude_deg = self._settings.area.origin_lat_deg
        return measured_pressure_pa(autopilot_of(self._settings.sim), now_s - self._begun_s, depth_m, latitude_deg)

    def delivered(self, k: int) -> int:
        """Number of packets that a vehicle's modem has passed to its driver."""
        return self.rack.delivered[k] if self.rack is not None else 0

    def accepted(self, k: int) -> tuple[int, int]:
        """Numbers of position targets and missions that a vehicle's autopilot has received."""
        if self.dock is None:
            return (0, 0)
        counts = self.dock.vehicles[k].counts
        return counts["targets"], counts["missions"]

    def close(self) -> None:
        """Closes every port."""
        if self.rack is not None:
            self.rack.close()
        if self.dock is not None:
            self.dock.close()


def autopilot_of(sim: SimConfig) -> AutopilotConfig:
    """The autopilots' imperfections that are in force."""
    if not (sim.ideal or sim.autopilot.ideal):
        return sim.autopilot
    return AutopilotConfig(
        origin_height_m=0.0,
        air_pressure_hpa=AIR_PA / 100.0,
        air_change_hpa_h=0.0,
        barometer_offset_hpa=0.0,
        barometer_drift_hpa_h=0.0,
    )


def measured_pressure_pa(config: AutopilotConfig, passed_s: float, depth_m: float, latitude_deg: float | None) -> float:
    """What a barometer measures (Pa) at a depth (m), `passed_s` after the start; latitude None: unknown."""
    drift_hpa = (config.air_change_hpa_h + config.barometer_drift_hpa_h) * passed_s / 3600.0
    at_surface_pa = 100.0 * (config.air_pressure_hpa + config.barometer_offset_hpa + drift_hpa)
    latitude_deg = MEAN_LATITUDE_DEG if latitude_deg is None else latitude_deg
    return at_surface_pa + gauge_pressure_pa(depth_m, config.water_density_kgpm3, latitude_deg)


def report_of(output: VehicleOutput, gps_std_m: float, pressure_pa: float) -> Report:
    """The state that a vehicle's autopilot reports after a tick.

    Args:
        output: The vehicle's.
        gps_std_m: Accuracy of GPS (m).
        pressure_pa: What its barometer measures (Pa).
    """
    estimate = output.odometry
    return Report(
        heading_rad=estimate.heading_rad,
        north_m=estimate.north_m,
        east_m=estimate.east_m,
        depth_m=output.pressure_depth_m,
        speed_mps=estimate.speed_mps,
        altitude_m=output.altitude_m,
        pressure_pa=pressure_pa,
        gps_m=output.gps_m,
        gps_std_m=gps_std_m,
    )


def _host_port(port: str) -> HostPort:
    address = read_address(port)
    if address.kind == "tcp" and address.place in _LOCAL_HOSTS:
        return TcpServerPort(address.number)
    if address.kind == "serial" and not address.place.startswith("/dev/"):
        return PtyPort(Path(address.place))
    raise AddressError(
        f"modem.port got {port!r}; expected a path outside /dev (a link to a pty) or tcp://127.0.0.1:PORT for an "
        "emulated modem. Change modem.port"
    )


def _autopilot_endpoint(endpoint: str) -> str:
    address = read_address(endpoint)
    if address.kind != "udpin" or address.place not in _LOCAL_HOSTS or address.number == 0:
        raise AddressError(
            f"link.endpoint got {endpoint!r}; expected udpin://127.0.0.1:PORT for a simulated autopilot. Change it"
        )
    return f"udpout://{address.place}:{address.number}"
