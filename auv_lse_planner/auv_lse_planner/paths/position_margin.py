"""Margin from the border that follows the uncertainty of a vehicle's position.

`area.margin_m` covers turns and a position with a standard deviation of up to that distance. Where the deviation
towards the border is larger, a vehicle keeps `DEVIATIONS` of them from the border. Only the next legs of a plan are
compared with this margin. Feasible actions and the paths of team mates depend on `area.margin_m` alone, so a growing
margin makes no plan void.
"""

# The functions that numba compiles have no annotations: it infers types itself, per call.
# mypy: disable-error-code="no-untyped-def"
import math
from dataclasses import dataclass, field

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_common.support.compiled import compiled
from auv_lse_planner.paths.free_space import FreeSpace, bilinear

#: Standard deviations of the position that a vehicle keeps from the border: errors exceed them once in 160 times.
DEVIATIONS = 2.5
#: Number of next legs that keep this margin. Later legs are planned again, when the position may be known better.
LEGS = 16
#: Shortfalls with a smaller sum of squares (m^2) are tolerated.
TOLERATED_M2 = 10.0
#: Covariance (m^2) of an exact position.
EXACT = np.zeros((2, 2))


@compiled
def room_shortfall(space, room, locations, margin, covariance):
    """Sum of the squared missing clearances (m^2) at locations (P, 2), bilinear on the raster, and its gradient (P, 2).

    The clearance needed is `room`. Where the position's standard deviation s towards the border exceeds `margin` (m),
    which the raster contains, it is larger by `DEVIATIONS` s - `margin`. The gradient ignores changes of the border's
    direction.

    Args:
        covariance: Covariance of the vehicle's position (m^2), (2, 2); `EXACT` for the room alone.
    """
    raster, cell = space.raster, space.cell
    total = 0.0
    gradient = np.zeros(locations.shape)
    rows, columns = raster.shape
    for p in range(locations.shape[0]):
        x = min(max((locations[p, 0] - space.north0) / cell, 0.0), rows - 1.001)
        y = min(max((locations[p, 1] - space.east0) / cell, 0.0), columns - 1.001)
        i, j, u, _, low, high = bilinear(raster, x, y)
        left = raster[i, j] * (1.0 - u) + raster[i + 1, j] * u
        right = raster[i, j + 1] * (1.0 - u) + raster[i + 1, j + 1] * u
        north, east = (high - low) / cell, (right - left) / cell
        variance = north * (north * covariance[0, 0] + 2.0 * east * covariance[0, 1]) + east * east * covariance[1, 1]
        needed = room
        if variance > margin * margin:
            needed += DEVIATIONS * math.sqrt(variance) - margin
        shortfall = needed - (low * (1.0 - u) + high * u)
        if shortfall > 0.0:
            total += shortfall * shortfall
            gradient[p, 0] = -2.0 * shortfall * north
            gradient[p, 1] = -2.0 * shortfall * east
    return total, gradient


@dataclass(frozen=True, slots=True)
class PositionMargin:
    """The margin of one decision.

    Attributes:
        covariance_m2: Covariance of the position: north, east, shape (2, 2); zeros if it is exact or unknown.
    """

    covariance_m2: Array = field(default_factory=EXACT.copy)

    def is_wider(self, space: FreeSpace) -> bool:
        """Whether the margin exceeds `area.margin_m` in any direction."""
        return float(np.linalg.eigvalsh(self.covariance_m2)[-1]) > space.margin_m**2

    def shortfall_m2(self, space: FreeSpace, locations_m: Array, room_m: float = 0.0) -> tuple[float, Array]:
        """Sum of the squared clearances (m^2) that locations (P, 2) lack in the area, and its gradient (P, 2).

        Args:
            room_m: Clearance to keep in addition to the margin.
        """
        covariance = np.ascontiguousarray(self.covariance_m2)
        total, gradient = room_shortfall(space.arguments(static=True), room_m, locations_m, space.margin_m, covariance)
        return float(total), np.asarray(gradient)
