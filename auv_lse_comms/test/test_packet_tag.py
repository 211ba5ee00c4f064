"""The tag: what was forged, altered or replayed is refused; keys stay in their file."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np
import pytest

from auv_lse_common.plan import NONE, Plan
from auv_lse_comms.packet.codec import Packet, PacketError, encode
from auv_lse_comms.packet.tag import KeyFileError, Tagger, read_key

KEY = bytes(range(32))


def packet(step: int = 7, east_m: float = 0.0) -> bytes:
    return encode(
        Packet(
            Plan(step=step, heading_rad=0.1, north_m=1.0, east_m=east_m, actions=(1, 2, 3), naive_path=NONE),
            np.ones((19, 3)),
        ),
        reserve=6,
    )


def reason(tagger: Tagger, data: bytes, source: int) -> str:
    with pytest.raises(PacketError) as caught:
        tagger.check(data, source)
    return caught.value.reason


def test_tag_is_blake2s_over_sender_dive_and_packet() -> None:
    data = packet()
    sealed = Tagger(KEY, 6, "lake 1").seal(data, 2)
    assert sealed[:246] == data[:246]
    by_hand = hashlib.blake2s(
        b"\x02\x00" + b"\x06" + b"lake 1" + data[:246], key=KEY, digest_size=6, person=b"auv_lse1"
    ).digest()
    assert sealed[246:] == by_hand


def test_own_packets_are_accepted() -> None:
    sender, receiver = Tagger(KEY, 6), Tagger(KEY, 6)
    for step in (0, 1, 5, 9):
        receiver.check(sender.seal(packet(step), 2), 2)
    receiver.check(sender.seal(packet(9, east_m=3.0), 2), 2)  # one step may give several packets


def test_any_altered_bit_is_detected() -> None:
    sealed = Tagger(KEY, 6).seal(packet(), 2)
    receiver = Tagger(KEY, 6)
    for bit in range(252 * 8):
        altered = bytearray(sealed)
        altered[bit // 8] ^= 1 << (bit % 8)
        assert reason(receiver, bytes(altered), 2) == "tag"
    receiver.check(sealed, 2)  # none of them was remembered


def test_forged_packets_are_refused() -> None:
    sealed = Tagger(KEY, 6).seal(packet(), 2)
    assert reason(Tagger(bytes(32), 6), sealed, 2) == "tag"  # another key
    assert reason(Tagger(KEY, 6), sealed, 3) == "tag"  # said to come from another sender
    assert reason(Tagger(KEY, 6, "tomorrow"), sealed, 2) == "tag"  # another dive
    assert reason(Tagger(KEY, 6), packet(), 2) == "tag"  # no tag at all
    assert reason(Tagger(KEY, 6), sealed[:-1], 2) == "length"


def test_replays_are_refused() -> None:
    sender, receiver = Tagger(KEY, 6), Tagger(KEY, 6)
    first, again, later = (sender.seal(packet(7, e), 2) for e in (0.0, 1.0, 2.0))
    next_step = sender.seal(packet(8), 2)
    receiver.check(first, 2)
    assert reason(receiver, first, 2) == "replay"
    receiver.check(again, 2)
    assert reason(receiver, again, 2) == "replay"
    assert reason(receiver, first, 2) == "replay"
    receiver.check(next_step, 2)
    assert reason(receiver, later, 2) == "replay"  # never heard, but older than what was
    receiver.check(Tagger(KEY, 6).seal(packet(0), 3), 3)  # senders do not mix


def write(path: Path, text: str, mode: int = 0o600) -> Path:
    path.write_text(text)
    path.chmod(mode)
    return path


def test_key_from_a_file(tmp_path: Path) -> None:
    assert read_key(write(tmp_path / "key", KEY.hex() + "\n")) == KEY
    assert read_key(write(tmp_path / "short", "00" * 16, 0o400)) == bytes(16)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o644, 0o601])
def test_key_file_open_to_others_is_refused(tmp_path: Path, mode: int) -> None:
    path = write(tmp_path / "key", KEY.hex(), mode)
    with pytest.raises(KeyFileError, match=f"mode 0{mode:o} gives others access to the key; expected 0600: chmod 600"):
        read_key(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("not hexadecimal at all", "not hexadecimal; make one with: openssl rand -hex 32"),
        ("\xff\xfe", "not hexadecimal"),
        ("00" * 15, "15 bytes; expected 16 to 32"),
        ("00" * 33, "33 bytes; expected 16 to 32"),
        ("", "0 bytes; expected 16 to 32"),
    ],
)
def test_key_file_without_a_key_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(KeyFileError, match=message) as caught:
        read_key(write(tmp_path / "key", text))
    assert not text or text not in str(caught.value)


def test_key_file_that_is_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(KeyFileError, match="missing: cannot be read: No such file"):
        read_key(tmp_path / "missing")
    with pytest.raises(KeyFileError, match="cannot be read: Is a directory"):
        read_key(tmp_path)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")
def test_key_file_of_another_user_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "key", KEY.hex())
    os.chown(path, 12345, -1)
    with pytest.raises(KeyFileError, match="belongs to user 12345"):
        read_key(path)


def test_key_is_in_no_message() -> None:
    tagger = Tagger(KEY, 6)
    assert KEY.hex() not in repr(tagger)
    assert repr(tagger) == "Tagger(size=6)"
    with pytest.raises(ValueError, match="a key of 5 bytes"):
        Tagger(b"12345", 6)
    with pytest.raises(ValueError, match="a tag of 0 bytes"):
        Tagger(KEY, 0)
