"""Emulated modems and autopilots, which stand between the simulated world and the vehicles' hardware drivers.

Which vehicle has which comes from its own sections: `modem.kind: micromodem` gives it an emulated Micromodem-2 on the
port that `modem.port` names (a link to a pty, or a TCP port of this machine); `link.kind: mavlink` gives it a simulated
autopilot that calls the UDP port on which `link.endpoint` listens. Knows no ROS, no clock and no thread.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import Stop
from auv_lse_comms.mavlink.messages.datum import Origin
from auv_lse_comms.transport import AddressError, read_address
from auv_lse_sim.emulated.host_ports import HostPort, PtyPort, TcpServerPort
from auv_lse_sim.emulated.mavlink_dock import MavlinkDock
from auv_lse_sim.emulated.mavlink_vehicle import MavlinkVehicle, Report
from auv_lse_sim.emulated.modem_packets import HeardPacket
from auv_lse_sim.emulated.modem_rack import ModemRack
from auv_lse_sim.vehicle.vehicle import tightest_radius_m
from auv_lse_sim.water.channel import Arrival
from auv_lse_sim.world import VehicleOutput

#: Pressure of the air (Pa), and of each metre of fresh water above a vehicle (Pa/m).
AIR_PA, WATER_PA_PER_M = 101325.0, 9806.65
_OWN = ("127.0.0.1", "localhost", "::1")


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
    ) -> None:
        """Opens the ports.

        Args:
            settings: The mission.
            transmit: Takes (vehicle, start (s), payload) into the water; returns the transmission's duration (s).
            follow: Takes (vehicle, leg), to be travelled after the legs before it.
            obey: Takes (vehicle, what it does in place of travelling; None: it travels on).

        Raises:
            ParameterError: naming a port that cannot be offered, and why.
        """
        numbers = range(1, settings.mission.vehicles + 1)
        self.modems = tuple(k for k in numbers if settings.vehicle(k).modem.kind == "micromodem")
        self.autopilots = tuple(k for k in numbers if settings.vehicle(k).link.kind == "mavlink")
        self.rack: ModemRack | None = None
        self.dock: MavlinkDock | None = None
        self._settings = settings
        try:
            if self.modems:
                shells = {k: _shell(settings.vehicle(k).modem.port) for k in self.modems}
                self.rack = ModemRack(shells, lambda k, packet: transmit(k, packet.start_s, packet.payload))
            if self.autopilots:
                autopilots = {k: self._autopilot(k, follow, obey) for k in self.autopilots}
                self.dock = MavlinkDock(
                    autopilots, {k: _calls(settings.vehicle(k).link.endpoint) for k in self.autopilots}
                )
        except (OSError, AddressError) as error:
            self.close()
            raise ParameterError(f"{settings.where}: emulated links: {error}") from error

    def _autopilot(
        self, k: int, follow: Callable[[int, Leg], None], obey: Callable[[int, Stop | None], None]
    ) -> MavlinkVehicle:
        vehicle, area = self._settings.vehicle(k).vehicle, self._settings.area
        origin = None
        if area.origin_lat_deg is not None and area.origin_lon_deg is not None:
            origin = Origin(lat_deg=area.origin_lat_deg, lon_deg=area.origin_lon_deg)
        start = (vehicle.start_heading_rad, vehicle.start_north_m, vehicle.start_east_m)
        radius_m = self._settings.motion.turn_radius_m
        system_id = self._settings.vehicle(k).link.autopilot_system_id or k
        return MavlinkVehicle(
            system_id,
            start,
            radius_m,
            origin,
            lambda leg: follow(k, leg),
            obey=lambda stop: obey(k, stop),
            tightest_m=tightest_radius_m(vehicle, self._settings.sim),
        )

    def greet(self, now_s: float) -> None:
        """Lets the drivers find their hardware before the mission's time runs."""
        if self.dock is not None:
            for k in self.autopilots:
                self.dock.greet(k, now_s)

    def serve(self, now_s: float) -> None:
        """Reads what the drivers have written and answers; never waits."""
        if self.rack is not None:
            self.rack.serve(now_s)
        if self.dock is not None:
            self.dock.serve(now_s)

    def poll(self, now_s: float) -> None:
        """Lets a tick pass on the modems: transmissions end."""
        if self.rack is not None:
            self.rack.poll(now_s)

    def arrive(self, now_s: float, k: int, arrival: Arrival) -> None:
        """A packet has reached a vehicle's modem, readable or not."""
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
        """A vehicle's autopilot sends its telemetry."""
        assert self.dock is not None
        self.dock.report(k, now_s, report_of(output, self._settings.sim.gps.noise_m))

    def delivered(self, k: int) -> int:
        """Packets that a vehicle's modem has handed to its driver so far."""
        return self.rack.delivered[k] if self.rack is not None else 0

    def heard(self, k: int) -> tuple[int, int]:
        """Position targets and missions that a vehicle's autopilot has taken so far."""
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


def report_of(output: VehicleOutput, gps_std_m: float) -> Report:
    """What a vehicle's autopilot believes after a tick; GPS readings are as good as `gps_std_m`."""
    estimate = output.odometry
    return Report(
        heading_rad=estimate.heading_rad,
        north_m=estimate.north_m,
        east_m=estimate.east_m,
        depth_m=output.pressure_depth_m,
        speed_mps=estimate.speed_mps,
        altitude_m=output.altitude_m,
        pressure_pa=AIR_PA + WATER_PA_PER_M * output.pressure_depth_m,
        gps_m=output.gps_m,
        gps_std_m=gps_std_m,
    )


def _shell(port: str) -> HostPort:
    address = read_address(port)
    if address.kind == "tcp" and address.place in _OWN:
        return TcpServerPort(address.number)
    if address.kind == "serial" and not address.place.startswith("/dev/"):
        return PtyPort(Path(address.place))
    raise AddressError(
        f"modem.port {port!r}: an emulated modem can be offered at a path outside /dev (a link to a pty), or at "
        "tcp://127.0.0.1:PORT"
    )


def _calls(endpoint: str) -> str:
    address = read_address(endpoint)
    if address.kind != "udpin" or address.place not in _OWN or address.number == 0:
        raise AddressError(f"link.endpoint {endpoint!r}: a simulated autopilot calls udpin://127.0.0.1:PORT")
    return f"udpout://{address.place}:{address.number}"
