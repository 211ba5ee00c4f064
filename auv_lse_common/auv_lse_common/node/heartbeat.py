"""Heartbeats of a watched process: systemd's protocol (sd_notify, WATCHDOG=1, STATUS=) over a Unix socket.

A hanging or stopped process looks alive from outside. So a node sends a heartbeat once a second, from the thread that
serves its callbacks. The socket is in Linux's abstract namespace, so it needs neither disk nor network. The kernel
identifies the sender. A process reports lines that the operator must read at once in the same way.
"""

import contextlib
import os
import socket
import struct
from collections.abc import Mapping

#: Environment variable with the address of the keeper's socket; "@" stands for the abstract namespace.
SOCKET_VARIABLE = "NOTIFY_SOCKET"
#: Period (s) of heartbeats.
BEAT_PERIOD_S = 1.0
_ALIVE, _STATUS = b"WATCHDOG=1", b"STATUS="
_LONGEST = 2000  # bytes of a datagram
_CREDENTIALS = struct.Struct("3i")  # pid, uid, gid


class Heartbeat:
    """Sender: sends heartbeats to the keeper that the environment names, if any."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        address = environment.get(SOCKET_VARIABLE, "")
        self.wanted = bool(address)
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) if address else None

    def beat(self) -> None:
        """Sends a heartbeat; ignores a keeper that has ended or is too busy."""
        self._send(_ALIVE)

    def report(self, text: str) -> None:
        """Sends a line for the terminal of the command that keeps this process."""
        self._send((_STATUS + text.encode())[:_LONGEST])

    def _send(self, data: bytes) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(data, self._address)


class Heartbeats:
    """Receiver of heartbeats.

    Attributes:
        address: Value of `SOCKET_VARIABLE` in the processes' environment.
    """

    def __init__(self) -> None:
        """Opens the socket with a name from the kernel."""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        self._socket.bind("")  # autobind, unix(7)
        self.address = "@" + self._socket.getsockname()[1:].decode()

    def take(self) -> tuple[set[int], list[str]]:
        """Ids of this user's processes that have sent a heartbeat since the last call, and the lines they report."""
        alive, reports = set(), []
        with contextlib.suppress(BlockingIOError):
            while True:
                data, ancillary, _, _ = self._socket.recvmsg(_LONGEST, socket.CMSG_SPACE(_CREDENTIALS.size))
                senders = [_CREDENTIALS.unpack(value) for _, kind, value in ancillary if kind == socket.SCM_CREDENTIALS]
                own = [pid for pid, uid, _ in senders if uid == os.getuid()]
                if data == _ALIVE:
                    alive |= set(own)
                elif own and data.startswith(_STATUS):
                    reports.append(data.removeprefix(_STATUS).decode(errors="replace"))
        return alive, reports

    def close(self) -> None:
        """Closes the socket."""
        self._socket.close()
