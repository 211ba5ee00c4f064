"""Plans and fences of QGroundControl (.plan), Mission Planner (.waypoints, .poly, .fen, .ral) and MAVProxy."""

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_shore.areas.features import FALSE, TRUE, Feature, ring_of

#: Corners of the polygon that stands for a circle.
_CIRCLE_CORNERS = 36
#: The role of a fence that vehicles stay inside; `roles` prefers a survey inside it.
_INSIDE = "inclusion fence"
#: Numbers joined by commas, without points: decimal commas if a line has more than two such groups.
_DECIMAL_COMMAS = re.compile(r"[+-]?\d+(?:,[+-]?\d+)+[,;]?")
_DEGREES = re.compile(r"-?\d+\.\d+")
#: MAV_CMD_NAV_FENCE_* and rally points in a waypoint file.
_FENCE_RETURN, _POLYGON_IN, _POLYGON_OUT, _CIRCLE_IN, _CIRCLE_OUT, _RALLY = 5000, 5001, 5002, 5003, 5004, 5100


def qgc_features(data: Mapping[str, Any], where: str) -> Iterator[Feature]:
    """The features of a QGroundControl plan: survey polygons, fences and rally points; the rest is named.

    Raises:
        ParameterError: naming what cannot be read.
        KeyError, TypeError, ValueError: if it is not a plan.
    """
    fence = data.get("geoFence") or {}
    for number, polygon in enumerate(fence.get("polygons") or (), 1):
        yield _fence(f"fence {number}", _is_inside(polygon, where), _ring(polygon["polygon"]))
    if fence.get("polygon"):  # plans of version 1
        yield _fence("fence", True, _ring(fence["polygon"]))
    for number, entry in enumerate(fence.get("circles") or (), 1):
        circle = entry["circle"]
        latitude, longitude = (float(v) for v in circle["center"][:2])
        inside = _is_inside(entry, where)
        ring = _circle(latitude, longitude, float(circle["radius"]), f"{where}: fence circle {number}", inside)
        yield _fence(f"circle {number}", inside, ring)
    if fence.get("breachReturn"):
        yield Feature("breach return point")
    for number, point in enumerate((data.get("rallyPoints") or {}).get("points") or (), 1):
        name = "recovery" if number == 1 else f"further point {number}"
        yield Feature(name, point=(float(point[0]), float(point[1])))
    yield from _mission_items((data.get("mission") or {}).get("items") or ())


def _is_inside(fence: Mapping[str, Any], where: str) -> bool:
    """Whether vehicles stay inside a fence, and not outside."""
    stated = fence.get("inclusion", True)
    if (text := str(stated).lower()) not in (*TRUE, *FALSE):
        raise ParameterError(f"{where}: inclusion is {stated!r}; write true or false")
    return text in TRUE


def _mission_items(items: Sequence[Mapping[str, Any]]) -> Iterator[Feature]:
    """The survey polygons among the items of a mission; the other items are named and counted."""
    others: Counter[str] = Counter()
    for number, item in enumerate(items, 1):
        kind = str(item.get("complexItemType") or item.get("type") or "item")
        if kind.lower() == "survey" and item.get("polygon"):
            yield Feature(f"survey {number}", rings=(_ring(item["polygon"]),))
        elif kind == "StructureScan" and item.get("polygon"):
            yield Feature(f"structure scan {number} (its polygon)")
        else:
            others["waypoint" if kind == "SimpleItem" else kind] += 1
    for kind, number in others.items():
        yield Feature(f"{number} x {kind}")


def _fence(name: str, inside: bool, ring: Array) -> Feature:
    return Feature(name if inside else f"no-go {name}", _INSIDE if inside else "exclusion", rings=(ring,))


def _ring(corners: Sequence[Any]) -> Array:
    """Corners (n, 2) of [latitude, longitude] pairs, or of objects with these members."""
    pairs = [(c["latitude"], c["longitude"]) if isinstance(c, Mapping) else (c[0], c[1]) for c in corners]
    return ring_of([(longitude, latitude) for latitude, longitude in pairs])


