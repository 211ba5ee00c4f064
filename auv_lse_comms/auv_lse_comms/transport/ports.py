"""Open ports: a serial device, a TCP connection, a UDP socket."""

from __future__ import annotations

import contextlib
import os
import select
import socket
from collections.abc import Callable
from typing import Any, Protocol

from auv_lse_comms.transport.address import Address

READ_BYTES = 65536
CONNECT_TIMEOUT_S = 3.0
#: A peer that takes nothing for so long is taken for dead (s).
WRITE_TIMEOUT_S = 2.0


class TransportError(OSError):
    """A port that cannot be opened, or has failed; its message names the port."""


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


class SerialPort:
    """A serial device, or a pty."""

    def __init__(self, device: str, baud: int, lines_low: bool = False) -> None:
        """Opens `device` at `baud`, 8N1, exclusively; `lines_low` keeps RTS and DTR low.

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
            self._port: Any = serial.Serial(None, baud, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
            self._port.port = device
            if lines_low:  # before it is opened: to open it raises both
                self._port.rts = self._port.dtr = False
            self._port.open()
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
            TransportError: if there is no server.
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
    """A UDP socket: bound and answering its peer (`udpin`), or sending to one place (`udpout`).

    The peer of `udpin` is the last sender of a datagram that is expected; others' datagrams are dropped.
    """

    def __init__(self, kind: str, host: str, port: int, expected: Callable[[bytes], bool] | None = None) -> None:
        """Binds or aims.

        Args:
            kind: "udpin" or "udpout".
            host: Address to bind, or to send to.
            port: Its port.
            expected: Whether a datagram of a new sender makes that the peer (`udpin`); None: any does.

        Raises:
            TransportError: if the address is taken or not one of this machine's.
        """
        self._name = f"{kind}://{host}:{port}"
        self._peer: Any = None
        self._expected = expected
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
                continue  # nobody listened when we last wrote, which UDP allows
            except OSError as error:
                raise TransportError(f"{self._name}: cannot be read: {error}") from error
            if not self._connected and peer != self._peer:
                if self._expected is not None and not self._expected(data):
                    continue
                self._peer = peer
            parts.append(data)
        return b"".join(parts)

    def write(self, data: bytes) -> None:
        """Sends one datagram; nowhere, before anything has come in."""
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


def open_transport(
    address: Address, expected: Callable[[bytes], bool] | None = None, lines_low: bool = False
) -> Transport:
    """Opens the port at `address`.

    Args:
        address: Where it is.
        expected: For `udpin`: whether a datagram of a new sender makes that the peer; None: any does.
        lines_low: For a serial device: RTS and DTR stay low.

    Raises:
        TransportError: if it cannot be opened.
    """
    if address.kind == "serial":
        return SerialPort(address.place, address.number, lines_low)
    if address.kind == "tcp":
        return TcpPort(address.place, address.number)
    return UdpPort(address.kind, address.place, address.number, expected)
