"""Section `area`: the operating area."""

import numpy as np

from auv_lse_common.mission_file.parameters import ParameterError, configuration, parameter
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.input_bounds import MAX_CORNERS
from auv_lse_common.vocabulary.sounding import DEEPEST_M


@configuration
class AreaConfig:
    """The area where the vehicles may be."""

    polygon_m: tuple[float, ...] = parameter(
        (-50.0, -50.0, 550.0, -50.0, 550.0, 650.0, -50.0, 650.0),
        unit="m",
        help="Corners of the operating area in order, either way round: north, east, north, east, ...",
    )
    no_go: dict[str, tuple[float, ...]] = parameter(
        {}, unit="m", help="Areas that vehicles must not enter, by name: corners as in polygon_m"
    )
    shore: dict[str, tuple[float, ...]] = parameter(
        {},
        unit="m",
        help="Lines along the shore by name: north, east, ...",
    )
    shore_depth_m: float = parameter(0.0, low=-100.0, high=DEEPEST_M, unit="m", help="Depth along the shore")
    file: str | None = parameter(
        None,
        help="Instead of polygon_m: a file with the area, no-go areas, starts and recovery positions, such as GeoJSON, "
        "KML, GPX, GeoPackage, shapefile or a QGroundControl plan (docs/guide/your-own-lake.md). Relative to the "
        "mission file",
    )
    polygon_deg: tuple[float, ...] = parameter(
        (), unit="deg", help="Instead of polygon_m: the corners' latitude, longitude, latitude, longitude, ..."
    )
    no_go_deg: dict[str, tuple[float, ...]] = parameter({}, unit="deg", help="As no_go, with corners as polygon_deg")
    origin_lat_deg: float | None = parameter(
        None, low=-90.0, high=90.0, unit="deg", help="WGS84 latitude of north = east = 0, where known"
    )
    origin_lon_deg: float | None = parameter(
        None, low=-180.0, high=180.0, unit="deg", help="WGS84 longitude of north = east = 0, where known"
    )
    margin_m: float = parameter(
        10.0,
        low=0.0,
        high=10e3,
        unit="m",
        help="Distance that vehicles keep from the area's border and from no-go areas",
    )
    raster_m: float = parameter(
        2.0,
        above=0.0,
        high=10e3,
        unit="m",
        help="Spacing of the raster of distances to the border, which err by at most twice this, on the safe side",
    )

    @property
    def origin_deg(self) -> tuple[float, float] | None:
        """Latitude and longitude (deg) of north = east = 0; None if unknown."""
        lat_deg, lon_deg = self.origin_lat_deg, self.origin_lon_deg
        return None if lat_deg is None or lon_deg is None else (lat_deg, lon_deg)

    def __post_init__(self) -> None:
        """Checks the polygons.

        Raises:
            ParameterError: naming the polygon and the error.
        """
        for key in ("file", "polygon_deg", "no_go_deg"):
            if value := getattr(self, key):
                raise ParameterError(metres_only(f"area.{key}", value))
        given = (self.polygon_m, *self.no_go.values(), *self.shore.values())
        number = sum(map(len, given)) // 2
        if number > MAX_CORNERS:
            raise ParameterError(
                f"area.polygon_m, area.no_go and area.shore have {number:,} corners together, more than "
                f"{MAX_CORNERS:,}. Simplify the polygons"
            )
        corners("area.polygon_m", self.polygon_m)
        for name, flat in self.no_go.items():
            corners(f"area.no_go.{name}", flat)
        for name, flat in self.shore.items():
            if len(flat) % 2 or len(flat) < 4 or not np.isfinite(flat).all():
                raise ParameterError(
                    f"area.shore.{name} has {len(flat)} numbers; give finite north, east of at least 2 corners"
                )
        if (self.origin_lat_deg is None) != (self.origin_lon_deg is None):
            raise ParameterError(
                f"area.origin_lat_deg, area.origin_lon_deg are {self.origin_lat_deg!r}, {self.origin_lon_deg!r}, "
                "so one is missing. Set it, or remove the other"
            )


