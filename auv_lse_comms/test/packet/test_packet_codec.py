"""Packet codec: golden bytes packed by hand, round trips, and damage."""

from __future__ import annotations

import dataclasses
import importlib.util
import math
import struct
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix
from auv_lse_common.vocabulary.plan import NONE, Plan, Tour
from auv_lse_comms.packet import fields
from auv_lse_comms.packet.codec import REASONS, Limits, Packet, PacketError, decode, encode, room_for_samples
from auv_lse_comms.packet.navigation import MAX_BYTES, Navigation

# 1 -> 3F800000, -2.5 -> C0200000, 100 -> 42C80000, 15 -> 41700000, 0.5 -> 3F000000, -0.25 -> BE800000,
# 200 -> 43480000, 16.5 -> 41840000 (IEEE 754 single, by hand), all little-endian
START = "2a00" + "0000003f" + "0000c842" + "000020c0"  # step 42, heading 0.5, north 100, east -2.5
SAMPLE_A = "0000803f" + "000020c0" + "00007041"  # 1, -2.5, 15
SAMPLE_B = "00004843" + "000080be" + "00008441"  # 200, -0.25, 16.5
UNUSED = "ff" * 12

GOLDEN = {
    # m = 3: 14 + 3 + 1 + 19 * 12 = 246 bytes, 6 spare
    "augmented, full": (
        START + "00050a" + "f2" + SAMPLE_A + SAMPLE_B * 18 + "ff" * 6,
        (0, 5, 10),
        0xF2,
        [(1.0, -2.5, 15.0)] + [(200.0, -0.25, 16.5)] * 18,
    ),
    "augmented, two samples": (
        START + "00050a" + "f0" + SAMPLE_A + SAMPLE_B + UNUSED * 17 + "ff" * 6,
        (0, 5, 10),
        0xF0,
        [(1.0, -2.5, 15.0), (200.0, -0.25, 16.5)],
    ),
    # m = 10: 14 + 10 + 1 + 18 * 12 = 241 bytes, 11 spare
    "plain, full": (
        START + "0102030405060708090a" + "ff" + SAMPLE_B * 18 + "ff" * 11,
        tuple(range(1, 11)),
        0xFF,
        [(200.0, -0.25, 16.5)] * 18,
    ),
    # no actions: 14 + 1 + 19 * 12 = 243, 9 spare
    "mission over": (START + "ff" + UNUSED * 19 + "ff" * 9, (), 0xFF, []),
    # 9 actions: 14 + 9 + 1 + 19 * 12 = 252, none spare
    "no spare byte": (
        START + "090807060504030201" + "fe" + SAMPLE_A * 19,
        (9, 8, 7, 6, 5, 4, 3, 2, 1),
        0xFE,
        [(1.0, -2.5, 15.0)] * 19,
    ),
    # 237 actions: 14 + 237 + 1 = 252
    "longest path": (START + "df" * 237 + "f1", (0xDF,) * 237, 0xF1, []),
}

GOLDEN_TOURS = {
    # 14 + 3 + 1 + 1 + 1 + 3 + 1 + 19 * 12 = 252, none spare
    "three actions, then three segments of two legs": (
        START + "00050a" + "ef" + "02" + "03" + "0040ff" + "f0" + SAMPLE_A * 19,
        (0, 5, 10),
        Tour(segment_legs=2, bearings=(0, 64, 255)),
        0xF0,
        [(1.0, -2.5, 15.0)] * 19,
    ),
    # 14 + 0 + 1 + 1 + 1 + 50 + 1 + 15 * 12 = 248, 4 spare
    "fifty segments": (
        START + "ef" + "02" + "32" + "00" * 25 + "80" * 25 + "ff" + SAMPLE_B * 15 + "ff" * 4,
        (),
        Tour(segment_legs=2, bearings=(0,) * 25 + (128,) * 25),
        0xFF,
        [(200.0, -0.25, 16.5)] * 15,
    ),
    # as many of everything as a tour can have: 14 + 5 + 3 + 64 + 1 + 13 * 12 = 243, 9 spare; bytes 0xFF are bearings
    "64 segments of 255 legs": (
        START + "0001020304" + "ef" + "ff" + "40" + "ff" * 64 + "fe" + SAMPLE_A + UNUSED * 12 + "ff" * 9,
        (0, 1, 2, 3, 4),
        Tour(segment_legs=255, bearings=(255,) * 64),
        0xFE,
        [(1.0, -2.5, 15.0)],
    ),
    # the tour takes the last byte that there is: 14 + 223 + 3 + 11 + 1 = 252
    "no room for a sample": (
        START + "10" * 223 + "ef" + "01" + "0b" + "0102030405060708090a0b" + "ff",
        (16,) * 223,
        Tour(segment_legs=1, bearings=tuple(range(1, 12))),
        0xFF,
        [],
    ),
}


