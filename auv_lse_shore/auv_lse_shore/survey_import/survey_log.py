"""The positions and depths of one log after the choice of its sources: what the track and the soundings come from."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from auv_lse_common.support.arrays import Array

#: Called with the share of a log that has been read, 0 to 1.
Progress = Callable[[float], None]

#: Faster than this (m/s), beyond `JUMP_M`, a track jumps.
MAX_SPEED_MPS, JUMP_M = 20.0, 5.0


class LogError(ValueError):
    """A log that cannot be imported; names the file, what is wrong with it, and the cure."""


@dataclass(slots=True, kw_only=True)
class SurveyLog:
    """One log of one vehicle.

    Attributes:
        positions: Rows (time s, latitude deg, longitude deg), or (time s, north m, east m) if not `is_geodetic`.
        depths: Rows (time s, depth of water m), below the surface, or below the vehicle if `immersion` is to be added.
        immersion: Rows (time s, depth of the vehicle m); a boat's is its transducer's, no rows if unknown.
        is_immersion_added: Whether `depths` contain it.
        is_geodetic: Whether positions are degrees.
        has_time: Whether the log has times; else they only number the soundings.
        is_utc: Whether times are seconds since 1970 UTC, or near it where a clock stood still (then not `has_time`);
            else they count from an unknown day or start.
        is_checked: Whether the soundings passed this project's checks in an earlier mission or import.
        position_std_m: Standard deviations north and east (m) that the log states for its positions, (n, 2), NaN where
            unknown; None if it states none. They are of estimated positions, whose errors have much in common.
        depth_std_m: Largest standard deviation (m) that it states for a depth; 0 if it states none.
        lag_std_s: Standard deviation (s) of the time between a depth's measurement and its stamp.
        left_out: Number of positions and depths that were left out, by reason.
        notes: What the numbers were read from.
        questions: What the log leaves open, with the option that answers it.
    """

    name: str
    positions: Array
    depths: Array
    immersion: Array = field(default_factory=lambda: np.empty((0, 2)))
    is_immersion_added: bool = True
    is_geodetic: bool = True
    has_time: bool = True
    is_utc: bool = True
    is_checked: bool = False
    position_std_m: Array | None = None
    depth_std_m: float = 0.0
    lag_std_s: float = 0.0
    left_out: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    questions: list[str] = field(default_factory=list)
