"""The emulated modems of a team, each on its port, all connected to one channel."""

import contextlib
import select
from collections import Counter, deque
from collections.abc import Callable, Mapping

from auv_lse_common.vocabulary.modem_rates import packet_duration_s
from auv_lse_sim.emulated.host_ports import HostPort
from auv_lse_sim.emulated.modem_emulator import ModemEmulator
from auv_lse_sim.emulated.modem_packets import HeardPacket, Transmission


class ModemRack:
    """One emulated modem per vehicle, each on its port, all connected to one channel; no threads and no clock.

    The owner calls `serve` whenever `fileno` is readable, and `poll` once a tick, both with the simulation's time.
    """

    def __init__(
        self, ports: Mapping[int, HostPort], transmit: Callable[[int, Transmission], float | None], now_s: float = 0.0
    ) -> None:
        """Boots one modem per port.

        Args:
            ports: Where a host reaches each vehicle's modem.
            transmit: Sends (vehicle, packet) into the water; returns the duration (s), or None for the nominal one.
        """
        self._ports = dict(ports)
        self.modems: dict[int, ModemEmulator] = {}
        self.transmitted: Counter[int] = Counter()
        self.delivered: Counter[int] = Counter()
        self._transmit = transmit
        self._epoll = select.epoll()
        self._watched: dict[int, int] = {}
        for vehicle in self._ports:
            self.modems[vehicle] = ModemEmulator(self._transmitter(vehicle))
            self.modems[vehicle].boot(now_s)
            self._flush(vehicle)

    @property
    def ports(self) -> dict[int, str]:
        """Where each vehicle's driver finds its modem, as `modem.port` takes it."""
        return {vehicle: port.port for vehicle, port in self._ports.items()}

    def fileno(self) -> int:
        """A file descriptor that is readable when `serve` has something to do."""
        return self._epoll.fileno()

    def serve(self, now_s: float) -> int:
        """Reads every port once and answers; returns the number of bytes read. Never blocks.

        Data beyond one read waits for the next call, so that no host can hold up the others.
        """
        total = 0
        for vehicle, port in self._ports.items():
            data = port.read()
            if data:
                total += len(data)
                self.modems[vehicle].receive(now_s, data)
            self._flush(vehicle)
        return total

    def poll(self, now_s: float) -> None:
        """Advances every modem to `now_s`."""
        for vehicle, modem in self.modems.items():
            modem.poll(now_s)
            self._flush(vehicle)

    def arrive(self, now_s: float, vehicle: int, arrival: HeardPacket) -> None:
        """Delivers a packet to a vehicle's modem; counts what the modem passes to its host."""
        self.delivered[vehicle] += self.modems[vehicle].arrive(now_s, arrival)
        self._flush(vehicle)

    def close(self) -> None:
        """Removes the ports."""
        for port in self._ports.values():
            port.close()
        self._epoll.close()

    def _transmitter(self, vehicle: int) -> Callable[[Transmission], float | None]:
        def transmit(transmission: Transmission) -> float | None:
            self.transmitted[vehicle] += 1
            return self._transmit(vehicle, transmission)

        return transmit

    def _flush(self, vehicle: int) -> None:
        self._ports[vehicle].write(self.modems[vehicle].outgoing())
        self._watch()

    def _watch(self) -> None:
        wanted = {number for port in self._ports.values() for number in port.filenos()}
        for number in set(self._watched) - wanted:
            del self._watched[number]
            with contextlib.suppress(OSError):  # already removed when the file was closed
                self._epoll.unregister(number)
        for number in wanted - set(self._watched):
            self._watched[number] = 1
            self._epoll.register(number, select.EPOLLIN)


def perfect_water(
    rack: Callable[[], ModemRack], delay_s: float = 0.5
) -> tuple[Callable[[int, Transmission], None], Callable[[float], None]]:
    """A channel for tests and the modem bench: every modem receives every packet after `delay_s`.

    Returns:
        `transmit` for a `ModemRack`, and `tick(now_s)`, which delivers the packets that have arrived by then.
    """
    under_way: deque[tuple[float, int, HeardPacket]] = deque()

    def transmit(vehicle: int, packet: Transmission) -> None:
        end_s = packet.start_s + delay_s + packet_duration_s(packet.rate, len(packet.payload))
        for other in rack().modems:
            if other != vehicle:
                arrival = HeardPacket(
                    start_s=packet.start_s + delay_s,
                    source=packet.source,
                    destination=packet.destination,
                    payload=packet.payload,
                    snr_db=20.0,
                    rate=packet.rate,
                    frames=packet.frames,
                )
                under_way.append((end_s, other, arrival))

    def tick(now_s: float) -> None:
        for item in [item for item in under_way if item[0] <= now_s]:
            under_way.remove(item)
            rack().arrive(now_s, item[1], item[2])

    return transmit, tick
