"""The tag: what was forged, altered, replayed or kept back is refused."""

from __future__ import annotations

import contextlib
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
    with pytest.raises(ValueError, match="key has 5 bytes"):
        Tagger(b"12345", 6, "a")
    with pytest.raises(ValueError, match="tag has 0 bytes"):
        Tagger(KEY, 0, "a")


class Pair:
    """Two vehicles with clocks of their own, which hear each other in each cycle of 20 s, until a clock is set back."""

    def __init__(self) -> None:
        draws = iter(range(1, 100))
        self.made = {k: Tagger(KEY, 6, "lake 1", lambda size: bytes([next(draws)] * size)) for k in (1, 2)}
        self.recorded: list[tuple[int, bytes, float]] = []

    def send(self, source: int, slot_s: float) -> bytes:
        sender = self.made[source]
        sender.enter(slot_s)
        data = encode(Packet(Plan.at(3, np.zeros(3), (), NONE)), reserve=sender.reserve)
        sealed = sender.seal(data, source, slot_s)
        self.recorded.append((source, sealed, slot_s))
        return sealed

    def hears(self, receiver: int, source: int, sealed: bytes, slot_s: float) -> bool:
        with contextlib.suppress(PacketError):
            self.made[receiver].accept(sealed, source, (slot_s - 20.0, slot_s))
            return True
        return False

    def cycle(self, start_s: float) -> list[bool]:
        """One packet of each; which were accepted."""
        return [self.hears(3 - k, k, self.send(k, start_s + 10.0 * k), start_s + 10.0 * k) for k in (1, 2)]


def test_clocks_that_are_set_back_agree_again_at_once() -> None:
    pair = Pair()
    assert all(pair.cycle(3600.0 + 20.0 * cycle) == [True, True] for cycle in range(5))
    assert all(pair.cycle(100.0 + 20.0 * cycle) == [True, True] for cycle in range(5))
    assert pair.made[1].reserve == pair.made[2].reserve == 6 + 8


@pytest.mark.parametrize("deaf", [1, 2])
def test_a_link_in_one_direction_works_again_although_it_brings_no_echo(deaf: int) -> None:
    pair = Pair()
    for cycle in range(5):
        pair.cycle(3600.0 + 20.0 * cycle)
    old, talker = list(pair.recorded), 3 - deaf
    for start_s in (100.0, 40.0, 2000.0, 10.0):  # set back, three times
        for cycle in range(4):
            slot_s = start_s + 20.0 * cycle + 10.0 * talker
            sealed = pair.send(talker, slot_s)
            assert pair.hears(deaf, talker, sealed, slot_s)
            assert not pair.hears(deaf, talker, sealed, slot_s)
            pair.send(deaf, start_s + 20.0 * cycle + 10.0 * deaf)  # nobody hears it
    assert pair.cycle(3600.0)[talker - 1]
    assert not any(pair.hears(3 - source, source, sealed, slot_s) for source, sealed, slot_s in old if source == talker)


def test_replayed_packets_are_rejected_in_later_slots() -> None:
    pair = Pair()
    for start_s in (400.0, 200.0, 300.0, 100.0):  # set back three times
        for cycle in range(20):
            pair.cycle(start_s + 20.0 * cycle)
    old = list(pair.recorded)
    for start_s in np.arange(500.0, 820.0, 20.0).tolist():
        for source, sealed, slot_s in old:
            if abs(slot_s - start_s) <= 40.0:
                assert not pair.hears(3 - source, source, sealed, slot_s)
        assert pair.cycle(start_s) == [True, True]


def test_a_vehicle_that_lost_its_state_after_its_clock_was_set_back_is_heard_again() -> None:
    pair = Pair()
    pair.cycle(3600.0)
    for cycle in range(3):
        pair.cycle(100.0 + 20.0 * cycle)
    pair.made[2] = Tagger(KEY, 6, "lake 1", lambda size: bytes([200] * size))
    heard = [pair.cycle(160.0 + 20.0 * cycle) for cycle in range(4)]
    assert heard[2:] == [[True, True], [True, True]]


def test_an_era_that_is_not_later_needs_an_echo_of_a_recent_packet() -> None:
    pair = Pair()
    for cycle in range(3):
        pair.cycle(3600.0 - 1000.0 * cycle)
    pair.made[2] = Tagger(KEY, 6, "lake 1", lambda size: bytes([200] * size))
    pair.made[2].begin_era()  # it has lost its state, and its number is smaller than before
    assert not pair.hears(1, 2, pair.send(2, 1720.0), 1720.0)
    assert pair.hears(2, 1, pair.send(1, 1730.0), 1730.0)
    answer = pair.send(2, 1740.0)
    for late in range(8):  # the echoed packet is too old by now
        pair.send(1, 1750.0 + 20.0 * late)
    assert not pair.hears(1, 2, answer, 1740.0)
    assert pair.hears(2, 1, pair.send(1, 1930.0), 1930.0)
    assert pair.hears(1, 2, pair.send(2, 1940.0), 1940.0)
