"""Open ports: a serial device, a TCP connection, a UDP socket."""

import contextlib
import errno
import os
import select
import socket
from collections import Counter, deque
from collections.abc import Callable
from typing import Any, Protocol

from auv_lse_common.mission_file.port_address import Address

READ_BYTES = 65536
#: Largest number of datagrams, and of bytes (and the rest of a datagram), that a read of a UDP port takes.
MAX_DATAGRAMS, MAX_TAKEN_BYTES = 1024, 1 << 19
#: Largest number of bytes that a read returns; older datagrams are dropped.
MAX_BYTES = 65536
CONNECT_TIMEOUT_S = 3.0
#: A peer that accepts no data for this long counts as dead (s).
WRITE_TIMEOUT_S = 2.0


class TransportError(OSError):
    """A port that cannot be opened, or has failed; its message names the port."""


#: Cures of errors in opening a port.
_CURES = {
    errno.ENOENT: "connect the device, or name another port",
    errno.EACCES: "add this user to the group of the device: sudo usermod -a -G dialout USER, then log in again",
    errno.EAGAIN: "another program has it open; end that program",
    errno.EBUSY: "another program has it open; end that program",
    errno.EADDRINUSE: "another program listens there, such as a ground station; end it, or choose another port",
    errno.EADDRNOTAVAIL: "this computer has no such address; use 127.0.0.1 (this computer) or 0.0.0.0 (every network)",
    errno.ECONNREFUSED: "nothing listens there; start it, or name another port",
}


def _reason(error: Exception) -> str:
    """Why a port cannot be opened, and the cure, without the port's name, which pyserial repeats."""
    number = error.errno if isinstance(error, OSError) else None
    if number not in _CURES:
        return str(error)
    return f"{os.strerror(number)} ({_CURES[number]})"


class Transport(Protocol):
    """An open port.

    Attributes:
        counts: "full_reads" (reads that reached their limit), "datagrams_dropped" (the oldest of too many).
    """

    counts: Counter[str]

    def fileno(self) -> int:
        """File descriptor for waiting on bytes."""
        ...

    def read(self) -> bytes:
        """The bytes that have arrived, up to a limit, b"" if none have. Raises TransportError."""
        ...

    def write(self, data: bytes) -> None:
        """Writes all of `data`. Raises TransportError."""
        ...

    def close(self) -> None:
        """Closes the port; calling it twice is allowed."""
        ...


class _StreamPort:
    """A `Transport` over a stream of bytes."""

    def __init__(self, name: str, stream: Any, write: Callable[[bytes], Any], lost: str) -> None:
        """Uses the open `stream`, writes with `write`; `lost` describes a stream that has ended."""
        self._name, self._stream, self._write, self._lost = name, stream, write, lost
        self.counts: Counter[str] = Counter()

    def fileno(self) -> int:
        """See `Transport`."""
        return int(self._stream.fileno())

    def read(self) -> bytes:
        """See `Transport`."""
        try:
            readable, _, _ = select.select([self.fileno()], [], [], 0.0)
            if not readable:
                return b""
            data = os.read(self.fileno(), READ_BYTES)
        except (OSError, ValueError) as error:  # pyserial's SerialException is an OSError
            raise TransportError(f"{self._name}: cannot be read: {error}") from error
        if not data:  # readable, yet without data: the stream has ended
            raise TransportError(f"{self._name}: {self._lost}")
        if len(data) == READ_BYTES:
            self.counts["full_reads"] += 1
        return data

    def write(self, data: bytes) -> None:
        """See `Transport`."""
        try:
            self._write(data)
        except (OSError, ValueError) as error:
            raise TransportError(f"{self._name}: cannot be written: {error}") from error

    def close(self) -> None:
        """See `Transport`."""
        with contextlib.suppress(OSError, ValueError):
            self._stream.close()


