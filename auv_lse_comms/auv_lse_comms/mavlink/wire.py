"""MAVLink 2 on the wire, by pymavlink: bytes to messages and back, with everything that was no message counted."""

from __future__ import annotations

from collections import Counter
from typing import Any

from auv_lse_common.missing import missing

try:
    from pymavlink.dialects.v20 import common as mavlink
except ImportError as error:
    raise missing(error, "MAVLink links (vehicle_link_node, emulated autopilots)") from error

__all__ = ["MavlinkCodec", "Message", "mavlink"]

#: A pymavlink message object; its type is `get_type()`, its fields are attributes.
Message = Any


class MavlinkCodec:
    """One endpoint's reading and writing.

    Attributes:
        counts: "messages", "bad" (bytes that were no message), "gaps" (messages lost, by the sequence numbers).
    """

    def __init__(self, system_id: int, component_id: int) -> None:
        """Writes as `system_id`, `component_id`."""
        self.counts: Counter[str] = Counter()
        self._mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._mav.robust_parsing = True  # bad bytes come back as BAD_DATA, not as an exception
        self._next: dict[tuple[int, int], int] = {}

    def decode(self, data: bytes) -> list[Message]:
        """The messages in `data`, with what was left over from before; bad bytes are counted and left out."""
        good: list[Message] = []
        for message in self._mav.parse_buffer(data) or ():
            if message.get_type() == "BAD_DATA":
                self.counts["bad"] += 1
                continue
            self.counts["messages"] += 1
            sender = (message.get_srcSystem(), message.get_srcComponent())
            gap = (message.get_seq() - self._next.get(sender, message.get_seq())) % 256
            self.counts["gaps"] += gap if gap < 128 else 0  # a datagram out of order is no gap
            self._next[sender] = (message.get_seq() + 1) % 256
            good.append(message)
        return good

    def encode(self, message: Message) -> bytes:
        """The message as bytes, with the next sequence number."""
        data: bytes = message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        return data
