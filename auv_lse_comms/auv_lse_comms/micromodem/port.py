"""A modem's driver on its port, with its line log: what `micromodem_node` owns."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TextIO

from auv_lse_comms.micromodem.config import ModemConfig
from auv_lse_comms.micromodem.driver import Micromodem
from auv_lse_comms.micromodem.events import Event, Problem
from auv_lse_comms.micromodem.log import LogEntry, LoggedModem, format_entry
from auv_lse_comms.transport import Connection, Transport, open_transport, read_address


class ModemPort:
    """The driver and the port it speaks on, which is opened again whenever it fails.

    `step` carries bytes both ways; `now_s` is the host's clock (UTC or simulated), `steady_s` one that never jumps, for
    the waits before the port is opened again. A line log that can no longer be written is closed and reported once; the
    modem goes on without it.
    """

    def __init__(self, config: ModemConfig, address: int) -> None:
        """For the modem of vehicle number `address`; opens nothing yet.

        Raises:
            AddressError: if `modem.port` is no address.
            OSError: if the line log cannot be written.
        """
        where = read_address(config.port, config.baud)
        self.modem = Micromodem(config, address)
        self.connection = Connection(lambda: open_transport(where), config.backoff_min_s, config.backoff_max_s)
        self._log: TextIO | None = None
        self._log_problem: Problem | None = None  # not reported yet
        self._driver: Micromodem | LoggedModem = self.modem
        if config.log_file:
            path = Path(config.log_file)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._log = path.open("a", encoding="ascii", buffering=1)  # a line at a time: a crash loses none
            self._driver = LoggedModem(self.modem, self._record)

    @property
    def transport(self) -> Transport | None:
        """The open port, to wait on for bytes; None if it is closed."""
        return self.connection.transport

    def send(self, now_s: float, payload: bytes, destination: int | None = None) -> int:
        """Asks for a packet to be transmitted, to `modem.destination` if None; `step` puts it on the wire.

        Raises:
            ValueError: see `Micromodem.send`.
        """
        return self._driver.send(now_s, payload, destination)

    def step(self, now_s: float, steady_s: float, poll: bool = True) -> list[Event]:
        """Opens the port if it is time, takes what has come, lets time pass (if `poll`), writes; returns the events."""
        if self.connection.poll(steady_s):
            self._driver.opened(now_s)
        data = self.connection.read(steady_s)
        if data:
            self._driver.receive(now_s, data)
        if poll:
            self._driver.poll(now_s)
        if self.modem.wants_reopen:
            self.connection.close(steady_s, "the modem does not answer")
        self.connection.write(self._driver.outgoing(), steady_s)
        if self.connection.transport is None and self.modem.is_open:
            self._driver.closed(now_s, self.connection.problem)
        return self._events()

    def close(self, now_s: float, steady_s: float) -> list[Event]:
        """Closes port and log for good."""
        self.connection.close(steady_s, "shutting down")
        if self.modem.is_open:
            self._driver.closed(now_s, "shutting down")
        events = self._events()
        self._close_log()
        return events

    def _events(self) -> list[Event]:
        events = self._driver.events()
        if self._log_problem is not None:
            events.append(self._log_problem)
            self._log_problem = None
        return events

    def _record(self, entry: LogEntry) -> None:
        if self._log is None:
            return
        try:
            self._log.write(format_entry(entry) + "\n")
        except OSError as error:  # a full disk must not stop the modem
            self._log_problem = Problem(text=f"line log {self._log.name}: closed: it cannot be written: {error}")
            self._close_log()

    def _close_log(self) -> None:
        if self._log is not None:
            with contextlib.suppress(OSError):  # it writes what it could not write before
                self._log.close()
            self._log = None
