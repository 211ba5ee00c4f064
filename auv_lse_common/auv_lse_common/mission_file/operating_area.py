"""The operating area: a polygon without its no-go areas, distances to their borders, and grids over it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.area import AreaConfig, corners
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_common.support.input_bounds import MAX_CELLS, MAX_RASTER_NODES

#: Prefix of the names of no-go areas that stand for ground which no vehicle can reach.
UNREACHABLE = "unreachable_"
#: Cells along each side of the raster on which the size of a polygon's no-go areas is counted.
AREA_CELLS = 500


@dataclasses.dataclass(frozen=True)
class Grid:
    """Centers of cells over the operating area.

    Attributes:
        north_m: North of the rows (ny,), ascending.
        east_m: East of the columns (nx,), ascending.
        inside: Whether a cell's center is in the area (ny, nx).
    """

    north_m: Array
    east_m: Array
    inside: Mask
    resolution_m: float

    @cached_property
    def locations_m(self) -> Array:
        """Centers (P, 2) of the cells inside the area, row by row; not to be changed."""
        rows, columns = np.nonzero(self.inside)
        return np.column_stack([self.north_m[rows], self.east_m[columns]])

    def within(self, middle_m: Array, radius_m: float) -> Grid:
        """The part of the grid with the cells inside the area and within a circle; all of it if there are none."""
        near = (self.north_m[:, None] - middle_m[0]) ** 2 + (self.east_m - middle_m[1]) ** 2 <= radius_m**2
        near &= self.inside
        rows, columns = (np.flatnonzero(near.any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            return self
        row, column = (slice(used[0], used[-1] + 1) for used in (rows, columns))
        return Grid(self.north_m[row], self.east_m[column], near[row, column], self.resolution_m)

    def fill(self, values: Array, outside: float = math.nan) -> Array:
        """Arranges values (P,) of the cells inside the area in an array (ny, nx); other cells get `outside`."""
        full = np.full(self.inside.shape, outside)
        full[self.inside] = values
        return full


class OperatingArea:
    """The operating area, with fast and conservative distances to its border.

    Attributes:
        polygon: Corners (n, 2): north, east (m).
        no_go: Corners (n, 2) of each no-go area by name.
        margin_m: Distance that vehicles keep from the border.
    """

    def __init__(self, config: AreaConfig) -> None:
        """Rasterizes the distance to the border.

        Raises:
            ParameterError: if the raster would be too large, or the no-go areas leave nothing free.
        """
        self.config = config
        self.polygon = corners("area.polygon_m", config.polygon_m)
        self.no_go = {name: corners(f"area.no_go.{name}", flat) for name, flat in config.no_go.items()}
        self.margin_m = config.margin_m
        self._raster()

    @property
    def extent_m(self) -> tuple[float, float, float, float]:
        """Smallest north, largest north, smallest east, largest east of the polygon."""
        low, high = self.polygon.min(axis=0), self.polygon.max(axis=0)
        return float(low[0]), float(high[0]), float(low[1]), float(high[1])

    @property
    def unreachable_m2(self) -> float:
        """Size of the ground in the polygon that is left out because no vehicle can reach it."""
        return unreachable_m2(self.config)

    def contains(self, locations_m: ArrayLike) -> Mask:
        """Mask (P,) of the positions (P, 2) inside the polygon and outside all no-go areas."""
        positions = np.asarray(locations_m, dtype=float).reshape(-1, 2)
        inside = _in_polygon(self.polygon, positions)
        for polygon in self.no_go.values():
            inside &= ~_in_polygon(polygon, positions)
        return inside

    def clearance_m(self, locations_m: ArrayLike) -> Array:
        """Distance (m) of positions (P, 2) to the nearest border, (P,); negative outside the area and in no-go areas.

        It is zero on the border; the planner's `FreeSpace.clearance_m` is zero at `margin_m` from it. The value comes
        from a raster: within the polygon's extent, the true distance is 0 to 2 raster_m more. So `clearance_m(p) >=
        margin_m` never accepts a position that is too close.
        """
        positions = np.asarray(locations_m, dtype=float).reshape(-1, 2)
        step = self.config.raster_m
        row = np.clip(np.rint((positions[:, 0] - self._north0_m) / step), 0, self._nodes.shape[0] - 1)
        column = np.clip(np.rint((positions[:, 1] - self._east0_m) / step), 0, self._nodes.shape[1] - 1)
        off = np.hypot(
            positions[:, 0] - (self._north0_m + row * step), positions[:, 1] - (self._east0_m + column * step)
        )
        # The signed distance changes by at most the distance between the two positions.
        return np.asarray(self._nodes[row.astype(np.intp), column.astype(np.intp)] - off)

    @property
    def finest_cell_m(self) -> float:
        """Size (m) of the smallest cells into which `grid` divides the area."""
        low_n, high_n, low_e, high_e = self.extent_m
        return math.ceil(10.0 * math.sqrt((high_n - low_n) * (high_e - low_e) / MAX_CELLS)) / 10.0

    def cell_m(self, size_m: float) -> float:
        """The size (m) of cells for `grid` that is nearest to `size_m`, where it is not the user's choice.

        It is at most half the largest distance to the border, so that several cells lie even across a narrow area, and
        at least `finest_cell_m`.
        """
        return max(min(size_m, 0.5 * float(self._nodes.max())), self.finest_cell_m)

    def grid(self, resolution_m: float, name: str = "resolution_m") -> Grid:
        """Cells of `resolution_m` that cover the polygon's extent, aligned to multiples of the resolution.

        Raises:
            ParameterError: if the resolution is not positive, there are too many cells, a cell is larger than the area,
                or no center is in the area.
        """
        if not (math.isfinite(resolution_m) and resolution_m > 0.0):
            raise ParameterError(f"{name} must be a finite number > 0, not {resolution_m!r}")
        low_n, high_n, low_e, high_e = self.extent_m
        cells = (high_n - low_n) * (high_e - low_e) / resolution_m**2
        if cells > MAX_CELLS:
            raise ParameterError(
                f"{name}: cells of {resolution_m!r} m divide the area of {high_n - low_n:.0f} m x "
                f"{high_e - low_e:.0f} m into {cells:.3g}, more than {MAX_CELLS:,}. Choose at least "
                f"{self.finest_cell_m:g} m, or a smaller area"
            )
        if resolution_m > max(high_n - low_n, high_e - low_e):
            raise ParameterError(
                f"{name}: a cell of {resolution_m!r} m is larger than the area of {high_n - low_n:.0f} m x "
                f"{high_e - low_e:.0f} m. Choose smaller cells"
            )
        axes: list[Array] = []
        for low, high in ((low_n, high_n), (low_e, high_e)):
            first, last = math.floor(low / resolution_m), math.ceil(high / resolution_m)
            axes.append((np.arange(first, max(last, first + 1), dtype=np.float64) + 0.5) * resolution_m)
        north, east = axes
        inside = _free([self.polygon, *self.no_go.values()], north, east)
        if not np.any(inside):
            raise ParameterError(
                f"{name}: no center of a {resolution_m!r} m cell lies in the area. Choose smaller cells"
            )
        return Grid(north, east, inside, resolution_m)

    def _raster(self) -> None:
        step = self.config.raster_m
        low_n, high_n, low_e, high_e = self.extent_m
        self._north0_m, self._east0_m = low_n - step, low_e - step
        rows, columns = (math.ceil((high - low) / step) + 3 for low, high in ((low_n, high_n), (low_e, high_e)))
        if rows * columns > MAX_RASTER_NODES:
            least_m = math.ceil(10.0 * step * math.sqrt(rows * columns / MAX_RASTER_NODES)) / 10.0
            raise ParameterError(
                f"area.raster_m: {step!r} m needs {rows * columns:,} raster nodes for the area of "
                f"{high_n - low_n:.0f} m x {high_e - low_e:.0f} m, more than {MAX_RASTER_NODES:,}. Choose a larger "
                f"raster_m, at least {least_m:g} m, or a smaller area"
            )
        self._nodes = _to_border_m(tuple(p.tobytes() for p in (self.polygon, *self.no_go.values())), step)
        if not np.any(self._nodes > 0.0):
            raise ParameterError(
                "area.no_go covers the whole polygon. If some of the area is free, decrease area.raster_m (now "
                f"{step!r})"
            )


def _free(polygons: Sequence[Array], north: Array, east: Array) -> Mask:
    """Whether the nodes (R, C) of these axes are inside the first polygon and outside all others."""
    inside = _raster_in_polygon(polygons[0], north, east)
    for polygon in polygons[1:]:
        inside &= ~_raster_in_polygon(polygon, north, east)
    return inside


@lru_cache(maxsize=2)  # a large area takes seconds, and a mission, its check and its report need it several times
def _to_border_m(polygons: tuple[bytes, ...], step_m: float) -> Array:
    """Distance (R, C) of the raster's nodes to the nearest border; negative outside and in no-go areas.

    Args:
        polygons: The bytes of the corners of the polygon and of each no-go area.
    """
    corners_m = [np.frombuffer(polygon).reshape(-1, 2) for polygon in polygons]
    north, east = _raster_axes(corners_m[0], step_m)
    distance = np.sqrt(_border_distance_2(corners_m, north, east))
    nodes = np.where(_free(corners_m, north, east), distance, -distance)
    nodes.flags.writeable = False
    return nodes


def _raster_axes(polygon: Array, step_m: float) -> tuple[Array, Array]:
    """North and east (m) of the rows and columns of a polygon's raster."""
    counts = np.ceil(np.ptp(polygon, axis=0) / step_m).astype(int) + 3
    north, east = (low - step_m + step_m * np.arange(n) for low, n in zip(polygon.min(axis=0), counts, strict=True))
    return north, east


def unreachable_m2(config: AreaConfig) -> float:
    """Size of the ground in the polygon that is left out because no vehicle can reach it."""
    polygon = corners("area.polygon_m", config.polygon_m)
    north, east = _raster_axes(polygon, config.raster_m)
    there = _raster_in_polygon(polygon, north, east)
    left_out = np.zeros_like(there)
    for name, flat in config.no_go.items():
        inside = _raster_in_polygon(corners(f"area.no_go.{name}", flat), north, east)
        if name.startswith(UNREACHABLE):
            left_out |= inside
        else:
            there &= ~inside
    return float(np.count_nonzero(left_out & there)) * config.raster_m**2


def free_m2(config: AreaConfig) -> float:
    """Size of the polygon without its no-go areas, whose share is counted on a raster of `AREA_CELLS` on each side."""
    polygon = corners("area.polygon_m", config.polygon_m)
    following = np.roll(polygon, -1, axis=0)
    whole_m2 = 0.5 * abs(float(np.sum(polygon[:, 0] * following[:, 1] - following[:, 0] * polygon[:, 1])))
    if not config.no_go:
        return whole_m2
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    north, east = (low + (high - low) * ((np.arange(AREA_CELLS)[:, None] + 0.5) / AREA_CELLS)).T
    inside = _raster_in_polygon(polygon, north, east)
    free = inside.copy()
    for name, flat in config.no_go.items():
        free &= ~_raster_in_polygon(corners(f"area.no_go.{name}", flat), north, east)
    return whole_m2 * max(float(free.sum()), 1.0) / max(float(inside.sum()), 1.0)


def _in_polygon(polygon: Array, positions: Array) -> Mask:
    """Mask (P,) by the even-odd rule, exact up to rounding.

    Shapely is unsuitable: it puts positions on the border outside, and grids and rasters have centers there.
    """
    inside = np.zeros(len(positions), dtype=bool)
    north, east = positions[:, 0], positions[:, 1]
    for (n0, e0), (n1, e1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if n0 == n1:
            continue
        spans = (n0 > north) != (n1 > north)
        inside ^= spans & (east < e0 + (north - n0) * ((e1 - e0) / (n1 - n0)))
    return inside


def _raster_in_polygon(polygon: Array, north: Array, east: Array) -> Mask:
    """`_in_polygon` for the nodes of a raster (R, C): each edge affects only the rows that it spans."""
    inside = np.zeros((len(north), len(east)), dtype=bool)
    for (n0, e0), (n1, e1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if n0 == n1:
            continue
        rows = slice(*np.searchsorted(north, sorted((n0, n1))))  # (n0 > north) != (n1 > north)
        crossing = e0 + (north[rows] - n0) * ((e1 - e0) / (n1 - n0))
        inside[rows] ^= east < crossing[:, None]
    return inside


def _edge_distance_2(n: Array, e: Array, dn: float, de: float) -> Array:
    """Squared distance to the edge (0, 0)-(dn, de) of positions given relative to its first corner."""
    along = np.clip((n * dn + e * de) / (dn * dn + de * de), 0.0, 1.0)
    squared: Array = (n - along * dn) ** 2 + (e - along * de) ** 2
    return squared


def _border_distance_2(polygons: Sequence[Array], north: Array, east: Array) -> Array:
    """Squared distance (R, C) of a raster's nodes to the nearest border; four to ten times as fast as shapely.

    Nodes are grouped in blocks. If an edge is farther from a block's middle than the nearest edge by more than the
    block's diagonal, it is nearest to none of its nodes. So each block compares only a few edges.
    """
    width = 8
    rows, columns = (math.ceil(len(axis) / width) for axis in (north, east))
    # The last blocks are padded with the raster's last nodes.
    n = np.pad(north, (0, rows * width - len(north)), mode="edge").reshape(rows, width)
    e = np.pad(east, (0, columns * width - len(east)), mode="edge").reshape(columns, width)
    middle_n, middle_e = (axis[:, [0, -1]].mean(axis=1) for axis in (n, e))
    reach = math.hypot(float(np.ptp(n, axis=1).max()), float(np.ptp(e, axis=1).max())) / 2.0
    edges = [
        (n0, e0, n1 - n0, e1 - e0)
        for polygon in polygons
        for (n0, e0), (n1, e1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True)
    ]
    nearest = np.full((rows, columns), np.inf)
    for n0, e0, dn, de in edges:
        np.minimum(nearest, _edge_distance_2(middle_n[:, None] - n0, middle_e - e0, dn, de), out=nearest)
    limit = (np.sqrt(nearest) + 2.0 * reach) ** 2 * (1.0 + 1e-9)
    result = np.full((rows, columns, width, width), np.inf)
    for n0, e0, dn, de in edges:
        i, j = np.nonzero(_edge_distance_2(middle_n[:, None] - n0, middle_e - e0, dn, de) <= limit)
        squared = _edge_distance_2(n[i][:, :, None] - n0, e[j][:, None, :] - e0, dn, de)
        result[i, j] = np.minimum(result[i, j], squared)
    whole = result.swapaxes(1, 2).reshape(rows * width, columns * width)
    return np.ascontiguousarray(whole[: len(north), : len(east)])
