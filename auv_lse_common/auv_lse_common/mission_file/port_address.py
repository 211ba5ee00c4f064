"""Addresses of ports, as written in the parameters.

    /dev/ttyUSB0, serial:///dev/ttyUSB0[:BAUD]     a serial device (8N1, no flow control), or a pty
    tcp://HOST:PORT                                connects to a TCP server
    udpin://BIND:PORT                              listens on a UDP port; answers the last expected sender
    udpout://HOST:PORT                             sends to a UDP port; accepts answers from there

A path in /dev/ may contain colons (/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0): only a number of 3 to 7
digits after the last one is a baud rate.
"""

import re
from dataclasses import dataclass

from auv_lse_common.mission_file.parameters import ParameterError

_HOST_PORT = re.compile(r"(tcp|udpin|udpout)://(\[[0-9a-fA-F:]+\]|[^:/\s]+):(\d{1,5})\Z")
_SERIAL = re.compile(r"(?:serial://)?(/dev/\S+?|/(?!dev/)[^\0\n:]*[^\s:])(?::([1-9]\d{2,6}))?\Z")


class AddressError(ValueError):
    """A text that is not an address of a port; names it and what was expected."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Address:
    """Address of a port: kind ("serial", "tcp", "udpin", "udpout"), device or host, port number or baud rate."""

    kind: str
    position: str
    number: int

    def __str__(self) -> str:
        """The address in the notation of the parameters."""
        return f"{self.kind}://{self.position}:{self.number}"


def read_address(text: str, baud: int = 19200) -> Address:
    """The address that `text` describes; `baud` is the default speed of a serial device.

    Raises:
        AddressError: naming the text and the allowed forms.
    """
    match = _HOST_PORT.match(text)
    if match and 0 <= int(match[3]) <= 65535:
        return Address(kind=match[1], position=match[2].strip("[]"), number=int(match[3]))
    match = _SERIAL.match(text)
    if match:
        return Address(kind="serial", position=match[1], number=int(match[2] or baud))
    raise AddressError(
        f"{text!r} is not an address; write /dev/NAME or serial:///dev/NAME, optionally with :BAUD (3 to "
        "7 digits), tcp://HOST:PORT, udpin://BIND:PORT or udpout://HOST:PORT"
    )


def check_address(key: str, text: str) -> None:
    """Rejects a parameter that is not an address.

    Raises:
        ParameterError: naming the key.
    """
    try:
        read_address(text)
    except AddressError as error:
        raise ParameterError(f"{key}: {error}") from error
