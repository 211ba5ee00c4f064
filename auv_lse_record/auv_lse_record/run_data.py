"""A mission's data in NumPy arrays: the input of evaluation and report.

A `RunData` comes from the fleet engine or from a recording (`run_reader.py`). Positions are north, east (m) on the
local tangent plane, times are mission time (s), headings are in rad, clockwise from north, and depths in m of water,
positive down.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.topics.records import Reception, Transmission
from auv_lse_common.vocabulary.dead_reckoning import Fix, MateNavigation
from auv_lse_common.vocabulary.plan import Plan
from auv_lse_common.vocabulary.sounding import Soundings


class DepthSource(Protocol):
    """An object with the true depth of water, such as `ground.Ground`."""

    def depth_m(self, north_m: Any, east_m: Any) -> Any:
        """True depth of water (m, positive down) at north, east (m); NaN where unknown or land."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DecisionRecord:
    """One published decision of a vehicle's planner.

    Attributes:
        step: Step at which the decided leg starts.
        plan: The published plan; the step of a kept plan can be less than `step`.
        jbar: Value Jbar (or J without a naive path) of the plan, in units of risk.
        reward_so_far: Reward of the legs travelled so far, in units of risk.
        lower_bound: The planner's time-varying lower bound.
        lower_bound_max: Running maximum of `lower_bound`.
        wall_s: Wall-clock time of planning; NaN if not recorded.
        method: The planning method ("augmented", "plain", ...).
        void: Whether the previous plan had been discarded or lost, so that it could not be continued.
    """

    now_s: float
    step: int
    plan: Plan
    jbar: float
    reward_so_far: float
    lower_bound: float
    lower_bound_max: float
    wall_s: float = float("nan")
    method: str = ""
    void: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class PacketReceived(Reception):
    """A payload that the modem of vehicle `receiver` received intact.

    Attributes:
        stamp_s: End of the reception.
        snr_db: Signal-to-noise ratio at the receiver; NaN if unknown.
        sent_s: Start of transmission by the sender's clock; NaN if unknown.
        arrival_s: Start of reception by the receiver's clock; NaN if unknown.
        travel_s: One-way travel time, measured with both clocks; NaN if unknown.
    """

    receiver: int


#: Columns of a vehicle's arrays.
_COLUMNS = {
    "truth": 4,
    "odometry": 4,
    "position_std_m": 2,
    "dead_reckoning": 5,
}


def _rows(columns: int) -> Array:
    return np.empty((0, columns))


