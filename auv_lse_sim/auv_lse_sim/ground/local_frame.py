"""Whether the coordinates of a file fit the mission's local frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from auv_lse_gp.soundings import FAR_M, is_far
from auv_lse_sim.ground.ground import GroundError

Array = NDArray[np.float64]


def ranges(north: Array, east: Array) -> str:
    """The ranges of places (m), for messages."""
    return f"north from {north.min():.0f} to {north.max():.0f} m, east from {east.min():.0f} to {east.max():.0f} m"


def check_near(path: Path, north: Array, east: Array, lat: Array, lon: Array, origin: tuple[float, float]) -> None:
    """Refuses geodetic data that lie far from the mission's origin.

    Raises:
        GroundError: naming both.
    """
    if is_far(north, east):
        raise GroundError(
            f"{path}: latitude {lat.min():.5f} to {lat.max():.5f}, longitude {lon.min():.5f} to {lon.max():.5f} deg, "
            f"all farther than {FAR_M / 1000:g} km from the mission's area.origin_lat_deg, origin_lon_deg = "
            f"{origin[0]:g}, {origin[1]:g}; expected an origin near the data: change it, or leave both out"
        )
