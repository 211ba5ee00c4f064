"""MAVLink 2 on the wire, with pymavlink: bytes to messages and back; bytes that are not a message are counted.

With a key every message is signed (https://mavlink.io/en/guide/message_signing.html). Received messages without a
signature, with another key, or received before count as bad.
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

#: Signatures count time from 2015-01-01 (s since 1970), in this many units per second.
_SIGNING_EPOCH_S, _SIGNING_PARTS = 1_420_070_400.0, 100_000
#: Sizes of a key and of a signature in bytes.
KEY_BYTES = 32
_SIGNATURE_BYTES = 6


class _Mavlink(mavlink.MAVLink):  # type: ignore[misc]  # pymavlink has no types
    """pymavlink's, except that a forged signature does not advance the time before which messages are refused."""

    def check_signature(self, msgbuf: bytearray, srcSystem: int, srcComponent: int) -> bool:
        made = hashlib.sha256(self.signing.secret_key + bytes(msgbuf[:-_SIGNATURE_BYTES])).digest()[:_SIGNATURE_BYTES]
        if not hmac.compare_digest(made, bytes(msgbuf[-_SIGNATURE_BYTES:])):
            return False
        return bool(super().check_signature(msgbuf, srcSystem, srcComponent))


class MavlinkCodec:
    """Encodes and decodes the messages of one endpoint.

    Attributes:
        counts: "messages", "bad" (bytes that are not a message), "gaps" (messages lost, by the sequence numbers).
    """

    def __init__(self, system_id: int, component_id: int, key: bytes | None = None) -> None:
        """Writes as `system_id`, `component_id`; signs messages with the 32 bytes of `key`, if there is one.

        Raises:
            ValueError: if the key has another length.
        """
        if key is not None and len(key) != KEY_BYTES:
            raise ValueError(f"key: got {len(key)} bytes; expected {KEY_BYTES}, as made by scripts/key")
        self.counts: Counter[str] = Counter()
        self._mav = _Mavlink(None, srcSystem=system_id, srcComponent=component_id)
        self._mav.robust_parsing = True  # bad bytes come back as BAD_DATA, not as an exception
        self._mav.signing.secret_key, self._mav.signing.sign_outgoing = key, key is not None
        self._next: dict[tuple[int, int], int] = {}

    def set_time(self, now_s: float) -> None:
        """Sets the time (s since 1970) with which messages are signed; it never goes back."""
        signing = self._mav.signing
        signing.timestamp = max(signing.timestamp, int((now_s - _SIGNING_EPOCH_S) * _SIGNING_PARTS))

    def would_decode(self, datagram: bytes) -> list[Message]:
        """The messages that `decode` would accept from a single datagram; the codec's state does not change."""
        other = MavlinkCodec(0, 0, self._mav.signing.secret_key)
        other._mav.signing.timestamp = self._mav.signing.timestamp
        other._mav.signing.stream_timestamps = dict(self._mav.signing.stream_timestamps)
        return other.decode(datagram)

    def decode(self, data: bytes) -> list[Message]:
        """The messages in `data` and earlier incomplete data; bad bytes are counted and skipped."""
        good: list[Message] = []
        for message in self._mav.parse_buffer(data) or ():
            if message.get_type() == "BAD_DATA":
                self.counts["bad"] += 1
                continue
            self.counts["messages"] += 1
            sender = (message.get_srcSystem(), message.get_srcComponent())
            gap = (message.get_seq() - self._next.get(sender, message.get_seq())) % 256
            self.counts["gaps"] += gap if gap < 128 else 0  # a reordered datagram is not a gap
            self._next[sender] = (message.get_seq() + 1) % 256
            good.append(message)
        del self._mav.buf[: self._mav.buf_index]  # pymavlink frees it only when data end with a message
        self._mav.buf_index = 0
        return good

    def encode(self, message: Message) -> bytes:
        """The message as bytes, with the next sequence number."""
        data: bytes = message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        return data
