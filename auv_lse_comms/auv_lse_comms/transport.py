"""Ports that carry bytes: serial, TCP, UDP. Thin: open, read what is there, write, close; and open again for ever.

Nothing here knows what the bytes mean. Reads never wait. Every failure becomes a `TransportError` that names the
port, so that `Connection` can close it, wait (longer each time, up to a limit) and open it again.

Addresses:

    /dev/ttyUSB0, serial:///dev/ttyUSB0[:BAUD]     a serial device (8N1, no flow control); a pty serves too
    tcp://HOST:PORT                                calls a TCP server
    udpin://BIND:PORT                              waits on a UDP port; answers whoever spoke last
    udpout://HOST:PORT                             sends to a UDP port; takes answers from there

A path in /dev/ may hold colons (/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0): only a number of 3 to 7 digits
after the last one is a baud rate.
"""

from __future__ import annotations

import contextlib
import os
import re
import select
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

READ_BYTES = 65536
CONNECT_TIMEOUT_S = 3.0
#: A peer that takes nothing for so long is taken for dead (s).
WRITE_TIMEOUT_S = 2.0

_HOST_PORT = re.compile(r"(tcp|udpin|udpout)://(\[[0-9a-fA-F:]+\]|[^:/\s]+):(\d{1,5})\Z")
_SERIAL = re.compile(r"(?:serial://)?(/dev/\S+?|/[^\s:]+)(?::([1-9]\d{2,6}))?\Z")


class TransportError(OSError):
    """A port that cannot be opened, or has failed; names it."""


class AddressError(ValueError):
    """Text that is no address of a port; says what was expected."""


