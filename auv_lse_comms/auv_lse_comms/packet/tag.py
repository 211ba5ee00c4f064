"""Optional tag at a packet's end: keyed BLAKE2s over the packet, its sender, the dive and the slot (RFC 7693).

The slot is not in the packet: the receiver knows its sender's slots. It tries the two around the packet's arrival, and
accepts from each sender one packet per slot, only from later slots than before. So forged, altered and replayed packets
are refused, even after a restart of the receiver; a restarted sender is accepted at once. The tag does not encrypt. A
packet that an attacker withholds and sends within a cycle of its slot, before a newer one arrives, is still accepted:
its content is unchanged.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Iterable

from auv_lse_comms.packet.codec import PacketError
from auv_lse_comms.packet.fields import PACKET_BYTES

_CONTEXT = b"auv_lse2"  # 8 bytes, the size of BLAKE2s's personalization


class Tagger:
    """Signs own packets and checks those of others; remembers the last slot accepted from each sender.

    Attributes:
        size: Size of the tag in bytes.
        last_slot_s: Start of the slot (s) of the last packet accepted, by sender.
    """

    def __init__(self, key: bytes, size: int, session: str) -> None:
        """Takes the key, which no text of this object reveals.

        Args:
            key: 16 to 32 bytes.
            size: Size of the tag in bytes.
            session: Name of the dive; packets of other dives are refused.

        Raises:
            ValueError: if the length of the key or the tag is not allowed.
        """
        if not 16 <= len(key) <= hashlib.blake2s.MAX_KEY_SIZE:
            raise ValueError(f"key: got {len(key)} bytes; expected 16 to {hashlib.blake2s.MAX_KEY_SIZE}")
        if not 1 <= size <= hashlib.blake2s.MAX_DIGEST_SIZE:
            raise ValueError(f"tag: got {size} bytes; expected 1 to {hashlib.blake2s.MAX_DIGEST_SIZE}")
        self.size = size
        self.last_slot_s: dict[int, float] = {}
        self._session = session.encode()
        self._key = key

    def __repr__(self) -> str:
        """Without the key."""
        return f"Tagger(size={self.size})"

    def _tag(self, source: int, slot_s: float, body: bytes) -> bytes:
        # every part but the last has a fixed length or a length prefix, so different inputs hash different bytes
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

    def accept(self, data: bytes, source: int, slots_s: Iterable[float], others_s: Iterable[float] = ()) -> None:
        """Accepts a packet once; from then on packets of its slot and earlier ones are refused.

        Args:
            data: Packet of 252 bytes from the water.
            source: Sender's number according to the modem.
            slots_s: Starts of the sender's slots (s) in which it may have been sent.
            others_s: Starts of other slots (s) of the sender, only to tell an old packet from a forged one.

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
                    "stale", f"vehicle {source} sent it in its slot at {other_s:.1f} s: replayed, or clocks differ"
                )
            raise PacketError("tag", f"the tag does not match vehicle {source}, these bytes, this dive and this key")
        last_s = self.last_slot_s.get(source)
        if last_s is not None and slot_s <= last_s:
            raise PacketError(
                "replay", f"slot at {slot_s:.1f} s of vehicle {source}: the last accepted one is at {last_s:.1f} s"
            )
        self.last_slot_s[source] = slot_s

    def _slot_of(self, source: int, body: bytes, tag: bytes, slots_s: Iterable[float]) -> float | None:
        return next((s for s in slots_s if hmac.compare_digest(tag, self._tag(source, s, body))), None)
