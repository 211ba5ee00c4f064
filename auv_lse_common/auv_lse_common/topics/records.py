"""The contents of messages as plain values; `codecs.py` encodes and decodes them.

Positions are north, east (m) in the local tangent plane. Depths are in m, positive down, headings in rad, clockwise
from north. `stamp_s` is the stamp of the message's header (s). Defaults apply to recordings of older versions that lack
the field.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.dead_reckoning import UNKNOWN, Covariance
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import RunStatus, Stop
from auv_lse_common.vocabulary.plan import Plan

#: Time (s) in a message's own field, in addition to its header.
Time = float


@dataclass(frozen=True, slots=True, kw_only=True)
class Odometry:
    """Position and motion of a vehicle.

    Attributes:
        covariance: Rows and columns: heading, north, east; all zeros if unknown, as in nav_msgs.
        yaw_rate_radps: Yaw rate, positive to starboard.
    """

    stamp_s: float
    heading_rad: float
    north_m: float
    east_m: float
    depth_m: float = 0.0
    speed_mps: float = 0.0
    yaw_rate_radps: float = 0.0
    covariance: Covariance = UNKNOWN

    @property
    def position_std_m(self) -> tuple[float, float]:
        """Standard deviation of north and east (m); 0 if unknown."""
        return math.sqrt(max(self.covariance[1][1], 0.0)), math.sqrt(max(self.covariance[2][2], 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class GeodeticPosition:
    """Position of a vehicle on the WGS84 ellipsoid, as its navigation estimates it.

    Attributes:
        covariance: Of east and north (m2), rows and columns in this order; all zeros if unknown.
    """

    stamp_s: float
    lat_deg: float
    lon_deg: float
    depth_m: float = 0.0
    covariance: tuple[tuple[float, float], tuple[float, float]] = ((0.0, 0.0), (0.0, 0.0))

    @classmethod
    def of(cls, position: Any, origin_deg: tuple[float, float]) -> GeodeticPosition:
        """The position of an `Odometry`, or of an object with the same attributes.

        Args:
            origin_deg: Latitude and longitude (deg) of north = east = 0.
        """
        lat_deg, lon_deg = geodetic_from_local(position.north_m, position.east_m, *origin_deg)
        _, (_, north, north_east), (_, _, east) = getattr(position, "covariance", UNKNOWN)
        return cls(
            stamp_s=position.stamp_s,
            lat_deg=float(lat_deg),
            lon_deg=float(lon_deg),
            depth_m=float(position.depth_m),
            covariance=((east, north_east), (north_east, north)),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Altitude:
    """Height over ground (m), and the range of its sensor; not finite: no echo."""

    stamp_s: float
    altitude_m: float
    min_m: float = 0.2
    max_m: float = 200.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Pressure:
    """Absolute pressure of the water (Pa)."""

    stamp_s: float
    pressure_pa: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionOrder:
    """A command to a vehicle's mission; the fields are those of MissionCommand.msg."""

    stamp_s: float
    command: int
    team: bool = False
    source: str = ""
    number: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class RunReport:
    """The state of a vehicle's mission with its revision, and the exceeded limits that only warn."""

    stamp_s: float
    revision: int
    status: RunStatus
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CentersReport:
    """Kernel centers of a map: positions (n, 2), depths and noise (n,), effects of position errors (n, r) or None."""

    stamp_s: float
    revision: int
    locations_m: Array
    depths_m: Array
    noise_std_m: Array
    position_effect_m: Array | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FieldReport:
    """A map on its grid: axes north (ny,), east (nx,) in m; layers (ny, nx), NaN outside the area.

    Messages hold the layers as float32.
    """

    stamp_s: float
    north_m: Array
    east_m: Array
    level_m: float
    variance_scale: float
    mean_m: NDArray[Any]
    std_m: NDArray[Any]
    risk: NDArray[Any]
    p_safe: NDArray[Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanReport:
    """The plan of `vehicle`, decided or received at `stamp_s`."""

    stamp_s: float
    vehicle: int
    plan: Plan


@dataclass(frozen=True, slots=True, kw_only=True)
class Waypoint:
    """The next leg to travel.

    Attributes:
        depth_m: Commanded depth.
        end: Heading (rad), north, east (m) at the leg's end.
        then: Action after the mission's last leg; None for other legs.
    """

    stamp_s: float
    leg: Leg
    speed_mps: float
    depth_m: float
    end: tuple[float, float, float]
    then: Stop | None


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundReport:
    """Value and lower bound of one decision; the fields are those of Bound.msg."""

    stamp_s: float
    step: int
    jbar: float
    reward_so_far: float
    lower_bound: float
    lower_bound_max: float
    incumbent_value: float = math.nan
    incumbent_kept: bool = False
    iterations: int = 0
    planning_s: float = math.nan
    deadline_hit: bool = False
    map_revision: int = 0
    plans_heard: int = 0
    odometry_taken: Time = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Transmission:
    """A packet to send, or a ping of `destination`; the fields are those of ModemTx.msg."""

    stamp_s: float
    source: int
    destination: int = 0
    ping: bool = False
    payload: bytes = b""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reception:
    """A received packet, or an answered ping; the fields are those of ModemRx.msg."""

    stamp_s: float
    source: int
    destination: int = 0
    snr_db: float = math.nan
    sent_s: float = math.nan
    arrival_s: float = math.nan
    travel_s: float = math.nan
    ping: bool = False
    payload: bytes = b""


@dataclass(frozen=True, slots=True, kw_only=True)
class TdmaReport:
    """Schedule and counts of an acoustic bridge; the fields are those of TdmaStatus.msg."""

    stamp_s: float
    vehicle: int
    slot_owner: int
    own_slot: bool
    next_own_slot: float
    slots_used: int
    slots_missed: int
    packets_received: int
    reasons: tuple[str, ...]
    counts: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SimReport:
    """Progress of a simulated mission; the fields are those of SimStatus.msg."""

    stamp_s: float
    state: int
    message: str
    steps: tuple[int, ...]
    steps_total: int
    packets_sent: int
    packets_received: int
    packets_lost: int
    speed: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthReport:
    """Diagnostics of the node or device `name`; `level` as in diagnostic_msgs/DiagnosticStatus (3: stale)."""

    stamp_s: float
    name: str
    level: int
    text: str
    values: Mapping[str, Any]
