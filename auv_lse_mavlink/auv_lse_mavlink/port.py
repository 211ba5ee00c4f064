"""A vehicle's MAVLink link on its endpoint, with the sounder; `vehicle_link_node` owns one."""

from collections.abc import Callable, Iterator
from dataclasses import replace

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.topics.records import Altitude
from auv_lse_common.vocabulary.health import Health
from auv_lse_common.vocabulary.sounding import Sounding
from auv_lse_comms.packet.key import new_nonce
from auv_lse_comms.transport import Connection, Transport, open_transport, read_address
from auv_lse_mavlink.health import link_health
from auv_lse_mavlink.link import VehicleLink
from auv_lse_mavlink.messages.datum import Origin
from auv_lse_mavlink.messages.events import AutopilotEstimate, Problem
from auv_lse_mavlink.messages.events import Event as LinkEvent
from auv_lse_mavlink.sounder import Sounder
from auv_lse_mavlink.targets.limits import TargetLimits

#: Default speed of a serial endpoint.
BAUD = 115200

#: Reason for closing the endpoint at the end.
CLOSING = "shutting down"

Event = LinkEvent | Sounding


class AutopilotPort:
    """The link and its endpoint, which is reopened whenever it fails.

    `step` transfers bytes both ways. `now_s` is the host's clock (UTC or simulated); `steady_s` is a clock that never
    jumps and times the waits before the endpoint is reopened.

    Attributes:
        connection: The endpoint.
    """

    def __init__(
        self,
        config: LinkConfig,
        vehicle: int,
        origin: Origin | None,
        limits: TargetLimits | None = None,
        key: bytes | None = None,
        steady: Callable[[], float] | None = None,
    ) -> None:
        """Prepares the link with the arguments of `VehicleLink`; opens nothing yet.

        Raises:
            ValueError: if `link.endpoint` is not an address; see also `VehicleLink`.
        """
        address = read_address(config.endpoint, BAUD)
        self.link = VehicleLink(config, vehicle, origin, limits, key, new_nonce(), steady)
        self.connection = Connection(
            lambda: open_transport(address, self.link.recognizes), config.backoff_min_s, config.backoff_max_s
        )
        self._sounder = Sounder(config.sounding_every_s, config.sounding_least_pings) if config.soundings else None
        self._sounded_from = self.link.datum
        self._reported = self.connection.problem
        self._sent = "uploads" if config.mode == "mission" else "target_messages"

    @property
    def transport(self) -> Transport | None:
        """The open endpoint, for waiting on bytes; None if it is closed."""
        return self.connection.transport

    @property
    def quiet(self) -> bool:
        """Whether the autopilot is heard and no immediate answer is pending."""
        return self.link.quiet

    @property
    def sent(self) -> int:
        """Number of target messages, or missions, sent so far."""
        return self.link.counts[self._sent]

    def step(self, now_s: float, steady_s: float, poll: bool = True) -> list[Event]:
        """Opens the endpoint if it is time, reads, lets time pass (if `poll`), writes; returns the events."""
        if self.connection.poll(steady_s):
            self.link.senders.reopened()
        data = self.connection.read(steady_s)
        if data:
            self.link.receive(now_s, data)
        if poll:
            self.link.poll(now_s)
        for datagram in self.link.outgoing():
            self.connection.write(datagram, steady_s)
        return list(self._events())

    def close(self, now_s: float, steady_s: float) -> list[Event]:
        """Closes the endpoint; `now_s` is not used."""
        self.connection.close(steady_s, CLOSING)
        return list(self._events())

    def health(self) -> Health:
        """The state of link, endpoint and sounder."""
        health = link_health(self.link, self.connection.problem)
        values = dict(health.values)
        values |= {f"port {name}": count for name, count in self.connection.counts.items()}
        if self._sounder is not None:
            values |= {f"sounder {name}": count for name, count in self._sounder.counts.items()}
        return replace(health, values=values)

    def _events(self) -> Iterator[Event]:
        if self.connection.problem != self._reported:
            self._reported = self.connection.problem
            if self._reported and self._reported != CLOSING:
                yield Problem(text=f"link.endpoint: {self._reported}; trying again")
        for event in self.link.events():
            yield event
            if self._sounder is not None and isinstance(event, Altitude):
                self._sounder.altitude(event.stamp_s, event.altitude_m)
            elif self._sounder is not None and isinstance(event, AutopilotEstimate):
                yield from self._soundings(self._sounder, event)

    def _soundings(self, sounder: Sounder, odometry: AutopilotEstimate) -> list[Sounding]:
        """The soundings that an estimate completes."""
        if self._sounded_from != self.link.datum:  # positions have shifted with the origin
            self._sounded_from = self.link.datum
            sounder.reset()
        if self.link.report.depth_problem or not self.link.gauge.is_known:  # water depth would be as wrong
            sounder.counts["without_depth"] += 1
            sounder.reset()
            return []
        raw_m = odometry.raw_north_m, odometry.raw_east_m
        return sounder.odometry(odometry.stamp_s, odometry.north_m, odometry.east_m, odometry.depth_m, raw_m)
