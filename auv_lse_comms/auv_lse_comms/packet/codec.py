"""Codec of the 252-byte packet: a vehicle's position, its planned path, and its samples (section 5).

`fields.py` defines the bytes. The sender's number is not among them: it is the source in the modem's header.
"""

import dataclasses
import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.vocabulary.plan import NONE, Plan, Tour
from auv_lse_comms.packet import navigation as nav
from auv_lse_comms.packet.fields import (
    ABORT,
    ACTION,
    BEARING,
    FILL,
    FIRST_TERMINAL,
    HEADER,
    HEADER_STRUCT,
    PACKET_BYTES,
    PAIRED,
    PAIRED_SET,
    PAIRS,
    PAIRS_HEADER,
    QUALITY,
    QUALITY_REACHED,
    RESERVED,
    SAMPLE,
    SAMPLE_BYTES,
    TERMINAL,
    TOUR,
    TOUR_HEADER,
    PacketField,
    are_paired,
    capacity,
    samples_start,
)
from auv_lse_comms.packet.navigation import Navigation

_SAMPLE_LOW = np.array([f.low for f in SAMPLE])
_SAMPLE_HIGH = np.array([f.high for f in SAMPLE])
_UNUSED = bytes([FILL]) * SAMPLE_BYTES


class PacketError(ValueError):
    """A packet that cannot be used.

    Attributes:
        reason: Short code by which it is counted, one of `REASONS`.
        clock_s: By how much clocks seem to be off (s), where the reason is a clock; NaN if unknown.
    """

    def __init__(self, reason: str, message: str, clock_s: float = math.nan) -> None:
        """With the code, a message, and by how much clocks seem to be off (s)."""
        super().__init__(f"{reason}: {message}")
        self.reason = reason
        self.clock_s = clock_s


