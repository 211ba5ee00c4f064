"""Emulated modems and autopilots between the simulated world and the vehicles' hardware drivers.

Each vehicle's sections select them: `modem.kind: micromodem` gives it an emulated Micromodem-2 on the
port that `modem.port` names (a link to a pty, or a TCP port of this machine); `link.kind: mavlink` gives it a simulated
autopilot that calls the UDP port on which `link.endpoint` listens. No ROS, no clock and no threads.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.settings import Settings
from auv_lse_comms.transport import AddressError, read_address
from auv_lse_sim.emulated.autopilot_report import autopilot_of, measured_pressure_pa, report_of
from auv_lse_sim.emulated.host_ports import LOCAL_HOSTS, HostPort, PtyPort, TcpServerPort
from auv_lse_sim.emulated.modem_packets import HeardPacket
from auv_lse_sim.emulated.modem_rack import ModemRack
from auv_lse_sim.water.channel import Arrival
from auv_lse_sim.world import VehicleOutput, World

if TYPE_CHECKING:
    from auv_lse_sim.emulated.mavlink_dock import MavlinkDock


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
        world: World,
    ) -> None:
        """Opens the ports.

        Args:
            transmit: Sends (vehicle, start (s), payload) into the water; returns the transmission's duration (s).
            world: The vehicles that autopilots move.

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
                from auv_lse_sim.emulated.autopilots import dock_of  # needs pymavlink

                self.dock = dock_of(settings, self.autopilots, world)
        except (OSError, AddressError) as error:
            self.close()
            raise ParameterError(f"{settings.where}: emulated links: {error}") from error

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
        """Pressure (Pa) that the barometers measure at a depth (m)."""
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


def _host_port(port: str) -> HostPort:
    address = read_address(port)
    if address.kind == "tcp" and address.position in LOCAL_HOSTS:
        return TcpServerPort(address.number)
    if address.kind == "serial" and not address.position.startswith("/dev/"):
        return PtyPort(Path(address.position))
    raise AddressError(
        f"modem.port {port!r} cannot be an emulated modem's; use a path outside /dev (a link to a pty) or "
        "tcp://127.0.0.1:PORT"
    )
