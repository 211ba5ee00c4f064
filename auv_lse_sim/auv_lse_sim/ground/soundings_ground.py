"""Ground from a table of scattered soundings, or from XYZ text, which it grids."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import QhullError, cKDTree

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.input_bounds import MAX_GRID_NODES
from auv_lse_common.support.plurals import counted
from auv_lse_common.vocabulary.frames import FAR_M, local_from_geodetic, unwrapped_deg
from auv_lse_common.vocabulary.sounding import DEEPEST_M
from auv_lse_gp.soundings import check_together, is_far, local_positions
from auv_lse_gp.soundings_table import SoundingsTable, read_table
from auv_lse_sim.ground.band_meaning import is_elevation
from auv_lse_sim.ground.depth_sign import SIGN_ADVICE, depths_of, grid_depths, upside_down
from auv_lse_sim.ground.grid_ground import GridGround
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.local_frame import check_near, check_placed, ranges


def read_soundings_ground(path: Path, config: BathymetryConfig, origin: tuple[float, float] | None) -> GridGround:
    """Reads ground from a table of soundings.

    Raises:
        GroundError: naming the line or the columns, and what was expected.
        TableError: if it is not a table of soundings.
    """
    table = read_table(path, may_be_xyz=True)
    if table.is_xyz:
        return _xyz_ground(path, table, config, origin)
    column, where = table.depth_name, table.file.where
    depth, sign_note = depths_of(table.values, path, column, table.upward, config)
    negative = np.flatnonzero(depth < 0.0)
    if upside_down(depth, sign_note, config):
        raise GroundError(
            f"{where(negative[0])}: depth {depth[negative[0]]:g} m is negative, as {len(negative)} of "
            f"{len(depth)} soundings are, but {column} is positive down: {SIGN_ADVICE}"
        )
    deep = np.flatnonzero(depth > DEEPEST_M)
    if len(deep):
        raise GroundError(
            f"{where(deep[0])}: depth {depth[deep[0]]:g} m is deeper than {DEEPEST_M:g} m; depths must be in metres"
        )
    notes_on_depth = "; ".join([f"{counted(len(depth), 'sounding')}, {sign_note}", *table.notes])
    locations = local_positions(table, origin)
    north, east = locations.north_m, locations.east_m
    if locations.from_degrees:
        assert table.lat_deg is not None
        assert table.lon_deg is not None
        assert locations.origin is not None
        check_near(path, north, east, table.lat_deg, table.lon_deg, locations.origin)
    elif is_far(north, east):
        raise GroundError(
            f"{path}: {ranges(north, east)} are farther than {FAR_M / 1000:g} km from a local origin, so they "
            "may be projected (UTM). Give lat, lon (WGS84) instead, or subtract an origin, here perhaps "
            f"{_round_middle(north):.0f} and {_round_middle(east):.0f}"
        )
    check_together(where, north, east)
    return grid_soundings(
        north, east, depth, config, name=path.name, origin=locations.origin, notes=(notes_on_depth, *locations.notes)
    )


def _xyz_ground(
    path: Path, table: SoundingsTable, config: BathymetryConfig, origin: tuple[float, float] | None
) -> GridGround:
    """Ground from XYZ text; x, y are degrees if they can be, else metres, which count from their middle."""
    assert table.north_m is not None
    assert table.east_m is not None
    unknown = np.isnan(table.values)
    up = is_elevation(path.stem) if table.upward is None else table.upward
    depth, notes = grid_depths(table.values[~unknown], path, table.depth_name, up, config)
    notes += [f"{counted(int(unknown.sum()), 'point')} without a value left out"] * bool(unknown.any())
    notes += table.notes
    kept = np.flatnonzero(~unknown)[np.isfinite(depth)]
    north, east, depth = table.north_m[kept], table.east_m[kept], depth[np.isfinite(depth)]
    if not len(depth):
        raise GroundError(f"{path} has no point with a depth")
    if degrees := _degrees_of(table, north, east, origin):
        lat, lon, order = degrees
        locations = local_positions(
            dataclasses.replace(table, north_m=None, east_m=None, lat_deg=lat, lon_deg=lon), origin
        )
        assert locations.origin is not None
        check_near(path, locations.north_m, locations.east_m, lat, lon, locations.origin)
        north, east, origin = locations.north_m, locations.east_m, locations.origin
        notes.append(f"x, y taken as {order}")
    elif is_far(north, east):
        middle = float(np.median(east)), float(np.median(north))
        check_placed(path, *middle, origin, "Write longitude and latitude instead")
        north, east, origin = north - middle[1], east - middle[0], None
        notes.append(f"no projection given: local origin put at its {middle[0]:.1f}, {middle[1]:.1f}")
    check_together(lambda k: table.file.where(kept[k]), north, east)
    return grid_soundings(north, east, depth, config, name=path.name, origin=origin, notes=tuple(notes))


def _degrees_of(
    table: SoundingsTable, north: Array, east: Array, origin: tuple[float, float] | None
) -> tuple[Array, Array, str] | None:
    """Latitudes, longitudes (deg) and their order in XYZ text; None if they can be none.

    Latitudes come first only if they are not named as longitudes, and the other order is impossible or far from the
    `origin`.
    """
    orders = [(north, unwrapped_deg(east), "longitude, latitude"), (east, unwrapped_deg(north), "latitude, longitude")]
    possible = [
        (lat, lon, order)
        for lat, lon, order in orders[: 1 if table.file.columns["east"].role == "lon" else 2]
        if (np.abs(lat) <= 90.0).all() and (np.abs(lon) <= 360.0).all() and max(np.ptp(lat), np.ptp(lon)) < 10.0
    ]
    if origin is not None:
        possible = [p for p in possible if not is_far(*local_from_geodetic(p[0], p[1], *origin))] or possible
    return possible[0] if possible else None


def _round_middle(values: Array) -> float:
    return round(float(values.min() + values.max()) / 2.0, -2)


def grid_soundings(
    north_m: Any,
    east_m: Any,
    depth_m: Any,
    config: BathymetryConfig,
    *,
    name: str = "soundings",
    origin: tuple[float, float] | None = None,
    notes: tuple[str, ...] = (),
) -> GridGround:
    """Grids soundings (N,): linear interpolation on their Delaunay triangles, NaN far from all of them.

    Raises:
        GroundError: if there are fewer than 10 locations, or they lie on one line.
    """
    north, east, depth = (np.asarray(v, dtype=float).ravel() for v in (north_m, east_m, depth_m))
    # Soundings within a decimetre become one location with their median depth.
    keys = np.round(np.stack([north, east], axis=1) * 10.0).astype(np.int64)
    order = np.lexsort((depth, keys[:, 1], keys[:, 0]))
    sorted_keys = keys[order]
    first = np.flatnonzero(np.r_[True, (np.diff(sorted_keys, axis=0) != 0).any(axis=1)])
    count = np.diff(np.r_[first, len(order)])
    low, high = order[first + (count - 1) // 2], order[first + count // 2]
    locations, values = np.stack([north[low], east[low]], axis=1), 0.5 * (depth[low] + depth[high])
    if len(locations) < 10:
        raise GroundError(
            f"{name}: soundings at {counted(len(locations), 'different location')} are too few; give at least 10"
        )
    step = config.resolution_m
    axes = []
    for column in (0, 1):
        start = math.floor(locations[:, column].min() / step) * step
        axes.append(start + step * np.arange(math.ceil((locations[:, column].max() - start) / step) + 1))
    if min(len(a) for a in axes) < 2 or len(axes[0]) * len(axes[1]) > MAX_GRID_NODES:
        raise GroundError(
            f"{name}: soundings over {np.ptp(locations[:, 0]):.0f} m x {np.ptp(locations[:, 1]):.0f} m do not "
            f"make a grid of 2 x 2 to 5000 x 5000 nodes at resolution_m {step:g}"
        )
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    try:
        grid = LinearNDInterpolator(locations, values)(nodes)
    except QhullError as error:
        raise GroundError(f"{name}: the soundings lie on one line; give soundings over an area") from error
    distance = cKDTree(locations).query(nodes, distance_upper_bound=config.max_gap_m)[0]
    grid = np.where(np.isfinite(distance), grid, np.nan).reshape(len(axes[0]), len(axes[1]))
    grid = _smoothed(grid, config.smoothing_m / step)
    notes = (*notes, f"linear between soundings, unknown beyond {config.max_gap_m:g} m of one")
    return GridGround(axes[0], axes[1], grid, name=name, origin=origin, notes=notes)


def _smoothed(grid: Array, sigma: float) -> Array:
    """Gaussian smoothing (sigma in nodes) that keeps the set of known nodes."""
    if sigma <= 0.0:
        return grid
    known = np.isfinite(grid)
    weight = ndimage.gaussian_filter(known.astype(float), sigma, mode="nearest")
    total = ndimage.gaussian_filter(np.where(known, grid, 0.0), sigma, mode="nearest")
    return np.where(known, total / np.maximum(weight, 1e-12), np.nan)