def metres_only(key: str, value: object) -> str:
    """The message of a node that gets positions in degrees, which are converted where a mission file is read."""
    return (
        f"{key} is {value!r}, but nodes and --set take metres only. Give it in a mission file, and start with "
        "auv_lse mission or auv_lse sim, which convert it"
    )


def corners(name: str, flat: tuple[float, ...]) -> Array:
    """Corners (n, 2) of a flat polygon (north, east, north, east, ...); a repeated last corner is dropped.

    Raises:
        ParameterError: if it is not a simple polygon of at least three finite corners.
    """
    if len(flat) % 2 or len(flat) < 6:
        raise ParameterError(
            f"{name} has {len(flat)} numbers; give north, east of at least 3 corners (an even number, 6 or more)"
        )
    polygon = np.array(flat, dtype=float).reshape(-1, 2)
    bad = np.flatnonzero(~np.isfinite(polygon).all(axis=1) | (np.abs(polygon) > 1e6).any(axis=1))
    if len(bad):
        raise ParameterError(
            f"{name}: corner {bad[0] + 1} is {tuple(polygon[bad[0]].tolist())}; coordinates must be finite and "
            "within 1000 km"
        )
    if len(polygon) > 3 and np.array_equal(polygon[0], polygon[-1]):
        polygon = polygon[:-1]
    following = np.roll(polygon, -1, axis=0)
    same = np.flatnonzero((polygon == following).all(axis=1))
    if len(same):
        raise ParameterError(f"{name}: corner {same[0] + 1} {tuple(polygon[same[0]].tolist())} is given twice in a row")
    crossing = _crossing_edges(polygon, following)
    if crossing is not None:
        one, other = (_edge_text(polygon, edge) for edge in crossing)
        raise ParameterError(f"{name} crosses itself: {one} meets {other}. List the corners in order around the area")
    area = 0.5 * float(np.sum(polygon[:, 0] * following[:, 1] - following[:, 0] * polygon[:, 1]))
    span = float(np.ptp(polygon, axis=0).max())
    if abs(area) <= 1e-9 * span * span:
        raise ParameterError(f"{name} has no area: its corners lie on one line")
    return polygon


def _edge_text(polygon: Array, edge: int) -> str:
    """An edge in words, with its corners counted from 1."""
    ends = ((i + 1, *polygon[i]) for i in (edge, (edge + 1) % len(polygon)))
    return "the edge from " + " to ".join(f"corner {number} ({north:g}, {east:g})" for number, north, east in ends)


def _crossing_edges(a: Array, b: Array) -> tuple[int, int] | None:
    """Numbers of two edges a[i]-b[i], a[j]-b[j] that meet outside a shared corner, or None."""
    n = len(a)

    def side(p: Array, q: Array, r: Array) -> Array:
        pq, pr = q - p, r - p
        return np.sign(pq[..., 0] * pr[..., 1] - pq[..., 1] * pr[..., 0])

    for i in range(n - 1):
        others = np.arange(i + 1, n)
        p, q = np.broadcast_to(a[i], (len(others), 2)), np.broadcast_to(b[i], (len(others), 2))
        r, s = a[others], b[others]
        neighbors = (others == i + 1) | ((i == 0) & (others == n - 1))
        d1, d2, d3, d4 = side(p, q, r), side(p, q, s), side(r, s, p), side(r, s, q)
        overlap = (np.minimum(p, q) <= np.maximum(r, s)) & (np.minimum(r, s) <= np.maximum(p, q))
        meets = (d1 * d2 <= 0) & (d3 * d4 <= 0) & overlap.all(axis=1)
        # Neighbors share a corner; they cross only if they lie on one line and fold back on each other.
        folded = (d1 == 0) & (d2 == 0) & (np.einsum("kd,kd->k", q - p, s - r) < 0.0)
        hit = np.flatnonzero(np.where(neighbors, folded, meets))
        if len(hit):
            return i, int(others[hit[0]])
    return None
