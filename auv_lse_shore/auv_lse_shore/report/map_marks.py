"""Marks on maps in local metres: latitude and longitude, a scale bar, and north."""

import math
from typing import Any

import numpy as np
from matplotlib.patheffects import withStroke

from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.frames import geodetic_from_local, local_from_geodetic

#: Color of the lines of latitude and longitude, and their width (points).
GRATICULE: dict[str, Any] = {"color": "#7a7a7a", "lw": 0.45, "ls": (0, (1.0, 3.0)), "zorder": 2.5}
#: White around marks.
_CASING = [withStroke(linewidth=3.2, foreground="white")]
#: Largest number of lines of latitude and of longitude.
MAX_LINES = 5
#: Size of their labels (points).
_LABEL_SIZE = 6.5
#: Shares of the map's height and width that scale bar and arrow take in a corner, with room for labels beside them.
_CORNER = (0.3, 0.36)
#: Share of the map's width and height between the bar and the edge: more than the 4 % that maps leave around an area.
_INSIDE = 0.065


def add_graticule(
    axis: Any, origin: tuple[float, float] | None, *, latitudes: bool = True, longitudes: bool = True
) -> None:
    """Draws lines of latitude and longitude over a map, labeled on the right and at the top.

    The map's limits must be final.

    Args:
        axis: A map: x is east, y is north (m).
        origin: Latitude and longitude (deg) of north = east = 0; None draws nothing.
        latitudes: Whether to label the lines of latitude.
        longitudes: Whether to label the lines of longitude.
    """
    if origin is None:
        return
    (west, east), (south, north) = axis.get_xlim(), axis.get_ylim()
    corners_n, corners_e = np.array([south, south, north, north]), np.array([west, east, west, east])
    lat, lon = geodetic_from_local(corners_n, corners_e, *origin)
    lon = origin[1] + (lon - origin[1] + 180.0) % 360.0 - 180.0  # without a jump at the antimeridian
    ends = np.linspace(0.0, 1.0, 9)
    at_north: list[tuple[float, str]] = []
    at_east: list[tuple[float, str]] = []
    values, digits = nice_values(float(lat.min()), float(lat.max()))
    for value in values:
        n, e = local_from_geodetic(np.full_like(ends, value), lon.min() + ends * np.ptp(lon), *origin)
        axis.plot(e, n, scalex=False, scaley=False, **GRATICULE)
        at_north.append((float(np.interp(east, e, n)), degrees(value, digits, "NS")))
    values, digits = nice_values(float(lon.min()), float(lon.max()))
    for value in values:
        n, e = local_from_geodetic(lat.min() + ends * np.ptp(lat), np.full_like(ends, value), *origin)
        axis.plot(e, n, scalex=False, scaley=False, **GRATICULE)
        at_east.append((float(np.interp(north, n, e)), degrees((value + 180.0) % 360.0 - 180.0, digits, "EW")))
    if latitudes:
        _label(axis.secondary_yaxis("right"), "yaxis", [row for row in at_north if south <= row[0] <= north])
    if longitudes:
        rows = [row for row in at_east if west <= row[0] <= east]
        width = axis.figure.get_figwidth() * 72.0 * axis.get_position().width  # points
        needed = sum(_LABEL_SIZE * 0.7 * len(text) for _, text in rows)
        _label(axis.secondary_xaxis("top"), "xaxis", rows[:: max(math.ceil(needed / width), 1)])


def nice_values(low: float, high: float) -> tuple[list[float], int]:
    """Round values between two, at most `MAX_LINES`, and the number of decimals that tells them apart."""
    step, digits = 10.0, 0
    for exponent in range(0, -7, -1):
        for factor in (5, 2, 1):
            finer = factor * 10.0**exponent
            if (high - low) / finer > MAX_LINES:
                return [round(k * step, 8) for k in range(math.ceil(low / step), math.floor(high / step) + 1)], digits
            step, digits = finer, -exponent
    return [round(k * step, 8) for k in range(math.ceil(low / step), math.floor(high / step) + 1)], digits


def degrees(value: float, digits: int, signs: str) -> str:
    """A latitude (signs "NS") or longitude ("EW") for readers."""
    return f"{abs(value):.{digits}f}° {signs[0] if value >= 0.0 else signs[1]}"


def _label(secondary: Any, name: str, rows: list[tuple[float, str]]) -> None:
    axis = getattr(secondary, name)
    axis.set_ticks(
        [location for location, _ in rows], [text for _, text in rows], fontsize=_LABEL_SIZE, color="#555555"
    )
    axis.set_tick_params(length=2.0, width=0.4, color="#7a7a7a", pad=1.5)
    for spine in secondary.spines.values():
        spine.set_visible(False)


def add_scale_bar(axis: Any, marked_m: Array | None = None) -> None:
    """Draws a scale bar of a round length, and an arrow to the north above it.

    Args:
        marked_m: Marked positions (n, 2), north and east: of the corners, the lower left one first, that with the
            fewest of them is used.
    """
    (west, east), (south, north) = axis.get_xlim(), axis.get_ylim()
    length = round_length((east - west) / 4.0)
    low, size = np.array([south, west]), np.array([north - south, east - west])
    top, right = _emptiest_corner(((np.empty((0, 2)) if marked_m is None else marked_m) - low) / size)
    x = east - _INSIDE * (east - west) - length if right else west + _INSIDE * (east - west)
    y = south + (0.8 if top else _INSIDE) * (north - south)
    end = {"markeredgewidth": 2.0, "marker": "|", "markersize": 6.0}
    line = {"color": "black", "lw": 2.0, "zorder": 6, "path_effects": _CASING}
    axis.plot([x, x + length], [y, y], **line, **end)
    text = {"zorder": 6, "ha": "center", "va": "bottom", "path_effects": _CASING}
    words = f"{length:g} m" if length < 1000.0 else f"{length / 1000.0:g} km"
    axis.annotate(words, (x + length / 2.0, y), (0.0, 4.0), textcoords="offset points", fontsize=7.5, **text)
    tail, head = (x, y + 0.05 * (north - south)), (x, y + 0.13 * (north - south))
    arrow = {"arrowstyle": "<|-", "lw": 1.2, "color": "black", "shrinkA": 0.0, "shrinkB": 0.0}
    axis.annotate("N", tail, head, arrowprops=arrow, fontsize=9.0, fontweight="bold", **text)


def _emptiest_corner(shares: Array) -> tuple[int, int]:
    """The corner with the fewest positions: whether it is at the top, and whether it is right.

    Args:
        shares: The positions (n, 2), as shares of the map's height and width from its lower left.
    """
    corners = ((0, 0), (0, 1), (1, 1), (1, 0))
    return min(corners, key=lambda corner: int((np.abs(shares - corner) < _CORNER).all(axis=1).sum()))


def round_length(largest_m: float) -> float:
    """The largest of 1, 2, 5, 10, 20, ... that is at most `largest_m`."""
    decade = 10.0 ** math.floor(math.log10(largest_m))
    return max(factor * decade for factor in (1.0, 2.0, 5.0) if factor * decade <= largest_m)
