"""The tag: what was forged, altered, replayed or kept back is refused."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_comms.packet.codec import Packet, PacketError, encode
from auv_lse_comms.packet.tag import Tagger

KEY = bytes(range(32))


def packet(step: int = 7, east_m: float = 0.0) -> bytes:
    return encode(
        Packet(
            Plan(step=step, heading_rad=0.1, north_m=1.0, east_m=east_m, actions=(1, 2, 3), naive_path=NONE),
            np.ones((19, 3)),
        ),
        reserve=6,
    )


def tagger(key: bytes = KEY, session: str = "lake 1") -> Tagger:
    return Tagger(key, 6, session)


def reason(receiver: Tagger, data: bytes, source: int, *slots_s: float, others_s: tuple[float, ...] = ()) -> str:
    with pytest.raises(PacketError) as caught:
        receiver.accept(data, source, slots_s or (30.0,), others_s)
    return caught.value.reason


def test_tag_is_blake2s_over_sender_dive_slot_and_packet() -> None:
    data = packet()
    sealed = tagger().seal(data, 2, 30.5)
    assert sealed[:246] == data[:246]
    slot = bytes([0xA0, 0x64, 0xD1, 0x01, 0, 0, 0, 0])  # 30,500,000 us
    by_hand = hashlib.blake2s(
        b"\x02\x00" + b"\x06" + b"lake 1" + slot + data[:246], key=KEY, digest_size=6, person=b"auv_lse2"
    ).digest()
    assert sealed[246:] == by_hand


def test_one_packet_of_each_slot_is_accepted_whatever_its_step() -> None:
    sender, receiver = tagger(), tagger()
    for cycle, step in enumerate((0, 1, 5, 0)):  # the last one: the sender was started again
        slot_s = 30.0 * cycle
        sealed = sender.seal(packet(step), 2, slot_s)
        receiver.accept(sealed, 2, (slot_s, slot_s + 30.0))
        assert reason(receiver, sealed, 2, slot_s, slot_s + 30.0) == "replay"
    second = sender.seal(packet(9), 2, 90.0)
    assert reason(receiver, second, 2, 90.0) == "replay"
    assert reason(receiver, sender.seal(packet(9), 2, 60.0), 2, 60.0, 90.0) == "replay"  # kept back, then given out


def test_a_packet_of_another_slot_is_stale() -> None:
    sealed = tagger().seal(packet(), 2, 30.0)
    assert reason(tagger(), sealed, 2, 60.0, 90.0, others_s=(0.0, 30.0)) == "stale"
    assert reason(tagger(), sealed, 2, 60.0, 90.0) == "tag"


def test_any_altered_bit_is_detected() -> None:
    sealed = tagger().seal(packet(), 2, 30.0)
    receiver = tagger()
    for bit in range(252 * 8):
        altered = bytearray(sealed)
        altered[bit // 8] ^= 1 << (bit % 8)
        assert reason(receiver, bytes(altered), 2) == "tag"
    receiver.accept(sealed, 2, (30.0,))  # none of them was remembered


def test_forged_packets_are_refused() -> None:
    sealed = tagger().seal(packet(), 2, 30.0)
    assert reason(tagger(bytes(32)), sealed, 2) == "tag"  # another key
    assert reason(tagger(), sealed, 3) == "tag"  # said to come from another sender
    assert reason(tagger(session="tomorrow"), sealed, 2) == "tag"  # another dive
    assert reason(tagger(), packet(), 2) == "tag"  # no tag at all
    assert reason(tagger(), sealed[:-1], 2) == "length"
    receiver = tagger()
    receiver.accept(sealed, 2, (30.0,))
    receiver.accept(tagger().seal(packet(0), 3, 10.0), 3, (10.0,))  # senders do not mix


def test_key_is_in_no_message() -> None:
    assert KEY.hex() not in repr(tagger())
    assert repr(tagger()) == "Tagger(size=6)"
    with pytest.raises(ValueError, match="key: got 5 bytes"):
        Tagger(b"12345", 6, "a")
    with pytest.raises(ValueError, match="tag: got 0 bytes"):
        Tagger(KEY, 0, "a")
