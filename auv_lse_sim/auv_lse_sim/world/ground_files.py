"""Ground from files: soundings (CSV), npz grids, ESRI ASCII grids, GeoTIFF (if rasterio is installed).

Whatever the file holds becomes one regular north-east grid of depths on the local tangent plane, NaN where
nothing is known, interpolated by a bicubic spline (twice continuously differentiable) between its nodes.

Sign of depth: a column or array called `depth_m` is positive down; one called `elevation_m` (or `z_m`) is
positive up: depth = water_level_m - elevation. Rasters have no names: there, `depth_sign` "auto" takes values that
are mostly negative as elevations, and refuses those that may be either. Depths of 0 or less are land, and as unknown
(NaN) as what was never sounded.
"""

from __future__ import annotations

import csv
import math
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import QhullError, cKDTree

from auv_lse_common.frames import geodetic_from_local, local_from_geodetic
from auv_lse_sim.world.config import BathymetryConfig
from auv_lse_sim.world.ground import Extent

Array = NDArray[np.float64]

DEEPEST_M = 11_000.0  # deeper than any water on Earth: a depth beyond it is in another unit, or wrong

#: What programs write, with either sign, where they know nothing. A depth of just this much is not met with.
NO_DATA = (9999.0, 99999.0, 32767.0, 32768.0)

#: Values all farther than this from 0 are elevations above sea level rather than depths, unless the user says so.
_ELEVATED_M = 200.0
#: Ground all of which lies farther than this from the local origin is not in local coordinates (UTM, a wrong origin).
FAR_M = 100_000.0
#: With more than this share of the values on either side of 0, a raster's sign is not guessed.
_BOTH_SIGNS = 0.05

_NORTH = ("north_m", "n_m", "y_m", "northing_m", "northing")
_EAST = ("east_m", "e_m", "x_m", "easting_m", "easting")
_LAT = ("lat", "latitude", "lat_deg")
_LON = ("lon", "lng", "longitude", "lon_deg")
_DEPTH = ("depth_m", "depth")
_ELEVATION = ("elevation_m", "elevation", "z_m")


class GroundError(ValueError):
    """A bathymetry file that cannot be used; says the file, the line or array, and what was expected."""


