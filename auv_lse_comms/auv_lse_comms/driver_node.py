"""Base of the nodes that drive hardware: they connect topics with a port."""

from __future__ import annotations

import time
from abc import abstractmethod
from typing import Any, Protocol

from auv_lse_common.node.vehicle_node import VehicleNode
from auv_lse_common.vocabulary.health import Health, Level
from auv_lse_comms.transport import PortWatcher, Transport

_POLL_PERIOD_S = 0.05
_DIAGNOSTICS_PERIOD_S = 4.0


class Port(Protocol):
    """A device's driver on its port."""

    @property
    def transport(self) -> Transport | None:
        """The open port, for waiting on bytes; None if it is closed."""
        ...

    @property
    def quiet(self) -> bool:
        """Whether the device is ready and no immediate answer is pending."""
        ...

    def step(self, now_s: float, steady_s: float, poll: bool) -> list[Any]:
        """Transfers bytes both ways and, if `poll`, lets time pass; returns the events."""
        ...

    def health(self) -> Health:
        """The state of device and port."""
        ...

    def close(self, now_s: float, steady_s: float) -> list[Any]:
        """Closes the port."""
        ...


class DriverNode(VehicleNode):
    """A node between topics and a device, woken by bytes, messages and a timer.

    In lockstep, time passes with ticks only, and a tick is answered once the device is quiet.
    """

    def __init__(self, name: str, status_name: str) -> None:
        """Args: name: the node's name. status_name: the name of its diagnostics and of its lockstep phase."""
        super().__init__(name)
        self._status_name = status_name
        self._watched: tuple[Transport, PortWatcher] | None = None
        self._waited_for: str | None = ""  # logged last; None once the device was ready

    def drive(self, port: Port, address: str) -> None:
        """Begins to open the port; call it after wiring every topic.

        Args:
            address: The parameter that names the port, and its value, for the log.
        """
        self._port, self._address = port, address
        self._bytes = self.create_guard_condition(self._on_bytes)
        self.phase(self._status_name, lambda now_s: self._exchange(poll=True), self.totals)
        self.begin()
        self.create_timer(_POLL_PERIOD_S, self._on_timer)
        self.create_timer(_DIAGNOSTICS_PERIOD_S, self.diagnose)

    @abstractmethod
    def on_event(self, event: Any) -> None:
        """Publishes or logs an event of the device."""

    @abstractmethod
    def totals(self) -> tuple[int, ...]:
        """The totals that the node's lockstep phase reports."""

    def begin(self) -> None:
        """In lockstep, starts handling ticks; otherwise the node's own timer suffices."""
        if self.lockstep:
            super().begin()

    def settled(self) -> bool:
        """Whether no answer of the device is pending."""
        return self._port.quiet

    def wake(self) -> None:
        """Transfers bytes and, in lockstep, handles the tick if it is complete."""
        self._exchange(poll=False)
        super().wake()

    def polls(self) -> bool:
        """Whether time passes with the timer: not in lockstep."""
        return not self.lockstep

    def diagnose(self) -> None:
        """Publishes the state of device and port; logs what the first connection waits for."""
        health = self._port.health()
        self.publish_health(self.now_s(), health, self._status_name)
        if health.level is not Level.ERROR:
            self._waited_for = None
        elif self._waited_for is not None and health.text != self._waited_for:
            self._waited_for = health.text
            text = f"waiting for a device on {self._address}: {health.text}"
            self.get_logger().warning(text)
            self.report_on_terminal(f"auv{self.vehicle}: {text}")

    def _on_timer(self) -> None:
        self.log_ready()
        self._exchange(poll=self.polls())
        super().wake()

    def _on_bytes(self) -> None:
        self.wake()
        if self._watched is not None:
            self._watched[1].handled()

    def _exchange(self, poll: bool) -> None:
        for event in self._port.step(self.now_s(), time.monotonic(), poll):
            self.on_event(event)
        transport = self._port.transport
        if self._watched is not None and self._watched[0] is not transport:
            self._watched[1].stop()
            self._watched = None
        if self._watched is None and transport is not None:
            self._watched = (transport, PortWatcher(transport, self._bytes.trigger))

    def destroy_node(self) -> None:
        """Stops watching and closes the port."""
        if self._watched is not None:
            self._watched[1].stop()
        self._port.close(self.now_s(), time.monotonic())
        super().destroy_node()
