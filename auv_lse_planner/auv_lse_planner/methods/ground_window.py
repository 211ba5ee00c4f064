"""The part of the map that a long mission plans with: the cells near its next legs, and the data near these cells.

A short mission plans with the whole map. In a long one, the cost of a decision would grow with the area and with the
number of soundings. The window is therefore *focused* on the path of the next legs, and focused anew every so many
legs. In between, only the cells of the window and the centers near them are updated. Centers near the window's border
are averaged. Elsewhere, the risk is updated when the window is focused, tile by tile, where centers have come or gone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from auv_lse_common.mission_file.operating_area import Grid
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.centers import NO_CENTERS, Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Cells of the window lie at most this far from its path, in length scales of the kernel.
CELLS_SCALES = 1.5
#: Elsewhere, the risk is updated this far from centers that have come or gone, in length scales.
STALE_SCALES = 2.0
#: Side (m) of the square tiles in which the risk elsewhere is updated.
TILE_M = 300.0
#: Centers, and places to be measured, count if they are at most this far from a cell of the window, in length scales.
DATA_SCALES = 2.5
#: Centers farther than this from all cells of the window, in length scales, are averaged in square cells of this side,
#: in the kernel's lengths.
AVERAGED_SCALES, AVERAGED_SIDE = 1.25, 0.4


class GroundWindow:
    """The posterior at the cells near a path; before the first `focus`, at all cells.

    Attributes:
        posterior: The posterior given the centers near the cells.
        is_focused: Whether it covers only a part of the map.
        elsewhere_risk: Risk of the map's other cells when the window was focused.
        most_centers: Largest number of centers before the first focus, if not None; more are averaged. So a planner
            that is started again late in a long mission does not condition on all of them.
    """

    def __init__(
        self, posterior: Posterior, gp: GpConfig, level_set: LevelSetConfig, map_grid: Grid, coarse_grid: Grid
    ) -> None:
        self.posterior = posterior
        self.is_focused = False
        self.elsewhere_risk = 0.0
        self.most_centers: int | None = None
        self._scale_m = max(gp.length_scale_m, gp.length_scale_2_m)
        self._levels = LevelSet.of(level_set)
        self._grid, self._coarse_grid = map_grid, coarse_grid
        self._centers = NO_CENTERS
        self._far_m = np.zeros(map_grid.inside.shape)  # of each cell from the window's cells
        self._fine: CachedPoints | None = None
        self._coarse: CachedPoints | None = None
        self._cells: NDArray[np.int64] | None = None  # numbers of the window's cells
        self._risk: Array = np.zeros(0)  # of all cells when they were last updated; empty before the first focus
        self._count = np.zeros(map_grid.inside.shape)  # centers in each cell then

    @property
    def fine(self) -> CachedPoints:
        """The posterior at the window's cells."""
        if self._fine is None:
            self._fine = CachedPoints(self.posterior, self._grid.places_m)
        return self._fine

    @property
    def coarse(self) -> CachedPoints:
        """The posterior at the window's cells of the coarse grid."""
        if self._coarse is None:
            self._coarse = CachedPoints(self.posterior, self._coarse_grid.places_m)
        return self._coarse

    def set_centers(self, centers: Centers) -> None:
        """Sets all centers of the map.

        Raises:
            IllConditionedError: see `Posterior.follow`.
        """
        self._centers = centers
        self._follow()

    def near(self, places_m: Array) -> Mask:
        """Mask (P,) of the places (P, 2) that are near enough to change the window's cells."""
        if not self.is_focused:
            return np.ones(len(places_m), dtype=bool)
        return self._far_at(places_m) <= DATA_SCALES * self._scale_m

    def covers(self, places_m: Array) -> Mask:
        """Mask (P,) of the places (P, 2) among the window's cells."""
        return self._far_at(places_m) <= 0.0

    def focus(self, path_m: Array) -> None:
        """Focuses the window on a path (P, 2)."""
        grid = self._grid
        off_path = np.ones(grid.inside.shape, dtype=bool)
        off_path[self._index(path_m)] = False
        on = (distance_transform_edt(off_path) * grid.resolution_m <= CELLS_SCALES * self._scale_m) & grid.inside
        self._update_elsewhere(on)
        self._far_m = np.asarray(distance_transform_edt(~on)) * grid.resolution_m
        self.is_focused = True
        self._follow()
        self._cells = np.flatnonzero(on[grid.inside])
        self._fine = CachedPoints(self.posterior, grid.places_m[self._cells])
        coarse_m = self._coarse_grid.places_m
        inside = self.covers(coarse_m)
        self._coarse = CachedPoints(self.posterior, coarse_m[inside] if inside.any() else self._fine.places_m)
        self.elsewhere_risk = float(self._risk.sum() - self._risk[self._cells].sum())

    def release(self) -> None:
        """Covers the whole map again."""
        if self.is_focused:
            self.is_focused, self.elsewhere_risk, self.most_centers = False, 0.0, None
            self._fine = self._coarse = self._cells = None
            self._follow()

    def _follow(self) -> None:
        c = self._centers
        if self.is_focused and len(c):
            c = self._thinned(c.take(np.flatnonzero(self.near(c.places_m))))
        elif self.most_centers is not None:
            c = self._averaged(c, self.most_centers)
        self.posterior.follow(c)

    def _averaged(self, centers: Centers, most: int) -> Centers:
        """At most `most` centers: averages in square cells, if there are more."""
        scaled, found, side = self.posterior.kernel.scale(centers.places_m), centers, AVERAGED_SIDE
        while len(found) > most:
            found, side = centers.averaged(np.floor(scaled / side).astype(np.int64)), 1.5 * side
        return found

    def _thinned(self, centers: Centers) -> Centers:
        """The centers, those far from the window's cells averaged."""
        if not len(centers):
            return centers
        far = self._far_at(centers.places_m) > AVERAGED_SCALES * self._scale_m
        keys = np.column_stack([np.arange(len(centers)), np.full((len(centers), 2), -1)])
        cells = np.floor(self.posterior.kernel.scale(centers.places_m[far]) / AVERAGED_SIDE)
        keys[far] = np.column_stack([np.full(len(cells), -1), cells])
        return centers.averaged(keys)

    def _update_elsewhere(self, window: Mask) -> None:
        """Updates the risk of all cells outside of the window (ny, nx) near which centers have come or gone."""
        grid, everywhere = self._grid, self._grid.places_m
        count = np.zeros(grid.inside.shape)
        np.add.at(count, self._index(self._centers.places_m), 1.0)
        if not len(self._risk):
            self._risk = np.zeros(len(everywhere))
            self._set_risk(np.arange(len(everywhere)), NO_CENTERS)
        elif self._cells is not None:
            now = self.fine.current()
            self._risk[self._cells] = self._levels.risk(now.mean_m, np.sqrt(now.data_var_m2))
        changed = count != self._count
        self._count = count
        if not changed.any():
            return
        near = np.asarray(distance_transform_edt(~changed)) * grid.resolution_m <= STALE_SCALES * self._scale_m
        stale = np.flatnonzero((near & ~window)[grid.inside])
        tiles, tile = np.unique(np.floor(everywhere[stale] / TILE_M), axis=0, return_inverse=True)
        for number, corner in enumerate(tiles * TILE_M):
            off = np.abs(self._centers.places_m - (corner + 0.5 * TILE_M)).max(axis=1)
            close = np.flatnonzero(off <= 0.5 * TILE_M + DATA_SCALES * self._scale_m)
            self._set_risk(stale[tile.ravel() == number], self._centers.take(close))

    def _set_risk(self, cells: NDArray[np.int64], centers: Centers) -> None:
        """Sets the risk of some cells given the centers near them."""
        local = self.posterior.blank()
        local.follow(centers)
        mean_m, variance_m2 = local.moments(self._grid.places_m[cells])
        self._risk[cells] = self._levels.risk(mean_m, np.sqrt(variance_m2))

    def _index(self, places_m: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and columns of the cells nearest to places (P, 2)."""
        grid = self._grid
        row = np.rint((places_m[:, 0] - grid.north_m[0]) / grid.resolution_m).astype(np.int64)
        column = np.rint((places_m[:, 1] - grid.east_m[0]) / grid.resolution_m).astype(np.int64)
        return np.clip(row, 0, len(grid.north_m) - 1), np.clip(column, 0, len(grid.east_m) - 1)

    def _far_at(self, places_m: Array) -> Array:
        return self._far_m[self._index(np.asarray(places_m, dtype=float).reshape(-1, 2))]