class GridGround:
    """Ground on a regular north-east grid, bicubic between the nodes.

    A place is known if the four nodes about it are.

    Args:
        north_m: Node coordinates (ny,), evenly spaced, growing.
        east_m: Node coordinates (nx,), evenly spaced, growing.
        depth_m: Depths (ny, nx), positive down; NaN or <= 0 for unknown or land.
        name: File or survey it came from, for messages.
        origin: WGS84 latitude and longitude (deg) of the local origin.
        notes: Sentences on how it was made, for `describe`.

    Raises:
        GroundError: if shapes do not fit, an axis is uneven, nothing is known, or the origin is nowhere on Earth.
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
                f"{name}: depth_m has shape {depth.shape}; expected (len(north_m), len(east_m)) = "
                f"({len(north)}, {len(east)})"
            )
        deepest = np.nanmax(np.where(np.isfinite(depth), depth, -np.inf))
        if deepest > DEEPEST_M:
            raise GroundError(f"{name}: depth {deepest:g} m; expected metres, at most {DEEPEST_M:g}")
        known = np.isfinite(depth) & (depth > 0.0)
        if known.sum() < 4:
            raise GroundError(f"{name}: {int(known.sum())} grid nodes hold water; expected at least 4 depths > 0")
        self._name = name
        self._origin = None if origin is None else _checked_origin(*origin, where=f"{name}: origin")
        self._notes = notes
        self._land = int((np.isfinite(depth) & (depth <= 0.0)).sum())
        self._known = known
        # The spline needs a value everywhere: unknown nodes take the nearest known one, and are masked afterwards.
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
        # A spline may swing a little beyond the data; ground is kept within them, so that water stays water.
        return np.where(inside, np.clip(depth, self._low, self._high), np.nan)

    def describe(self) -> str:
        """Where it came from, how large it is, and how it was read."""
        e = self._extent
        where = f", origin {self._origin[0]:.5f}, {self._origin[1]:.5f} deg" if self._origin else ", no origin on Earth"
        land = f"; {self._land} nodes are land" if self._land else ""
        notes = "".join(f"; {note}" for note in self._notes)
        return (
            f"{self._name}: {e.height_m:.0f} m x {e.width_m:.0f} m (north x east), {100.0 * self.known_share:.0f} % "
            f"sounded, {self._low:.1f} to {self._high:.1f} m deep{where}{land}{notes}"
        )


def _checked_origin(lat: Any, lon: Any, where: str) -> tuple[float, float]:
    """Latitude and longitude (deg) of an origin as numbers.

    Raises:
        GroundError: if they are not one number each, or nowhere on Earth.
    """
    try:
        lat_deg, lon_deg = (float(np.asarray(v, dtype=float).item()) for v in (lat, lon))
    except (TypeError, ValueError):
        shapes = f"{np.shape(lat)}, {np.shape(lon)}"
        raise GroundError(f"{where}: of shapes {shapes}; expected one latitude and one longitude in degrees") from None
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
        raise GroundError(
            f"{where}: {lat_deg:g}, {lon_deg:g}; expected degrees, a latitude of -90 to 90, a longitude of -180 to 180"
        )
    return lat_deg, lon_deg


def _longitude(lon: float) -> float:
    """A longitude (deg) of -180 to 360 as one of -180 to 180."""
    return lon if abs(lon) <= 180.0 else (lon + 180.0) % 360.0 - 180.0


def _axis(values: Any, what: str, name: str) -> tuple[Array, float]:
    axis = np.asarray(values, dtype=float)
    if axis.ndim != 1 or len(axis) < 2:
        raise GroundError(f"{name}: {what} has shape {axis.shape}; expected at least 2 coordinates in a row")
    steps = np.diff(axis)
    step = float(axis[-1] - axis[0]) / (len(axis) - 1)
    if not np.isfinite(axis).all() or step <= 0.0 or np.abs(steps - step).max() > 0.01 * step:
        raise GroundError(
            f"{name}: {what} runs from {axis[0]:g} to {axis[-1]:g}; expected growing, evenly spaced metres"
        )
    return axis, step


def load_ground(
    path: str | Path, config: BathymetryConfig | None = None, origin: tuple[float, float] | None = None
) -> GridGround:
    """Reads a bathymetry file; its ending says what it is (.csv .txt .xyz, .npz, .asc .grd, .tif .tiff).

    Args:
        path: The file.
        config: How to read it.
        origin: WGS84 latitude and longitude (deg) to place the local origin at, where the file has none of its own;
            by default the middle of the data.

    Raises:
        GroundError: naming the file, the line where there is one, what was found and what was expected.
    """
    path = Path(path)
    config = config or BathymetryConfig()
    if not path.is_file():
        raise GroundError(f"{path}: no such file; expected bathymetry as .csv, .npz, .asc or .tif")
    kinds = {
        ".csv": _read_soundings,
        ".txt": _read_soundings,
        ".xyz": _read_soundings,
        ".npz": _read_npz,
        ".asc": _read_ascii,
        ".grd": _read_ascii,
        ".tif": _read_geotiff,
        ".tiff": _read_geotiff,
    }
    reader = kinds.get(path.suffix.lower())
    if reader is None:
        raise GroundError(f"{path}: ending {path.suffix!r}; expected one of {', '.join(kinds)}")
    if origin is not None:
        origin = _checked_origin(*origin, where=f"{path}: area.origin_lat_deg, origin_lon_deg")
    try:
        return reader(path, config, origin)
    except OSError as error:
        raise GroundError(f"{path}: cannot be read: {error.strerror or error}") from error


# -- soundings


def _column(header: list[str], names: tuple[str, ...]) -> int | None:
    return next((header.index(name) for name in names if name in header), None)


def _read_soundings(path: Path, config: BathymetryConfig, origin: tuple[float, float] | None) -> GridGround:
    columns, lines, column, up = _soundings_table(path)
    name = path.name
    marks = np.flatnonzero(_no_data(columns["depth"]))
    if len(marks):
        raise GroundError(
            f"{path}:{lines[marks[0]]}: {column} is {columns['depth'][marks[0]]:g}, as on {len(marks)} of {len(lines)} "
            "lines: a usual mark for no data; expected soundings only: take these lines out"
        )
    depth, sign_note = _depths(columns["depth"], path, column, up, config)
    negative = np.flatnonzero(depth < 0.0)
    if _upside_down(depth, sign_note, config):
        raise GroundError(
            f"{path}:{lines[negative[0]]}: depth {depth[negative[0]]:g} m, as for {len(negative)} of {len(depth)} "
            f"soundings; expected {column} positive down: {_SIGN_ADVICE}"
        )
    deep = np.flatnonzero(depth > DEEPEST_M)
    if len(deep):
        raise GroundError(f"{path}:{lines[deep[0]]}: depth {depth[deep[0]]:g} m; expected metres, below {DEEPEST_M:g}")
    notes: list[str] = [f"{len(depth)} soundings, {sign_note}"]
    lat, lon = columns.get("lat"), columns.get("lon")
    if "north" in columns and lat is not None and _far(columns["north"], columns["east"]):
        del columns["north"], columns["east"]
        notes.append("metres far from any local origin (projected?) are not used, but lat, lon")
    if "north" in columns:
        north, east = columns["north"], columns["east"]
        if _far(north, east):
            raise GroundError(
                f"{path}: {_ranges(north, east)}; expected metres about a local origin, within {FAR_M / 1000:g} km, "
                "not projected ones (UTM): give lat, lon (WGS84) instead, or subtract an origin, here perhaps "
                f"{_round_middle(north):.0f} and {_round_middle(east):.0f}"
            )
        if lat is not None and lon is not None:
            origin = _origin_of(north, east, lat, lon)
            if origin is None:
                notes.append("lat, lon do not fit east_m, north_m and are not used")
    else:
        assert lat is not None
        assert lon is not None
        if origin is None:
            origin = (float((lat.min() + lat.max()) / 2.0), _longitude(float((lon.min() + lon.max()) / 2.0)))
            notes.append("origin put at the middle of the soundings")
        north, east = local_from_geodetic(lat, lon, *origin)
        _check_near(path, north, east, lat, lon, origin)
    return grid_soundings(north, east, depth, config, name=name, origin=origin, notes=tuple(notes))


def _far(north: Array, east: Array) -> bool:
    """Whether places (m) all lie farther from the local origin than local coordinates can."""
    away = [max(float(v.min()), -float(v.max())) for v in (north, east)]
    return not max(away) <= FAR_M


def _ranges(north: Array, east: Array) -> str:
    return f"north from {north.min():.0f} to {north.max():.0f} m, east from {east.min():.0f} to {east.max():.0f} m"


def _round_middle(values: Array) -> float:
    return round(float(values.min() + values.max()) / 2.0, -2)


def _check_near(path: Path, north: Array, east: Array, lat: Array, lon: Array, origin: tuple[float, float]) -> None:
    """Refuses geodetic data that lie nowhere near the mission's origin.

    Raises:
        GroundError: naming both.
    """
    if _far(north, east):
        raise GroundError(
            f"{path}: latitude {lat.min():.5f} to {lat.max():.5f}, longitude {lon.min():.5f} to {lon.max():.5f} deg, "
            f"all farther than {FAR_M / 1000:g} km from the mission's area.origin_lat_deg, origin_lon_deg = "
            f"{origin[0]:g}, {origin[1]:g}; expected an origin near the data: change it, or leave both out"
        )


def _soundings_table(path: Path) -> tuple[dict[str, Array], NDArray[np.int64], str, bool]:
    """Columns by meaning, the line each row stands on, the depth column's name and whether it is an elevation."""
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    rows = [
        (i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not line.lstrip().startswith("#")
    ]
    if len(rows) < 2:
        raise GroundError(f"{path}: {len(rows)} lines; expected a header such as east_m,north_m,depth_m and soundings")
    head_line, head = rows[0]
    delimiter = next((d for d in (",", ";", "\t") if d in head), None)

    def split(line: str) -> list[str]:
        return line.split() if delimiter is None else [f.strip() for f in next(csv.reader([line], delimiter=delimiter))]

    header = [h.strip().lower() for h in split(head)]
    found = {
        "north": _column(header, _NORTH),
        "east": _column(header, _EAST),
        "lat": _column(header, _LAT),
        "lon": _column(header, _LON),
        "depth": _column(header, _DEPTH),
    }
    up = False
    if found["depth"] is None:
        found["depth"], up = _column(header, _ELEVATION), True
    metric = found["north"] is not None and found["east"] is not None
    geodetic = found["lat"] is not None and found["lon"] is not None
    if found["depth"] is None or not (metric or geodetic):
        raise GroundError(
            f"{path}:{head_line}: columns are {', '.join(header)}; expected east_m,north_m,depth_m (or easting, "
            "northing) or lat,lon,depth_m (elevation_m instead of depth_m for values that are positive up)"
        )
    wanted = [
        k
        for k, i in found.items()
        if i is not None and (k == "depth" or (metric and k in ("north", "east")) or (geodetic and k in ("lat", "lon")))
    ]
    indices = [(key, int(found[key])) for key in wanted]  # type: ignore[arg-type]  # None was filtered out
    values: dict[str, list[float]] = {key: [] for key in wanted}
    lines: list[int] = []
    for number, line in rows[1:]:
        fields = split(line)
        if len(fields) != len(header):
            raise GroundError(f"{path}:{number}: {len(fields)} fields {line.strip()[:60]!r}; expected {len(header)}")
        for key, index in indices:
            try:
                value = float(fields[index])
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                raise GroundError(f"{path}:{number}: {header[index]} is {fields[index]!r}; expected a finite number")
            if (key == "lat" and abs(value) > 90.0) or (key == "lon" and abs(value) > 360.0):
                raise GroundError(f"{path}:{number}: {header[index]} is {value:g}; expected degrees")
            values[key].append(value)
        lines.append(number)
    column = header[int(found["depth"])]
    return {k: np.array(v) for k, v in values.items()}, np.array(lines, dtype=np.int64), column, up


def _origin_of(north: Array, east: Array, lat: Array, lon: Array) -> tuple[float, float] | None:
    """The origin at which the local coordinates are azimuthal equidistant ones of the geodetic, if there is one."""
    design = np.stack([np.ones_like(north), north, east], axis=1)
    lat0 = float(np.linalg.lstsq(design, lat, rcond=None)[0][0])
    lon0 = float(np.linalg.lstsq(design, lon, rcond=None)[0][0])
    for _ in range(2):
        if not (abs(lat0) <= 90.0 and abs(lon0) <= 360.0):
            return None
        n, e = local_from_geodetic(lat, lon, lat0, lon0)
        new_lat, new_lon = geodetic_from_local(np.median(n - north), np.median(e - east), lat0, lon0)
        lat0, lon0 = float(new_lat), float(new_lon)
    if not math.isfinite(lat0 + lon0):
        return None
    n, e = local_from_geodetic(lat, lon, lat0, lon0)
    # 2 m: the rounding of lat and lon to 5 decimals.
    return (lat0, lon0) if float(np.median(np.hypot(n - north, e - east))) < 2.0 else None


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
    """Soundings (N,) as a grid: linear interpolation on their Delaunay triangles, NaN far from any of them.

    Raises:
        GroundError: if there are fewer than 10 places, or they lie on one line.
    """
    north, east, depth = (np.asarray(v, dtype=float).ravel() for v in (north_m, east_m, depth_m))
    # Soundings within a decimetre are one place: their median.
    keys = np.round(np.stack([north, east], axis=1) * 10.0).astype(np.int64)
    order = np.lexsort((depth, keys[:, 1], keys[:, 0]))
    sorted_keys = keys[order]
    first = np.flatnonzero(np.r_[True, (np.diff(sorted_keys, axis=0) != 0).any(axis=1)])
    count = np.diff(np.r_[first, len(order)])
    low, high = order[first + (count - 1) // 2], order[first + count // 2]
    places, values = np.stack([north[low], east[low]], axis=1), 0.5 * (depth[low] + depth[high])
    if len(places) < 10:
        raise GroundError(f"{name}: {len(places)} soundings at different places; expected at least 10")
    step = config.resolution_m
    axes = []
    for column in (0, 1):
        start = math.floor(places[:, column].min() / step) * step
        axes.append(start + step * np.arange(math.ceil((places[:, column].max() - start) / step) + 1))
    if min(len(a) for a in axes) < 2 or len(axes[0]) * len(axes[1]) > 25_000_000:
        raise GroundError(
            f"{name}: soundings span {np.ptp(places[:, 0]):.0f} m x {np.ptp(places[:, 1]):.0f} m; expected an area "
            f"that makes a grid of 2 x 2 to 5000 x 5000 nodes at resolution_m {step:g}"
        )
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    try:
        grid = LinearNDInterpolator(places, values)(nodes)
    except QhullError as error:
        raise GroundError(f"{name}: the soundings lie on one line; expected them to cover an area") from error
    distance = cKDTree(places).query(nodes, distance_upper_bound=config.max_gap_m)[0]
    grid = np.where(np.isfinite(distance), grid, np.nan).reshape(len(axes[0]), len(axes[1]))
    grid = _smoothed(grid, config.smoothing_m / step)
    notes = (*notes, f"linear between soundings, unknown beyond {config.max_gap_m:g} m of one")
    return GridGround(axes[0], axes[1], grid, name=name, origin=origin, notes=notes)


def _smoothed(grid: Array, sigma: float) -> Array:
    """Gaussian smoothing (sigma in nodes) that neither invents nor loses known nodes."""
    if sigma <= 0.0:
        return grid
    known = np.isfinite(grid)
    weight = ndimage.gaussian_filter(known.astype(float), sigma, mode="nearest")
    total = ndimage.gaussian_filter(np.where(known, grid, 0.0), sigma, mode="nearest")
    return np.where(known, total / np.maximum(weight, 1e-12), np.nan)


# -- grids


def _no_data(values: Array) -> NDArray[np.bool_]:
    """Which values are usual marks for no data."""
    return np.isin(np.abs(values), NO_DATA)


def _grid_depths(
    values: Array, path: Path, what: str, up: bool | None, config: BathymetryConfig
) -> tuple[Array, list[str]]:
    """As `_depths`, for a grid: marks for no data become NaN, and are said among the notes."""
    marks = _no_data(values)
    notes = []
    if marks.any():
        found = ", ".join(f"{v:g}" for v in np.unique(values[marks]))
        notes = [f"{int(marks.sum())} nodes of {found} taken as unknown"]
        values = np.where(marks, np.nan, values)
    depth, note = _depths(values, path, what, up, config)
    return depth, [note, *notes]


_DOWN = "depth positive down"
_SIGN_ADVICE = "set sim.bathymetry.depth_sign: up for elevations, down for depths with land above them"


def _depths(values: Array, path: Path, what: str, up: bool | None, config: BathymetryConfig) -> tuple[Array, str]:
    """Depths (m, positive down) of a file's values, and in words how they were taken.

    Args:
        values: What the file holds, any shape, NaN for unknown.
        path: The file, for messages.
        what: What the file calls them.
        up: Whether that name says that they are elevations; None for a raster, which has no names.
        config: How to read them.

    Raises:
        GroundError: if they can be taken either way, or are elevations none of which is under water.
    """
    known = values[np.isfinite(values)]
    if not known.size:
        return values, "nothing known"
    span = f"{what} from {known.min():g} to {known.max():g} m"
    level = config.water_level_m
    if config.depth_sign != "auto":
        up = config.depth_sign == "up"
    elif up is None:
        up = level is not None or _looks_up(known, f"{path}: {span}")
    if not up:
        if level is not None:
            raise GroundError(
                f"{path}: {span}, taken as depths (positive down), with sim.bathymetry.water_level_m = {level:g} m; "
                "expected water_level_m for elevations only: leave it out, or set sim.bathymetry.depth_sign: up"
            )
        return values, _DOWN
    surface = 0.0 if level is None else level
    if known.min() >= surface:
        raise GroundError(
            f"{path}: {span}, taken as elevations, none below the water surface at {surface:g} m; expected the "
            "bottom's elevations: set sim.bathymetry.water_level_m to the elevation of the water surface in the file's "
            "datum, or sim.bathymetry.depth_sign: down if these are depths"
        )
    return surface - values, "elevations, " + ("negated" if surface == 0.0 else f"water surface at {surface:g} m")


def _looks_up(known: Array, span: str) -> bool:
    """Whether a raster's values are elevations, by their signs.

    Raises:
        GroundError: if signs do not tell.
    """
    negative, positive = float((known < 0.0).mean()), float((known > 0.0).mean())
    if min(negative, positive) > _BOTH_SIGNS:
        raise GroundError(
            f"{span}, {100.0 * negative:.0f} % negative, {100.0 * positive:.0f} % positive: water and land, but which "
            "is which? Expected sim.bathymetry.water_level_m, the elevation of the water surface in the file's datum "
            "(these are elevations), or sim.bathymetry.depth_sign: down (these are depths, positive down)"
        )
    # Zeros often fill what is outside of the survey, and stray values happen: the bulk decides.
    if positive > 0.5 and float(np.quantile(known[known != 0.0], _BOTH_SIGNS)) > _ELEVATED_M:
        raise GroundError(
            f"{span}: elevations above sea level, or depths? Expected sim.bathymetry.water_level_m, the elevation of "
            "the water surface in the file's datum (these are elevations), or sim.bathymetry.depth_sign: down (these "
            "are depths, positive down)"
        )
    return negative > 0.5


def _upside_down(depth: Array, note: str, config: BathymetryConfig) -> bool:
    """Whether what a name says are depths cannot be: mostly negative, or, where the user insists, nowhere positive."""
    known = depth[np.isfinite(depth)]
    if note != _DOWN:
        return False
    return bool((known < 0.0).mean() > 0.5 if config.depth_sign == "auto" else (known < 0.0).all())


#: What numpy and zipfile raise on a file that is none, or is cut short or damaged anywhere.
_BROKEN_NPZ = (
    ValueError, EOFError, OSError, KeyError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError,
    MemoryError, OverflowError, SyntaxError, TypeError,
)  # fmt: skip


def _read_npz(path: Path, config: BathymetryConfig, origin: tuple[float, float] | None) -> GridGround:
    try:
        with path.open("rb") as file:
            data = np.load(file, allow_pickle=False)
            arrays = {key: np.asarray(data[key]) for key in data.files} if hasattr(data, "files") else None
    except _BROKEN_NPZ as error:
        raise GroundError(
            f"{path}: not a readable npz file, or a damaged one ({error}); expected arrays east_m, north_m, depth_m"
        ) from error
    if arrays is None:
        raise GroundError(
            f"{path}: a single array of shape {data.shape} (npy); expected an npz file of east_m, north_m, depth_m "
            "(np.savez)"
        )
    depth_name = "depth_m" if "depth_m" in arrays else "elevation_m"
    for key in ("north_m", "east_m", depth_name):
        if key not in arrays:
            raise GroundError(
                f"{path}: arrays are {', '.join(sorted(arrays)) or 'none'}; expected east_m (nx,), north_m (ny,), "
                "depth_m (ny, nx), optionally lat0, lon0, dist_to_sounding_m"
            )
        if arrays[key].dtype.kind not in "fiu":
            raise GroundError(f"{path}: {key} holds {arrays[key].dtype}; expected numbers")
    depth, notes = _grid_depths(arrays[depth_name].astype(float), path, depth_name, depth_name == "elevation_m", config)
    if _upside_down(depth, notes[0], config):
        raise GroundError(
            f"{path}: {depth_name} is mostly negative (median {np.nanmedian(depth):g} m); expected positive down: "
            f"{_SIGN_ADVICE}"
        )
    distance = arrays.get("dist_to_sounding_m")
    if distance is not None:
        if distance.dtype.kind not in "fiu":
            raise GroundError(f"{path}: dist_to_sounding_m holds {distance.dtype}; expected numbers")
        if distance.shape != depth.shape:
            raise GroundError(f"{path}: dist_to_sounding_m has shape {distance.shape}; expected {depth.shape}")
        depth = np.where(distance <= config.max_gap_m, depth, np.nan)
        notes.append(f"unknown beyond {config.max_gap_m:g} m of a sounding")
    if ("lat0" in arrays) != ("lon0" in arrays):
        raise GroundError(f"{path}: only one of lat0, lon0; expected both or neither")
    if "lat0" in arrays:
        origin = _checked_origin(arrays["lat0"], arrays["lon0"], f"{path}: lat0, lon0")
    north, east = arrays["north_m"].astype(float), arrays["east_m"].astype(float)
    if north.size and east.size and _far(north, east):
        raise GroundError(
            f"{path}: {_ranges(north, east)}; expected metres about a local origin, within {FAR_M / 1000:g} km, "
            "not projected ones (UTM): subtract an origin, and give its latitude and longitude as lat0, lon0"
        )
    return GridGround(
        north,
        east,
        depth,
        name=path.name,
        origin=origin,
        notes=tuple(notes),
    )


def _read_ascii(path: Path, config: BathymetryConfig, origin: tuple[float, float] | None) -> GridGround:
    """ESRI ASCII grid: a header of `name value` lines, then rows from north to south."""
    header: dict[str, float] = {}
    values: list[float] = []
    rows = 0
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            fields = line.split()
            if not fields:
                continue
            if fields[0][0].isalpha() and fields[0].lower() != "nan" and not rows:
                key = fields[0].lower()
                try:
                    header[key] = float(fields[1])
                except (IndexError, ValueError):
                    raise GroundError(
                        f"{path}:{number}: {line.strip()!r}; expected a header line 'name number'"
                    ) from None
                count = key in ("ncols", "nrows")
                if count and not (header[key].is_integer() and header[key] >= 2):
                    raise GroundError(f"{path}:{number}: {line.strip()!r}; expected a whole number of at least 2")
                if not (math.isfinite(header[key]) or key == "nodata_value"):
                    raise GroundError(f"{path}:{number}: {line.strip()!r}; expected a finite number")
                continue
            try:
                row = [float(f) for f in fields]
            except ValueError:
                bad = next(f for f in fields if not _is_number(f))
                raise GroundError(f"{path}:{number}: {bad!r}; expected a number") from None
            columns = int(header.get("ncols", 0))
            if columns and len(row) != columns:
                raise GroundError(f"{path}:{number}: {len(row)} values; expected ncols = {columns}")
            values.extend(row)
            rows += 1
    corner = "xllcorner" in header
    x_name, y_name = ("xllcorner", "yllcorner") if corner else ("xllcenter", "yllcenter")
    for key in ("ncols", "nrows", x_name, y_name, "cellsize"):
        if key not in header:
            raise GroundError(f"{path}: header has {', '.join(header) or 'nothing'}; expected also {key}")
    columns, expected = int(header["ncols"]), int(header["nrows"])
    if rows != expected:
        raise GroundError(f"{path}: {rows} rows of values; expected nrows = {expected}")
    grid = np.array(values).reshape(rows, columns)[::-1]  # the file runs from north to south
    grid = np.where(grid == header.get("nodata_value", math.nan), np.nan, grid)
    step = header["cellsize"]
    if step <= 0.0:
        raise GroundError(f"{path}: cellsize {step:g}; expected > 0")
    shift = 0.5 * step if corner else 0.0
    x = header[x_name] + shift + step * np.arange(columns, dtype=np.float64)
    y = header[y_name] + shift + step * np.arange(rows, dtype=np.float64)
    projection = path.with_suffix(".prj")
    crs = projection.read_text() if projection.is_file() else None
    return _raster(path, x, y, grid, crs, config, origin)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_geotiff(path: Path, config: BathymetryConfig, origin: tuple[float, float] | None) -> GridGround:
    try:
        import rasterio
        from rasterio.errors import RasterioError, RasterioIOError
    except ImportError:
        raise GroundError(
            f"{path}: reading a GeoTIFF needs rasterio, which is not installed; pip install rasterio, or convert it: "
            "gdal_translate -of AAIGrid in.tif out.asc"
        ) from None
    try:
        with rasterio.open(path) as data:
            grid = data.read(1).astype(float)
            nodata, transform, crs = data.nodata, data.transform, data.crs
    except (RasterioIOError, RasterioError) as error:
        raise GroundError(f"{path}: not a readable GeoTIFF: {error}") from error
    if transform.b or transform.d or transform.e >= 0 or transform.a <= 0:
        raise GroundError(f"{path}: transform {tuple(transform)[:6]}; expected a north-up raster (gdalwarp makes one)")
    if nodata is not None:
        grid = np.where(grid == nodata, np.nan, grid)
    rows, columns = grid.shape
    x = transform.c + transform.a * (np.arange(columns) + 0.5)
    y = (transform.f + transform.e * (np.arange(rows) + 0.5))[::-1]
    return _raster(path, x, y, grid[::-1], crs.to_wkt() if crs else None, config, origin)


def _raster(
    path: Path,
    x: Array,
    y: Array,
    grid: Array,
    crs: str | None,
    config: BathymetryConfig,
    origin: tuple[float, float] | None,
) -> GridGround:
    """A raster in any coordinates as local ground: x (nx,) and y (ny,) grow, grid is (ny, nx)."""
    grid, notes = _grid_depths(grid, path, "values", None, config)
    degrees = crs is None and x[0] >= -360 and x[-1] <= 360 and y[0] >= -90 and y[-1] <= 90 and x[1] - x[0] < 0.1
    if crs is None and not degrees:
        far = max(abs(x[0]), abs(x[-1]), abs(y[0]), abs(y[-1])) > 50_000.0
        if not far:
            return GridGround(
                y, x, grid, name=path.name, origin=None, notes=(*notes, "coordinates taken as local metres")
            )
        x0, y0 = float(x[0] + x[-1]) / 2.0, float(y[0] + y[-1]) / 2.0
        shifted = f"no projection given: local origin put at its {x0:.1f}, {y0:.1f}"
        return GridGround(y - y0, x - x0, grid, name=path.name, origin=None, notes=(*notes, shifted))
    from pyproj import CRS, Transformer
    from pyproj.exceptions import CRSError

    try:
        to_raster = Transformer.from_crs(
            "EPSG:4326", CRS.from_user_input("EPSG:4326" if crs is None else crs), always_xy=True
        )
    except CRSError as error:
        raise GroundError(f"{path}: projection not understood: {error}") from error
    corners_x, corners_y = np.meshgrid([x[0], x[-1]], [y[0], y[-1]])
    lon, lat = to_raster.transform(corners_x, corners_y, direction="INVERSE")
    if origin is None:
        origin = _checked_origin(np.mean(lat), _longitude(float(np.mean(lon))), f"{path}: the middle of the raster")
    north, east = local_from_geodetic(lat, lon, *origin)
    _check_near(path, north, east, lat, lon, origin)
    ny, nx = grid.shape
    step = min(float(np.ptp(north)) / (ny - 1), float(np.ptp(east)) / (nx - 1))
    north_m = north.min() + step * np.arange(int(np.ptp(north) / step) + 1)
    east_m = east.min() + step * np.arange(int(np.ptp(east) / step) + 1)
    if len(north_m) * len(east_m) > 25_000_000:
        raise GroundError(f"{path}: {len(north_m)} x {len(east_m)} nodes; expected at most 25 million: cut the raster")
    node_north, node_east = np.meshgrid(north_m, east_m, indexing="ij")
    lat, lon = geodetic_from_local(node_north, node_east, *origin)
    rx, ry = to_raster.transform(lon, lat)
    rows = (np.asarray(ry) - y[0]) / (y[1] - y[0])
    columns = (np.asarray(rx) - x[0]) / (x[1] - x[0])
    # Bilinear with NaN outside: a node that mixes in an unknown one is unknown.
    local = ndimage.map_coordinates(grid, [rows, columns], order=1, mode="constant", cval=np.nan)
    return GridGround(
        north_m, east_m, local, name=path.name, origin=origin, notes=(*notes, "reprojected to local metres")
    )
