"""The packet's layout as one table, from which sizes, ranges, the codec and the documentation derive."""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_lse_common.mission_file.sections.acoustics import SAMPLE_DEPTHS_M
from auv_lse_common.vocabulary.plan import BEARINGS, MAX_ACTION_SET, MAX_SEGMENT_LEGS, MAX_SEGMENTS, NONE

#: Bytes of every packet: one frame of the Micromodem holds 256.
PACKET_BYTES = 252
#: The first byte of the path that is at least this ends the actions.
FIRST_TERMINAL = MAX_ACTION_SET
#: Ends the actions of a plan with a tour, which follows.
TOUR = 0xEF
#: Ends the path of a vehicle that calls the team to abort the mission.
ABORT = 0xEE
#: Begins a path with two actions per byte.
PAIRS = 0xEB
#: Precedes the byte that ends the path, if the sender's map has the quality that `mission.until` asks for.
QUALITY = 0xEA
#: Numbers of actions that are encoded in pairs, if each action is below `PAIRED_SET`: longer than a search plans.
PAIRED = range(17, 256)
PAIRED_SET = 16
#: Bytes from `FIRST_TERMINAL` on that are not ids of naive paths: `TOUR`, `ABORT`, `PAIRS`, `QUALITY`, navigation's,
#: and reserved.
RESERVED = range(0xE5, 0xF0)
#: Fills unused bytes.
FILL = 0xFF

_CODES = {"uint8": "B", "uint16": "H", "float32": "f"}


@dataclass(frozen=True, slots=True, kw_only=True)
class PacketField:
    """One number on the wire, little-endian.

    Attributes:
        name: Its name in `Plan`, or in a sample.
        type: "uint8", "uint16" or "float32".
        unit: SI unit, "" for none.
        low: Smallest value, inclusive, representable in the type.
        high: Largest value, inclusive, representable in the type.
        meaning: One line for the documentation.
    """

    name: str
    type: str
    unit: str = ""
    low: float
    high: float
    meaning: str

    @property
    def code(self) -> str:
        """Letter of the type in `struct`."""
        return _CODES[self.type]

    @property
    def size(self) -> int:
        """Bytes on the wire."""
        return struct.calcsize("<" + self.code)


def _float32(value: float) -> float:
    return float(np.float32(value))


#: Where the sender's path begins.
HEADER = (
    PacketField(name="step", type="uint16", low=0, high=0xFFFF, meaning="mission step of the initial state"),
    PacketField(
        name="heading_rad",
        type="float32",
        unit="rad",
        low=_float32(-2.0 * math.pi),
        high=_float32(2.0 * math.pi),
        meaning="heading there, clockwise from north",
    ),
    PacketField(name="north_m", type="float32", unit="m", low=-1e6, high=1e6, meaning="north of the map's origin"),
    PacketField(name="east_m", type="float32", unit="m", low=-1e6, high=1e6, meaning="east of the map's origin"),
)
#: Repeated once per action.
ACTION = PacketField(name="actions", type="uint8", low=0, high=FIRST_TERMINAL - 1, meaning="index in the action set")
#: Once, before the actions, if they are encoded in pairs.
PAIRS_HEADER = (
    PacketField(name="pairs", type="uint8", low=PAIRS, high=PAIRS, meaning="two actions per byte"),
    PacketField(name="n_actions", type="uint8", low=PAIRED[0], high=PAIRED[-1], meaning="number of actions"),
)
#: Then once per pair of actions, the earlier one in the low bits; 0xF completes the last pair of an odd number.
PAIR = PacketField(name="actions", type="uint8", low=0, high=0xFF, meaning="two indices in the action set")
#: Once, after the actions, if the plan has a tour.
TOUR_HEADER = (
    PacketField(name="tour", type="uint8", low=TOUR, high=TOUR, meaning="ends the actions: a tour follows"),
    PacketField(
        name="segment_legs", type="uint8", low=1, high=MAX_SEGMENT_LEGS, meaning="length of each segment in legs"
    ),
    PacketField(name="segments", type="uint8", low=1, high=MAX_SEGMENTS, meaning="number of segments"),
)
#: Repeated once per segment of the tour.
BEARING = PacketField(
    name="bearings",
    type="uint8",
    unit="1/256 turn",
    low=0,
    high=BEARINGS - 1,
    meaning="direction of each segment, clockwise from north",
)
#: Once, before the byte that ends the path, if the map has the quality asked for.
QUALITY_REACHED = PacketField(
    name="quality_reached",
    type="uint8",
    low=QUALITY,
    high=QUALITY,
    meaning="quality reached",
)
#: Once, after the actions, the tour, navigation and `QUALITY_REACHED`.
TERMINAL = PacketField(
    name="naive_path",
    type="uint8",
    low=FIRST_TERMINAL,
    high=NONE,
    meaning="ends the path: 0xFF without a naive path, 0xEE likewise and the team must abort, else the id of the naive "
    "path that continues to the mission's end",
)
#: Repeated once per sample; an unused position holds 12 bytes 0xFF.
SAMPLE = (
    PacketField(name="north_m", type="float32", unit="m", low=-1e6, high=1e6, meaning="north of the map's origin"),
    PacketField(name="east_m", type="float32", unit="m", low=-1e6, high=1e6, meaning="east of the map's origin"),
    PacketField(
        name="depth_m",
        type="float32",
        unit="m",
        low=SAMPLE_DEPTHS_M[0],
        high=SAMPLE_DEPTHS_M[1],
        meaning="water depth, positive down",
    ),
)

