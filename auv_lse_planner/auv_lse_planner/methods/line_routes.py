"""Routes along the unlocated isobath: along its expected course, and along its course in draws from the map.

Each route follows the level's contours of one field: the posterior mean, or a draw from the posterior. Where the map
is certain of the line, all fields agree, so every route begins by following it. Farther away draws differ, and each
shows one location where the line may be. The planner's objective decides between them, not this module.

A stretch of a contour is wanted if the standard deviation s left there is more than 10 m times the field's own slope,
which is the definition of `reward/line.py`, and no mate plans to pass it. A route repeatedly goes to the stretch with
the largest length per distance to travel and follows it to its end, until the legs are used up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.level_set.lines import resample
from auv_lse_gp.map.certainty import FOUND, MAX_STD_M
from auv_lse_planner.methods.method import PlanningContext

Array = NDArray[np.float64]

#: Draws from the posterior, and largest number of locations at which their deviations from the mean are drawn.
DRAWS, MAX_DRAWN = 8, 600
#: Distance (m) between the points of a stretch, and the shortest stretch (m) that is followed.
SPACING_M, SHORTEST_M = 10.0, 20.0
#: A mate that plans to pass a location within this distance (m) locates it.
MATE_M = 15.0
#: Length (m) charged for every further stretch, beside the way to it: for turns, and because it may not exist.
DETOUR_M = 15.0
#: Largest distance (m) of a stretch from ground where vehicles can travel.
OUTSIDE_M = 8.0


@dataclass(frozen=True, slots=True)
class Route:
    """A route.

    Attributes:
        line_m: Its polyline (n + 1, 2); only the start if there is nothing to follow.
        spans: Distances (m) travelled at which each stretch begins and ends.
    """

    line_m: Array
    spans: list[tuple[float, float]]

    def followed_m(self, length_m: float) -> float:
        """Length (m) of the stretches in the first `length_m` of the route."""
        return sum(max(0.0, min(end, length_m) - begin) for begin, end in self.spans)


class LineRoutes:
    """Makes routes for one vehicle."""

    def __init__(self, context: PlanningContext) -> None:
        self._context = context

    def routes(self, points: CachedPoints, state: Array, legs: int, mates_m: Array) -> list[Route]:
        """Routes of at most `legs` legs from a state (3,): along the mean's contours first, then along each draw's.

        Args:
            points: The posterior at the cells of the map.
            mates_m: Locations (P, 2) that mates plan to pass.
        """
        grid, level_m = self._context.map_grid, self._context.settings.level_set.level_m
        now = points.current()
        std = grid.fill(np.sqrt(np.minimum(now.planned_var_m2, now.data_var_m2)))
        mean = grid.fill(now.mean_m)
        length_m = legs * self._context.space.motion.leg_length_m
        taken = cKDTree(mates_m) if len(mates_m) else None
        routes = []
        for deviation in [None, *self._deviations(points)]:
            field = mean if deviation is None else mean + std * deviation
            stretches = self._stretches(field, std, level_m, taken)
            routes.append(route_along(np.asarray(state[1:], dtype=float), stretches, length_m))
        return routes

    def _deviations(self, points: CachedPoints) -> list[Array]:
        """Draws' deviations from the mean, in standard deviations, on the map's grid (ny, nx)."""
        context, grid = self._context, self._context.map_grid
        every = max(1, int(np.ceil(np.sqrt(np.count_nonzero(grid.inside) / MAX_DRAWN))))
        inner = grid.inside[every // 2 :: every, every // 2 :: every]
        apart = np.zeros_like(grid.inside)
        apart[every // 2 :: every, every // 2 :: every] = True
        chosen = apart[grid.inside]
        if not chosen.any():
            return []
        now = points.current()
        white, scaled = now.white[chosen], now.scaled[chosen]
        covariance = context.posterior.kernel.of_scaled(scaled, scaled) - white @ white.T
        std = np.sqrt(np.maximum(np.diag(covariance), 1e-6))
        correlation = covariance / np.outer(std, std)
        correlation[np.diag_indices_from(correlation)] = 1.0 + 1e-3
        drawn = np.linalg.cholesky(correlation) @ context.rng.standard_normal((len(std), DRAWS))
        nearest = ndimage.distance_transform_edt(~inner, return_distances=False, return_indices=True)
        rows, columns = ((np.arange(size) - every // 2) / every for size in grid.inside.shape)
        at = np.meshgrid(rows, columns, indexing="ij")
        fields = []
        for column in drawn.T:
            sparse = np.zeros(inner.shape)
            sparse[inner] = column
            fields.append(ndimage.map_coordinates(sparse[tuple(nearest)], at, order=1, mode="nearest"))
        return fields

    def _stretches(self, field: Array, std: Array, level_m: float, taken: cKDTree | None) -> list[Array]:
        """Stretches (n, 2) of a field's contours that are wanted and can be travelled along."""
        import contourpy

        grid = self._context.map_grid
        steepness = np.hypot(*np.gradient(field, grid.resolution_m))
        known = np.isfinite(steepness) & np.isfinite(std)
        wanted = np.where(known, std, np.inf) > MAX_STD_M[FOUND] * np.where(known, steepness, 0.0)
        generator = contourpy.contour_generator(grid.east_m, grid.north_m, np.ma.masked_invalid(field))
        stretches = []
        for line in generator.lines(level_m):
            points = resample([line[:, ::-1]], SPACING_M)
            mask = wanted[self._cells(points)] & self._travelled(points)
            if taken is not None:
                mask &= taken.query(points, distance_upper_bound=MATE_M)[0] > MATE_M
            stretches += _runs(points, mask, closed=bool(np.all(line[0] == line[-1])))
        return stretches

    def _cells(self, points: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        grid = self._context.map_grid
        row = np.rint((points[:, 0] - grid.north_m[0]) / grid.resolution_m).astype(np.int64)
        column = np.rint((points[:, 1] - grid.east_m[0]) / grid.resolution_m).astype(np.int64)
        return np.clip(row, 0, len(grid.north_m) - 1), np.clip(column, 0, len(grid.east_m) - 1)

    def _travelled(self, points: Array) -> NDArray[np.bool_]:
        """Whether vehicles can pass near points (P, 2)."""
        space = self._context.space
        row = np.rint((points[:, 0] - space.north0_m) / space.cell_m).astype(np.int64)
        column = np.rint((points[:, 1] - space.east0_m) / space.cell_m).astype(np.int64)
        raster = space.area_raster
        row, column = np.clip(row, 0, raster.shape[0] - 1), np.clip(column, 0, raster.shape[1] - 1)
        return np.asarray(raster[row, column] >= -OUTSIDE_M)


def route_along(start_m: Array, stretches: list[Array], length_m: float) -> Route:
    """A greedy route from a location (2,) along stretches (n, 2); it ends once it is `length_m` long."""
    left, here, parts, spans = length_m, start_m, [start_m[None]], []
    rest = list(stretches)
    while rest and left > 0.0:
        best, found = 0.0, None
        for number, stretch in enumerate(rest):
            along = SPACING_M * np.arange(len(stretch))
            way = np.hypot(*(stretch - here).T)
            for backward in (False, True):
                gain = np.minimum(along if backward else along[-1] - along, left - way)
                score = gain / (way + DETOUR_M + np.maximum(gain, SPACING_M))
                entry = int(np.argmax(score))
                if score[entry] > best:
                    best, found = float(score[entry]), (number, entry, backward)
        if found is None:
            break
        number, entry, backward = found
        stretch = rest.pop(number)
        followed = stretch[entry::-1] if backward else stretch[entry:]
        remaining = stretch[entry + 1 :] if backward else stretch[:entry]
        if SPACING_M * len(remaining) >= SHORTEST_M:
            rest.append(remaining)
        begin = length_m - left + float(np.hypot(*(followed[0] - here)))
        spans.append((begin, begin + SPACING_M * (len(followed) - 1)))
        left = length_m - spans[-1][1]
        parts.append(followed)
        here = followed[-1]
    return Route(np.concatenate(parts), spans)


def _runs(points: Array, mask: NDArray[np.bool_], *, closed: bool) -> list[Array]:
    """Runs of points (n, 2) whose mask is set, at least `SHORTEST_M` long; over the ends of a closed line."""
    if closed and not mask.all():
        begin = int(np.argmin(mask))
        points, mask = np.roll(points, -begin, axis=0), np.roll(mask, -begin)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    runs = [points[a:b] for a, b in edges.reshape(-1, 2)]
    return [run for run in runs if SPACING_M * len(run) >= SHORTEST_M]