GOLDEN_QUALITY = {
    # 14 + 3 + 1 + 1 + 19 * 12 = 247 bytes, 5 spare
    "three actions": (START + "00050a" + "ea" + "f2" + SAMPLE_A * 19 + "ff" * 5, (0, 5, 10), None, 0xF2, 19),
    # the byte takes the place of a sample: 14 + 9 + 1 + 1 + 18 * 12 = 241, 11 spare
    "nine actions": (
        START + "090807060504030201" + "ea" + "ff" + SAMPLE_A * 18 + "ff" * 11,
        (9, 8, 7, 6, 5, 4, 3, 2, 1), None, 0xFF, 18,
    ),
    # 14 + 3 + 7 + 1 + 1 + 18 * 12 = 242, 10 spare
    "navigation": (
        START + "00050a" + "ec" + "393000" + "feffff" + "ea" + "f2" + SAMPLE_A * 18 + "ff" * 10,
        (0, 5, 10), Navigation(raw_cm=(12345, -2)), 0xF2, 18,
    ),
}  # fmt: skip


@pytest.mark.parametrize("layout", GOLDEN_QUALITY)
def test_golden_packet_that_announces_the_quality_asked_for(layout: str) -> None:
    text, actions, navigation, naive_path, samples = GOLDEN_QUALITY[layout]
    data = bytes.fromhex(text)
    assert len(data) == 252
    plan = Plan(
        step=42, heading_rad=0.5, north_m=100.0, east_m=-2.5, actions=actions, naive_path=naive_path,
        quality_reached=True,
    )  # fmt: skip
    packet = Packet(plan, np.tile([1.0, -2.5, 15.0], (samples, 1)), navigation=navigation)
    assert encode(packet) == data
    assert decode(data) == packet


@pytest.mark.parametrize("layout", GOLDEN)
def test_golden_packet_packed_by_hand(layout: str) -> None:
    text, actions, naive_path, samples = GOLDEN[layout]
    data = bytes.fromhex(text)
    assert len(data) == 252
    plan = Plan(step=42, heading_rad=0.5, north_m=100.0, east_m=-2.5, actions=actions, naive_path=naive_path)
    packet = Packet(plan, np.array(samples).reshape(-1, 3))
    assert encode(packet) == data
    assert decode(data) == packet


@pytest.mark.parametrize("layout", GOLDEN_TOURS)
def test_golden_packet_with_a_tour_packed_by_hand(layout: str) -> None:
    text, actions, tour, naive_path, samples = GOLDEN_TOURS[layout]
    data = bytes.fromhex(text)
    assert len(data) == 252
    plan = Plan(step=42, heading_rad=0.5, north_m=100.0, east_m=-2.5, actions=actions, naive_path=naive_path, tour=tour)
    packet = Packet(plan, np.array(samples).reshape(-1, 3))
    assert encode(packet) == data
    assert decode(data) == packet


