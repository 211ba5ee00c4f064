"""Packet rates of the WHOI Micromodem-2: capacity and duration of a packet."""

from typing import NamedTuple

#: Destination address of a broadcast packet.
BROADCAST = 0


class PacketRate(NamedTuple):
    """A packet rate of the Micromodem.

    Attributes:
        frames: Largest number of frames in one packet.
        bit_rate: Nominal bits per second.
    """

    frames: int
    frame_bytes: int
    bit_rate: float


#: Packet rates by number (Micromodem-2 User's Guide; docs/reference/hardware.md).
RATES = {
    0: PacketRate(1, 32, 80.0),
    1: PacketRate(3, 64, 250.0),
    2: PacketRate(3, 64, 500.0),
    3: PacketRate(2, 256, 1200.0),
    4: PacketRate(2, 256, 1300.0),
    5: PacketRate(8, 256, 5300.0),
}

#: Time (s) of a packet besides its data: probe, header and equalizer training. With it a 252-byte packet at rate 4
#: takes 2.00 s, which agrees with "about 2 s" in the field.
PACKET_OVERHEAD_S = 0.45

#: Time (s) of a mini-packet, 13 bits and a checksum at 80 bit/s.
MINI_PACKET_S = 0.9


def packet_duration_s(rate: int, count: int) -> float:
    """Nominal duration (s) on the water of a packet of `count` bytes at packet rate number `rate`."""
    return PACKET_OVERHEAD_S + 8.0 * count / RATES[rate].bit_rate