class Transport(Protocol):
    """An open port."""

    def fileno(self) -> int:
        """File descriptor to wait on for bytes."""
        ...

    def read(self) -> bytes:
        """The bytes that are there, b"" if none are. Raises TransportError."""
        ...

    def write(self, data: bytes) -> None:
        """Writes all of `data`. Raises TransportError."""
        ...

    def close(self) -> None:
        """Closes the port; a second time does nothing."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Address:
    """Where a port is: kind ("serial", "tcp", "udpin", "udpout"), device or host, port number or baud rate."""

    kind: str
    place: str
    number: int

    def __str__(self) -> str:
        """As it is written in the parameters."""
        return f"{self.kind}://{self.place}:{self.number}"


def read_address(text: str, baud: int = 19200) -> Address:
    """The address that `text` names (see the module's text).

    Args:
        text: The address.
        baud: Speed of a serial device whose address names none.

    Raises:
        AddressError: naming the text and the forms that are known.
    """
    match = _HOST_PORT.match(text)
    if match and 0 <= int(match[3]) <= 65535:
        return Address(kind=match[1], place=match[2].strip("[]"), number=int(match[3]))
    match = _SERIAL.match(text)
    if match:
        return Address(kind="serial", place=match[1], number=int(match[2] or baud))
    raise AddressError(
        f"address {text!r}: expected /dev/NAME or serial:///dev/NAME, with :BAUD (3 to 7 digits) after it or without, "
        "tcp://HOST:PORT, udpin://BIND:PORT or udpout://HOST:PORT"
    )


class SerialPort:
    """A serial device, or a pty."""

    def __init__(self, device: str, baud: int) -> None:
        """Opens `device` at `baud`, 8N1, exclusively.

        Raises:
            TransportError: if it is not there, is no serial device, another process has it, or pyserial is missing.
        """
        try:
            import serial  # here so that TCP and UDP work without it
        except ImportError as error:
            raise TransportError(
                f"{device}: cannot be opened: the Python package pyserial is not installed ({error}); expected "
                "python3-serial (apt) or pyserial (pip)"
            ) from error

        self._name = device
        self._failures: tuple[type[BaseException], ...] = (serial.SerialException, OSError, ValueError)
        try:
            self._port: Any = serial.Serial(device, baud, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
        except self._failures as error:
            raise TransportError(f"{device}: cannot be opened: {error}") from error

    def fileno(self) -> int:
        """See `Transport`."""
        return int(self._port.fileno())

    def read(self) -> bytes:
        """See `Transport`."""
        try:
            readable, _, _ = select.select([self.fileno()], [], [], 0.0)
            if not readable:
                return b""
            data = os.read(self.fileno(), READ_BYTES)
        except self._failures as error:
            raise TransportError(f"{self._name}: cannot be read: {error}") from error
        if not data:  # readable, yet nothing there: the device is gone
            raise TransportError(f"{self._name}: the device is gone")
        return data

    def write(self, data: bytes) -> None:
        """See `Transport`."""
        try:
            self._port.write(data)
        except self._failures as error:
            raise TransportError(f"{self._name}: cannot be written: {error}") from error

    def close(self) -> None:
        """See `Transport`."""
        with contextlib.suppress(*self._failures):
            self._port.close()


class TcpPort:
    """A TCP connection to a server."""

    def __init__(self, host: str, port: int) -> None:
        """Connects; waits at most `CONNECT_TIMEOUT_S`.

        Raises:
            TransportError: if nobody answers there.
        """
        self._name = f"tcp://{host}:{port}"
        try:
            self._socket = socket.create_connection((host, port), timeout=CONNECT_TIMEOUT_S)
        except (OSError, UnicodeError) as error:  # UnicodeError: a name that no host can have
            raise TransportError(f"{self._name}: cannot connect: {error}") from error
        self._socket.settimeout(WRITE_TIMEOUT_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)

    def fileno(self) -> int:
        """See `Transport`."""
        return self._socket.fileno()

    def read(self) -> bytes:
        """See `Transport`."""
        try:
            readable, _, _ = select.select([self._socket], [], [], 0.0)
            if not readable:
                return b""
            data = self._socket.recv(READ_BYTES)
        except (OSError, ValueError) as error:
            raise TransportError(f"{self._name}: cannot be read: {error}") from error
        if not data:
            raise TransportError(f"{self._name}: the other side has closed")
        return data

    def write(self, data: bytes) -> None:
        """See `Transport`."""
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise TransportError(f"{self._name}: cannot be written: {error}") from error

    def close(self) -> None:
        """See `Transport`."""
        self._socket.close()


class UdpPort:
    """A UDP socket: bound and answering the last speaker (`udpin`), or sending to one place (`udpout`)."""

    def __init__(self, kind: str, host: str, port: int) -> None:
        """Binds or aims.

        Raises:
            TransportError: if the address is taken or not one of this machine's.
        """
        self._name = f"{kind}://{host}:{port}"
        self._peer: Any = None
        try:
            family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
        except (OSError, UnicodeError) as error:
            raise TransportError(f"{self._name}: {error}") from error
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
            if kind == "udpin":
                self._socket.bind(address)
            else:
                self._peer = address
                # only what comes from the peer is taken; also makes the local port known
                self._socket.connect(address)
        except OSError as error:
            self._socket.close()
            raise TransportError(f"{self._name}: {error}") from error
        self._connected = kind == "udpout"
        self._socket.setblocking(False)

    @property
    def local_port(self) -> int:
        """Port number on this side."""
        return int(self._socket.getsockname()[1])

    def fileno(self) -> int:
        """See `Transport`."""
        return self._socket.fileno()

    def read(self) -> bytes:
        """The payloads of the datagrams that are there, one after another."""
        parts: list[bytes] = []
        while True:
            try:
                data, peer = self._socket.recvfrom(READ_BYTES)
            except BlockingIOError:
                break
            except ConnectionRefusedError:
                continue  # nobody listened when we last wrote: UDP does not mind, nor do we
            except OSError as error:
                raise TransportError(f"{self._name}: cannot be read: {error}") from error
            if not self._connected:
                self._peer = peer
            parts.append(data)
        return b"".join(parts)

    def write(self, data: bytes) -> None:
        """Sends one datagram; nowhere, if nobody has spoken yet."""
        if self._peer is None:
            return
        try:
            if self._connected:
                self._socket.send(data)
            else:
                self._socket.sendto(data, self._peer)
        except (ConnectionRefusedError, BlockingIOError):
            pass  # nobody listens, or the buffer is full: a datagram may be lost
        except OSError as error:
            raise TransportError(f"{self._name}: cannot be written: {error}") from error

    def close(self) -> None:
        """See `Transport`."""
        self._socket.close()


def open_transport(address: Address) -> Transport:
    """Opens the port at `address`.

    Raises:
        TransportError: if it cannot be opened.
    """
    if address.kind == "serial":
        return SerialPort(address.place, address.number)
    if address.kind == "tcp":
        return TcpPort(address.place, address.number)
    return UdpPort(address.kind, address.place, address.number)


class Connection:
    """A port that is opened again whenever it fails, for ever, waiting longer after each failure in a row.

    `poll` with a steady clock opens it when it is time; `read` and `write` close it when it fails.

    Attributes:
        transport: The open port, or None.
        problem: Why it is not open, for messages; "" while it is.
        failures: Failures in a row: to open, or of a port that was open.
    """

    def __init__(self, open_port: Callable[[], Transport], backoff_min_s: float, backoff_max_s: float) -> None:
        """Opens with `open_port`, which raises TransportError."""
        self.transport: Transport | None = None
        self.problem = "not opened yet"
        self.failures = 0
        self._open_port = open_port
        self._backoff_s = (backoff_min_s, backoff_max_s)
        self._retry_s: float | None = None

    def poll(self, steady_s: float) -> bool:
        """Opens the port if it is closed and the wait is over; returns True if it has just been opened."""
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
        """What has come; b"" if nothing has, or the port has just failed."""
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
        """Closes the port; it is opened again after the wait."""
        if self.transport is not None:
            self.transport.close()
            self.transport = None
            self._fail(reason, steady_s)

    @property
    def wait_s(self) -> float:
        """The wait after the failures so far, s."""
        low, high = self._backoff_s
        return min(high, low * 2.0 ** min(self.failures - 1, 60)) if self.failures else 0.0

    def _fail(self, reason: str, steady_s: float) -> None:
        self.problem = reason
        self.failures += 1
        self._retry_s = steady_s + self.wait_s


class Readable(Protocol):
    """Something with a file descriptor that becomes readable."""

    def fileno(self) -> int:
        """The file descriptor."""
        ...


class Watcher:
    """A thread that waits for bytes on a port and calls `wake` (from that thread) when there are some.

    The owner reads them and calls `handled`, after which the thread waits again. `stop` ends it.
    """

    def __init__(self, transport: Readable, wake: Callable[[], None]) -> None:
        """Starts watching."""
        self._transport = transport
        self._wake = wake
        self._handled = threading.Event()
        self._stopped = False
        self._stop_read, self._stop_write = os.pipe()
        self._thread = threading.Thread(target=self._watch, name="port watcher", daemon=True)
        self._thread.start()

    def handled(self) -> None:
        """What was there has been read."""
        self._handled.set()

    def stop(self) -> None:
        """Ends the thread and waits for it; to be called before the port is closed."""
        if self._stopped:
            return
        self._stopped = True
        os.write(self._stop_write, b"x")
        self._handled.set()
        self._thread.join()
        os.close(self._stop_read)
        os.close(self._stop_write)

    def _watch(self) -> None:
        while True:
            try:
                readable, _, _ = select.select([self._transport.fileno(), self._stop_read], [], [])
            except (OSError, ValueError):
                return  # the port was closed under us
            if self._stop_read in readable:
                return
            self._handled.clear()
            if self._stopped:  # since select returned: `stop` had set `_handled`, which is now cleared
                return
            self._wake()
            self._handled.wait()