# dead-reckoned position 123.45, -0.02 m: 12345 -> 003039, -2 -> FFFFFE; at the fix 100, -50.5 m: 200 -> 00C8, -101 ->
# FF9B;
# GPS 2.5 m south and 1.2 m east of it: -25 dm -> FE7, 12 dm -> 00C, the first in the low bits: 00CFE7
RAW = "393000" + "feffff"
TOLD = Navigation(raw_cm=(12345, -2))
FIXED = Navigation(raw_cm=(12345, -2), fix_raw_half_m=(200, -101), fix_off_dm=(-25, 12))
GOLDEN_NAVIGATION = {
    # 14 + 3 + 7 + 1 + 18 * 12 = 241, 11 spare
    "no fix yet": (START + "00050a" + "ec" + RAW + "f2" + SAMPLE_A * 18 + "ff" * 11, None, TOLD, 18),
    # 14 + 3 + 14 + 1 + 18 * 12 = 248, 4 spare
    "a fix": (
        START + "00050a" + "ed" + RAW + "c800" + "9bff" + "e7cf00" + "ff" + SAMPLE_A * 18 + "ff" * 4, None, FIXED, 18
    ),
    # 14 + 3 + 3 + 48 + 14 + 1 + 14 * 12 = 251, 1 spare
    "a fix and a tour": (
        START + "00050a" + "ef" + "02" + "30" + "40" * 48 + "ed" + RAW + "c800" + "9bff" + "e7cf00" + "f0"
        + SAMPLE_A * 14 + "ff",
        Tour(segment_legs=2, bearings=(64,) * 48),
        FIXED,
        14,
    ),
}  # fmt: skip


#: 101 actions: 0, 1 to 10, and so on; two to a byte, the earlier one in the low bits.
_LONG = tuple(i % 11 for i in range(101))
_LONG_BYTES = "".join(f"{high:x}{low:x}" for low, high in zip(_LONG[::2], (*_LONG[1::2], 15), strict=True))


def test_golden_packet_of_a_long_path_packed_by_hand() -> None:
    # 14 + 2 + 51 + 1 + 15 * 12 = 248, 4 spare
    assert _LONG_BYTES.startswith("10325476" + "98" + "0a" + "21")
    data = bytes.fromhex(START + "eb65" + _LONG_BYTES + "f2" + SAMPLE_A * 15 + "ff" * 4)
    plan = Plan(step=42, heading_rad=0.5, north_m=100.0, east_m=-2.5, actions=_LONG, naive_path=0xF2)
    packet = Packet(plan, np.tile([1.0, -2.5, 15.0], (15, 1)))
    assert encode(packet) == data
    assert decode(data) == packet


def test_a_path_to_the_end_of_a_hundred_legs_leaves_room_for_fifteen_samples() -> None:
    def room(n: int, reserve: int = 0, navigation: Navigation | None = None, action: int = 10) -> int:
        return room_for_samples(dataclasses.replace(PLAIN.plan, actions=(action,) * n), reserve, navigation)

    assert room(100) == 15
    assert room(100, reserve=6) == room(100, navigation=FIXED) == 14
    assert room(16) == room(17) == 18, "as many as a search plans are told a byte each"
    assert room(100, action=16) == 11, "of a larger action set"
    with pytest.raises(PacketError, match=r"terminal: 256 actions do not fit; at most 255 do"):
        encode(Packet(dataclasses.replace(PLAIN.plan, actions=(0,) * 256)))


@pytest.mark.parametrize(
    "path",
    [
        "eb10" + "00" * 8 + "ff",  # 16 of them
        "eb21" + "00" * 17 + "ff",  # a 34th action, 0, beside the last of 33
        "eb21" + "00" * 16 + "ef" + "ff",  # the low bits of the last byte are the action
        "00" * 17 + "ff",  # 17 of them a byte each
    ],
)
def test_actions_in_a_noncanonical_encoding_are_refused(path: str) -> None:
    with pytest.raises(PacketError, match="pairs: "):
        decode(bytes.fromhex(START + path).ljust(252, b"\xff"))


def test_pairs_that_are_cut_off_or_end_in_an_action_are_refused() -> None:
    with pytest.raises(PacketError, match=r"naive_path: naive_path is 7, outside 224\.\.255"):
        decode(bytes.fromhex(START + "eb22" + "00" * 17 + "07").ljust(252, b"\xff"))
    plan = dataclasses.replace(PLAIN.plan, actions=(3,) * 255)
    assert decode(encode(Packet(plan))).plan == plan
    with pytest.raises(PacketError, match="naive_path"):
        decode(bytes.fromhex(START + "eb22" + "00" * 17 + "eb").ljust(252, b"\xff"))


