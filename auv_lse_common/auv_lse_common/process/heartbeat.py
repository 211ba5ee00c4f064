"""Heartbeats of a watched process: systemd's protocol (sd_notify, WATCHDOG=1) over a Unix socket.

A hanging or stopped process looks alive from outside. So a node sends a heartbeat once a second, from the thread that
serves its callbacks. The socket is in Linux's abstract namespace, so it needs neither disk nor network. The kernel
identifies the sender.
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct
from collections.abc import Mapping

#: Environment variable with the address of the keeper's socket; "@" stands for the abstract namespace.
SOCKET_VARIABLE = "NOTIFY_SOCKET"
#: Period (s) of heartbeats.
BEAT_PERIOD_S = 1.0
_ALIVE = b"WATCHDOG=1"
_CREDENTIALS = struct.Struct("3i")  # pid, uid, gid


class Heartbeat:
    """Sender: sends heartbeats to the keeper that the environment names, if any."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        """Sends nothing yet."""
        address = environment.get(SOCKET_VARIABLE, "")
        self.wanted = bool(address)
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) if address else None

    def beat(self) -> None:
        """Sends a heartbeat; a keeper that has ended or is too busy is ignored."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(_ALIVE, self._address)


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

    def take(self) -> set[int]:
        """Ids of this user's processes that have sent a heartbeat since the last call."""
        alive = set()
        with contextlib.suppress(BlockingIOError):
            while True:
                data, ancillary, _, _ = self._socket.recvmsg(len(_ALIVE), socket.CMSG_SPACE(_CREDENTIALS.size))
                pids = [
                    _CREDENTIALS.unpack(value)[:2] for _, kind, value in ancillary if kind == socket.SCM_CREDENTIALS
                ]
                alive |= {pid for pid, uid in pids if data == _ALIVE and uid == os.getuid()}
        return alive

    def close(self) -> None:
        """Closes the socket."""
        self._socket.close()
