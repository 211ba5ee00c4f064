"""The sockets that processes have open, from the kernel's tables: who could be reached from another machine?"""

import ipaddress
import os
import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

_LISTEN = "0A"
_SOCKET = re.compile(r"socket:\[(\d+)\]")


@dataclass(frozen=True, slots=True)
class OpenSocket:
    """A socket on which something can arrive: protocol, local address and port, and the process that has it."""

    protocol: str
    address: str
    port: int
    pid: int

    @property
    def local(self) -> bool:
        """Whether only this machine can reach it."""
        return ipaddress.ip_address(self.address).is_loopback


def family_of(pid: int) -> list[int]:
    """A process and all its descendants."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue  # it has ended
            children.setdefault(int(fields[1]), []).append(int(entry.name))
    family = [pid]
    for member in family:
        family += children.get(member, [])
    return family


def open_sockets(pids: Iterable[int]) -> list[OpenSocket]:
    """TCP sockets that listen, and UDP sockets that are bound and not connected, of some processes (Linux)."""
    owners: dict[int, int] = {}
    for pid in pids:
        try:
            for link in Path(f"/proc/{pid}/fd").iterdir():
                if match := _SOCKET.match(os.readlink(link)):
                    owners[int(match[1])] = pid
        except OSError:
            continue  # it has ended
    found = []
    for protocol in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/net/{protocol}").read_text().splitlines()[1:]:
            fields = line.split()
            inode, state = int(fields[9]), fields[3]
            reachable = state == _LISTEN if protocol.startswith("tcp") else state == "07"
            if inode in owners and reachable:
                address, _, port = fields[1].partition(":")
                found.append(OpenSocket(protocol, _address(address), int(port, 16), owners[inode]))
    return found


def _address(text: str) -> str:
    words = [struct.pack("=I", int(text[i : i + 8], 16)) for i in range(0, len(text), 8)]
    return str(ipaddress.ip_address(b"".join(words)))
