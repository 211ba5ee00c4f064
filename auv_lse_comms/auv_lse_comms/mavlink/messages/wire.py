"""MAVLink 2 on the wire, by pymavlink: bytes to messages and back, with everything that was no message counted.

With a key every message is signed (https://mavlink.io/en/guide/message_signing.html), and one that is not, or not by
that key, or that came before, counts as bad.
"""

from __future__ import annotations

import hashlib
import hmac
from collections import Counter
from typing import Any

from auv_lse_common.support.missing_packages import missing

try:
    from pymavlink.dialects.v20 import common as mavlink
except ImportError as error:
    raise missing(error, "MAVLink links (vehicle_link_node, emulated autopilots)") from error

__all__ = ["MavlinkCodec", "Message", "mavlink"]

#: A pymavlink message object; its type is `get_type()`, its fields are attributes.
Message = Any


#: Signatures count time from 2015-01-01 (s since 1970), in so many parts of a second.
_SIGNING_EPOCH_S, _SIGNING_PARTS = 1_420_070_400.0, 100_000
#: Bytes of a key, and of a signature.
KEY_BYTES = 32
_SIGNATURE_BYTES = 6


class _Mavlink(mavlink.MAVLink):  # type: ignore[misc]  # pymavlink has no types
    """pymavlink's, but a forged signature does not move the time from which on messages are believed."""

    def check_signature(self, msgbuf: bytearray, srcSystem: int, srcComponent: int) -> bool:
        made = hashlib.sha256(self.signing.secret_key + bytes(msgbuf[:-_SIGNATURE_BYTES])).digest()[:_SIGNATURE_BYTES]
        if not hmac.compare_digest(made, bytes(msgbuf[-_SIGNATURE_BYTES:])):
            return False
        return bool(super().check_signature(msgbuf, srcSystem, srcComponent))


class MavlinkCodec:
    """One endpoint's reading and writing.

    Attributes:
        counts: "messages", "bad" (bytes that were no message), "gaps" (messages lost, by the sequence numbers).
    """

    def __init__(self, system_id: int, component_id: int, key: bytes | None = None) -> None:
        """Writes as `system_id`, `component_id`.

        Args:
            system_id: MAVLink system id.
            component_id: MAVLink component id.
            key: Key of 32 bytes with which messages are signed; None: they are not.

        Raises:
            ValueError: if the key has another length.
        """
        if key is not None and len(key) != KEY_BYTES:
            raise ValueError(f"a key of {len(key)} bytes; expected {KEY_BYTES}, as scripts/key makes")
        self.counts: Counter[str] = Counter()
        self._mav = _Mavlink(None, srcSystem=system_id, srcComponent=component_id)
        self._mav.robust_parsing = True  # bad bytes come back as BAD_DATA, not as an exception
        self._mav.signing.secret_key, self._mav.signing.sign_outgoing = key, key is not None
        self._next: dict[tuple[int, int], int] = {}

    def set_time(self, now_s: float) -> None:
        """The time (s since 1970) with which messages are signed; it never goes back."""
        signing = self._mav.signing
        signing.timestamp = max(signing.timestamp, int((now_s - _SIGNING_EPOCH_S) * _SIGNING_PARTS))

    def would_decode(self, datagram: bytes) -> list[Message]:
        """The messages in a datagram on its own, without taking them: what `decode` would believe."""
        other = MavlinkCodec(0, 0, self._mav.signing.secret_key)
        other._mav.signing.timestamp = self._mav.signing.timestamp
        other._mav.signing.stream_timestamps = dict(self._mav.signing.stream_timestamps)
        return other.decode(datagram)

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
