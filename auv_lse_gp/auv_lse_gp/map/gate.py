"""Checks a sounding before it enters the map: plausible numbers, and no outlier."""

import math

import numpy as np

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.vocabulary.frames import FARTHEST_M


class SoundingError(ValueError):
    """An implausible sounding: not finite, or out of range."""


def check_sounding(config: GpConfig, north_m: float, east_m: float, depth_m: float) -> None:
    """Rejects an implausible sounding.

    Raises:
        SoundingError: if a number is not finite, or the depth or location out of range.
    """
    if not (math.isfinite(north_m) and math.isfinite(east_m) and math.isfinite(depth_m)):
        raise SoundingError(f"sounding: north_m={north_m!r}, east_m={east_m!r}, depth_m={depth_m!r} must be finite")
    if not config.min_depth_m <= depth_m <= config.max_depth_m:
        raise SoundingError(
            f"sounding at north {north_m:.1f} m, east {east_m:.1f} m: depth_m={depth_m!r} is implausible; "
            f"plausible are {config.min_depth_m:g} to {config.max_depth_m:g} m (gp.min_depth_m, gp.max_depth_m)"
        )
    if max(abs(north_m), abs(east_m)) > FARTHEST_M:
        raise SoundingError(
            f"sounding: north_m={north_m!r}, east_m={east_m!r} is not within 1000 km of the local origin"
        )


def plausible(config: GpConfig, rows: Array) -> Mask:
    """Mask (n,) of the rows (n, 3) of north, east, depth (m) that `check_sounding` accepts."""
    with np.errstate(invalid="ignore"):
        deep = (config.min_depth_m <= rows[:, 2]) & (rows[:, 2] <= config.max_depth_m)
        near = (np.abs(rows[:, :2]) <= FARTHEST_M).all(axis=1)
    return np.asarray(np.isfinite(rows).all(axis=1) & deep & near)


def within_gate(config: GpConfig, residuals_m: Array, variance_m2: Array, sigmas: float) -> Mask:
    """Mask (P,) of soundings whose residuals (P,), of variances (P,) plus the noise's, are within `sigmas`."""
    return np.asarray(np.abs(residuals_m) <= sigmas * np.sqrt(variance_m2 + config.noise_std_m**2))
