"""A port that is reopened whenever it fails."""

from collections import Counter
from collections.abc import Callable

from auv_lse_comms.transport.ports import Transport, TransportError


class Connection:
    """A port that is reopened whenever it fails, after a wait that doubles with each successive failure.

    `poll` opens it when it is time, by a steady clock; `read` and `write` close it when it fails.

    Attributes:
        transport: The open port, or None.
        problem: Why it is not open, for messages; "" while it is.
        failures: Number of successive failures, of opening or of the open port.
    """

    def __init__(self, open_port: Callable[[], Transport], backoff_min_s: float, backoff_max_s: float) -> None:
        """Starts closed; `open_port` opens the port or raises TransportError."""
        self.transport: Transport | None = None
        self.problem = "not opened yet"
        self.failures = 0
        self._open_port = open_port
        self._closed_counts: Counter[str] = Counter()
        self._backoff_s = (backoff_min_s, backoff_max_s)
        self._retry_s: float | None = None

    def poll(self, steady_s: float) -> bool:
        """Opens the port if it is closed and the wait is over; returns whether it was opened."""
        if self.transport is not None or (self._retry_s is not None and steady_s < self._retry_s):
            return False
        try:
            self.transport = self._open_port()
        except TransportError as error:
            self._fail(str(error), steady_s)
            return False
        self.problem = ""
        return True

    def read(self, steady_s: float) -> bytes:
        """The bytes that have arrived; b"" if none have, or the port is closed or fails."""
        if self.transport is None:
            return b""
        try:
            data = self.transport.read()
        except TransportError as error:
            self.close(steady_s, str(error))
            return b""
        if data:
            self.failures = 0
        return data

    def write(self, data: bytes, steady_s: float) -> None:
        """Writes, if the port is open."""
        if self.transport is None or not data:
            return
        try:
            self.transport.write(data)
        except TransportError as error:
            self.close(steady_s, str(error))

    def close(self, steady_s: float, reason: str) -> None:
        """Closes the port; it is reopened after the wait."""
        if self.transport is not None:
            self.transport.close()
            self._closed_counts += self.transport.counts
            self.transport = None
            self._fail(reason, steady_s)

    @property
    def counts(self) -> Counter[str]:
        """Counts of the open port and of those before it (`Transport.counts`)."""
        return self._closed_counts + (self.transport.counts if self.transport else Counter())

    @property
    def wait_s(self) -> float:
        """The wait after the present number of failures (s)."""
        low, high = self._backoff_s
        return min(high, low * 2.0 ** min(self.failures - 1, 60)) if self.failures else 0.0

    def _fail(self, reason: str, steady_s: float) -> None:
        self.problem = reason
        self.failures += 1
        self._retry_s = steady_s + self.wait_s
