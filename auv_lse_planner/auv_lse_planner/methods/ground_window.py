"""The part of the map that the planner uses.

In a large area, the map is *limited* to the cells that the remaining legs can reach. A short mission plans with all of
them. In a long one, the cost of a decision would grow with their number and with the number of soundings. The window is
therefore *focused* on the path of the next legs, and refocused every few legs. Its *cells* are those near the path
whose risk can still fall; ground that is surveyed and certain is *settled*. The posterior holds the centers near these
cells, averaged if they are not close. It is conditioned on new centers only when plans are evaluated (`update`).
Elsewhere, risk and mean are updated when the window is focused, tile by tile, where centers were added or removed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from auv_lse_common.mission_file.operating_area import Grid, OperatingArea
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.centers import NO_CENTERS, Centers
from auv_lse_gp.inference.factor import IllConditionedError
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Least spacing (m) of the cells over which the gradient of a reward is summed, except in narrow areas.
COARSE_M = 30.0
#: Largest number of cells of a map that is not limited: limiting it would save nothing.
MANY_CELLS = 5000
#: A map is limited to cells within the first distance from the legs, and limited again when the vehicle's drift leaves
#: less than the second; in length scales of the kernel.
REACH_SCALES, LEAST_REACH_SCALES = 3.0, 2.0
#: Cells of the window lie at most this far from its path, in length scales of the kernel.
CELLS_SCALES = 1.5
#: Ground is settled if its risk, relative to the largest possible, is at most this, and a center is at most this far
#: away, in length scales.
SETTLED_SHARE, SETTLED_SCALES = 1e-3, 0.5
#: Elsewhere, the risk is updated this far from centers that were added or removed, in length scales.
STALE_SCALES = 2.0
#: Side (m) of the square tiles in which risk and mean elsewhere are updated.
TILE_M = 300.0
#: Locations to be measured count if they are at most this far from a cell of the window, in length scales.
LOCATIONS_SCALES = 2.5
#: Distances from the cells up to which centers count, and beyond which they are averaged, in length scales. Closely
#: sounded ground screens farther centers: the second pair applies if the first leaves more than `MOST_EXACT` of them.
MARGINS, MOST_EXACT = ((2.5, 1.25), (1.5, 0.6)), 400
#: Side of the square cells in which centers are averaged, in the kernel's lengths.
AVERAGED_SIDE = 0.4


class GroundWindow:
    """The posterior at the cells near a path; before the first `focus`, at all cells.

    Attributes:
        grid: The map's cells; after `limit`, those within reach.
        posterior: The posterior given the centers near the cells.
        is_focused: Whether it covers only a part of the map.
        elsewhere_risk: Risk of the map's other cells when the window was focused.
        refused: Why the posterior does not hold the last centers; "" if it does.
        most_centers: Largest number of centers before the first focus, if not None; more are averaged. So a planner
            that restarts late in a long mission does not condition on all of them.
    """

    def __init__(
        self, posterior: Posterior, gp: GpConfig, level_set: LevelSetConfig, map_grid: Grid, coarse_grid: Grid
    ) -> None:
        self.posterior = posterior
        self.refused = ""
        self.most_centers: int | None = None
        self._scale_m = max(gp.length_scale_m, gp.length_scale_2_m)
        self._levels = LevelSet.of(level_set)
        self._whole = map_grid, coarse_grid
        self._reach: tuple[Array, float] | None = None  # middle (2,) and radius (m) of the cells within reach
        self._centers = NO_CENTERS
        self._is_current = True  # whether the posterior holds `_centers`
        self._set_grids(map_grid, coarse_grid)

    @classmethod
    def of(cls, settings: PlannerSettings, area: OperatingArea, posterior: Posterior, spacing_m: float) -> GroundWindow:
        """The map of an area, with cells of `planner.map_spacing_m`.

        Raises:
            ParameterError: if these are too many, or none lies in the area.
        """
        grids = (
            area.grid(spacing_m, "planner.map_spacing_m"),
            area.grid(max(area.cell_m(COARSE_M), spacing_m)),
        )
        return cls(posterior, settings.gp, settings.level_set, *grids)

    def _set_grids(self, grid: Grid, coarse_grid: Grid) -> None:
        self.grid, self._coarse_grid = grid, coarse_grid
        self.is_focused, self.elsewhere_risk = False, 0.0
        self._covered = grid.inside.copy()  # cells near the path, settled or not
        self._distance_m = np.zeros(grid.inside.shape)  # of each cell from the window's cells
        self._fine: CachedPoints | None = None
        self._coarse: CachedPoints | None = None
        self._cells: NDArray[np.int64] = np.zeros(0, dtype=np.int64)  # numbers of the window's cells
        self._risk: Array = np.zeros(0)  # of all cells when they were last updated; empty before the first focus
        self._mean_m: Array = np.zeros(0)  # likewise
        self._count = np.zeros(grid.inside.shape)  # centers in each cell then

    @property
    def fine(self) -> CachedPoints:
        """The posterior at the window's cells."""
        self.update()
        if self._fine is None:
            self._fine = CachedPoints(self.posterior, self.grid.locations_m)
        return self._fine

    @property
    def coarse(self) -> CachedPoints:
        """The posterior at the window's cells of the coarse grid."""
        self.update()
        if self._coarse is None:
            self._coarse = CachedPoints(self.posterior, self._coarse_grid.locations_m)
        return self._coarse

    @property
    def centers(self) -> Centers:
        """All centers of the map."""
        return self._centers

    def limit(self, middle_m: Array, legs_m: float) -> bool:
        """Limits a large map to the cells within reach of legs of a total length from a location (2,).

        Cells that these legs cannot measure do not affect the choice between paths. Later legs of the same mission
        reach no other cells unless the vehicle drifts; the map is then limited anew.

        Returns:
            Whether the map's cells changed.
        """
        if np.count_nonzero(self._whole[0].inside) <= MANY_CELLS:
            return False
        if self._reach is not None:
            off_m = float(np.hypot(*(middle_m - self._reach[0])))
            if off_m + legs_m + LEAST_REACH_SCALES * self._scale_m <= self._reach[1]:
                return False
        self._reach = np.array(middle_m), legs_m + REACH_SCALES * self._scale_m
        grid, coarse_grid = (each.within(*self._reach) for each in self._whole)
        if grid.inside.shape == self.grid.inside.shape and np.array_equal(grid.locations_m, self.grid.locations_m):
            return False
        self._set_grids(grid, coarse_grid)
        self._is_current = False
        return True

    def set_centers(self, centers: Centers) -> None:
        """Sets all centers of the map. A focused window's posterior takes them at the next `update`."""
        self._centers, self._is_current = centers, False
        if not self.is_focused:
            self.update()

    def update(self) -> None:
        """Conditions the posterior on the centers that were set last."""
        if not self._is_current:
            self._condition()

    def near(self, locations_m: Array) -> Mask:
        """Mask (P,) of the locations (P, 2) that are near enough to change the window's cells."""
        if self.is_focused:
            return self._distance_at_m(locations_m) <= LOCATIONS_SCALES * self._scale_m
        if self._reach is None:
            return np.ones(len(locations_m), dtype=bool)
        off_m = np.hypot(*(locations_m - self._reach[0]).T)
        return np.asarray(off_m <= self._reach[1] + LOCATIONS_SCALES * self._scale_m)

    def covers(self, locations_m: Array) -> Mask:
        """Mask (P,) of the locations (P, 2) near the path, on settled ground too."""
        return np.asarray(self._covered[self._index(locations_m)])

    def mean_m(self, locations_m: Array) -> Array:
        """Mean depth (P,) at covered locations (P, 2); on settled ground, that of the nearest cell at the last
        focus."""
        if not self.is_focused:
            return self.posterior.mean_m(locations_m)
        field = self.grid.fill(self._mean_m)
        mean_m, settled = field[self._index(locations_m)], self._distance_at_m(locations_m) > 0.0
        mean_m[~settled] = self.posterior.mean_m(locations_m[~settled])
        return mean_m

    def around(self, position_m: Array, radius_m: float) -> Posterior:
        """The posterior within a circle about a location (2,), given the centers in it and near it.

        Raises:
            IllConditionedError: if they cannot be factorized.
        """
        off_m = np.hypot(*(self._centers.locations_m - position_m).T)
        local = self.posterior.blank()
        local.follow(self._centers.take(np.flatnonzero(off_m <= radius_m + MARGINS[-1][0] * self._scale_m)))
        return local

    @property
    def risks_elsewhere(self) -> Array:
        """Risk of each cell outside of the window (C,), when the window was focused."""
        return np.delete(self._risk, self._cells)

    def focus(self, path_m: Array) -> None:
        """Focuses the window on a path (P, 2)."""
        grid = self.grid
        self._update_map()
        self._covered = self._near(path_m, CELLS_SCALES) & grid.inside
        surveyed = self._near(self._centers.locations_m, SETTLED_SCALES)
        settled = surveyed & (grid.fill(self._risk) <= SETTLED_SHARE * self._levels.largest_risk)
        on = self._covered & ~settled
        on = on if on.any() else self._covered
        self._distance_m = np.asarray(distance_transform_edt(~on)) * grid.resolution_m
        self.is_focused = True
        self._condition()
        self._cells = np.flatnonzero(on[grid.inside])
        self._fine = CachedPoints(self.posterior, grid.locations_m[self._cells])
        coarse_m = self._coarse_grid.locations_m
        inside = self._distance_at_m(coarse_m) <= 0.0
        self._coarse = CachedPoints(self.posterior, coarse_m[inside] if inside.any() else self._fine.locations_m)
        self.elsewhere_risk = float(self._risk.sum() - self._risk[self._cells].sum())

    def release(self) -> None:
        """Covers the whole map again."""
        if self.is_focused:
            self.is_focused, self.elsewhere_risk, self.most_centers = False, 0.0, None
            self._fine = self._coarse = None
            self._covered, self._distance_m = self.grid.inside.copy(), np.zeros(self.grid.inside.shape)
            self._condition()

    def _condition(self) -> None:
        c, self._is_current = self._centers, True
        if self.is_focused and len(c):
            c = self._thinned(c)
        elif self.most_centers is not None:
            c = self._averaged(c, self.most_centers)
        try:
            self.posterior.follow(c)
            self.refused = ""
        except IllConditionedError as error:
            self.refused = f"map: {error}"

    def _averaged(self, centers: Centers, most: int) -> Centers:
        """At most `most` centers: averages in square cells, if there are more."""
        scaled, found, side = self.posterior.kernel.scale(centers.locations_m), centers, AVERAGED_SIDE
        while len(found) > most:
            found, side = centers.averaged(np.floor(scaled / side).astype(np.int64)), 1.5 * side
        return found

    def _thinned(self, centers: Centers) -> Centers:
        """The centers near the window's cells; those not close to them are averaged."""
        far_m, found = self._distance_at_m(centers.locations_m), centers
        for counts, averaged in MARGINS:
            kept = np.flatnonzero(far_m <= counts * self._scale_m)
            found = centers.take(kept)
            far = far_m[kept] > averaged * self._scale_m
            keys = np.column_stack([np.arange(len(found)), np.full((len(found), 2), -1)])
            cells = np.floor(self.posterior.kernel.scale(found.locations_m[far]) / AVERAGED_SIDE)
            keys[far] = np.column_stack([np.full(len(cells), -1), cells])
            found = found.averaged(keys) if len(found) else found
            if len(found) <= MOST_EXACT:
                break
        return found

    def _update_map(self) -> None:
        """Updates risk and mean of all cells near which centers were added or removed."""
        grid, everywhere = self.grid, self.grid.locations_m
        count = np.zeros(grid.inside.shape)
        np.add.at(count, self._index(self._centers.locations_m), 1.0)
        if not len(self._risk):
            self._risk, self._mean_m = np.zeros(len(everywhere)), np.zeros(len(everywhere))
            self._set_map(np.arange(len(everywhere)), NO_CENTERS)
        changed = count != self._count
        self._count = count
        if not changed.any():
            return
        near = np.asarray(distance_transform_edt(~changed)) * grid.resolution_m <= STALE_SCALES * self._scale_m
        stale = np.flatnonzero(near[grid.inside])
        tiles, tile = np.unique(np.floor(everywhere[stale] / TILE_M), axis=0, return_inverse=True)
        for number, corner in enumerate(tiles * TILE_M):
            off = np.abs(self._centers.locations_m - (corner + 0.5 * TILE_M)).max(axis=1)
            close = np.flatnonzero(off <= 0.5 * TILE_M + LOCATIONS_SCALES * self._scale_m)
            self._set_map(stale[tile.ravel() == number], self._centers.take(close))

    def _set_map(self, cells: NDArray[np.int64], centers: Centers) -> None:
        """Sets risk and mean of some cells given the centers near them."""
        local = self.posterior.blank()
        local.follow(centers)
        mean_m, variance_m2 = local.moments(self.grid.locations_m[cells])
        self._mean_m[cells], self._risk[cells] = mean_m, self._levels.risk(mean_m, np.sqrt(variance_m2))

    def _near(self, locations_m: Array, scales: float) -> Mask:
        """Mask (ny, nx) of the cells within a number of length scales of locations (P, 2)."""
        off = np.ones(self.grid.inside.shape, dtype=bool)
        off[self._index(locations_m)] = False
        if off.all():
            return np.zeros_like(off)
        return np.asarray(distance_transform_edt(off) * self.grid.resolution_m <= scales * self._scale_m)

    def _index(self, locations_m: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and columns of the cells nearest to locations (P, 2)."""
        grid = self.grid
        row = np.rint((locations_m[:, 0] - grid.north_m[0]) / grid.resolution_m).astype(np.int64)
        column = np.rint((locations_m[:, 1] - grid.east_m[0]) / grid.resolution_m).astype(np.int64)
        return np.clip(row, 0, len(grid.north_m) - 1), np.clip(column, 0, len(grid.east_m) - 1)

    def _distance_at_m(self, locations_m: Array) -> Array:
        return self._distance_m[self._index(np.asarray(locations_m, dtype=float).reshape(-1, 2))]
