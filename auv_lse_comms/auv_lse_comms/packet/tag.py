"""Optional tag at a packet's end: keyed BLAKE2s over the packet, its sender, the dive and the slot (RFC 7693).

The slot is not in the packet: the receiver knows its sender's slots. It tries the two around the packet's arrival, and
accepts from each sender one packet per slot, only from later slots than before. So forged, altered and replayed packets
are refused, even after a restart of the receiver; a restarted sender is accepted at once. The tag does not encrypt. A
packet that an attacker withholds and sends within a cycle of its slot, before a newer one arrives, is still accepted:
its content is unchanged.

A clock that is set back makes slots come again. From then on a vehicle's packets are in a new *era*: eight bytes before
the tag hold the era, its number and two random bytes, and an *echo*, the first bytes of the last tag that the vehicle
has received from one of its mates, in turn. A receiver accepts a later era than the last one of its sender, so that a
link that works in one direction only needs no answer, and any other era, as of a sender that lost its state, with the
echo of one of its own last packets, which no packet recorded earlier contains. From then on it accepts that era only,
in the order of slots. A vehicle that hears a mate in an era, or misses an echo, also begins an era, so that the mate
receives echoes.
"""

import hashlib
import hmac
import math
import secrets
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NoReturn

from auv_lse_comms.packet.codec import PacketError
from auv_lse_comms.packet.fields import PACKET_BYTES

#: 8 bytes, the size of BLAKE2s's personalization: of packets without an era, and with one.
_CONTEXT, _ERA_CONTEXT = b"auv_lse2", b"auv_lse3"
#: Bytes of an era, of these its number, and of an echo.
ERA_BYTES, NUMBER_BYTES, ECHO_BYTES = 4, 2, 4
#: Bytes that an era takes at a packet's end, before the tag.
TRAILER_BYTES = ERA_BYTES + ECHO_BYTES
#: Number of own packets whose echo is fresh.
_FRESH = 8


