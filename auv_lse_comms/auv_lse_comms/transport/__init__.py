"""Ports that carry bytes: serial, TCP, UDP. Opened by address, and opened again whenever they fail.

Nothing here knows what the bytes mean. Reads never wait. Every failure becomes a `TransportError` that names the port,
so that `Connection` can close it, wait (longer after each failure, up to a limit) and open it again.
"""

from auv_lse_comms.transport.address import Address, AddressError, read_address
from auv_lse_comms.transport.connection import Connection
from auv_lse_comms.transport.ports import (
    SerialPort,
    TcpPort,
    Transport,
    TransportError,
    UdpPort,
    open_transport,
)
from auv_lse_comms.transport.watcher import PortWatcher, Readable

__all__ = [
    "Address",
    "AddressError",
    "Connection",
    "PortWatcher",
    "Readable",
    "SerialPort",
    "TcpPort",
    "Transport",
    "TransportError",
    "UdpPort",
    "open_transport",
    "read_address",
]
