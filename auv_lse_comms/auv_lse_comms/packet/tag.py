"""Optional tag at a packet's end: keyed BLAKE2s over the packet, its sender, the dive and the slot (RFC 7693).

The slot is not in the packet: the receiver knows which slots its sender has. It tries the two around the packet's
arrival, and takes from each sender one packet a slot, of ever later slots. So forged, altered and replayed packets are
refused, whatever the receiver remembers; a sender that was started again is heard at once. The tag does not encrypt. It
also accepts a packet that an attacker withheld and gives out within a cycle of its slot, before a newer one arrives:
that packet is still what the sender sent.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Iterable

from auv_lse_comms.packet.codec import PacketError
from auv_lse_comms.packet.fields import PACKET_BYTES

_CONTEXT = b"auv_lse2"  # 8 bytes, the size of BLAKE2s's personalization


class Tagger:
    """Signs own packets and checks those of others; remembers the last slot that it has accepted of each sender.

    Attributes:
        size: Bytes of the tag.
        last_slot_s: Start of the slot (s) of the last packet accepted, by sender.
    """

    def __init__(self, key: bytes, size: int, session: str) -> None:
        """Takes the key, which no text of this object shows.

        Args:
            key: 16 to 32 bytes.
            size: Bytes of the tag.
            session: Name of the dive; packets of another one are refused.

        Raises:
            ValueError: if the key or the tag has a length that is not allowed.
        """
        if not 16 <= len(key) <= hashlib.blake2s.MAX_KEY_SIZE:
            raise ValueError(f"a key of {len(key)} bytes: expected 16 to {hashlib.blake2s.MAX_KEY_SIZE}")
        if not 1 <= size <= hashlib.blake2s.MAX_DIGEST_SIZE:
            raise ValueError(f"a tag of {size} bytes: expected 1 to {hashlib.blake2s.MAX_DIGEST_SIZE}")
        self.size = size
        self.last_slot_s: dict[int, float] = {}
        self._session = session.encode()
        self._key = key

    def __repr__(self) -> str:
        """Without the key."""
        return f"Tagger(size={self.size})"

    def _tag(self, source: int, slot_s: float, body: bytes) -> bytes:
        # every part but the last has a fixed length or its length before it: no two inputs hash the same bytes
        prefix = source.to_bytes(2, "little") + bytes([len(self._session)]) + self._session
        slot = round(slot_s * 1e6).to_bytes(8, "little", signed=True)
        return hashlib.blake2s(prefix + slot + body, key=self._key, digest_size=self.size, person=_CONTEXT).digest()

    def seal(self, data: bytes, source: int, slot_s: float) -> bytes:
        """The packet with the tag in its last bytes.

        Args:
            data: Packet from `encode(..., reserve=size)`.
            source: Number of the sender.
            slot_s: Start of the slot in which it is sent (s).
        """
        body = data[: PACKET_BYTES - self.size]
        return body + self._tag(source, slot_s, body)

    def check(self, data: bytes, source: int, slots_s: Iterable[float], others_s: Iterable[float] = ()) -> None:
        """Accepts a packet, once, and none of a slot before it afterwards.

        Args:
            data: Packet of 252 bytes from the water.
            source: Sender's number according to the modem.
            slots_s: Starts of the sender's slots (s) in which it may have been sent.
            others_s: Starts of others of its slots (s), only to tell an old packet from a forged one.

        Raises:
            PacketError: "length"; "replay" if a packet of this slot or a later one was accepted before; "stale" if it
                was sent in one of the other slots; "tag" if its tag is not that of these bytes from this sender.
        """
        if len(data) != PACKET_BYTES:
            raise PacketError("length", f"{len(data)} bytes: expected {PACKET_BYTES}")
        body, tag = data[: PACKET_BYTES - self.size], data[PACKET_BYTES - self.size :]
        slot_s = self._slot_of(source, body, tag, slots_s)
        if slot_s is None:
            other_s = self._slot_of(source, body, tag, others_s)
            if other_s is not None:
                raise PacketError(
                    "stale", f"vehicle {source} sent it in its slot at {other_s:.1f} s: replayed, or clocks are apart"
                )
            raise PacketError("tag", f"the tag is not that of vehicle {source}, these bytes, this dive and team's key")
        last_s = self.last_slot_s.get(source)
        if last_s is not None and slot_s <= last_s:
            raise PacketError("replay", f"slot at {slot_s:.1f} s of vehicle {source}: {last_s:.1f} s was received")
        self.last_slot_s[source] = slot_s

    def _slot_of(self, source: int, body: bytes, tag: bytes, slots_s: Iterable[float]) -> float | None:
        return next((s for s in slots_s if hmac.compare_digest(tag, self._tag(source, s, body))), None)