class Tagger:
    """Signs own packets and checks those of others; remembers the last slot accepted from each sender.

    Attributes:
        size: Size of the tag in bytes.
        last_slot_s: Start of the slot (s) of the last packet accepted, by sender.
        eras: Era of that packet, by sender; b"" or missing: none.
        era: Era of own packets; b"": none.
        sealed_s: Start of the slot (s) of the last own packet.
        began: Called with each new `era`.
    """

    def __init__(self, key: bytes, size: int, session: str, draw: Callable[[int], bytes] = secrets.token_bytes) -> None:
        """Signs with a key, which the object's `repr` does not reveal.

        Args:
            key: 16 to 32 bytes.
            size: Size of the tag in bytes.
            session: Name of the dive; packets of other dives are refused.
            draw: Draws that many random bytes for an era.

        Raises:
            ValueError: if the length of the key or the tag is not allowed.
        """
        if not 16 <= len(key) <= hashlib.blake2s.MAX_KEY_SIZE:
            raise ValueError(f"key has {len(key)} bytes; use 16 to {hashlib.blake2s.MAX_KEY_SIZE}")
        if not ECHO_BYTES <= size <= hashlib.blake2s.MAX_DIGEST_SIZE:
            raise ValueError(f"tag has {size} bytes; use {ECHO_BYTES} to {hashlib.blake2s.MAX_DIGEST_SIZE}")
        self.size = size
        self.last_slot_s: dict[int, float] = {}
        self.eras: dict[int, bytes] = {}
        self.era = b""
        self.sealed_s = -math.inf
        self.began: Callable[[bytes], None] = lambda era: None
        self._session = session.encode()
        self._key = key
        self._draw = draw
        self._own_tags: deque[bytes] = deque(maxlen=_FRESH)
        self._to_echo: dict[int, bytes] = {}  # by sender, the one whose turn it is first

    def __repr__(self) -> str:
        """Without the key."""
        return f"Tagger(size={self.size})"

    @property
    def reserve(self) -> int:
        """Bytes at the end of own packets: the tag, and the era if there is one."""
        return self.size + (TRAILER_BYTES if self.era else 0)

    def _tag(self, source: int, slot_s: float, body: bytes, context: bytes) -> bytes:
        # every part but the last has a fixed length or a length prefix, so different inputs hash different bytes
        prefix = source.to_bytes(2, "little") + bytes([len(self._session)]) + self._session
        slot = round(slot_s * 1e6).to_bytes(8, "little", signed=True)
        return hashlib.blake2s(prefix + slot + body, key=self._key, digest_size=self.size, person=context).digest()

    def begin_era(self, anew: bool = False) -> None:
        """Begins an era of own packets; `anew`: also if there is one."""
        if anew or not self.era:
            number = min(_number(self.era) + 1, 256**NUMBER_BYTES - 1)
            self.era = number.to_bytes(NUMBER_BYTES, "big") + self._draw(ERA_BYTES - NUMBER_BYTES)
            self._own_tags.clear()
            self.began(self.era)

    def snapshot(self) -> dict[str, Any]:
        """The era, the last own slot, and the last slot and era accepted from each sender, as JSON values."""
        accepted = [[source, slot_s, self.eras.get(source, b"").hex()] for source, slot_s in self.last_slot_s.items()]
        return {"era": self.era.hex(), "sealed_s": self.sealed_s, "accepted": sorted(accepted)}

    def restore(self, values: Mapping[str, Any]) -> None:
        """Continues from a `snapshot`."""
        self.era, self.sealed_s = bytes.fromhex(values["era"]), values["sealed_s"]
        for source, slot_s, era in values["accepted"]:
            self.last_slot_s[source], self.eras[source] = slot_s, bytes.fromhex(era)

    def enter(self, slot_s: float) -> None:
        """Begins a new era if the clock was set back to before the last own packet; call it before `seal`.

        Args:
            slot_s: Start of the slot in which the next packet is sent (s).
        """
        if slot_s < self.sealed_s:
            self.begin_era(anew=True)

    def seal(self, data: bytes, source: int, slot_s: float) -> bytes:
        """The packet with the era, if there is one, and the tag in its last bytes.

        Args:
            data: Packet from `encode(..., reserve=self.reserve)`.
            slot_s: Start of the slot in which it is sent (s).
        """
        self.sealed_s = slot_s
        body = data[: PACKET_BYTES - self.reserve]
        if self.era:
            mate = next(iter(self._to_echo), None)
            body += self.era + (bytes(ECHO_BYTES) if mate is None else self._to_echo.pop(mate))
        tag = self._tag(source, slot_s, body, _ERA_CONTEXT if self.era else _CONTEXT)
        self._own_tags.append(tag[:ECHO_BYTES])
        return body + tag

    def accept(self, data: bytes, source: int, slots_s: Iterable[float], others_s: Iterable[float] = ()) -> int:
        """Accepts a packet once; from then on packets of its slot and earlier ones are refused.

        Args:
            data: Packet of 252 bytes from the water.
            source: Sender's number according to the modem.
            slots_s: Starts of the sender's slots (s) in which it may have been sent.
            others_s: Starts of other slots (s) of the sender, only to tell an old packet from a forged one.

        Returns:
            Bytes at its end that are not part of its content.

        Raises:
            PacketError: "length"; "replay" if a packet of this slot or a later one was accepted before; "unproven" if a
                clock was set back and it has neither a later era nor a fresh echo; "stale" if it was sent in one of the
                other slots; "tag" if its tag is not that of these bytes from this sender.
        """
        if len(data) != PACKET_BYTES:
            raise PacketError("length", f"{len(data)} bytes instead of {PACKET_BYTES}")
        body, tag = data[: PACKET_BYTES - self.size], data[PACKET_BYTES - self.size :]
        slots_s = list(slots_s)
        found = self._slot_of(source, body, tag, slots_s)
        if found is None:
            self._refuse(source, body, tag, slots_s, others_s)
        slot_s, has_era = found
        era, echo = (body[-TRAILER_BYTES:-ECHO_BYTES], body[-ECHO_BYTES:]) if has_era else (b"", b"")
        self._to_echo[source] = tag[:ECHO_BYTES]
        if era:
            self.begin_era()
        last_s = self.last_slot_s.get(source)
        if last_s is not None:
            self._check_order(source, slot_s, max(slots_s), era, echo in self._own_tags)
        self.last_slot_s[source], self.eras[source] = slot_s, era
        return self.size + (TRAILER_BYTES if era else 0)

    def _check_order(self, source: int, slot_s: float, latest_s: float, era: bytes, proven: bool) -> None:
        """Refuses a packet that may have been recorded earlier; `latest_s`: the sender's latest slot by now."""
        last_s = self.last_slot_s[source]
        if era == self.eras.get(source, b""):
            if slot_s > last_s:
                return
            if last_s <= latest_s:
                raise PacketError(
                    "replay", f"slot at {slot_s:.1f} s of vehicle {source}: the last accepted one is at {last_s:.1f} s"
                )
            why = f"this vehicle's clock was set back by about {last_s - slot_s:.0f} s"
        elif proven or _number(era) > _number(self.eras.get(source, b"")):
            return
        else:
            why = f"the clock of vehicle {source} was set back, or it has lost its state"
        self.begin_era()
        raise PacketError("unproven", f"{why}: no echo of this vehicle's last packets", last_s - slot_s)

    def _refuse(
        self, source: int, body: bytes, tag: bytes, slots_s: Iterable[float], others_s: Iterable[float]
    ) -> NoReturn:
        """Refuses a packet that belongs to none of the slots."""
        other = self._slot_of(source, body, tag, others_s)
        if other is None:
            raise PacketError("tag", f"the tag does not match vehicle {source}, these bytes, this dive and this key")
        off_s = other[0] - min(slots_s, default=math.nan)  # the first of them has begun when the packet arrives
        raise PacketError(
            "stale", f"vehicle {source} sent it in its slot at {other[0]:.1f} s: replayed, or clocks differ", off_s
        )

    def _slot_of(self, source: int, body: bytes, tag: bytes, slots_s: Iterable[float]) -> tuple[float, bool] | None:
        """The slot of a packet, and whether it has an era; None if its tag is that of no slot."""
        for slot_s in slots_s:
            for context in (_CONTEXT, _ERA_CONTEXT):
                if hmac.compare_digest(tag, self._tag(source, slot_s, body, context)):
                    return slot_s, context is _ERA_CONTEXT
        return None


def _number(era: bytes) -> int:
    """The number of an era; 0: before the first one."""
    return int.from_bytes(era[:NUMBER_BYTES], "big")