@pytest.mark.parametrize("layout", GOLDEN_NAVIGATION)
def test_golden_packet_with_navigation_packed_by_hand(layout: str) -> None:
    text, tour, navigation, count = GOLDEN_NAVIGATION[layout]
    data = bytes.fromhex(text)
    assert len(data) == 252
    naive_path = data[17 + (0 if tour is None else 51) + navigation.size]
    plan = Plan(
        step=42, heading_rad=0.5, north_m=100.0, east_m=-2.5, actions=(0, 5, 10), naive_path=naive_path, tour=tour
    )
    packet = Packet(plan, np.tile([1.0, -2.5, 15.0], (count, 1)), navigation=navigation)
    assert room_for_samples(plan, navigation=navigation) == count
    assert encode(packet) == data
    assert decode(data) == packet


def test_navigation_in_metres_and_back() -> None:
    raw = DeadReckoning(stamp_s=9.0, heading_rad=0.0, north_m=123.449, east_m=-0.021, depth_m=3.0)
    fix = Fix(stamp_s=5.0, north_m=97.6, east_m=-49.4, raw_north_m=100.1, raw_east_m=-50.6, std_m=1.0)
    assert Navigation.of(raw, None) == TOLD
    assert Navigation.of(raw, fix) == FIXED
    assert FIXED.raw_m == pytest.approx((123.45, -0.02))
    assert FIXED.fix_raw_m == (100.0, -50.5)
    assert FIXED.fix_m == pytest.approx((97.5, -49.3)), "2.5 m south and 1.2 m east of the dead-reckoned position"
    assert np.isnan([TOLD.fix_raw_m, TOLD.fix_m]).all()
    with pytest.raises(
        ValueError, match=r"dead-reckoned position is 90000.0, 0.0 m; a packet holds at most \+-83886.1 m"
    ):
        Navigation.of(dataclasses.replace(raw, north_m=9e4, east_m=0.0), None)
    with pytest.raises(
        ValueError, match=r"fix minus dead-reckoned position is 300.0, 1.2 m; a packet holds at most \+-204.7 m"
    ):
        Navigation.of(raw, dataclasses.replace(fix, north_m=400.1))
    with pytest.raises(ValueError, match=r"dead-reckoned position must be finite, not nan, 0.0 m"):
        Navigation.of(dataclasses.replace(raw, north_m=math.nan, east_m=0.0), None)


@pytest.mark.parametrize("navigation", [TOLD, FIXED])
def test_navigation_that_is_cut_off_or_repeated_is_refused(navigation: Navigation) -> None:
    told = navigation.to_bytes()
    start = bytes.fromhex(START)

    def reason(path: bytes) -> str:
        with pytest.raises(PacketError) as caught:
            decode((start + path).ljust(252, b"\xff"))
        return caught.value.reason

    assert reason(told + b"\xe9") == "naive_path"
    assert reason(told + b"\xea\xea") == "naive_path", "announced twice"
    assert reason(told + told + b"\xff") == "naive_path", "a second one"
    assert reason(told + b"\xef") == "naive_path", "a tour after it"
    assert reason(b"\x10" * (238 - len(told)) + told) == "terminal", "no byte is left for the terminal one"
    with pytest.raises(
        PacketError, match=r"terminal: 237 actions do not fit; at most .* and [0-9]+ bytes of navigation"
    ):
        encode(Packet(dataclasses.replace(PLAIN.plan, actions=(16,) * 237), navigation=navigation))


def test_a_full_tour_leaves_room_for_fifteen_samples() -> None:
    tour = Tour(segment_legs=2, bearings=(7,) * 50)
    for actions in range(5):
        assert room_for_samples(dataclasses.replace(PLAIN.plan, actions=(0,) * actions, tour=tour)) == 15
    assert fields.capacity(3, reserve=6, segments=50) == 14
    assert fields.capacity(0, reserve=6, segments=48) == 15
    with pytest.raises(ValueError, match="185 actions, a tour of 50 segments and 0 bytes of tag do not fit"):
        fields.capacity(185, segments=50)


