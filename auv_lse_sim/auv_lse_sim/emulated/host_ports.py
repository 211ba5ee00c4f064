"""Ports on which a host reaches an emulated modem: a pseudo-terminal, or a TCP server."""

import contextlib
import os
import socket
import tty
from collections.abc import Callable, Iterable
from pathlib import Path

#: Bytes kept for a host that does not read; older bytes are dropped.
MAX_UNREAD_BYTES = 1 << 16
#: Names of this machine in addresses.
LOCAL_HOSTS = ("127.0.0.1", "localhost", "::1")


class _Unread:
    """Bytes for a host that reads slowly or not at all."""

    def __init__(self) -> None:
        self._data = bytearray()
        self.dropped = 0

    def write(self, data: bytes, put: Callable[[bytes], int]) -> None:
        """Writes older bytes, then `data`; keeps the rest."""
        self._data += data
        while self._data:
            try:
                count = put(bytes(self._data))
            except (BlockingIOError, InterruptedError):
                break
            except OSError:
                self._data.clear()
                break
            del self._data[:count]
        if len(self._data) > MAX_UNREAD_BYTES:
            self.dropped += len(self._data) - MAX_UNREAD_BYTES
            del self._data[: len(self._data) - MAX_UNREAD_BYTES]


class PtyPort:
    """A pseudo-terminal, which the host uses like a serial device."""

    def __init__(self, link: Path | None = None) -> None:
        """Creates the terminal.

        Args:
            link: Symbolic link to create to it (replaces an existing one), so that its name is known in advance.
        """
        self._master, self._slave = os.openpty()  # the slave stays open, so that the host may reconnect
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._unread = _Unread()
        self._link = link
        self._device = os.ttyname(self._slave)
        if link is not None:
            link.parent.mkdir(parents=True, exist_ok=True)
            with contextlib.suppress(FileNotFoundError):
                link.unlink()
            link.symlink_to(self._device)

    @property
    def port(self) -> str:
        """The link, or the device."""
        return str(self._link) if self._link is not None else self._device

    def filenos(self) -> Iterable[int]:
        """File descriptors to wait on."""
        return (self._master,)

    def read(self) -> bytes:
        """Bytes from the host; b"" if there are none."""
        try:
            return os.read(self._master, 65536)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """Writes without blocking; keeps the rest for the next call (b"" tries again)."""
        self._unread.write(data, lambda part: os.write(self._master, part))

    def close(self) -> None:
        """Removes the port."""
        if self._master < 0:
            return
        os.close(self._master)
        os.close(self._slave)
        self._master = -1
        if self._link is not None:
            with contextlib.suppress(OSError):
                if os.readlink(self._link) == self._device:
                    self._link.unlink()


class TcpServerPort:
    """A TCP server on the loopback interface for one host at a time; a new host replaces the old one."""

    def __init__(self, port: int = 0) -> None:
        """Listens on 127.0.0.1:`port`; 0: any free port."""
        self._server = socket.create_server(("127.0.0.1", port))
        self._server.setblocking(False)
        self._client: socket.socket | None = None
        self._unread = _Unread()

    @property
    def port(self) -> str:
        """`tcp://127.0.0.1:PORT`."""
        return f"tcp://127.0.0.1:{self._server.getsockname()[1]}"

    def filenos(self) -> Iterable[int]:
        """File descriptors to wait on."""
        return (self._server.fileno(),) if self._client is None else (self._server.fileno(), self._client.fileno())

    def read(self) -> bytes:
        """Bytes from the host, b"" if there are none; accepts a new host."""
        with contextlib.suppress(BlockingIOError):
            client, _ = self._server.accept()
            if self._client is not None:
                self._client.close()
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._client = client
            self._unread = _Unread()
        if self._client is None:
            return b""
        try:
            data = self._client.recv(65536)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._client.close()
            self._client = None
        return data

    def write(self, data: bytes) -> None:
        """As `PtyPort.write`; drops the bytes without a host."""
        client = self._client
        if client is not None:
            self._unread.write(data, client.send)

    def close(self) -> None:
        """Removes the port."""
        if self._client is not None:
            self._client.close()
        self._server.close()


#: A port on which a host can reach an emulated modem.
HostPort = PtyPort | TcpServerPort
