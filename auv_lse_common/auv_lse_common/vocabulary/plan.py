"""A plan: the intended path that a vehicle sends to its team mates (paper, section 5)."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_lse_common.support.arrays import Array

#: `Plan.naive_path` of a plan without a naive path.
NONE = 0xFF
#: Largest number of actions in a set: in a packet, a byte below this is an action.
MAX_ACTION_SET = 0xE0
#: Number of directions of a tour's segment: multiples of 1/256 of a turn, one byte each.
BEARINGS = 256
#: Largest number of segments of a tour.
MAX_SEGMENTS = 64
#: Largest length of a tour's segment, in legs.
MAX_SEGMENT_LEGS = 255

# Rounded to float32, so that the table does not depend on the mathematical library.
_AHEAD = [(float(np.float32(math.cos(a))), float(np.float32(math.sin(a)))) for a in np.arange(256) * (math.pi / 128)]
# Relative tolerance of a segment's length, for the table's rounding.
_ROUNDED = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Tour:
    """The rest of a mission as straight segments of equal length, one byte each.

    A tour consists of directions only; it begins where the plan's actions end.

    Attributes:
        segment_legs: Length of a segment in legs, 1 to `MAX_SEGMENT_LEGS`.
        bearings: Directions of the 1 to `MAX_SEGMENTS` segments (1/256 of a turn, clockwise from north).
    """

    segment_legs: int
    bearings: tuple[int, ...]

    def __post_init__(self) -> None:
        """Converts the numbers to integers without checking their ranges (`is_sound`).

        Raises:
            TypeError: if a number is not an integer.
        """
        object.__setattr__(self, "segment_legs", operator.index(self.segment_legs))
        object.__setattr__(self, "bearings", tuple(operator.index(bearing) for bearing in self.bearings))

    @classmethod
    def from_fields(cls, segment_legs: int, bearings: Sequence[int]) -> Tour | None:
        """The tour of a message's two fields; None for 0 and no bearings."""
        if segment_legs == 0 and len(bearings) == 0:
            return None
        return cls(segment_legs=segment_legs, bearings=tuple(bearings))

    @property
    def is_sound(self) -> bool:
        """Whether all numbers are in their ranges."""
        return (
            1 <= self.segment_legs <= MAX_SEGMENT_LEGS
            and 1 <= len(self.bearings) <= MAX_SEGMENTS
            and all(0 <= bearing < BEARINGS for bearing in self.bearings)
        )

    @property
    def legs(self) -> int:
        """Length of the tour, in legs."""
        return self.segment_legs * len(self.bearings)

    def waypoints_m(self, start_m: Array, leg_m: float) -> Array:
        """Waypoints, shape (segments + 1, 2): north, east (m); the first one is the start.

        All arithmetic is scalar, so that all receivers compute identical waypoints.

        Args:
            start_m: North, east (m) of the tour's start, shape (2,).

        Raises:
            ValueError: if the tour is not sound.
        """
        if not self.is_sound:
            raise ValueError(
                f"{self} is out of range: segment_legs must be 1..{MAX_SEGMENT_LEGS}, with 1..{MAX_SEGMENTS} "
                f"bearings of 0..{BEARINGS - 1}"
            )
        segment_m = self.segment_legs * float(leg_m)
        north, east = float(start_m[0]), float(start_m[1])
        waypoints = [(north, east)]
        for bearing in self.bearings:
            north += segment_m * _AHEAD[bearing][0]
            east += segment_m * _AHEAD[bearing][1]
            waypoints.append((north, east))
        return np.array(waypoints)

    @classmethod
    def through(cls, waypoints_m: Array, segment_legs: int, leg_m: float) -> Tour:
        """The tour along a polyline.

        Each segment leads from the end of the previous rounded one to the position where the polyline first is a
        segment's length away. So rounding errors of bearings do not accumulate: every waypoint except the last is
        within pi / 256 of a segment's length (0.6 m for 47 m) of the polyline. Segments cut corners, so the tour is
        shorter than the polyline. A rest of at least half a segment becomes a whole one. A polyline that is never a
        segment's length away becomes one segment, towards its farthest corner.

        Args:
            waypoints_m: Corners of the polyline, including the tour's start: north, east (m), shape (n, 2).
            segment_legs: Length of a segment, in legs.

        Raises:
            ValueError: if the polyline is not of that shape, not finite, a single position, or too long for
                `MAX_SEGMENTS` segments; or if `segment_legs` is out of range.
        """
        corners = np.asarray(waypoints_m, dtype=float)
        if corners.ndim != 2 or corners.shape[1:] != (2,) or not len(corners) or not np.isfinite(corners).all():
            raise ValueError(f"waypoints_m must be finite north, east of shape (n, 2); its shape is {corners.shape}")
        if not 1 <= segment_legs <= MAX_SEGMENT_LEGS:
            raise ValueError(f"segment_legs must be 1..{MAX_SEGMENT_LEGS}, not {segment_legs}")
        segment_m = segment_legs * float(leg_m)
        on_line, *ahead = [(north, east) for north, east in corners.tolist()]
        north, east = on_line
        bearings: list[int] = []
        while True:
            while ahead and math.hypot(ahead[0][0] - north, ahead[0][1] - east) < segment_m * (1.0 - _ROUNDED):
                on_line = ahead.pop(0)
            if ahead:
                on_line = _leaving(on_line, ahead[0], (north, east), segment_m)
            if not ahead and not bearings:  # the polyline stays near its start: towards its farthest corner
                on_line = max(map(tuple, corners.tolist()), key=lambda c: math.hypot(c[0] - north, c[1] - east))
            rest_m = math.hypot(on_line[0] - north, on_line[1] - east)
            if not ahead and (rest_m < 0.5 * segment_m if bearings else rest_m == 0.0):
                break
            if len(bearings) == MAX_SEGMENTS:
                raise ValueError(
                    f"a polyline of {length_m(corners):.0f} m needs more than {MAX_SEGMENTS} segments of "
                    f"{segment_m:g} m; choose longer segments (segment_legs is {segment_legs})"
                )
            bearing = round(math.atan2(on_line[1] - east, on_line[0] - north) * (BEARINGS / math.tau)) % BEARINGS
            bearings.append(bearing)
            north += segment_m * _AHEAD[bearing][0]
            east += segment_m * _AHEAD[bearing][1]
            if not ahead:
                break
        if not bearings:
            raise ValueError(f"waypoints_m {corners.tolist()} never leave the start; give a polyline of some length")
        return cls(segment_legs=segment_legs, bearings=tuple(bearings))