def test_golden_packet_with_room_for_a_tag() -> None:
    data = bytes.fromhex(START + "00050a" + "f2" + SAMPLE_A * 19 + "0123456789ab")
    packet = decode(data, reserve=6)
    assert packet.samples.tolist() == [[1.0, -2.5, 15.0]] * 19
    assert encode(packet, reserve=6) == data[:-6] + b"\xff" * 6
    with pytest.raises(PacketError, match="spare: unused bytes 246 to 251 are 0123456789ab"):
        decode(data)


def test_capacity_is_the_papers() -> None:
    assert fields.capacity(3) == 19  # the paper, section 5
    assert fields.capacity(10) == 18
    assert fields.capacity(3, reserve=6) == 19
    assert fields.capacity(10, reserve=6) == 18
    for n in range(fields.MAX_ACTIONS + 1):
        for paired in (False, True):
            assert fields.samples_start(n, paired=paired) + fields.capacity(n, paired=paired) * 12 <= 252
        assert 0 <= spare_bytes(n) < 12
    with pytest.raises(ValueError, match="238 actions and 0 bytes of tag do not fit"):
        fields.capacity(238)


def spare_bytes(n_actions: int) -> int:
    """Bytes left over after the samples of a full packet."""
    return fields.PACKET_BYTES - fields.samples_start(n_actions) - fields.capacity(n_actions) * fields.SAMPLE_BYTES


