"""Ground that the map shows as too shallow for a vehicle: it is blocked in the vehicle's free space."""

import numpy as np

from auv_lse_common.mission_file.operating_area import Grid
from auv_lse_common.mission_file.sections.vehicle import SHALLOWEST_M, VehicleConfig
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_planner.methods.ground_window import GroundWindow
from auv_lse_planner.paths.free_space import FreeSpace

#: Ground is checked this far (m) beyond the reach of a plan's legs, to leave room for turns.
BEYOND_M = 100.0


class ShallowGround:
    """Keeps the shallow ground of one vehicle's free space up to date."""

    def __init__(self, space: FreeSpace, window: GroundWindow, grid: Grid, limit_m: float) -> None:
        """Starts without shallow ground.

        Args:
            space: Where it is blocked.
            window: The map.
            grid: Locations that are checked.
            limit_m: Ground that is less deep is too shallow.
        """
        self._space, self._window, self._grid, self._limit_m = space, window, grid, limit_m
        self._shallow = np.zeros(len(grid.locations_m), dtype=bool)
        self._depths_m = np.full(len(grid.locations_m), np.inf)  # expected, where it was checked last

    def update_window(self) -> None:
        """Checks all ground of the window."""
        self._set(self._window.covers(self._grid.locations_m))

    def update_around(self, position_m: Array, legs_m: float) -> None:
        """Checks the ground within reach of legs of a total length from a location (2,)."""
        self._set(self._within(position_m, legs_m))

    def update_ahead(self, position_m: Array, legs_m: float) -> None:
        """Like `update_around`, but with the last centers, which the window may lack; other ground does not change.

        Raises:
            IllConditionedError: if the centers there cannot be factorized; nothing changes.
        """
        near = self._within(position_m, legs_m)
        local = self._window.around(position_m, legs_m + BEYOND_M)
        shallow = self._is_shallow(near, local.mean_m(self._grid.locations_m[near]))
        if not np.array_equal(self._shallow[near], shallow):
            self._shallow[near] = shallow
            self._block(near | self._window.covers(self._grid.locations_m))

    def _within(self, position_m: Array, legs_m: float) -> Mask:
        off_m = np.hypot(*(self._grid.locations_m - position_m).T)
        return np.asarray(off_m <= legs_m + BEYOND_M)

    def _set(self, checked: Mask) -> None:
        self._shallow[:] = False
        self._shallow[checked] = self._is_shallow(checked, self._window.mean_m(self._grid.locations_m[checked]))
        self._block(checked)

    def _is_shallow(self, checked: Mask, depths_m: Array) -> Mask:
        """Whether checked locations of these mean depths are too shallow, or too near to a bank."""
        banks = self._window.posterior.banks
        if banks is not None and len(depths_m):
            depths_m = banks.depths(self._grid.locations_m[checked], depths_m)
        self._depths_m[checked] = depths_m
        return np.asarray(depths_m < self._limit_m)

    def travel_depth_m(self, leg: Leg, vehicle: VehicleConfig) -> float:
        """Depth (m) at which a vehicle keeps `vehicle.min_altitude_m` above the map's ground along a leg."""
        if vehicle.min_altitude_m <= 0.0 or vehicle.depth_m <= SHALLOWEST_M:
            return vehicle.depth_m
        ahead_m = np.linspace(0.0, leg.length_m, max(2, round(leg.length_m / self._grid.resolution_m) + 1))
        points = np.array([leg.state_at(float(m))[1:] for m in ahead_m])
        near = np.hypot(*(self._grid.locations_m[:, None] - points).T).min(axis=0) <= 0.75 * self._grid.resolution_m
        least_m = float(self._depths_m[near].min(initial=np.inf))
        return min(vehicle.depth_m, max(least_m - vehicle.min_altitude_m, SHALLOWEST_M))

    def _block(self, checked: Mask) -> None:
        self._space.set_shallow(self._grid.locations_m[checked], self._shallow[checked], self._grid.resolution_m)
