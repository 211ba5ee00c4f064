"""Fuzzing of the packet's decoder: from a million damaged inputs only `PacketError` may escape.

    python auv_lse_comms/test/packet/packet_fuzz.py [inputs] [seed]

Three requirements are checked with every input: nothing but `PacketError` escapes, its reason is one of
`REASONS`, and what does decode encodes to the very same bytes and lies within the limits. Where the damage determines
the reason, that reason is required.
"""

from __future__ import annotations

import argparse
import struct
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from auv_lse_common.vocabulary.plan import NONE, Plan, Tour
from auv_lse_comms.packet import navigation as nav
from auv_lse_comms.packet.codec import REASONS, Limits, Packet, PacketError, decode, encode, room_for_samples
from auv_lse_comms.packet.fields import (
    FIRST_TERMINAL,
    HEADER_STRUCT,
    PACKET_BYTES,
    PAIRED,
    PAIRS,
    QUALITY,
    RESERVED,
    SAMPLE_BYTES,
    are_paired,
    path_bytes,
    samples_start,
)

LIMITS = Limits(
    steps=100,
    n_actions=11,
    north_m=(-100.0, 800.0),
    east_m=(-100.0, 700.0),
    depth_m=(-10.0, 60.0),
)


class Finding(AssertionError):
    """A violated requirement."""


def packet(rng: np.random.Generator) -> Packet:
    """A packet within `LIMITS`, of any length of path, with a tour or without, and any number of samples."""
    n_actions, legs = int(rng.integers(0, 30 if rng.random() < 0.5 else 101)), int(rng.integers(1, 4))
    bearings = rng.integers(0, 256, int(rng.integers(1, 33))).tolist()
    low, high = (-100.0, -100.0, -10.0), (800.0, 700.0, 60.0)
    plan = Plan(
        step=int(rng.integers(0, 101)),
        heading_rad=float(rng.uniform(-np.pi, np.pi)),
        north_m=float(rng.uniform(-100.0, 800.0)),
        east_m=float(rng.uniform(-100.0, 700.0)),
        actions=tuple(rng.integers(0, 11, n_actions).tolist()),
        naive_path=int(rng.choice([0xF0, 0xF1, 0xF2, 0xF3, NONE])),
        tour=Tour(segment_legs=legs, bearings=tuple(bearings)) if rng.random() < 0.5 else None,
    )
    told = _navigation(rng) if rng.random() < 0.5 else None
    n = int(rng.integers(0, room_for_samples(plan, navigation=told) + 1))
    return Packet(plan, rng.uniform(low, high, (n, 3)), navigation=told)


def _navigation(rng: np.random.Generator) -> nav.Navigation:
    """A dead-reckoned position, with a fix or without."""
    raw, position, off = (tuple(rng.integers(-(2**bits), 2**bits, 2).tolist()) for bits in (23, 15, 11))
    if rng.random() < 0.5:
        return nav.Navigation(raw_cm=raw)
    return nav.Navigation(raw_cm=raw, fix_raw_half_m=position, fix_off_dm=off)


def _samples_start(sent: Packet) -> int:
    told = 0 if sent.navigation is None else sent.navigation.size
    actions = sent.plan.actions
    return samples_start(len(actions), len(sent.plan.tour_fields[1]), told, are_paired(actions))


