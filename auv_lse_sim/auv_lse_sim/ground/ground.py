"""The interface `Ground`: the bottom that the simulated vehicles measure.

Depth is water depth in metres below the still surface, positive down. NaN means unknown ground or land. `lake.py`
generates synthetic ground, `ground_files.py` reads ground from files.
"""

from typing import Any, Protocol

from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.extent import Extent


class Ground(Protocol):
    """A bottom with a known depth."""

    @property
    def extent(self) -> Extent:
        """The rectangle outside of which every depth is NaN."""

    @property
    def origin(self) -> tuple[float, float] | None:
        """WGS84 latitude and longitude (deg) of the local origin, None if it has none."""

    def depth_m(self, north_m: Any, east_m: Any) -> Array:
        """Water depth (m, positive down) at locations of any broadcastable shape; NaN where unknown or land."""

    def describe(self) -> str:
        """One or two sentences for the log and the report."""


class GroundError(ValueError):
    """Invalid bathymetry; the message names the file, the line or array, and what was expected."""
