"""What lies under the water: the `Ground` that the simulated vehicles sound.

Depth is water depth in metres, positive down, referred to the still surface. NaN means that the ground is unknown
there, or that it is land. `lake.py` draws synthetic ground, `ground_files.py` reads ground from files.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.vocabulary.extent import Extent

Array = NDArray[np.float64]


class Ground(Protocol):
    """Ground that can be sounded."""

    @property
    def extent(self) -> Extent:
        """The rectangle outside which every depth is NaN."""

    @property
    def origin(self) -> tuple[float, float] | None:
        """WGS84 latitude and longitude (deg) of the local origin, None if it is nowhere on Earth."""

    def depth_m(self, north_m: Any, east_m: Any) -> Array:
        """Water depth (m, positive down) at places of any broadcastable shape; NaN where unknown or land."""

    def describe(self) -> str:
        """One or two sentences for the log and the report."""


class GroundError(ValueError):
    """Bathymetry that cannot be used; names the file, the line or array, and what was expected."""
