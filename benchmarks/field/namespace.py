"""Network namespaces, one for each vehicle, behind links that lose, delay and interrupt packets. Needs root."""

import contextlib
import fcntl
import json
import os
import signal
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.command import call_as_root

ROOT = Path(__file__).resolve().parents[2]
_NEEDED_BY = "--packets"
#: ioctl of a TUN device, and its flags: packets without a head.
_TUNSETIFF, _TUN, _BARE = 0x400454CA, 0x0001, 0x1000


class Namespace:
    """The computer of one vehicle, on a network of its own.

    Attributes:
        inside: The words that run a command in it.
        address: Where it listens; an address changes with `move`.
    """

    def __init__(self, number: int) -> None:
        """Makes nothing yet.

        Args:
            number: The vehicle's number, at most 99.
        """
        self._number, self.name = number, f"auv_lse_field{number}"
        self._near, self._far = f"alf{number}n", f"alf{number}f"
        self.inside = ("ip", "netns", "exec", self.name)
        self._host = 2

    @property
    def address(self) -> str:
        """Its address now."""
        return f"10.77.{self._number}.{self._host}"

    def connect(self) -> tuple[int, int]:
        """Makes its devices; returns their descriptors: the laptop's, the vehicle's.

        Raises:
            RuntimeError: if this process may not.
        """
        near, far = _tun(self._near), _tun(self._far)
        call_as_root(_NEEDED_BY, "ip", "link", "set", self._far, "netns", self.name)
        call_as_root(_NEEDED_BY, "ip", "addr", "add", f"10.77.{self._number}.1/24", "dev", self._near)
        call_as_root(_NEEDED_BY, "ip", "link", "set", self._near, "up")
        call_as_root(_NEEDED_BY, *self.inside, "ip", "link", "set", "lo", "up")
        self._add_address()
        call_as_root(_NEEDED_BY, *self.inside, "ip", "link", "set", self._far, "up")
        # slowest under loss and allowed everywhere; loss may hardly slow down the machine's default
        call_as_root(_NEEDED_BY, *self.inside, "sysctl", "-q", "-w", "net.ipv4.tcp_congestion_control=reno")
        return near, far

    def move(self) -> None:
        """Gives it another address, as a router does after a restart: open connections fall silent."""
        call_as_root(_NEEDED_BY, *self.inside, "ip", "addr", "flush", "dev", self._far)
        self._host = self._host + 1 if self._host < 250 else 2
        self._add_address()

    def kill_all(self) -> None:
        """Kills every process in it, as a power failure does: nothing is closed."""
        found = subprocess.run(["ip", "netns", "pids", self.name], capture_output=True, text=True, check=False)
        for pid in found.stdout.split():
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(pid), signal.SIGKILL)

    def remove(self) -> None:
        """Removes it, and what runs in it."""
        self.kill_all()
        call_as_root(_NEEDED_BY, "ip", "netns", "del", self.name)

    def _add_address(self) -> None:
        call_as_root(_NEEDED_BY, *self.inside, "ip", "addr", "add", f"{self.address}/24", "dev", self._far)


class Radio:
    """The links to all vehicles."""

    def __init__(self, process: subprocess.Popen[bytes], count: int) -> None:
        """Controls a running process of `benchmarks/field/air.py`."""
        self._process, self._count = process, count

    def set(self, link: int | None = None, **values: float | bool) -> None:
        """Changes a link, or all: loss (0 to 1), delay_s (one way), up."""
        assert self._process.stdin is not None
        for k in range(self._count) if link is None else (link,):
            self._process.stdin.write(json.dumps({"link": k, **values}).encode() + b"\n")
        self._process.stdin.flush()


@contextlib.contextmanager
def namespaces(count: int, seed: int) -> Iterator[tuple[Radio, list[Namespace]]]:
    """A context with the namespaces of vehicles, and the links to them, which pass everything at first.

    Raises:
        RuntimeError: if this process may not make them.
    """
    made = [Namespace(number) for number in range(1, count + 1)]
    with contextlib.ExitStack() as stack:
        descriptors: list[int] = []
        for own in made:
            call_as_root(_NEEDED_BY, "ip", "netns", "add", own.name)
            stack.callback(own.remove)
            descriptors += own.connect()
        command = [sys.executable, "-m", "benchmarks.field.air", str(seed), *map(str, descriptors)]
        process = subprocess.Popen(command, stdin=subprocess.PIPE, cwd=ROOT, pass_fds=descriptors)
        for descriptor in descriptors:
            os.close(descriptor)
        try:
            yield Radio(process, count), made
        finally:
            assert process.stdin is not None
            process.stdin.close()
            process.wait(5.0)


def _tun(name: str) -> int:
    """A new TUN device's descriptor."""
    try:
        descriptor = os.open("/dev/net/tun", os.O_RDWR)
        fcntl.ioctl(descriptor, _TUNSETIFF, struct.pack("16sH", name.encode(), _TUN | _BARE))
    except OSError as error:
        raise RuntimeError(f"{_NEEDED_BY} needs root and TUN devices: /dev/net/tun: {error.strerror}") from error
    return descriptor
