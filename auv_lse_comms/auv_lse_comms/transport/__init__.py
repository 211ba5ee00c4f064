"""Ports for bytes: serial, TCP, UDP. They are opened by address, and reopened whenever they fail.

Reads never block. Every failure becomes a `TransportError` that names the port; `Connection` then closes the port,
waits (longer after each failure, up to a limit) and opens it again.
"""

from auv_lse_common.mission_file.port_address import Address, AddressError, read_address
from auv_lse_comms.transport.connection import Connection
from auv_lse_comms.transport.ports import SerialPort, TcpPort, Transport, TransportError, UdpPort, open_transport
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
