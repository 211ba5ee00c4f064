"""MAVLink 2 on the wire, with pymavlink: bytes to messages and back; bytes that are not a message are counted.

With a key every message is signed (https://mavlink.io/en/guide/message_signing.html). Received messages without a
signature, with another key, or received before count as bad.

A codec that has just started has no record of received messages, so recorded ones could be replayed to it. It
therefore sends a nonce in a TIMESYNC request. A sender's messages count from its answer with that nonce on, which no
recording contains. Nothing has to be remembered across restarts.
"""

import hashlib
import hmac
from collections import Counter
from typing import Any

from auv_lse_common.support.missing_packages import missing

try:
    from pymavlink.dialects.v20 import common as mavlink
except ImportError as error:
    raise missing(error, "MAVLink links (vehicle_link_node, emulated autopilots)") from error

__all__ = ["SIGNING_EPOCH_S", "SIGNING_PARTS", "MavlinkCodec", "Message", "mavlink"]

#: A pymavlink message object; its type is `get_type()`, its fields are attributes.
Message = Any

#: Signatures count time from 2015-01-01 (s since 1970), in this many units per second.
SIGNING_EPOCH_S, SIGNING_PARTS = 1_420_070_400.0, 100_000
#: Sizes of a key and of a signature in bytes.
KEY_BYTES = 32
_SIGNATURE_BYTES, _SIGNATURE_BLOCK_BYTES = 6, 13
#: Positions of the number and the payload in a MAVLink 2 message, and of the requester's time, `ts1`, in TIMESYNC's.
_NUMBER, _PAYLOAD_FROM, _TS1 = slice(7, 10), 10, slice(8, 16)


#: pymavlink's words for a message without a signature, or with a wrong one.
_NO_SIGNATURE = "Invalid signature"


class _Mavlink(mavlink.MAVLink):  # type: ignore[misc]  # pymavlink has no types
    """pymavlink's class with other rules for signatures.

    A forged signature does not advance the time before which messages are refused. With a `nonce` a sender's first
    message must be the answer to it, and a new stream of a known sender must be newer than all of its messages.

    Attributes:
        nonce: The nonce; None: new streams may be a minute old, as MAVLink prescribes.
        claimed: Newest timestamps by sender of signed messages without an answer; None: they are refused.
        unproven: Number of messages by sender that were refused for lack of an answer.
    """

    nonce: int | None = None
    claimed: dict[tuple[int, int], int] | None = None
    unproven: Counter[tuple[int, int]]

    def check_signature(self, msgbuf: bytearray, srcSystem: int, srcComponent: int) -> bool:
        made = hashlib.sha256(self.signing.secret_key + bytes(msgbuf[:-_SIGNATURE_BYTES])).digest()[:_SIGNATURE_BYTES]
        if not hmac.compare_digest(made, bytes(msgbuf[-_SIGNATURE_BYTES:])):
            return False
        if self.nonce is None:
            return bool(super().check_signature(msgbuf, srcSystem, srcComponent))
        sender, link_id = (srcSystem, srcComponent), msgbuf[-_SIGNATURE_BLOCK_BYTES]
        timestamp = int.from_bytes(msgbuf[-2 * _SIGNATURE_BYTES : -_SIGNATURE_BYTES], "little")
        # the sender refuses older timestamps than the last
        self.signing.timestamp = max(self.signing.timestamp, timestamp)
        newest = self.newest(sender)
        if newest is None and not self._answers(msgbuf):
            self.unproven[sender] += 1
            return self._claims(sender, timestamp)
        known = self.signing.stream_timestamps
        if timestamp <= known.get((link_id, *sender), -1 if newest is None else newest):
            return False
        known[(link_id, *sender)] = timestamp
        return True

    def newest(self, sender: tuple[int, int]) -> int | None:
        """Newest timestamp accepted from a sender; None without one."""
        return max((t for key, t in self.signing.stream_timestamps.items() if key[1:] == sender), default=None)

    def _answers(self, msgbuf: bytearray) -> bool:
        """Whether a message is TIMESYNC with the nonce."""
        number = int.from_bytes(msgbuf[_NUMBER], "little")
        payload = bytes(msgbuf[_PAYLOAD_FROM : _PAYLOAD_FROM + msgbuf[1]])
        sent_at = payload[_TS1].ljust(8, b"\0")  # zeros at the end of a payload are not sent
        return number == mavlink.MAVLINK_MSG_ID_TIMESYNC and int.from_bytes(sent_at, "little") == self.nonce

    def _claims(self, sender: tuple[int, int], timestamp: int) -> bool:
        if self.claimed is None or timestamp <= self.claimed.get(sender, -1):
            return False
        self.claimed[sender] = timestamp
        return True