def _circle(latitude: float, longitude: float, radius_m: float, where: str, inside: bool) -> Array:
    """Corners (36, 2) of a polygon around a circle, so that no part of an excluded circle is left outside."""
    if not (math.isfinite(radius_m) and 0.0 < radius_m <= 100_000.0 and abs(latitude) <= 89.0):
        raise ParameterError(f"{where} has the radius {radius_m:g} m at latitude {latitude:g}. Draw a polygon instead")
    turn = np.linspace(0.0, 2.0 * math.pi, _CIRCLE_CORNERS, endpoint=False)
    outer_m = radius_m if inside else radius_m / math.cos(math.pi / _CIRCLE_CORNERS)
    north, east = outer_m * np.cos(turn), outer_m * np.sin(turn)
    return np.column_stack(geodetic_from_local(north, east, latitude, longitude))


def waypoint_features(text: str, where: str) -> Iterator[Feature]:
    """The features of a waypoint file (QGC WPL): fences and rally points; waypoints are counted.

    Raises:
        ParameterError: naming the line that cannot be read, or a fence with missing corners.
    """
    others = 0
    polygon: list[tuple[float, float]] = []
    expected, inside, number = 0, True, 0
    for line_number, line in enumerate(text.splitlines()[1:], 2):
        fields = line.split()
        if not fields or line.startswith("#"):
            continue
        try:
            command, value, latitude, longitude = int(fields[3]), *(float(fields[k]) for k in (4, 8, 9))
        except (IndexError, ValueError):
            raise ParameterError(f"{where}:{line_number}: {line.strip()[:80]!r} is not a waypoint") from None
        if polygon and command != (_POLYGON_IN if inside else _POLYGON_OUT):
            raise ParameterError(f"{where}:{line_number}: fence {number} has {len(polygon)} of {expected} corners")
        if command in (_POLYGON_IN, _POLYGON_OUT):
            if not polygon:
                expected, inside, number = int(value) if math.isfinite(value) else 0, command == _POLYGON_IN, number + 1
            polygon.append((longitude, latitude))
            if len(polygon) >= expected:
                yield _fence(f"fence {number}", inside, ring_of(polygon))
                polygon = []
        elif command in (_CIRCLE_IN, _CIRCLE_OUT):
            number += 1
            inside_circle = command == _CIRCLE_IN
            ring = _circle(latitude, longitude, value, f"{where}:{line_number}: the circle", inside_circle)
            yield _fence(f"circle {number}", inside_circle, ring)
        elif command == _RALLY:
            yield Feature("recovery", point=(latitude, longitude))
        elif command == _FENCE_RETURN:
            yield Feature("fence return point")
        else:
            others += 1
    if polygon:
        raise ParameterError(f"{where}: fence {number} has {len(polygon)} of {expected} corners. Export it again")
    if others:
        yield Feature(f"{others} x waypoint")


def is_fence(text: str) -> bool:
    """Whether a text is a fence as MAVProxy saves it: rows of latitude and longitude, closed after its return point."""
    rows = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    is_closed = len(rows) > 4 and rows[1] == rows[-1] != rows[0]
    return is_closed and all(len(row) == 2 and all(map(_DEGREES.fullmatch, row)) for row in rows)


def corner_list_features(text: str, where: str, suffix: str) -> Iterator[Feature]:
    """The features of Mission Planner's lists of corners: a survey (.poly), a fence (.fen), rally points (.ral).

    Raises:
        ParameterError: naming the line that cannot be read.
    """
    corners: list[tuple[float, float]] = []
    for number, line in enumerate(text.splitlines(), 1):
        parts = line.replace("RALLY", "").split()
        fields = " ".join(parts).replace(",", " ").split()
        if not fields or line.startswith("#"):
            continue
        if len(fields) > 2 and any(map(_DECIMAL_COMMAS.fullmatch, parts[:2])):
            raise ParameterError(
                f"{where}:{number}: {line.strip()[:80]!r} has decimal commas; write decimal points, such as 46.5 6.6"
            )
        try:
            latitude, longitude = float(fields[0]), float(fields[1])
        except (IndexError, ValueError):
            raise ParameterError(f"{where}:{number}: {line.strip()[:80]!r}; write latitude and longitude") from None
        corners.append((longitude, latitude))
    if suffix == ".ral":
        for number, (longitude, latitude) in enumerate(corners, 1):
            yield Feature("recovery" if number == 1 else f"further point {number}", point=(latitude, longitude))
    elif suffix == ".fen":
        yield Feature("fence return point")
        yield _fence("fence", True, ring_of(corners[1:]))
    else:
        yield Feature("survey", rings=(ring_of(corners),))
