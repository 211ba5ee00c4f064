"""Estimates the size of a recording before the mission.

The constants come from the default mission, compressed (docs/evidence/runtime.md).
"""

import math
from dataclasses import dataclass

import numpy as np

from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import UNWATCHED_PERIODS, GpConfig
from auv_lse_common.mission_file.sections.mission import MissionConfig, MotionConfig
from auv_lse_common.mission_file.sections.record import RecordConfig
from auv_lse_common.mission_file.settings import Settings

#: A recording begins with the definitions of its messages (MB).
START_MB = 0.15
#: Bytes that a vehicle records each second beside maps: positions, soundings, packets, plans, health, and the index.
BASE_BYTES_PER_S = 700.0
#: A published map with its isobath and kernel centers, for each cell (B), and the shares that compression leaves of
#: cells without and with a sounding within a length scale.
MAP_BYTES_PER_CELL = 22.0
BLANK_COMPRESSED, SOUNDED_COMPRESSED = 0.04, 0.34
#: With record.map_bytes_per_s = 0 every change of the kernel centers is recorded: bytes each second for each second of
#: the mission, of a center, and their compression.
CENTERS_BYTES_PER_S2, CENTER_BYTES, CENTERS_COMPRESSED = 10.0, 36.0, 0.4


@dataclass(frozen=True, slots=True, kw_only=True)
class SizeEstimate:
    """Expected size of recordings (MB): of one vehicle, and of a simulated mission of all vehicles."""

    vehicle_mb: float
    mission_mb: float


def estimate_size(
    mission: MissionConfig, motion: MotionConfig, area: AreaConfig, gp: GpConfig, record: RecordConfig, speed_mps: float
) -> SizeEstimate:
    """The expected size of a mission's recording, within about a factor of 1.5.

    Args:
        mission: Number of legs and vehicles.
        motion: Length of a leg.
        area: Size of the map.
        gp: Resolution of the map, and how often it is published.
        record: How much of the maps is recorded.
    """
    path_m = mission.steps * math.radians(motion.theta_max_deg) * motion.turn_radius_m
    duration_s = path_m / speed_mps
    extent_m = np.ptp(np.reshape(area.polygon_m, (-1, 2)), axis=0)
    map_bytes = MAP_BYTES_PER_CELL * float(np.prod(np.ceil(extent_m / gp.map_resolution_m)))
    rate, centers = map_bytes / (UNWATCHED_PERIODS * gp.publish_period_s), 0.0
    if record.map_bytes_per_s > 0.0:
        rate = min(rate, record.map_bytes_per_s)
    else:
        centers = CENTERS_COMPRESSED * min(CENTERS_BYTES_PER_S2 * duration_s, CENTER_BYTES * gp.max_centers)
    most = (
        mission.vehicles * path_m * 2.0 * gp.length_scale_m / float(np.prod(extent_m))
    )  # 1: the end has no blank cell
    sounded = 0.5 * most if most < 1.0 else 1.0 - 0.5 / most  # in the mean over the mission
    compressed = BLANK_COMPRESSED + sounded * (SOUNDED_COMPRESSED - BLANK_COMPRESSED)
    each_s = BASE_BYTES_PER_S + compressed * rate + centers
    vehicle_mb = 1e-6 * (each_s * duration_s + 2.0 * compressed * map_bytes)
    return SizeEstimate(vehicle_mb=START_MB + vehicle_mb, mission_mb=START_MB + mission.vehicles * vehicle_mb)


def size_of(settings: Settings) -> SizeEstimate:
    """As `estimate_size`, from a whole mission file; the first vehicle's sections count for all."""
    own = settings.vehicles[0]
    return estimate_size(
        settings.mission, settings.motion, settings.area, own.gp, settings.record, own.vehicle.speed_mps
    )


def lack_of_space(needed_mb: float, free_mb: float, least_free_mb: float) -> str:
    """Text for a disk without enough space for a recording; "" if it has enough."""
    room_mb = max(free_mb - least_free_mb, 0.0)
    if needed_mb <= room_mb:
        return ""
    return (
        f"record.folder has {room_mb:.0f} MB of free space beyond record.least_free_mb ({least_free_mb:g} MB), "
        f"but the recording needs about {max(needed_mb, 1.0):.0f} MB. Free space, or lower record.map_bytes_per_s"
    )
