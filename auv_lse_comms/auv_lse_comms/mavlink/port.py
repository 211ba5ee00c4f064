"""A vehicle's MAVLink link on its endpoint, with the sounder: what `vehicle_link_node` owns. Knows no ROS."""

from __future__ import annotations

from collections.abc import Iterator

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_common.vocabulary.health import Health, Level
from auv_lse_common.vocabulary.mission_run import Stop
from auv_lse_comms.mavlink.link import LinkState, VehicleLink
from auv_lse_comms.mavlink.messages.conversion import Target
from auv_lse_comms.mavlink.messages.datum import Origin
from auv_lse_comms.mavlink.messages.events import Altitude, AutopilotEstimate, Problem
from auv_lse_comms.mavlink.messages.events import Event as LinkEvent
from auv_lse_comms.mavlink.sounder import Sounder, Sounding
from auv_lse_comms.mavlink.targets import TargetLimits
from auv_lse_comms.transport import Connection, Transport, open_transport, read_address

#: Speed of a serial endpoint that names none.
_BAUD = 115200

#: Why the endpoint is closed at the end.
CLOSING = "shutting down"

Event = LinkEvent | Sounding


class AutopilotPort:
    """The link and the endpoint it speaks on, which is opened again whenever it fails.

    `step` carries bytes both ways; `now_s` is the host's clock (UTC or simulated), `steady_s` one that never jumps, for
    the waits before the endpoint is opened again.

    Attributes:
        link: The link.
        connection: The endpoint.
    """

    def __init__(
        self,
        config: LinkConfig,
        vehicle: int,
        origin: Origin | None,
        limits: TargetLimits | None = None,
        key: bytes | None = None,
    ) -> None:
        """For the autopilot of vehicle number `vehicle`; opens nothing yet.

        Args:
            config: Section `link`.
            vehicle: Number of the vehicle.
            origin: The mission's origin.
            limits: What no target may exceed.
            key: Key with which messages are signed.

        Raises:
            ValueError: if `link.endpoint` is no address, or missions are to be uploaded and there is no origin.
        """
        address = read_address(config.endpoint, _BAUD)
        self.link = VehicleLink(config, vehicle, origin, limits, key)
        self.connection = Connection(
            lambda: open_transport(address, self.link.recognizes), config.backoff_min_s, config.backoff_max_s
        )
        self._sounder = Sounder(config.sounding_every_s, config.sounding_least_pings) if config.soundings else None
        self._sounded_from = self.link.datum
        self._told = self.connection.problem
        self._sent = "uploads" if config.mode == "mission" else "target_messages"

    @property
    def transport(self) -> Transport | None:
        """The open endpoint, to wait on for bytes; None if it is closed."""
        return self.connection.transport

    @property
    def quiet(self) -> bool:
        """True if the autopilot is heard and owes no answer that would come at once."""
        return self.link.quiet

    @property
    def sent(self) -> int:
        """Targets, or missions, that the autopilot has been sent so far."""
        return self.link.counts[self._sent]

    def command(self, now_s: float, target: Target) -> None:
        """Queues the end of the next leg; `step` puts it on the wire.

        Raises:
            ValueError: see `VehicleLink.command`.
        """
        self.link.command(now_s, target)

    def stop(self, now_s: float, stop: Stop | None) -> None:
        """Stops the vehicle, or lets it travel on (None); `step` puts it on the wire."""
        self.link.stop(now_s, stop)

    def step(self, now_s: float, steady_s: float, poll: bool = True) -> list[Event]:
        """Opens the endpoint if it is time, takes what has come, lets time pass (if `poll`), writes; tells events."""
        self.connection.poll(steady_s)
        data = self.connection.read(steady_s)
        if data:
            self.link.receive(now_s, data)
        if poll:
            self.link.poll(now_s)
        for datagram in self.link.outgoing():
            self.connection.write(datagram, steady_s)
        return list(self._events())

    def close(self, now_s: float, steady_s: float) -> list[Event]:
        """Closes the endpoint for good; `now_s` is not used."""
        self.connection.close(steady_s, CLOSING)
        return list(self._events())

    def health(self) -> Health:
        """The state of link, endpoint and sounder."""
        link = self.link
        up = link.state is LinkState.UP
        text = ("armed" if link.armed else "not armed") if up else self.connection.problem or "no autopilot heard"
        if up and not link.says.mode_obeys:
            text += f"; mode {link.custom_mode}, expected one of {list(link.obeying_modes)} (link.modes)"
        if up and not link.placed:
            text += "; the autopilot's origin is not known: no odometry, no targets"
        values = {"mode": link.custom_mode, "targets waiting": len(link.targets), **link.counts}
        values |= {f"wire {name}": count for name, count in link.wire.items()}
        if self._sounder is not None:
            values |= {f"sounder {name}": count for name, count in self._sounder.counts.items()}
        return Health(level=Level.OK if up and link.placed else Level.ERROR, text=text, values=values)

    def _events(self) -> Iterator[Event]:
        if self.connection.problem != self._told:
            self._told = self.connection.problem
            if self._told and self._told != CLOSING:
                yield Problem(text=f"link.endpoint: {self._told}; it is tried again")
        for event in self.link.events():
            yield event
            if self._sounder is not None and isinstance(event, Altitude):
                self._sounder.altitude(event.stamp_s, event.altitude_m)
            elif self._sounder is not None and isinstance(event, AutopilotEstimate):
                yield from self._soundings(self._sounder, event)

    def _soundings(self, sounder: Sounder, odometry: AutopilotEstimate) -> list[Sounding]:
        """The soundings that are complete now."""
        if self._sounded_from != self.link.datum:  # places have shifted with the origin
            self._sounded_from = self.link.datum
            sounder.reset()
        raw_m = odometry.raw_north_m, odometry.raw_east_m
        return sounder.odometry(odometry.stamp_s, odometry.north_m, odometry.east_m, odometry.depth_m, raw_m)