def _leaving(
    inside_m: tuple[float, float], outside_m: tuple[float, float], center_m: tuple[float, float], radius_m: float
) -> tuple[float, float]:
    """North, east (m) where the line from a position inside a circle to one on or outside it leaves the circle."""
    to_n, to_e = outside_m[0] - inside_m[0], outside_m[1] - inside_m[1]
    off_n, off_e = inside_m[0] - center_m[0], inside_m[1] - center_m[1]
    a, b = to_n * to_n + to_e * to_e, off_n * to_n + off_e * to_e
    c = off_n * off_n + off_e * off_e - radius_m * radius_m
    along = 1.0 if a == 0.0 else min(1.0, (-b + math.sqrt(max(0.0, b * b - a * c))) / a)
    return inside_m[0] + along * to_n, inside_m[1] + along * to_e


def length_m(line_m: Array) -> float:
    """Length (m) of a polyline (n + 1, 2)."""
    return float(np.hypot(*np.diff(line_m, axis=0).T).sum())


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A vehicle's path to the end of its mission, as a packet carries it.

    The state is rounded to float32, as in the packet, so that sender and receivers build the path from the same
    numbers. The vehicle is not part of the plan; the packet's header contains it.

    Attributes:
        step: Mission step of the state; step i is reached after i actions.
        heading_rad: Heading of the state (rad, clockwise from north).
        north_m, east_m: Position of the state.
        actions: Indices into the action set.
        naive_path: Id of the naive path after the actions and the tour, or `NONE`.
        tour: The tour after the actions; None: no tour.
        quality_reached: Whether its vehicle's map has the quality that `mission.until` asks for.
    """

    step: int
    heading_rad: float
    north_m: float
    east_m: float
    actions: tuple[int, ...]
    naive_path: int
    tour: Tour | None = None
    quality_reached: bool = False

    def __post_init__(self) -> None:
        """Rounds the state to float32; numbers beyond its range become infinite, and cannot be encoded.

        Raises:
            TypeError: if an action is not an integer.
        """
        with np.errstate(over="ignore"):
            for name in ("heading_rad", "north_m", "east_m"):
                object.__setattr__(self, name, float(np.float32(getattr(self, name))))
        object.__setattr__(self, "actions", tuple(operator.index(action) for action in self.actions))

    @classmethod
    def at(cls, step: int, state: Array, actions: tuple[int, ...], naive_path: int, tour: Tour | None = None) -> Plan:
        """The plan from a state (3,): heading (rad), north, east (m)."""
        heading, north, east = (float(v) for v in state)
        return cls(
            step=step,
            heading_rad=heading,
            north_m=north,
            east_m=east,
            actions=actions,
            naive_path=naive_path,
            tour=tour,
        )

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Plan:
        """The plan from the result of `dataclasses.asdict`, also after conversion to and from JSON."""
        tour = values["tour"]
        return cls(**{**values, "tour": None if tour is None else Tour(**tour)})

    @property
    def tour_fields(self) -> tuple[int, tuple[int, ...]]:
        """The tour as a message's two fields, `segment_legs` and `bearings`; 0 and () without a tour."""
        return (0, ()) if self.tour is None else (self.tour.segment_legs, self.tour.bearings)

    @property
    def state(self) -> Array:
        """Heading (rad), north, east (m), shape (3,)."""
        return np.array([self.heading_rad, self.north_m, self.east_m])
