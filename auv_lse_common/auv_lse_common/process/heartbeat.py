"""Signs of life of a supervised process: systemd's protocol (sd_notify, WATCHDOG=1) over a Unix socket without a file.

A process that hangs, or was stopped, looks alive from outside. So a node says once a second, from the thread that
serves its callbacks, that it still serves them. The socket's name is in Linux's abstract namespace: no disk, full or
read-only, and no network takes part. The kernel says which process a message is from.
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct
from collections.abc import Mapping

#: Environment variable with the address of the supervisor's socket; "@" stands for the abstract namespace.
SOCKET_VARIABLE = "NOTIFY_SOCKET"
#: How often (s) a process says that it lives.
BEAT_PERIOD_S = 1.0
_ALIVE = b"WATCHDOG=1"
_CREDENTIALS = struct.Struct("3i")  # pid, uid, gid


class Heartbeat:
    """A process's side: says that it lives, to the supervisor that the environment names, if it names one."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        """Says nothing yet."""
        address = environment.get(SOCKET_VARIABLE, "")
        self.wanted = bool(address)
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) if address else None

    def beat(self) -> None:
        """The process lives. A supervisor that is gone, or too busy to read, is passed over."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(_ALIVE, self._address)


class Heartbeats:
    """The supervisor's side: which processes have said that they live.

    Attributes:
        address: What the processes' environment has under `SOCKET_VARIABLE`.
    """

    def __init__(self) -> None:
        """Opens the socket under a name that the kernel chooses."""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        self._socket.bind("")  # autobind, unix(7)
        self.address = "@" + self._socket.getsockname()[1:].decode()

    def take(self) -> set[int]:
        """Ids of the processes of this user that have said that they live since the last call."""
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
