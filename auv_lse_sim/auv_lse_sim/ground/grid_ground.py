"""Ground on a regular grid of depths; every bathymetry file becomes one.

The grid lies on the local tangent plane and is interpolated by a bicubic spline (twice continuously differentiable).
NaN is unknown ground; depths of 0 or less are land, which counts as unknown.
"""

from typing import Any

import numpy as np
from scipy import ndimage

from auv_lse_common.support.arrays import Array
from auv_lse_common.support.input_bounds import MAX_GRID_NODES
from auv_lse_common.support.plurals import counted
from auv_lse_common.vocabulary.extent import Extent
from auv_lse_common.vocabulary.sounding import DEEPEST_M
from auv_lse_sim.ground.ground import GroundError


class GridGround:
    """Ground on a regular north-east grid, bicubic between the nodes.

    A location is known if the four nodes around it are known.

    Args:
        north_m: Node coordinates (ny,), evenly spaced, growing.
        east_m: Node coordinates (nx,), evenly spaced, growing.
        depth_m: Depths (ny, nx), positive down; NaN or <= 0 for unknown or land.
        origin: WGS84 latitude and longitude (deg) of the local origin.
        notes: How it was made, for `describe`.

    Raises:
        GroundError: if shapes do not match, an axis is uneven, nothing is known, or the origin is invalid.
    """

    def __init__(
        self,
        north_m: Any,
        east_m: Any,
        depth_m: Any,
        *,
        name: str = "grid",
        origin: tuple[float, float] | None = None,
        notes: tuple[str, ...] = (),
    ) -> None:
        """Checks the grid and fits the spline."""
        north, north_step = _axis(north_m, "north_m", name)
        east, east_step = _axis(east_m, "east_m", name)
        depth = np.array(depth_m, dtype=float)
        if depth.shape != (len(north), len(east)):
            raise GroundError(
                f"{name}: depth_m must have the shape (len(north_m), len(east_m)) = ({len(north)}, {len(east)}), "
                f"not {depth.shape}"
            )
        deepest = np.nanmax(np.where(np.isfinite(depth), depth, -np.inf))
        if deepest > DEEPEST_M:
            raise GroundError(f"{name}: depth {deepest:g} m is deeper than {DEEPEST_M:g} m; depths must be in metres")
        known = np.isfinite(depth) & (depth > 0.0)
        if known.sum() < 4:
            raise GroundError(
                f"{name}: only {int(known.sum())} grid nodes hold water; at least 4 must have a depth > 0"
            )
        self._name = name
        self._origin = None if origin is None else checked_origin(*origin, where=f"{name}: origin")
        self._notes = notes
        self._land = int((np.isfinite(depth) & (depth <= 0.0)).sum())
        self._known = known
        # The spline needs a value everywhere: unknown nodes get the nearest known value and are masked afterwards.
        nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
        filled = depth[tuple(nearest)]
        self._low, self._high = float(depth[known].min()), float(depth[known].max())
        self._coefficients = ndimage.spline_filter(filled, order=3, mode="mirror")
        self._north0, self._north_step, self._east0, self._east_step = north[0], north_step, east[0], east_step
        self._extent = Extent(
            north_min_m=float(north[0]),
            north_max_m=float(north[-1]),
            east_min_m=float(east[0]),
            east_max_m=float(east[-1]),
        )

    @property
    def extent(self) -> Extent:
        """The grid's rectangle."""
        return self._extent

    @property
    def origin(self) -> tuple[float, float] | None:
        """WGS84 latitude and longitude (deg) of the local origin, None if unknown."""
        return self._origin

    @property
    def known_share(self) -> float:
        """Share of the nodes that hold a depth."""
        return float(self._known.mean())

    def depth_m(self, north_m: Any, east_m: Any) -> Array:
        """Water depth (m, positive down), any broadcastable shape; NaN where a surrounding node is unknown."""
        north, east = np.broadcast_arrays(np.asarray(north_m, float), np.asarray(east_m, float))
        row = (north - self._north0) / self._north_step
        col = (east - self._east0) / self._east_step
        ny, nx = self._known.shape
        with np.errstate(invalid="ignore"):
            inside = (row >= 0) & (row <= ny - 1) & (col >= 0) & (col <= nx - 1)
        row, col = np.where(inside, row, 0.0), np.where(inside, col, 0.0)
        r, c = np.minimum(row.astype(int), ny - 2), np.minimum(col.astype(int), nx - 2)
        known = self._known
        inside &= known[r, c] & known[r + 1, c] & known[r, c + 1] & known[r + 1, c + 1]
        at = [row.ravel(), col.ravel()]
        depth = ndimage.map_coordinates(self._coefficients, at, order=3, mode="mirror", prefilter=False).reshape(
            row.shape
        )
        # The spline may overshoot; clipping to the range of the data keeps water from becoming land.
        return np.where(inside, np.clip(depth, self._low, self._high), np.nan)

    def describe(self) -> str:
        """Its source, size and depths, and how it was read."""
        e = self._extent
        where = f", origin {self._origin[0]:.5f}, {self._origin[1]:.5f} deg" if self._origin else ", no origin on Earth"
        land = f"; {counted(self._land, 'node')} {'is' if self._land == 1 else 'are'} land" if self._land else ""
        notes = "".join(f"; {note}" for note in self._notes)
        return (
            f"{self._name}: {e.height_m:.0f} m x {e.width_m:.0f} m (north x east), {100.0 * self.known_share:.0f} % "
            f"sounded, {self._low:.1f} to {self._high:.1f} m deep{where}{land}{notes}"
        )


def check_nodes(name: str, rows: int, columns: int, block: int = 1) -> None:
    """Checks the size of a grid, before it is read in blocks of `block` x `block` nodes.

    Raises:
        GroundError: if it is too large.
    """
    if (rows // block) * (columns // block) > MAX_GRID_NODES:
        blocks = f" blocks of {block} x {block}" if block > 1 else ""
        raise GroundError(
            f"{name} has {rows:,} x {columns:,} nodes, more than {MAX_GRID_NODES:,}{blocks}. Cut the grid, or make it "
            "coarser (gdal_translate -projwin, -tr)"
        )


def checked_origin(lat: Any, lon: Any, where: str) -> tuple[float, float]:
    """Checks the latitude and longitude (deg) of an origin.

    Raises:
        GroundError: if they are not one number each, or out of range.
    """
    try:
        lat_deg, lon_deg = (float(np.asarray(v, dtype=float).item()) for v in (lat, lon))
    except (TypeError, ValueError):
        shapes = f"{np.shape(lat)}, {np.shape(lon)}"
        raise GroundError(
            f"{where} must be one latitude and one longitude in degrees, not of shapes {shapes}"
        ) from None
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
        raise GroundError(
            f"{where}: {lat_deg:g}, {lon_deg:g} is not a position in degrees, with a latitude of -90 to 90 and a "
            "longitude of -180 to 180"
        )
    return lat_deg, lon_deg


def _axis(values: Any, what: str, name: str) -> tuple[Array, float]:
    axis = np.asarray(values, dtype=float)
    if axis.ndim != 1 or len(axis) < 2:
        raise GroundError(f"{name}: {what} must be a row of at least 2 coordinates, not of shape {axis.shape}")
    steps = np.diff(axis)
    step = float(axis[-1] - axis[0]) / (len(axis) - 1)
    if not np.isfinite(axis).all() or step <= 0.0 or np.abs(steps - step).max() > 0.01 * step:
        raise GroundError(f"{name}: {what} must increase in even steps (m); it runs from {axis[0]:g} to {axis[-1]:g}")
    return axis, step
