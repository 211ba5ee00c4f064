"""The polygon that a line encloses: a drawn path, a route of corners, or a track along the border."""

import math

import numpy as np

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.plurals import counted
from auv_lse_common.vocabulary.frames import geodetic_from_local, local_from_geodetic

#: Largest gap between the ends of a track, as a share of its length.
MAX_GAP = 0.1
#: Minimum share of the enclosed ground in the main loop of the line; the others are small loops of a GPS track.
_MAIN_LOOP = 0.95
#: Corners of a recorded track closer than this (m) to the simplified one are left out.
_TOLERANCE_M = 0.5


def lengths_m(line: Array) -> tuple[float, float]:
    """Length (m) of a line of latitude, longitude (deg), and between its ends."""
    north, east = local_from_geodetic(line[:, 0], line[:, 1], line[0, 0], line[0, 1])
    length_m = float(np.hypot(np.diff(north), np.diff(east)).sum())
    return length_m, math.hypot(float(north[-1] - north[0]), float(east[-1] - east[0]))


def ends_meet(line: Array) -> bool:
    """Whether a track ends where it began."""
    length_m, gap_m = lengths_m(line)
    return gap_m <= MAX_GAP * length_m


def outline(line: Array, closes: str, where: str) -> tuple[Array, str]:
    """The corners (n, 2) of the polygon inside a line (m, 2), both in degrees, and a note on how it was made.

    Args:
        line: Latitude, longitude along it.
        closes: "route": its corners are those of the polygon; "track": recorded on the way around; "": closed already.

    Raises:
        ParameterError: if it is not closed, or encloses several areas.
    """
    if len(line) < 3:
        raise ParameterError(f"{where} has {counted(len(line), 'point')}; an outline needs 3. Draw a polygon instead")
    north, east = local_from_geodetic(line[:, 0], line[:, 1], line[0, 0], line[0, 1])
    gap_m = lengths_m(line)[1]
    if closes == "track" and not ends_meet(line):
        raise ParameterError(
            f"{where} is a track whose ends lie {gap_m:.0f} m apart. Draw a polygon, or a route of the area's corners"
        )
    if closes != "track":
        ring = line[:-1] if len(line) > 3 and np.array_equal(line[0], line[-1]) else line
        return ring, f", closed over {gap_m:.0f} m" if gap_m > 0.0 else ""
    import shapely  # slow to import, and rarely needed

    loops = shapely.polygonize([shapely.unary_union(shapely.LinearRing(np.column_stack([east, north])))])
    merged = shapely.unary_union(loops)
    parts = sorted(shapely.get_parts(merged), key=lambda part: -part.area)
    if not parts or parts[0].area < _MAIN_LOOP * sum(part.area for part in parts):
        raise ParameterError(f"{where} crosses itself and encloses {len(parts)} areas. Draw a polygon instead")
    main = shapely.Polygon(parts[0].exterior).simplify(_TOLERANCE_M)
    corners = np.asarray(main.exterior.coords)[:-1]
    left_out = merged.area - parts[0].area
    note = f", closed over {gap_m:.0f} m, {len(corners)} of {len(line)} points kept"
    note += f", {left_out:.0f} m2 of small loops left out" if left_out > 1.0 else ""
    return np.column_stack(geodetic_from_local(corners[:, 1], corners[:, 0], line[0, 0], line[0, 1])), note