def single(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers that a float32 holds, in a field's range."""
    return st.floats(low, high, width=32, allow_nan=False)


def tours() -> st.SearchStrategy[Tour]:
    """Tours of every length."""
    bearings = st.lists(st.integers(0, 255), min_size=1, max_size=64)
    return st.builds(lambda legs, b: Tour(segment_legs=legs, bearings=tuple(b)), st.integers(1, 255), bearings)


def navigations() -> st.SearchStrategy[Navigation]:
    """Navigation with a fix and without, of all numbers that fit."""

    def pair(bits: int) -> st.SearchStrategy[tuple[int, int]]:
        one = st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        return st.tuples(one, one)

    fixed = st.builds(
        lambda raw, position, off: Navigation(raw_cm=raw, fix_raw_half_m=position, fix_off_dm=off),
        pair(24),
        pair(16),
        pair(12),
    )
    return fixed | st.builds(lambda raw: Navigation(raw_cm=raw), pair(24))


@st.composite
def packets(draw: st.DrawFn, reserve: int = 0) -> Packet:
    tour = draw(st.none() | tours())
    segments = 0 if tour is None else len(tour.bearings)
    n_actions = draw(st.integers(0, fields.PACKET_BYTES - reserve - fields.samples_start(0, segments)))
    highest = draw(st.sampled_from([fields.PAIRED_SET - 1, fields.FIRST_TERMINAL - 1]))
    actions = tuple(draw(st.lists(st.integers(0, highest), min_size=n_actions, max_size=n_actions)))
    paired = fields.are_paired(actions)
    left = fields.PACKET_BYTES - reserve - fields.samples_start(n_actions, segments, paired=paired)
    told = draw(st.none() | navigations()) if left >= MAX_BYTES else None
    before = 0 if told is None else told.size
    reached = left > before and draw(st.booleans())
    most = fields.capacity(n_actions, reserve, segments, before + reached, paired)
    n = draw(st.integers(0, most))
    rows = [[draw(single(f.low, f.high)) for f in fields.SAMPLE] for _ in range(n)]
    plan = Plan(
        step=draw(st.integers(0, 65535)),
        heading_rad=draw(single(fields.HEADER[1].low, fields.HEADER[1].high)),
        north_m=draw(single(fields.HEADER[2].low, fields.HEADER[2].high)),
        east_m=draw(single(fields.HEADER[3].low, fields.HEADER[3].high)),
        actions=actions,
        naive_path=draw(st.integers(0xF0, 0xFF)),
        tour=tour,
        quality_reached=reached,
    )
    return Packet(plan, np.array(rows, dtype=float).reshape(n, 3), navigation=told)


@settings(max_examples=150)
@given(packets())
def test_round_trip(packet: Packet) -> None:
    data = encode(packet)
    assert len(data) == 252
    assert decode(data) == packet
    assert encode(decode(data)) == data


@settings(max_examples=60)
@given(packets(reserve=8), st.binary(min_size=8, max_size=8))
def test_round_trip_leaves_the_tag_alone(packet: Packet, tag: bytes) -> None:
    data = encode(packet, reserve=8)
    assert len(data) == 252
    assert decode(data[:-8] + tag, reserve=8) == packet


@settings(max_examples=100)
@given(st.lists(st.tuples(*[st.floats(-1e5, 1e5)] * 2, st.floats(-100.0, 1e4)), max_size=19))
def test_numbers_are_rounded_to_float32_and_no_further(rows: list[tuple[float, float, float]]) -> None:
    samples = np.array(rows, dtype=float).reshape(-1, 3)
    got = decode(encode(dataclasses.replace(PLAIN, samples=samples))).samples
    assert np.array_equal(got, samples.astype(np.float32).astype(float))


PLAIN = Packet(Plan(step=1, heading_rad=0.0, north_m=0.0, east_m=0.0, actions=(1, 2, 3), naive_path=NONE))


def changed(change: dict[str, object]) -> Packet:
    """`PLAIN` with other samples, or with another field of its plan."""
    if "samples" in change:
        return dataclasses.replace(PLAIN, **change)
    return dataclasses.replace(PLAIN, plan=dataclasses.replace(PLAIN.plan, **change))


LIMITS = Limits(steps=100, n_actions=11, north_m=(-10, 500), east_m=(-20, 600), depth_m=(0, 50))


@pytest.mark.parametrize(
    ("change", "reason", "message"),
    [
        ({"step": -1}, "step", "step is -1, outside 0..65535"),
        ({"step": 65536}, "step", "step is 65536"),
        ({"heading_rad": 6.2832}, "heading", "heading_rad is 6.28"),
        ({"heading_rad": math.nan}, "not_finite", "heading_rad is nan"),
        ({"north_m": math.inf}, "not_finite", "north_m is inf"),
        ({"north_m": 1e300}, "not_finite", "north_m is inf"),
        ({"north_m": 1.1e6}, "position", "north_m is 1100000.0, outside -1e[+]06..1e[+]06 m"),
        ({"east_m": -1.1e6}, "position", "east_m is -1100000.0"),
        ({"actions": (0, 240)}, "action", r"actions \[0, 240\]"),
        ({"actions": (-1,)}, "action", r"actions \[-1\]"),
        ({"actions": (16,) * 238}, "terminal", "238 actions do not fit; at most 237 do"),
        ({"naive_path": 0xEF}, "naive_path", "naive_path is 239, but 229..233 are reserved"),
        ({"naive_path": 256}, "naive_path", "naive_path is 256"),
        ({"actions": (224,)}, "action", r"actions \[224\] must be indices 0\.\.223"),
        ({"tour": Tour(segment_legs=0, bearings=(1,))}, "tour", "segment_legs is 0, outside 1..255"),
        ({"tour": Tour(segment_legs=256, bearings=(1,))}, "tour", "segment_legs is 256"),
        ({"tour": Tour(segment_legs=1, bearings=())}, "tour", "segments is 0, outside 1..64"),
        ({"tour": Tour(segment_legs=1, bearings=(0,) * 65)}, "tour", "segments is 65"),
        ({"tour": Tour(segment_legs=1, bearings=(0, 256))}, "tour", "bearings is 256, outside 0..255"),
        (
            {"actions": (16,) * 171, "tour": Tour(segment_legs=1, bearings=(0,) * 64)},
            "terminal",
            "171 actions do not fit; at most 170 do with a tour of 64 segments",
        ),
        ({"samples": np.zeros((20, 3))}, "sample", "20 samples do not fit; at most 19 do with 3 actions"),
        ({"samples": np.zeros((2, 4))}, "sample", r"shape \(n, 3\), not \(2, 4\)"),
        ({"samples": np.zeros(3)}, "sample", r"not \(3,\)"),
        ({"samples": np.array([[0.0, 0.0, math.nan]])}, "not_finite", r"samples\[0\].depth_m is nan"),
        ({"samples": np.array([[0.0, 0.0, 5.0], [0.0, 2e6, 5.0]])}, "sample", r"samples\[1\].east_m is 2000000.0"),
        ({"samples": np.array([[0.0, 0.0, 12001.0]])}, "sample", "depth_m is 12001.0, outside -1000..12000"),
    ],
)
def test_sender_raises_out_of_range(change: dict[str, object], reason: str, message: str) -> None:
    with pytest.raises(PacketError, match=message) as caught:
        encode(changed(change))
    assert caught.value.reason == reason
    assert reason in REASONS


@pytest.mark.parametrize("change", [{"step": 1.5}, {"actions": (1.0,)}, {"naive_path": "f0"}])
def test_sender_raises_on_what_is_not_an_integer(change: dict[str, object]) -> None:
    with pytest.raises(TypeError):
        encode(changed(change))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"step": 101}, "step"),
        ({"north_m": 500.1}, "position"),
        ({"east_m": -20.1}, "position"),
        ({"actions": (0, 11)}, "action"),
        ({"tour": Tour(segment_legs=10, bearings=(0,) * 11)}, "tour"),
        ({"samples": np.array([[501.0, 0.0, 1.0]])}, "sample"),
        ({"samples": np.array([[0.0, 601.0, 1.0]])}, "sample"),
        ({"samples": np.array([[0.0, 0.0, 50.1]])}, "sample"),
    ],
)
def test_limits_hold_on_both_sides(change: dict[str, object], reason: str) -> None:
    packet = changed(change)
    with pytest.raises(PacketError) as sending:
        encode(packet, LIMITS)
    with pytest.raises(PacketError) as receiving:
        decode(encode(packet), LIMITS)
    assert sending.value.reason == receiving.value.reason == reason


