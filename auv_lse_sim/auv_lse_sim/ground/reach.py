"""Leaves ground that no vehicle can reach out of a mission: it becomes no-go areas of their own name."""

import numpy as np
import shapely
from contourpy import contour_generator
from scipy import ndimage

from auv_lse_common.mission_file.operating_area import UNREACHABLE, OperatingArea, free_m2, unreachable_m2
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.plurals import area_size
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_sim.ground.reachable import UnreachedPart, strait_to, unreached_parts

#: Largest number of parts that are described one by one.
MAX_DESCRIBED = 3
#: Tolerance of an outline, in nodes of the raster. Outlines may be larger by twice this, which is less than a turning
#: loop's reach, so that vehicles keep their margin wherever they can go.
TOLERANCE_NODES = 1.0


def without_unreachable(settings: Settings) -> Settings:
    """The mission without the no-go areas that `clip_to_reachable` adds."""
    if not any(name.startswith(UNREACHABLE) for name in settings.area.no_go):
        return settings
    patterns = settings.open_patterns()
    no_go = patterns["/**"]["area"]["no_go"]
    patterns["/**"]["area"]["no_go"] = {k: flat for k, flat in no_go.items() if not k.startswith(UNREACHABLE)}
    return Settings.from_patterns(patterns, settings.where)


def clip_to_reachable(settings: Settings) -> tuple[Settings, list[str]]:
    """Adds no-go areas `unreachable_1`, ... around ground that no feasible actions lead to from any start.

    Strips, lanes, planning, and evaluation then leave it out. If everything can be reached, nothing changes.

    Args:
        settings: A mission, whose area and starts are final.

    Returns:
        The mission, and a note on what cannot be reached and why; no note if everything can.
    """
    settings = without_unreachable(settings)
    space = FreeSpace(OperatingArea(settings.area), MotionTable(settings.motion), settings.area.raster_m)
    starts = [
        (v.start_heading_rad, v.start_north_m, v.start_east_m) for v in (own.vehicle for own in settings.vehicles)
    ]
    parts = unreached_parts(space, np.array(starts))
    if not parts:
        return settings, []
    rings = [ring for part in parts for ring in _rings(space, part)]
    no_go = {f"{UNREACHABLE}{i}": _flat(ring) for i, ring in enumerate(rings, 1)}  # beside the mission's own
    fitted = settings.with_overrides({"area": {"no_go": no_go}})
    return fitted, [_note(space, parts, fitted)]


def _note(space: FreeSpace, parts: list[UnreachedPart], fitted: Settings) -> str:
    left_out_m2 = unreachable_m2(fitted.area)
    share = left_out_m2 / (left_out_m2 + free_m2(fitted.area))
    needed_m = 2.0 * (space.margin_m + float(space.motion.loops_m[:, 2].min()))
    reasons = [_reason(space, part) for part in parts[:MAX_DESCRIBED]]
    if len(parts) > 1:
        reasons = [f"{area_size(part.area_m2)}: {text}" for part, text in zip(parts, reasons, strict=False)]
    more = len(parts) - MAX_DESCRIBED
    others = f"; {more} smaller part{'s' * (more > 1)}" if more > 0 else ""
    return (
        f"area: {_percent(share)} of it ({area_size(left_out_m2)}) cannot be reached from the starts and is "
        f"left out. {'; '.join(reasons)}{others}. A safe turn needs {needed_m:.0f} m, including area.margin_m on both "
        "sides, and no leg leads through. To include this ground, start vehicles there, as at "
        f"{_widest(space, parts[0])}, or choose a smaller margin or turning radius"
    )


def _widest(space: FreeSpace, part: UnreachedPart) -> str:
    """The location of a part that is farthest from land and borders."""
    clearance = np.where(part.nodes, space.area_raster, -np.inf)
    row, column = np.unravel_index(np.argmax(clearance), clearance.shape)
    return f"north {space.north0_m + space.cell_m * row:.0f}, east {space.east0_m + space.cell_m * column:.0f} m"


def _reason(space: FreeSpace, part: UnreachedPart) -> str:
    (north, east), width_m = strait_to(space, part)
    location = f"north {north:.0f}, east {east:.0f} m"
    if width_m > 0.0:
        return f"The strait at {location} is {width_m:.0f} m wide"
    return f"Land or a no-go area at {location} separates it"


def _percent(share: float) -> str:
    if share >= 0.01:
        return f"{100.0 * share:.0f} %"
    return f"{100.0 * share:.1f} %" if share >= 0.0005 else "less than 0.1 %"


def _rings(space: FreeSpace, part: UnreachedPart) -> list[shapely.LinearRing]:
    """Outlines (east, north) of a part that together cover it; one that surrounds other water is cut in two."""
    used = [np.flatnonzero(part.nodes.any(axis=axis)) for axis in (1, 0)]
    window = tuple(slice(max(int(along[0]) - 2, 0), int(along[-1]) + 3) for along in used)
    own, inside = part.nodes[window], space.area_raster[window] > -space.margin_m
    nodes = own | (ndimage.binary_dilation(own) & ~inside)  # no sliver along the shore
    padded = np.pad(nodes.astype(float), 1)
    first = [side.start - 1.0 for side in window]
    north = space.north0_m + space.cell_m * (np.arange(len(padded)) + first[0])
    east = space.east0_m + space.cell_m * (np.arange(len(padded[0])) + first[1])
    lines = contour_generator(east, north, padded).lines(0.5)
    shapes = [shapely.Polygon(line) for line in lines if len(line) >= 4]
    outer = max(shapes, key=lambda ring: ring.area)
    water = np.argwhere(inside & ~own)  # other water
    other_m = np.column_stack([north[water[:, 0] + 1], east[water[:, 1] + 1]])
    holes = [s for s in shapes if s is not outer and outer.contains(s) and _holds(s, other_m)]
    tolerance_m = TOLERANCE_NODES * space.cell_m
    shape = shapely.Polygon(outer.exterior, [hole.exterior for hole in holes]).simplify(tolerance_m)
    return [piece.exterior for piece in _without_holes(shape.buffer(tolerance_m, join_style="mitre"))]


def _holds(ring: shapely.Polygon, locations_m: Array) -> bool:
    """Whether any of the locations (n, 2) lies in a ring."""
    west, south, east, north = ring.bounds
    near = locations_m[np.all((locations_m >= (south, west)) & (locations_m <= (north, east)), axis=1)]
    return bool(shapely.contains_xy(ring, near[:, 1], near[:, 0]).any())


def _without_holes(shape: shapely.Polygon) -> list[shapely.Polygon]:
    if not shape.interiors:
        return [shape]
    west, south, east, north = shape.bounds
    cut = shape.interiors[0].centroid.x
    halves = [shape.intersection(shapely.box(*box)) for box in ((west, south, cut, north), (cut, south, east, north))]
    pieces = [p for half in halves for p in getattr(half, "geoms", [half]) if p.area > 1.0]
    return [simple for piece in pieces for simple in _without_holes(piece)]


def _flat(ring: shapely.LinearRing) -> list[float]:
    """Corners as north, east, ... rounded to centimetres, without the repeated last one."""
    return [round(float(v), 2) for v in np.asarray(ring.coords)[:-1, ::-1].ravel()]
