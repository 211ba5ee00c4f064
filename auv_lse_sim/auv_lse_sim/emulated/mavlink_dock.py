"""The simulated autopilots of a team, each on its UDP port."""

import select
from collections.abc import Mapping

from auv_lse_comms.transport import UdpPort, read_address
from auv_lse_sim.emulated.ardupilot.autopilot import ArduPilot
from auv_lse_sim.emulated.autopilot_report import Report
from auv_lse_sim.emulated.mavlink_vehicle import MavlinkVehicle

#: A simulated autopilot.
Autopilot = ArduPilot | MavlinkVehicle


class MavlinkDock:
    """One simulated autopilot per vehicle, each on its UDP port; no threads and no clock.

    The owner calls `serve` whenever `fileno` is readable, and `report` once a tick, both with the simulation's time.
    """

    def __init__(self, vehicles: Mapping[int, Autopilot], endpoints: Mapping[int, str]) -> None:
        """Opens the ports.

        Args:
            endpoints: Their ports: "udpin://127.0.0.1:PORT" listens (0: any free port), "udpout://127.0.0.1:PORT"
                sends first.

        Raises:
            TransportError: if a port is taken.
        """
        self.vehicles = dict(vehicles)
        self._ports: dict[int, UdpPort] = {}
        self._epoll = select.epoll()
        for vehicle in self.vehicles:
            address = read_address(endpoints[vehicle])
            self._ports[vehicle] = UdpPort(address.kind, address.position, address.number)
            self._epoll.register(self._ports[vehicle].fileno(), select.EPOLLIN)

    def fileno(self) -> int:
        """A file descriptor that is readable when `serve` has something to do."""
        return self._epoll.fileno()

    def serve(self, now_s: float) -> int:
        """Reads every port and answers; returns the number of bytes read. Never blocks."""
        total = 0
        for vehicle, port in self._ports.items():
            data = port.read()
            if data:
                total += len(data)
                self.vehicles[vehicle].receive(now_s, data)
            self._flush(vehicle)
        return total

    def send_on_deck(self, vehicle: int, now_s: float, pressure_pa: float) -> None:
        """Sends what a vehicle's driver needs before the mission; `pressure_pa` is the pressure on deck (Pa)."""
        self.vehicles[vehicle].send_on_deck(now_s, pressure_pa)
        self._flush(vehicle)

    def report(self, vehicle: int, now_s: float, report: Report) -> None:
        """Sends a vehicle's telemetry of one tick."""
        self.vehicles[vehicle].report(now_s, report)
        self._flush(vehicle)

    def close(self) -> None:
        """Closes the ports."""
        for port in self._ports.values():
            port.close()
        self._epoll.close()

    def _flush(self, vehicle: int) -> None:
        for datagram in self.vehicles[vehicle].outgoing():
            self._ports[vehicle].write(datagram)