def test_limits_hold_after_rounding() -> None:
    # float32(0.1) > 0.1: a value on the limit that rounds beyond it is refused by sender and receivers alike
    limits = Limits(depth_m=(0.0, 0.1))
    samples = np.array([[0.0, 0.0, 0.1]])
    assert not limits.fits(samples).any()
    with pytest.raises(PacketError):
        encode(dataclasses.replace(PLAIN, samples=samples), limits)


def test_every_naive_path_and_none_have_a_byte_of_their_own() -> None:
    for naive_path in range(0xF0, 0x100):
        assert decode(encode(changed({"naive_path": naive_path}))).plan.naive_path == naive_path
    assert decode(encode(PLAIN), LIMITS).plan.naive_path == 0xFF


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"steps": 65536}, "steps"),
        ({"n_actions": 241}, "n_actions"),
        ({"north_m": (5.0, 4.0)}, "north_m"),
        ({"depth_m": (0.0, math.nan)}, "depth_m"),
    ],
)
def test_limits_wider_than_the_table_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Limits(**change)  # type: ignore[arg-type]


def test_box_of_a_polygon() -> None:
    north_m, east_m = Limits.box(np.array([[0.0, 10.0], [700.0, 20.0], [350.0, 610.0]]), 50.0)
    assert north_m == (-50.0, 750.0)
    assert east_m == (-40.0, 660.0)


def test_damage_has_its_reason() -> None:
    good = encode(dataclasses.replace(PLAIN, samples=np.full((3, 3), 7.0)))

    def reason(data: bytes) -> str:
        with pytest.raises(PacketError) as caught:
            decode(data, LIMITS)
        return caught.value.reason

    assert reason(b"") == "length"
    assert reason(good[:-1]) == "length"
    assert reason(good + b"\xff") == "length"
    assert reason(good[:6] + struct.pack("<f", math.inf) + good[10:]) == "not_finite"
    assert reason(good[:2] + struct.pack("<f", 7.0) + good[6:]) == "heading"
    assert reason(good[:30] + b"\xff" * 12 + good[42:]) == "gap"
    assert reason(good[:-1] + b"\x00") == "spare"
    assert reason(good[:14] + bytes(238)) == "terminal"
    assert decode(bytearray(good)) == decode(memoryview(good)) == decode(good)
    for terminal in (*range(0xE5, 0xEA), 0xEB):  # reserved for what is still unknown
        assert reason(good[:17] + bytes([terminal]) + good[18:]) == "naive_path"
    twice = encode(Packet(dataclasses.replace(PLAIN.plan, quality_reached=True), PLAIN.samples))
    assert reason(twice[:18] + b"\xea" + twice[19:]) == "naive_path"