def _random_length(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    data = rng.bytes(int(rng.integers(0, 600)))
    return data, set() if len(data) == PACKET_BYTES else {"length"}


def _random_bytes(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    return rng.bytes(PACKET_BYTES), set()


def _truncated(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    return good[: int(rng.integers(0, PACKET_BYTES))], {"length"}


def _padded(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    return good + rng.bytes(int(rng.integers(1, 5))), {"length"}


def _flipped(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    data = bytearray(good)
    for bit in rng.integers(0, PACKET_BYTES * 8, int(rng.integers(1, 9))).tolist():
        data[bit // 8] ^= 1 << (bit % 8)
    return bytes(data), set()


def _burst(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    start, length = int(rng.integers(0, PACKET_BYTES)), int(rng.integers(1, 40))
    return (good[:start] + rng.bytes(length) + good[start + length :])[:PACKET_BYTES], set()


def _lost_terminal(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    data = bytearray(good)
    for i in range(HEADER_STRUCT.size, PACKET_BYTES):
        data[i] = min(data[i], int(rng.integers(0, FIRST_TERMINAL)))
    return bytes(data), {"terminal"}


def _reserved(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    """A terminal byte that ends the path, after the actions or the tour, and is no naive path's."""
    at = _samples_start(sent) - 1
    return good[:at] + bytes([int(rng.integers(RESERVED[0], QUALITY))]) + good[at + 1 :], {"naive_path"}


def _bad_pairs(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    """Pairs of too few actions, or an odd number with something beside the last."""
    at = HEADER_STRUCT.size
    few = rng.random() < 0.5
    data = bytes([PAIRS, int(rng.integers(0, PAIRED[0]))]) + rng.bytes(30) if few else bytes([PAIRS, 0x21]) + bytes(17)
    return (good[:at] + data + good[at + len(data) :])[:PACKET_BYTES], {"pairs"}


def _bad_tour(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    """A tour with segments of no legs, too many legs, or too few or too many segments."""
    if sent.plan.tour is None:
        return good, set()
    actions = sent.plan.actions
    data, at = bytearray(good), HEADER_STRUCT.size + path_bytes(len(actions), paired=are_paired(actions))
    kind = int(rng.integers(0, 4))
    if kind < 2:
        data[at], data[at + 1] = (0, data[at + 1]) if kind == 0 else (100, max(2, data[at + 1]))
    else:
        data[at + 1] = 0 if kind == 2 else int(rng.integers(65, 256))
    return bytes(data), {"tour", "terminal"} if kind == 3 else {"tour"}


def _not_finite(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    positions = [2, 6, 10]
    start = _samples_start(sent)
    positions += [start + 4 * i for i in range(3 * len(sent.samples))]
    at = int(rng.choice(positions))
    value = float(rng.choice([np.nan, np.inf, -np.inf]))
    return good[:at] + struct.pack("<f", value) + good[at + 4 :], {"not_finite"}


def _outside(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    at = int(rng.choice([6, 10]))
    value = float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(3.0, 30.0))
    return good[:at] + struct.pack("<f", value) + good[at + 4 :], {"position"}


def _sample_outside(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    if not len(sent.samples):
        return good, set()
    at = _samples_start(sent) + 4 * int(rng.integers(0, 3 * len(sent.samples)))
    value = float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(3.0, 30.0))
    return good[:at] + struct.pack("<f", value) + good[at + 4 :], {"sample"}


def _gap(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    if len(sent.samples) < 2:
        return good, set()
    at = _samples_start(sent) + SAMPLE_BYTES * int(rng.integers(0, len(sent.samples) - 1))
    return good[:at] + b"\xff" * SAMPLE_BYTES + good[at + SAMPLE_BYTES :], {"gap"}


def _spare(rng: np.random.Generator, good: bytes, sent: Packet) -> tuple[bytes, set[str]]:
    stop = _samples_start(sent) + SAMPLE_BYTES * room_for_samples(sent.plan, navigation=sent.navigation)
    if stop == PACKET_BYTES:
        return good, set()
    data = bytearray(good)
    data[int(rng.integers(stop, PACKET_BYTES))] = int(rng.integers(0, 0xFF))
    return bytes(data), {"spare"}


Damage = Callable[[np.random.Generator, bytes, Packet], tuple[bytes, set[str]]]
DAMAGES: dict[str, Damage] = {
    "random length": _random_length,
    "random bytes": _random_bytes,
    "truncated": _truncated,
    "padded": _padded,
    "bits flipped": _flipped,
    "burst": _burst,
    "lost terminal": _lost_terminal,
    "reserved terminal": _reserved,
    "pairs": _bad_pairs,
    "tour": _bad_tour,
    "NaN or infinite": _not_finite,
    "position outside": _outside,
    "sample outside": _sample_outside,
    "gap": _gap,
    "spare bytes": _spare,
}


def judge(data: bytes, expected: set[str], limits: Limits | None) -> str:
    """The reason for which an input is refused, "decoded" if it is not.

    Raises:
        Finding: if anything but `PacketError` escapes, the reason is unknown or another one than expected, or what
            was decoded does not encode to the same bytes.
    """
    try:
        got = decode(data, limits)
    except PacketError as error:
        if error.reason not in REASONS or (expected and error.reason not in expected):
            raise Finding(f"{data.hex()}: {error}; expected {expected or 'a known reason'}") from error
        return error.reason
    except Exception as error:
        raise Finding(f"{data.hex()}: {type(error).__name__}: {error} escaped") from error
    if expected:
        raise Finding(f"{data.hex()}: decoded; expected {expected}")
    if encode(got, limits) != data:
        raise Finding(f"{data.hex()}: encodes to other bytes once decoded")
    return "decoded"


def fuzz(inputs: int, rng: np.random.Generator) -> dict[str, Counter[str]]:
    """Feeds this many inputs to the decoder; returns the reasons counted for each kind of damage.

    Raises:
        Finding: see `judge`.
    """
    counts: dict[str, Counter[str]] = {name: Counter() for name in DAMAGES}
    kinds = list(DAMAGES.items())
    good, sent = b"", packet(rng)
    for i in range(inputs):
        if i % 20 == 0:
            sent = packet(rng)
            good = encode(sent, LIMITS)
        name, damage = kinds[i % len(kinds)]
        data, expected = damage(rng, good, sent)
        # without limits the action set is unknown, so that only the damage itself is judged
        strict = bool(expected) or i % 2 == 0
        counts[name][judge(data, expected, LIMITS if strict else None)] += 1
    return counts


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the reasons for each kind of damage."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", type=int, nargs="?", default=1_000_000, metavar="N", help="(default: a million)")
    parser.add_argument("seed", type=int, nargs="?", default=0, metavar="SEED", help="(default: 0)")
    options = parser.parse_args(arguments)
    inputs = options.inputs
    counts = fuzz(inputs, np.random.default_rng(options.seed))
    for name, reasons in counts.items():
        print(f"{name:18}", ", ".join(f"{reason} {n}" for reason, n in reasons.most_common()))
    print(f"{inputs} inputs, only PacketError escaped")


if __name__ == "__main__":
    main()