class SerialPort(_StreamPort):
    """A serial device, or a pty."""

    def __init__(self, device: str, baud: int, lines_low: bool = False) -> None:
        """Opens `device` at `baud`, 8N1, exclusively; `lines_low` keeps RTS and DTR low.

        Raises:
            TransportError: if it does not exist, is not a serial device, is in use, or pyserial is missing.
        """
        try:
            import serial  # here, so that TCP and UDP work without it
        except ImportError as error:
            raise TransportError(
                f"{device} cannot be opened: the Python package pyserial is not installed ({error}). Install "
                "python3-serial (apt) or pyserial (pip)"
            ) from error
        try:
            port = serial.Serial(None, baud, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
            port.port = device
            if lines_low:  # before opening, which would raise both lines
                port.rts = port.dtr = False
            port.open()
        except (OSError, ValueError) as error:
            raise TransportError(f"{device}: cannot be opened: {_reason(error)}") from error
        super().__init__(device, port, port.write, "the device is gone")


class TcpPort(_StreamPort):
    """A TCP connection to a server."""

    def __init__(self, host: str, port: int) -> None:
        """Connects; waits at most `CONNECT_TIMEOUT_S`.

        Raises:
            TransportError: if there is no server.
        """
        name = f"tcp://{host}:{port}"
        try:
            connection = socket.create_connection((host, port), timeout=CONNECT_TIMEOUT_S)
        except (OSError, UnicodeError) as error:  # UnicodeError: an impossible host name
            raise TransportError(f"{name}: cannot connect: {_reason(error)}") from error
        connection.settimeout(WRITE_TIMEOUT_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        super().__init__(name, connection, connection.sendall, "the other side has closed")


class UdpPort:
    """A UDP socket: bound and answering its peer (`udpin`), or sending to one address (`udpout`).

    The peer of `udpin` is the last sender of an expected datagram; others' datagrams are dropped.
    """

    def __init__(self, kind: str, host: str, port: int, expected: Callable[[bytes], bool] | None = None) -> None:
        """Binds or connects.

        Args:
            kind: "udpin" or "udpout".
            host: Address to bind, or to send to.
            expected: Whether a datagram of a new sender makes that the peer (`udpin`); None: any does.

        Raises:
            TransportError: if the address is in use or does not belong to this machine.
        """
        self._name = f"{kind}://{host}:{port}"
        self.counts: Counter[str] = Counter()
        self._peer: Any = None
        self._expected = expected
        try:
            family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
        except (OSError, UnicodeError) as error:
            raise TransportError(f"{self._name}: cannot be opened: {_reason(error)}") from error
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
            if kind == "udpin":
                self._socket.bind(address)
            else:
                self._peer = address
                # accepts only the peer's datagrams; also determines the local port
                self._socket.connect(address)
        except OSError as error:
            self._socket.close()
            raise TransportError(f"{self._name}: cannot be opened: {_reason(error)}") from error
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
        """The payloads of the datagrams that have arrived, joined.

        A flood cannot hold the caller: what exceeds a read's limits waits for the next one.
        """
        parts: deque[bytes] = deque()
        taken = size = 0
        for _ in range(MAX_DATAGRAMS):
            try:
                data, peer = self._socket.recvfrom(READ_BYTES)
            except BlockingIOError:
                break
            except ConnectionRefusedError:
                continue  # nothing listened at the last write, which UDP allows
            except OSError as error:
                raise TransportError(f"{self._name}: cannot be read: {error}") from error
            taken += len(data)
            if self._accepts(data, peer):
                parts.append(data)
                size += len(data)
            while size > MAX_BYTES:
                size -= len(parts.popleft())
                self.counts["datagrams_dropped"] += 1
            if taken >= MAX_TAKEN_BYTES:
                self.counts["full_reads"] += 1
                break
        else:
            self.counts["full_reads"] += 1
        return b"".join(parts)

    def _accepts(self, data: bytes, peer: Any) -> bool:
        """Whether a datagram is the peer's, or makes its sender the peer."""
        if not self._connected and peer != self._peer:
            if self._expected is not None and not self._expected(data):
                return False
            self._peer = peer
        return True

    def write(self, data: bytes) -> None:
        """Sends one datagram; does nothing until there is a peer."""
        if self._peer is None:
            return
        try:
            if self._connected:
                self._socket.send(data)
            else:
                self._socket.sendto(data, self._peer)
        except (ConnectionRefusedError, BlockingIOError):
            pass  # nothing listens, or the buffer is full: datagrams may get lost
        except OSError as error:
            raise TransportError(f"{self._name}: cannot be written: {error}") from error

    def close(self) -> None:
        """See `Transport`."""
        self._socket.close()


def open_transport(
    address: Address, expected: Callable[[bytes], bool] | None = None, lines_low: bool = False
) -> Transport:
    """Opens the port at `address`; `expected` is that of `UdpPort`, `lines_low` that of `SerialPort`.

    Raises:
        TransportError: if it cannot be opened.
    """
    if address.kind == "serial":
        return SerialPort(address.position, address.number, lines_low)
    if address.kind == "tcp":
        return TcpPort(address.position, address.number)
    return UdpPort(address.kind, address.position, address.number, expected)