def test_a_call_to_abort_is_a_terminal_byte() -> None:
    packet = Packet(dataclasses.replace(PLAIN.plan, naive_path=NONE), PLAIN.samples)
    call = dataclasses.replace(packet, abort=True)
    quiet, loud = encode(packet), encode(call)
    assert [i for i in range(252) if quiet[i] != loud[i]] == [17]
    assert (quiet[17], loud[17]) == (0xFF, 0xEE)
    assert decode(loud) == call != decode(quiet)
    with pytest.raises(PacketError, match=r"a call to abort carries none \(255\)"):
        encode(dataclasses.replace(PLAIN, plan=dataclasses.replace(PLAIN.plan, naive_path=0xF1), abort=True))


def test_a_damaged_tour_has_its_reason() -> None:
    plan = dataclasses.replace(PLAIN.plan, tour=Tour(segment_legs=2, bearings=(1, 2, 3, 4)))
    good = encode(Packet(plan, np.full((18, 3), 7.0)))
    assert good[17:25] == bytes.fromhex("ef 02 04 01 02 03 04 ff")

    def reason(at: int, *values: int, stop: int = 252, reserve: int = 0, limits: Limits | None = LIMITS) -> str:
        data = (good[:at] + bytes(values) + good[at + len(values) :])[:stop]
        with pytest.raises(PacketError) as caught:
            decode(data, limits, reserve)
        return caught.value.reason

    assert reason(18, 0) == "tour", "segments of no legs"
    assert reason(18, 34) == "tour", "longer than the mission"
    assert reason(19, 0) == "tour", "no segment"
    assert reason(19, 65) == "tour"
    assert reason(24, 0xEF) == "naive_path", "a second tour"
    assert reason(24, 0x01) == "naive_path", "an action after the tour"
    # a tour that leaves no byte for a terminal: 230 actions, then one of 20 segments
    assert reason(14, *([20] * 230), 0xEF, 1, 20, limits=None) == "terminal"
    # the same where the last bytes are the tag's
    assert reason(14, *([20] * 230), 0xEF, 1, 3, 0, 0, 0, 0xFF, 0xFF, reserve=6, limits=None) == "terminal"
    assert reason(14, *([20] * 237), 0xEF, limits=None) == "terminal"


def load_fuzz() -> ModuleType:
    spec = importlib.util.spec_from_file_location("packet_fuzz", Path(__file__).with_name("packet_fuzz.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["packet_fuzz"] = module
    spec.loader.exec_module(module)
    return module


def test_fuzz_only_packet_errors_escape() -> None:
    counts = load_fuzz().fuzz(50_000, np.random.default_rng(5))
    total = sum(sum(c.values()) for c in counts.values())
    assert total == 50_000
    reasons = {reason for c in counts.values() for reason in c}
    for name in (
        "length",
        "not_finite",
        "position",
        "terminal",
        "sample",
        "gap",
        "spare",
        "action",
        "step",
        "tour",
        "naive_path",
    ):
        assert name in reasons
    assert 0 < counts["bits flipped"]["decoded"] < sum(counts["bits flipped"].values())


def test_fuzz_notices_a_broken_decoder(monkeypatch: pytest.MonkeyPatch) -> None:
    module = load_fuzz()
    monkeypatch.setattr(module, "decode", lambda data, limits: PLAIN)
    with pytest.raises(module.Finding):
        module.fuzz(100, np.random.default_rng(1))


@settings(max_examples=300)
@given(st.binary(max_size=300) | st.binary(min_size=252, max_size=252))
def test_any_bytes_decode_or_raise_packet_error(data: bytes) -> None:
    try:
        packet = decode(data)
    except PacketError as error:
        assert error.reason in REASONS  # noqa: PT017
    else:
        assert encode(packet) == data