HEADER_STRUCT = struct.Struct("<" + "".join(field.code for field in HEADER))
SAMPLE_BYTES = sum(field.size for field in SAMPLE)
_PAIRS_HEADER_BYTES = sum(field.size for field in PAIRS_HEADER)
_TOUR_HEADER_BYTES = sum(field.size for field in TOUR_HEADER)
#: Largest number of actions, one byte each and without a tour, that leaves room for the terminal byte.
MAX_ACTIONS = (PACKET_BYTES - HEADER_STRUCT.size - TERMINAL.size) // ACTION.size

if HEADER_STRUCT.size != sum(field.size for field in HEADER) or MAX_ACTIONS < 1:
    raise AssertionError(f"the field table does not fit a packet of {PACKET_BYTES} bytes")


def are_paired(actions: Sequence[int]) -> bool:
    """Whether a path's actions are encoded in pairs, two per byte; each sequence of actions has one encoding."""
    return len(actions) in PAIRED and max(actions) < PAIRED_SET


def path_bytes(n_actions: int, segments: int = 0, paired: bool = False) -> int:
    """Size in bytes of a plan's path: its actions, its tour, and the terminal byte.

    Args:
        segments: Segments of its tour, 0 if there is none.
        paired: Whether its actions are encoded in pairs (`are_paired`).
    """
    actions = _PAIRS_HEADER_BYTES + (n_actions + 1) // 2 * PAIR.size if paired else n_actions * ACTION.size
    tour = _TOUR_HEADER_BYTES + segments * BEARING.size if segments else 0
    return actions + tour + TERMINAL.size


def samples_start(n_actions: int, segments: int = 0, navigation: int = 0, paired: bool = False) -> int:
    """Index of the first byte of a packet's samples; the arguments are those of `capacity`."""
    return HEADER_STRUCT.size + path_bytes(n_actions, segments, paired) + navigation


def capacity(n_actions: int, reserve: int = 0, segments: int = 0, navigation: int = 0, paired: bool = False) -> int:
    """Number of samples that fit a packet.

    Args:
        n_actions: Actions in the packet, 0 to `MAX_ACTIONS`, in pairs up to the end of `PAIRED`.
        reserve: Bytes at the end reserved for the tag, 0 if there is none.
        segments: Segments of the tour in the packet, 0 if there is none.
        navigation: Bytes of navigation and `QUALITY_REACHED` in the packet, 0 without.
        paired: Whether the actions are encoded in pairs (`are_paired`).

    Raises:
        ValueError: if the actions, the tour and the reserve do not fit the packet.
    """
    room = PACKET_BYTES - reserve - samples_start(n_actions, segments, navigation, paired)
    if n_actions < 0 or reserve < 0 or segments < 0 or room < 0:
        tour = f", a tour of {segments} segments" if segments else ""
        tour += f", {navigation} bytes of navigation" if navigation else ""
        raise ValueError(
            f"{n_actions} actions{tour} and {reserve} bytes of tag do not fit a packet of {PACKET_BYTES} bytes; "
            f"use at most {PACKET_BYTES - reserve - samples_start(0, segments, navigation)} actions"
        )
    return room // SAMPLE_BYTES