class MavlinkCodec:
    """Encodes and decodes the messages of one endpoint.

    Attributes:
        counts: "messages", "bad" (bytes that are not a message), "unsigned" (of these: messages without a signature or
            with another key's), "unknown" (messages of other dialects, which are ignored), "gaps" (messages lost, by
            the sequence numbers), "unproven" (signed messages of senders that have not answered the nonce).
        unsigned: Systems and components that have sent unsigned or unproven messages.
    """

    def __init__(self, system_id: int, component_id: int, key: bytes | None = None, nonce: int | None = None) -> None:
        """Prepares messages from the given system and component.

        Args:
            system_id: MAVLink system id.
            component_id: MAVLink component id.
            key: 32 bytes to sign with; None: messages are not signed.
            nonce: Random number, 1 to 2**63 - 1, that a sender must repeat before its messages count; None: they count
                if they are at most a minute old.

        Raises:
            ValueError: if the key has another length.
        """
        if key is not None and len(key) != KEY_BYTES:
            raise ValueError(f"key has {len(key)} bytes, not {KEY_BYTES}; make one with auv_lse key")
        self.counts: Counter[str] = Counter()
        self.unsigned: set[tuple[int, int]] = set()
        self._mav = _Mavlink(None, srcSystem=system_id, srcComponent=component_id)
        self._mav.robust_parsing = True  # bad bytes come back as BAD_DATA, not as an exception
        self._mav.signing.secret_key, self._mav.signing.sign_outgoing = key, key is not None
        self._mav.nonce, self._mav.unproven = nonce if key is not None else None, Counter()
        self._claimed: dict[tuple[int, int], int] = {}
        self._next: dict[tuple[int, int], int] = {}

    def set_time(self, now_s: float) -> None:
        """Sets the time (s since 1970) with which messages are signed; it never goes back."""
        signing = self._mav.signing
        signing.timestamp = max(signing.timestamp, int((now_s - SIGNING_EPOCH_S) * SIGNING_PARTS))

    def proven(self, sender: tuple[int, int]) -> bool:
        """Whether a system and component has answered the nonce, or need not."""
        return self._mav.nonce is None or self._mav.newest(sender) is not None

    def is_unproven(self, sender: tuple[int, int]) -> bool:
        """Whether a system and component signs with the key, but has not answered the nonce."""
        return self._mav.unproven[sender] > 0 and not self.proven(sender)

    @property
    def challenge(self) -> Message:
        """The message that senders must answer."""
        return mavlink.MAVLink_timesync_message(0, self._mav.nonce)

    def senders(self, datagram: bytes) -> set[tuple[int, int]]:
        """Systems and components whose messages in a single datagram `decode` would accept.

        Includes senders that have not answered the nonce yet, if their message is signed later than all such before it.
        """
        other = MavlinkCodec(0, 0, self._mav.signing.secret_key, self._mav.nonce)
        other._mav.signing.timestamp = self._mav.signing.timestamp
        other._mav.signing.stream_timestamps = dict(self._mav.signing.stream_timestamps)
        other._mav.claimed = self._claimed
        found = {_sender(message) for message in other.decode(datagram)}
        self.unsigned |= other.unsigned
        self.counts["unsigned"] += other.counts["unsigned"]
        self.counts["unknown"] += 0 if other.counts["bad"] else other.counts["unknown"]
        return found

    def decode(self, data: bytes) -> list[Message]:
        """The messages in `data` and earlier incomplete data; bad bytes are counted and skipped."""
        good: list[Message] = []
        for message in self._mav.parse_buffer(data) or ():
            if message.get_type() == "BAD_DATA":
                self.counts["bad"] += 1
                if message.reason == _NO_SIGNATURE:
                    self.counts["unsigned"] += 1
                    self.unsigned.add(_header(message.get_msgbuf())[0])
                continue
            if isinstance(message, mavlink.MAVLink_unknown):  # not checked, but it has a sequence number
                self.counts["unknown"] += 1
                self._count_gap(*_header(message.get_msgbuf()))
                continue
            self.counts["messages"] += 1
            self._count_gap(_sender(message), message.get_seq())
            good.append(message)
        del self._mav.buf[: self._mav.buf_index]  # pymavlink frees it only when data end with a message
        self._mav.buf_index = 0
        self.counts["unproven"] = self._mav.unproven.total()
        return good

    def _count_gap(self, sender: tuple[int, int], number: int) -> None:
        gap = (number - self._next.get(sender, number)) % 256
        self.counts["gaps"] += gap if gap < 128 else 0  # a reordered datagram is not a gap
        self._next[sender] = (number + 1) % 256

    def is_addressed(self, message: Message) -> bool:
        """Whether a message is for this system and component, or for all: a ground station gets answers, too."""
        fields = zip(("target_system", "target_component"), (self._mav.srcSystem, self._mav.srcComponent), strict=True)
        return all(getattr(message, name, 0) in (0, own) for name, own in fields)

    def encode(self, message: Message) -> bytes:
        """The message as bytes, with the next sequence number."""
        data: bytes = message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        return data


def _sender(message: Message) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def _header(data: bytes) -> tuple[tuple[int, int], int]:
    """Sender and sequence number of a message that pymavlink does not know, or refuses."""
    at = 4 if data[0] == mavlink.PROTOCOL_MARKER_V2 else 2
    return (data[at + 1], data[at + 2]), data[at]