#: Codes of `PacketError.reason` and their meanings. The last seven come from the bridge and the tag.
REASONS = {
    "length": "not 252 bytes",
    "step": "step beyond the mission",
    "not_finite": "a NaN or infinite number",
    "heading": "heading out of range",
    "position": "the path's start lies outside the area",
    "action": "an action that is not in the action set",
    "terminal": "no terminal byte ends the path, or too many actions",
    "pairs": "too few actions in pairs, or cut off; or one byte per action where the encoding in pairs is required",
    "tour": "a tour without segments, with more than 64, or longer than the mission",
    "naive_path": "a terminal byte that is reserved (0xE5 to 0xE9), a second tour or navigation, or one below 0xE0",
    "sample": "a sample outside the area or the range of depths",
    "gap": "a sample after an unused position",
    "spare": "spare bytes that are not 0xFF",
    "source": "not from a member of the team, or from the receiver itself",
    "excess": "more packets than their sender has slots",
    "tag": "the tag does not match: forged, altered, another key or another dive",
    "stale": "the tag belongs to another slot of its sender: an old packet, or clocks that differ",
    "replay": "received before, or sent in an earlier slot than the last packet of this sender",
    "implausible": "without a tag: its position or step does not follow the last packets of this sender",
    "unproven": "a clock was set back, and the packet has neither a later era nor a fresh echo",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits of a mission's packets: narrower ranges than those of the field table.

    Attributes:
        steps: Largest mission step.
        n_actions: Size of the action set.
        north_m: Smallest and largest north (m) of positions.
        east_m: Smallest and largest east (m) of positions.
        depth_m: Smallest and largest water depth (m) of samples.
    """

    steps: int = int(HEADER[0].high)
    n_actions: int = FIRST_TERMINAL
    north_m: tuple[float, float] = (SAMPLE[0].low, SAMPLE[0].high)
    east_m: tuple[float, float] = (SAMPLE[1].low, SAMPLE[1].high)
    depth_m: tuple[float, float] = (SAMPLE[2].low, SAMPLE[2].high)
    _low: Array = field(init=False, repr=False, compare=False)
    _high: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Checks that the limits are within the field table's ranges.

        Raises:
            ValueError: naming the limit, its value and the table's.
        """
        for name, value, table in (
            ("steps", (0, self.steps), HEADER[0]),
            ("n_actions", (0, self.n_actions - 1), ACTION),
            ("north_m", self.north_m, SAMPLE[0]),
            ("east_m", self.east_m, SAMPLE[1]),
            ("depth_m", self.depth_m, SAMPLE[2]),
        ):
            if not table.low <= value[0] <= value[1] <= table.high:
                raise ValueError(
                    f"limits: {name} is {value}, but must be low <= high within {table.low:g}..{table.high:g}"
                )
        object.__setattr__(self, "_low", np.array([self.north_m[0], self.east_m[0], self.depth_m[0]]))
        object.__setattr__(self, "_high", np.array([self.north_m[1], self.east_m[1], self.depth_m[1]]))

    def fits(self, samples_m: Array) -> Mask:
        """Which samples fit into a packet, shape (n,); samples are north, east, depth (m), shape (n, 3)."""
        with np.errstate(over="ignore"):
            small = np.asarray(samples_m).astype("<f4")
        return np.asarray(((small >= self._low) & (small <= self._high)).all(axis=1))

    @staticmethod
    def box(polygon_m: Array, margin_m: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """`north_m` and `east_m` of the box around the corners (P, 2) of an operating area, plus `margin_m` (m)."""
        low, high = np.min(polygon_m, axis=0) - margin_m, np.max(polygon_m, axis=0) + margin_m
        return (float(low[0]), float(high[0])), (float(low[1]), float(high[1]))


@dataclass(frozen=True, slots=True, eq=False)
class Packet:
    """The content of one packet: its sender's plan, and some of its samples.

    Attributes:
        plan: Start of the sender's path, its actions, its tour, and the naive path that continues it.
        samples: North (m), east (m), water depth (m, positive down), shape (n, 3).
        abort: Whether the sender calls the team to abort the mission; its plan then has no naive path.
        navigation: The sender's dead-reckoned position and last fix; the samples are then in its raw frame. None: the
            packet has neither, and the samples are at the positions that the sender's navigation estimated.
    """

    plan: Plan
    samples: Array = field(default_factory=lambda: np.zeros((0, 3)))
    abort: bool = False
    navigation: Navigation | None = None

    def __eq__(self, other: object) -> bool:
        """Whether all fields are equal."""
        if not isinstance(other, Packet):
            return NotImplemented
        same = self.plan == other.plan and self.abort == other.abort and self.navigation == other.navigation
        return same and np.array_equal(self.samples, other.samples)

    __hash__ = None  # type: ignore[assignment]  # holds an array


def room_for_samples(plan: Plan, reserve: int = 0, navigation: Navigation | None = None) -> int:
    """Number of samples that fit a packet with this plan and navigation; `reserve` bytes at the end are for a tag.

    Raises:
        ValueError: if the plan does not fit a packet.
    """
    before = _size(navigation) + _quality_size(plan)
    return capacity(len(plan.actions), reserve, _segments(plan.tour), before, are_paired(plan.actions))


def _segments(tour: Tour | None) -> int:
    return 0 if tour is None else len(tour.bearings)


def _size(navigation: Navigation | None) -> int:
    return 0 if navigation is None else navigation.size


def _quality_size(plan: Plan) -> int:
    return QUALITY_REACHED.size if plan.quality_reached else 0


def check_plan(
    plan: Plan, limits: Limits | None = None, reserve: int = 0, navigation_bytes: int = 0, abort: bool = False
) -> None:
    """Checks that a packet can hold a plan.

    Args:
        limits: Narrower ranges than those of the field table.
        reserve: Bytes at the end that stay free for a tag.
        navigation_bytes: Bytes of navigation in the packet.
        abort: Whether the packet calls the team to abort the mission.

    Raises:
        PacketError: (a ValueError) naming the field, its value and what was expected.
        TypeError: if the step or the naive path is not an integer.
    """
    step, naive_path, actions = operator.index(plan.step), operator.index(plan.naive_path), plan.actions
    _check("step", step, HEADER[0])
    _check_terminal(naive_path)
    if abort and naive_path != NONE:
        raise PacketError("naive_path", f"naive_path is {naive_path}, but a call to abort carries none ({NONE})")
    if any(not ACTION.low <= action <= ACTION.high for action in actions):
        raise PacketError("action", f"actions {list(actions)} must be indices 0..{ACTION.high:g}")
    _check_tour(plan.tour, limits)
    segments, before = _segments(plan.tour), navigation_bytes + _quality_size(plan)
    if samples_start(len(actions), segments, before, are_paired(actions)) > PACKET_BYTES - reserve:
        left = PACKET_BYTES - reserve - samples_start(0, segments, before)
        in_pairs = min(2 * (left - len(PAIRS_HEADER)), PAIRED[-1])
        most = in_pairs if max(actions) < PAIRED_SET and in_pairs in PAIRED else left
        beside = f" with a tour of {segments} segments" if segments else ""
        beside += f" and {navigation_bytes} bytes of navigation" if navigation_bytes else ""
        raise PacketError("terminal", f"{len(actions)} actions do not fit; at most {most} do{beside}")
    _check_start(step, plan.heading_rad, plan.north_m, plan.east_m, limits)
    _check_actions(actions, limits)


def encode(packet: Packet, limits: Limits | None = None, reserve: int = 0) -> bytes:
    """The packet's 252 bytes.

    Args:
        packet: The packet. Samples are rounded to float32, as the plan already is; nothing else is changed.
        limits: Narrower ranges than those of the field table.
        reserve: Bytes at the end that stay free (0xFF) for a tag.

    Raises:
        PacketError: (a ValueError) naming the field, its value and what was expected. Nothing is clamped, wrapped
            or left out.
        TypeError: if the step or the naive path is not an integer.
    """
    plan, navigation = packet.plan, packet.navigation
    check_plan(plan, limits, reserve, _size(navigation), packet.abort)
    samples = np.asarray(packet.samples, dtype=float)
    if samples.ndim != 2 or samples.shape[1] != len(SAMPLE):
        raise PacketError("sample", f"samples must have the shape (n, {len(SAMPLE)}), not {samples.shape}")
    if len(samples) > (room := room_for_samples(plan, reserve, navigation)):
        what = f"{len(plan.actions)} actions"
        what += f" and a tour of {_segments(plan.tour)} segments" if plan.tour else ""
        raise PacketError("sample", f"{len(samples)} samples do not fit; at most {room} do with {what}")
    with np.errstate(over="ignore"):
        small_samples = samples.astype("<f4")
    _check_samples(small_samples, limits)
    header = HEADER_STRUCT.pack(plan.step, plan.heading_rad, plan.north_m, plan.east_m)
    actions = _pairs_bytes(plan.actions) if are_paired(plan.actions) else bytes(plan.actions)
    navigation_bytes = b"" if navigation is None else navigation.to_bytes()
    terminal = bytes([QUALITY] * plan.quality_reached + [ABORT if packet.abort else plan.naive_path])
    used = header + actions + _tour_bytes(plan.tour) + navigation_bytes + terminal + small_samples.tobytes()
    return used.ljust(PACKET_BYTES, bytes([FILL]))


def decode(data: bytes | bytearray | memoryview, limits: Limits | None = None, reserve: int = 0) -> Packet:
    """The packet that 252 bytes hold.

    Args:
        data: Bytes from the water, of any length and content.
        limits: Narrower ranges than those of the field table.
        reserve: Bytes at the end that hold a tag, which is not checked here.

    Raises:
        PacketError: if the bytes are not a packet within the limits.
    """
    data = bytes(data)
    if len(data) != PACKET_BYTES:
        raise PacketError("length", f"{len(data)} bytes instead of {PACKET_BYTES}")
    step, heading, north, east = HEADER_STRUCT.unpack_from(data)
    _check_start(step, heading, north, east, limits)
    last = PACKET_BYTES - reserve
    actions, end = _read_actions(data[:last])
    paired = are_paired(actions)
    _check_actions(actions, limits)
    tour = _read_tour(data[end:last])
    _check_tour(tour, limits)
    segments = _segments(tour)
    after_path = samples_start(len(actions), segments, paired=paired) - 1  # the terminal byte, or the navigation
    size = nav.SIZES.get(data[after_path], 0)
    reached = data[after_path + size] == QUALITY if after_path + size < last else False
    start = after_path + size + reached + 1
    if start > last:
        raise PacketError("terminal", "no byte ends the path")
    navigation = Navigation.from_bytes(data[after_path : after_path + size]) if size else None
    abort = data[start - 1] == ABORT
    naive_path = NONE if abort else data[start - 1]
    _check_terminal(naive_path)
    positions = capacity(len(actions), reserve, segments, size + reached, paired)
    stop = start + positions * SAMPLE_BYTES
    n = positions
    while n and data[start + (n - 1) * SAMPLE_BYTES : start + n * SAMPLE_BYTES] == _UNUSED:
        n -= 1
    if data[stop:last].count(FILL) != last - stop:
        raise PacketError("spare", f"unused bytes {stop} to {last - 1} are {data[stop:last].hex()}, not all 0xFF")
    samples = np.frombuffer(data, "<f4", n * len(SAMPLE), start).reshape(n, len(SAMPLE))
    try:
        _check_samples(samples, limits)
    except PacketError:
        position = start + int(np.argmin(np.isfinite(samples).all(axis=1))) * SAMPLE_BYTES
        if data[position : position + SAMPLE_BYTES] == _UNUSED:
            raise PacketError("gap", f"the sample at byte {position} is unused, a later one is not") from None
        raise
    plan = Plan.at(step, np.array([heading, north, east]), actions, naive_path, tour)
    plan = dataclasses.replace(plan, quality_reached=reached)
    return Packet(plan, samples.astype(float), abort, navigation)


def _check(reason: str, value: float, table: PacketField) -> None:
    if not table.low <= value <= table.high:
        allowed = f"{table.low:g}..{table.high:g} {table.unit}".rstrip()
        raise PacketError(reason, f"{table.name} is {value}, outside {allowed}")


def _check_terminal(naive_path: int) -> None:
    _check("naive_path", naive_path, TERMINAL)
    if naive_path in RESERVED:
        raise PacketError("naive_path", f"naive_path is {naive_path}, but {RESERVED[0]}..{QUALITY - 1} are reserved")


def _check_start(step: int, heading: float, north: float, east: float, limits: Limits | None) -> None:
    for name, value in (("heading_rad", heading), ("north_m", north), ("east_m", east)):
        if not math.isfinite(value):
            raise PacketError("not_finite", f"{name} is {value}, not a finite float32")
    _check("heading", heading, HEADER[1])
    _check("position", north, HEADER[2])
    _check("position", east, HEADER[3])
    if limits is None:
        return
    if step > limits.steps:
        raise PacketError("step", f"step {step} is beyond the mission's {limits.steps} steps")
    for name, value, (low, high) in (("north_m", north, limits.north_m), ("east_m", east, limits.east_m)):
        if not low <= value <= high:
            raise PacketError("position", f"{name} is {value:.2f} m, outside the area's {low:g}..{high:g} m")


def _check_actions(actions: Sequence[int], limits: Limits | None) -> None:
    if limits is not None and actions and max(actions) >= limits.n_actions:
        raise PacketError("action", f"action {max(actions)}: the set has {limits.n_actions}")


def _check_tour(tour: Tour | None, limits: Limits | None) -> None:
    """Checks a tour, for senders and receivers alike."""
    if tour is None:
        return
    for value, table in ((tour.segment_legs, TOUR_HEADER[1]), (len(tour.bearings), TOUR_HEADER[2])):
        _check("tour", value, table)
    for bearing in tour.bearings:
        _check("tour", bearing, BEARING)
    if limits is not None and tour.legs - tour.segment_legs >= limits.steps:
        raise PacketError("tour", f"a tour of {tour.legs} legs is longer than the mission's {limits.steps} steps")


def _pairs_bytes(actions: Sequence[int]) -> bytes:
    """Two actions per byte, the earlier one in the low bits; 0xF fills the last byte of an odd number."""
    low, high = actions[::2], (*actions[1::2], FILL & 0xF)
    return bytes([PAIRS, len(actions), *(a | b << 4 for a, b in zip(low, high, strict=False))])


def _read_actions(data: bytes) -> tuple[tuple[int, ...], int]:
    """The actions in a packet's bytes up to the tag, and the index of the byte after them (>= `FIRST_TERMINAL`)."""
    start = end = HEADER_STRUCT.size
    pairs = data[start] == PAIRS
    if pairs:
        n = data[start + 1]
        start += len(PAIRS_HEADER)
        end = start + (n + 1) // 2
        halves = [half for byte in data[start:end] for half in (byte & 0xF, byte >> 4)]
        if n not in PAIRED or end >= len(data) or halves[n:] not in ([], [FILL & 0xF]):
            allowed = f"{PAIRED[0]}..{PAIRED[-1]} of them, and 0xF after the last of an odd number"
            raise PacketError("pairs", f"{n} actions in pairs; pairs hold {allowed}")
        return tuple(halves[:n]), end
    while end < len(data) and data[end] < FIRST_TERMINAL:
        end += 1
    if end == len(data):
        raise PacketError("terminal", f"no byte >= 0x{FIRST_TERMINAL:02X} ends the actions")
    actions = tuple(data[start:end])
    if are_paired(actions):
        raise PacketError("pairs", f"{len(actions)} actions below 16 have one byte each instead of being in pairs")
    return actions, end


def _tour_bytes(tour: Tour | None) -> bytes:
    return b"" if tour is None else bytes([TOUR, tour.segment_legs, len(tour.bearings), *tour.bearings])


def _read_tour(rest: bytes) -> Tour | None:
    """The tour at the beginning of `rest`, the bytes after the actions, unchecked; None if there is none."""
    if rest[0] != TOUR:
        return None
    n = len(TOUR_HEADER)
    if len(rest) <= n or len(rest) <= n + rest[2]:
        raise PacketError("terminal", "no byte ends the tour")
    return Tour(segment_legs=rest[1], bearings=tuple(rest[n : n + rest[2]]))


def _check_samples(samples: NDArray[np.float32], limits: Limits | None) -> None:
    if not len(samples):
        return
    low, high = (_SAMPLE_LOW, _SAMPLE_HIGH) if limits is None else (limits._low, limits._high)
    inside = (samples >= low) & (samples <= high)  # a NaN is not inside
    if inside.all():
        return
    row, column = (int(i) for i in np.argwhere(~inside)[0])
    value = float(samples[row, column])
    what = f"samples[{row}].{SAMPLE[column].name} is {value}, outside {low[column]:g}..{high[column]:g} m"
    raise PacketError("sample" if math.isfinite(value) else "not_finite", what)