@dataclass(slots=True, kw_only=True)
class VehicleRun:
    """Tracks, measurements, receptions and decisions of one vehicle.

    Attributes:
        truth: True track, rows (time s, north m, east m, heading rad).
        odometry: Estimated track (INS), rows (time s, north m, east m, heading rad).
        soundings: Own measurements, at estimated positions.
        received: Samples received from the team, stamped with their arrival, in order of time.
        decisions: Every decision of its planner, in time order.
        position_std_m: Standard deviation (m) of the position in each row of `odometry`, columns (north, east); no rows
            if unknown.
        dead_reckoning: Raw track, rows (time s, north m, east m, heading rad, depth of the vehicle m).
        fixes: Fixes taken under way, in order of time.
        mates: Navigation data of received packets, in order of time.
        ended_early: Why its mission ended or was aborted before its last leg; "" if it did not.
        unfinished_legs: How many of the legs decided last are not complete when its mission, or its recording,
            ends: the one on which it is, and perhaps the next, which is decided a little earlier.
        battery: Last values of `LEGS_LEFT`, `LEGS_PLANNED` and `BATTERY_LASTS` while its mission ran; empty if unknown.
    """

    vehicle: int
    truth: Array = field(default_factory=lambda: _rows(4))
    odometry: Array = field(default_factory=lambda: _rows(4))
    soundings: Soundings = field(default_factory=lambda: Soundings.from_rows(()))
    received: Soundings = field(default_factory=lambda: Soundings.from_rows(()))
    decisions: list[DecisionRecord] = field(default_factory=list)
    position_std_m: Array = field(default_factory=lambda: _rows(2))
    dead_reckoning: Array = field(default_factory=lambda: _rows(5))
    fixes: list[Fix] = field(default_factory=list)
    mates: list[MateNavigation] = field(default_factory=list)
    ended_early: str = ""
    unfinished_legs: int = 0
    battery: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Checks the shapes.

        Raises:
            ValueError: naming the array, its shape and the shape expected.
        """
        for name, columns in _COLUMNS.items():
            rows = np.asarray(getattr(self, name), dtype=float)
            if rows.size == 0:
                rows = _rows(columns)
            if rows.ndim != 2 or rows.shape[1] != columns:
                raise ValueError(f"auv{self.vehicle} {name} must have the shape (n, {columns}), not {rows.shape}")
            setattr(self, name, rows)
        count, expected = len(self.position_std_m), len(self.odometry)
        if count not in (0, expected):
            raise ValueError(f"auv{self.vehicle} position_std_m has {count} rows, but odometry has {expected}")

    def position_std_at(self, stamps_s: Array) -> Array:
        """Standard deviation (m) of the vehicle's position at times (n,), columns (north, east); NaN if unknown."""
        if len(self.position_std_m) == 0:
            return np.full((len(stamps_s), 2), np.nan)
        times = self.odometry[:, 0]
        return np.column_stack([np.interp(stamps_s, times, self.position_std_m[:, c]) for c in (0, 1)])

    @property
    def span_s(self) -> tuple[float, float] | None:
        """When its mission began, and the time of its last position or sounding; None without any.

        A simulation begins at 0, another mission with its first leg, a survey with its first position or sounding.
        """
        stamps = np.concatenate([self.odometry[:, 0], self.soundings.stamp_s])
        if not len(stamps):
            return None
        begin_s = 0.0 if len(self.truth) else self.decisions[0].now_s if self.decisions else stamps.min()
        return float(begin_s), float(stamps.max())

    @property
    def steps(self) -> int:
        """Number of legs travelled, as the simulator counts them: those decided, except those that were cut off."""
        decided = max((d.step for d in self.decisions), default=-1) + 1
        return max(decided - self.unfinished_legs, 0)

    @property
    def travelled(self) -> list[DecisionRecord]:
        """The decisions whose legs were travelled."""
        return [d for d in self.decisions if d.step < self.steps]


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundGrid:
    """True depth on the evaluation grid.

    Attributes:
        north_m: North of the rows, shape (R,), ascending.
        east_m: East of the columns, shape (C,), ascending.
        depth_m: True depth (m), shape (R, C); NaN where unknown or land.
        inside: Whether a position is in the operating area, shape (R, C).
    """

    north_m: Array
    east_m: Array
    depth_m: Array
    inside: Mask

    @property
    def resolution_m(self) -> float:
        """Spacing of the grid (m)."""
        return float(self.north_m[1] - self.north_m[0])

    @property
    def scored(self) -> Mask:
        """Evaluated cells: inside the area and of known depth, shape (R, C)."""
        scored: Mask = self.inside & np.isfinite(self.depth_m)
        return scored

    @property
    def locations_m(self) -> Array:
        """All positions of the grid, row by row, shape (R * C, 2): north, east."""
        north, east = np.meshgrid(self.north_m, self.east_m, indexing="ij")
        return np.column_stack([north.ravel(), east.ravel()])

    @classmethod
    def sample(cls, ground: DepthSource, north_m: Array, east_m: Array, inside: Mask) -> GroundGrid:
        """The true ground on a grid; `inside` (R, C): whether a position is in the operating area."""
        north, east = np.meshgrid(north_m, east_m, indexing="ij")
        depth = np.asarray(ground.depth_m(north.ravel(), east.ravel()), dtype=float).reshape(north.shape)
        return cls(north_m=np.asarray(north_m), east_m=np.asarray(east_m), depth_m=depth, inside=np.asarray(inside))


def origin_of(parameters: Mapping[str, Mapping[str, Any]]) -> tuple[float, float] | None:
    """Latitude and longitude (deg, WGS84) of north = east = 0 in a mission file's `area`; None without them."""
    area = parameters_for(parameters, "/auv1/planner_node").get("area", {})
    latitude, longitude = area.get("origin_lat_deg"), area.get("origin_lon_deg")
    return None if latitude is None or longitude is None else (float(latitude), float(longitude))


@dataclass(slots=True, kw_only=True)
class RunData:
    """A whole mission.

    Attributes:
        parameters: The complete mission file: {node pattern ("/**", "/auv2/**"): nested parameters}.
        vehicles: One entry per vehicle, in order of number.
        sent: Every payload transmitted, in time order.
        received: Every payload received, in time order.
        ground: True ground on the evaluation grid; None if unknown.
        end_s: Time of the last message (s).
        wall_s: Wall-clock duration (s); NaN if not recorded.
        origin: Latitude and longitude (deg, WGS84) of north = east = 0; None if unknown.
        notes: Remarks for the report (a start was moved, a deadline was hit, a node died).
    """

    parameters: Mapping[str, Mapping[str, Any]]
    vehicles: list[VehicleRun]
    sent: list[Transmission] = field(default_factory=list)
    received: list[PacketReceived] = field(default_factory=list)
    ground: GroundGrid | None = None
    end_s: float = 0.0
    wall_s: float = float("nan")
    origin: tuple[float, float] | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def mission_s(self) -> float:
        """Time (s) during which a mission of any vehicle lasted; pauses between dives do not count."""
        total_s, until_s = 0.0, -math.inf
        for begin_s, end_s in sorted(span for vehicle in self.vehicles if (span := vehicle.span_s)):
            total_s += max(end_s - max(begin_s, until_s), 0.0)
            until_s = max(until_s, end_s)
        return total_s

    @property
    def steps(self) -> int:
        """Largest number of legs travelled by any vehicle."""
        return max((v.steps for v in self.vehicles), default=0)
