"""Acoustic communication of a team: the 252-byte packet, time slots, and the bridge between a vehicle and its modem.

The names below are the library's interface; docs/reference/python/packet.md uses no others. Two subpackages are
independent of the rest: `micromodem` drives a WHOI Micromodem-2, `transport` opens ports.
"""

from typing import TYPE_CHECKING

from auv_lse_common.support.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
    from auv_lse_comms.bridge import ModemBridge, Received
    from auv_lse_comms.packet.codec import REASONS, Limits, Packet, PacketError, decode, encode
    from auv_lse_comms.packet.fields import PACKET_BYTES, capacity
    from auv_lse_comms.packet.key import KeyFileError, read_key
    from auv_lse_comms.packet.tag import Tagger
    from auv_lse_comms.settings import bridge_of
    from auv_lse_comms.tdma import Slot, Tdma

__all__ = [
    "PACKET_BYTES",
    "REASONS",
    "KeyFileError",
    "Limits",
    "ModemBridge",
    "Packet",
    "PacketConfig",
    "PacketError",
    "Received",
    "Slot",
    "Tagger",
    "Tdma",
    "TdmaConfig",
    "bridge_of",
    "capacity",
    "decode",
    "encode",
    "read_key",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "bridge": ("ModemBridge", "Received"),
        "auv_lse_common.mission_file.sections.acoustics": ("PacketConfig", "TdmaConfig"),
        "packet.codec": ("REASONS", "Limits", "Packet", "PacketError", "decode", "encode"),
        "packet.fields": ("PACKET_BYTES", "capacity"),
        "packet.key": ("KeyFileError", "read_key"),
        "packet.tag": ("Tagger",),
        "settings": ("bridge_of",),
        "tdma": ("Slot", "Tdma"),
    },
)
