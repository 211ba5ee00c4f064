"""Conversions between angles and frames (see docs/reference/frames.md).

The stack uses north, east (m) on the local tangent plane, and headings (rad) clockwise from north. ROS messages use the
ENU map frame (REP 103): x east, y north, z up, yaw counter-clockwise from east.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from auv_lse_common.support.arrays import Array

#: Largest plausible distance (m) from the map's origin, north or east.
FARTHEST_M = 1e6
#: What lies farther than this (m) from a local origin has another one: it is UTM, a wrong origin, or another lake.
FAR_M = 100_000.0


def wrap_pi(angle_rad: Any) -> Any:
    """Angle (scalar or array, rad) wrapped to [-pi, pi)."""
    return (np.asarray(angle_rad) + math.pi) % (2.0 * math.pi) - math.pi


def is_possible(heading_rad: float, north_m: float, east_m: float) -> bool:
    """Whether a state is plausible: finite, heading within a turn, position within `FARTHEST_M` of the origin."""
    turn = 2.0 * math.pi * (1.0 + 1e-6)  # 2 pi in float32 is slightly larger
    return abs(heading_rad) <= turn and abs(north_m) <= FARTHEST_M and abs(east_m) <= FARTHEST_M


def yaw_from_heading(heading_rad: float) -> float:
    """ENU yaw (rad, counter-clockwise from east) of a heading (rad, clockwise from north), in [-pi, pi)."""
    return float(wrap_pi(math.pi / 2.0 - heading_rad))


def heading_from_yaw(yaw_rad: float) -> float:
    """Heading (rad, clockwise from north) of an ENU yaw (rad), in [-pi, pi)."""
    return float(wrap_pi(math.pi / 2.0 - yaw_rad))


def quaternion_from_heading(heading_rad: float) -> tuple[float, float, float, float]:
    """Quaternion (x, y, z, w) in ENU of a level vehicle with this heading (rad, clockwise from north)."""
    half = yaw_from_heading(heading_rad) / 2.0
    return (0.0, 0.0, math.sin(half), math.cos(half))


def heading_from_quaternion(x: float, y: float, z: float, w: float) -> float:
    """Heading (rad, clockwise from north) of an ENU attitude quaternion."""
    return heading_from_yaw(math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def unwrapped_deg(lon_deg: Any) -> Array:
    """Longitudes (deg) without a jump between them.

    From 0 to 360 if some lie on both sides of the antimeridian, from -180 to 180 if they are written from 0 to 360 and
    lie on both sides of Greenwich.
    """
    lon = np.asarray(lon_deg, float)
    if not lon.size or float(np.ptp(lon)) <= 180.0:
        return lon
    from_0, from_180 = lon % 360.0, (lon + 180.0) % 360.0 - 180.0
    return from_180 if float(np.ptp(from_180)) <= 180.0 < float(np.ptp(from_0)) else from_0


@lru_cache(maxsize=8)
def _projection(lat0_deg: float, lon0_deg: float) -> Any:
    from pyproj import Proj

    return Proj(proj="aeqd", lat_0=lat0_deg, lon_0=lon0_deg, datum="WGS84", units="m")


def geodetic_from_local(north_m: Any, east_m: Any, lat0_deg: float, lon0_deg: float) -> tuple[Array, Array]:
    """WGS84 latitude and longitude (deg) of local positions (azimuthal equidistant about the origin)."""
    lon, lat = _projection(lat0_deg, lon0_deg)(np.asarray(east_m, float), np.asarray(north_m, float), inverse=True)
    return np.asarray(lat), np.asarray(lon)


def local_from_geodetic(lat_deg: Any, lon_deg: Any, lat0_deg: float, lon0_deg: float) -> tuple[Array, Array]:
    """Local north and east (m) of WGS84 positions (azimuthal equidistant about the origin)."""
    east, north = _projection(lat0_deg, lon0_deg)(np.asarray(lon_deg, float), np.asarray(lat_deg, float))
    return np.asarray(north), np.asarray(east)
