"""Area, no-go areas, starts and recovery positions from GeoJSON, KML and QGroundControl files, or in degrees.

A mission file may name such a file (`area.file`) or give positions in latitude and longitude (`area.polygon_deg`,
`vehicle.start_deg`, ...). They are converted to metres when the mission file is read: nodes only know metres.

`position_roles` says what a feature is for.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.parameters import ParameterError, nest
from auv_lse_common.mission_file.position_roles import (
    NAMING,
    Feature,
    Positions,
    add_no_go,
    checked,
    named_feature,
    sorted_by_role,
)
from auv_lse_common.support.input_bounds import MAX_YAML_BYTES, over_size
from auv_lse_common.vocabulary.frames import geodetic_from_local, local_from_geodetic

Array = NDArray[np.float64]
Patterns = dict[str, dict[str, Any]]

#: Corners of the polygon that stands for a circle of a QGroundControl plan.
_CIRCLE_CORNERS = 36

_KINDS = "GeoJSON (.geojson, .json), KML (.kml) or QGroundControl (.plan)"


def read_positions(path: str | Path) -> Positions:
    """Reads the positions of a GeoJSON, KML or QGroundControl plan file.

    Raises:
        ParameterError: if the file is missing, too large or of another kind, or its positions are impossible.
    """
    path = Path(path)
    readers: dict[str, Callable[[str, str], Iterator[Feature]]] = {
        ".geojson": _geojson, ".json": _geojson, ".kml": _kml, ".plan": _qgc_plan,
    }  # fmt: skip
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise ParameterError(f"{path}: got a file {path.suffix or 'without suffix'}; expected {_KINDS}")
    try:
        if problem := over_size(path, MAX_YAML_BYTES):
            raise ParameterError(problem)
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ParameterError(f"{path}: is not UTF-8 text: {error}") from error
    try:
        features = list(reader(text, str(path)))
    except (KeyError, TypeError, IndexError, ValueError, AttributeError, RecursionError, OverflowError) as error:
        if isinstance(error, ParameterError):
            raise
        raise ParameterError(
            f"{path}: is not valid {path.suffix[1:]}: {type(error).__name__}: {error}; expected {_KINDS}"
        ) from error
    return sorted_by_role(features, str(path))


def with_positions(patterns: Mapping[str, Mapping[str, Any]], folder: Path, where: str) -> Patterns:
    """Converts `area.file` and all positions in degrees of a mission file to metres.

    A file's starts and recovery positions apply where the mission file gives none. Without `area.origin_lat_deg` and
    `origin_lon_deg` the origin is the middle of the area, rounded to 1e-5 deg.

    Args:
        patterns: Nested parameters by node pattern.
        folder: Folder that a relative `area.file` is in.
        where: The mission file, for messages.

    Raises:
        ParameterError: naming the key and what is wrong with it.
    """
    converted = {pattern: _copied(values) for pattern, values in patterns.items()}
    areas = [values["area"] for values in converted.values() if isinstance(values.get("area"), dict)]
    area = next((a for a in areas if {"file", "polygon_deg", "no_go_deg"} & set(a)), areas[0] if areas else {})
    positions = _positions_of(area, folder, where)
    own = [values["vehicle"] for values in converted.values() if isinstance(values.get("vehicle"), dict)]
    if positions is None and not any({"start_deg", "recovery_deg"} & set(vehicle) for vehicle in own):
        return converted
    if positions is not None and positions.area is None and "polygon_m" not in area:
        raise ParameterError(
            f"{where}: area: no polygon is the operating area. Name one 'area' (not 'no-go', 'island' or 'exclusion'), "
            "or give area.polygon_m"
        )
    origin = _origin(area, positions, where)
    for vehicle in own:
        for name in ("start", "recovery"):
            if f"{name}_deg" in vehicle:
                position = _numbers(vehicle.pop(f"{name}_deg"), f"{where}: vehicle.{name}_deg")
                if len(position) != 1:
                    raise ParameterError(
                        f"{where}: vehicle.{name}_deg: got {len(position)} positions; expected lat, lon"
                    )
                vehicle.update(_metres(name, (position[0, 0], position[0, 1]), origin))
    if positions is None:
        return converted
    area["origin_lat_deg"], area["origin_lon_deg"] = origin
    if positions.area is not None:
        area["polygon_m"] = _flat(positions.area, origin)
    if positions.no_go:
        given = area.get("no_go", {})
        if not isinstance(given, Mapping):
            raise ParameterError(f"{where}: area.no_go: got {given!r}; expected corners by name")
        area["no_go"] = dict(given)
        for name, ring in positions.no_go.items():
            add_no_go(area["no_go"], name, _flat(ring, origin))
    if positions.shores:
        lines = {f"shore_{number}": _flat(line, origin) for number, line in enumerate(positions.shores, 1)}
        area["shore"] = {**lines, **(area.get("shore") or {})}
    return _under(converted, positions, origin)


def with_area_file(patterns: Mapping[str, Mapping[str, Any]], file: str) -> Patterns:
    """Replaces area, no-go areas and origin in a mission file's parameters with those of its file of positions.

    Raises:
        ParameterError: as `with_positions`.
    """
    replaced = {pattern: nest(values) for pattern, values in patterns.items()}
    for values in replaced.values():
        if isinstance(values.get("area"), Mapping):
            replaceable = ("polygon_m", "no_go", "shore", "shore_depth_m", "origin_lat_deg", "origin_lon_deg")
            values["area"] = {k: v for k, v in values["area"].items() if k not in replaceable}
    values = replaced.setdefault("/**", {})
    values["area"] = {**values.get("area", {}), "file": file}
    return with_positions(replaced, Path(), "--area")


def _copied(values: Mapping[str, Any]) -> dict[str, Any]:
    """A pattern's values, their sections copied; dotted names of positions are nested."""
    dotted = any(re.fullmatch(r"(area|vehicle)\.(file|\w+_deg)", name) for name in values)
    copied = {k: dict(v) if isinstance(v, Mapping) else v for k, v in (nest(values) if dotted else values).items()}
    for section in (copied.get("area"), copied.get("vehicle")):
        for key in ("file", "polygon_deg", "no_go_deg", "start_deg", "recovery_deg"):
            if isinstance(section, dict) and key in section and not section[key] and section[key] != 0:
                del section[key]  # empty: not given
    return copied


def _under(patterns: Patterns, positions: Positions, origin: tuple[float, float]) -> Patterns:
    """The patterns, below them the starts and recovery positions of a file."""
    below: Patterns = {}
    for name, found in (("recovery", positions.recoveries), ("start", positions.starts)):
        for number, position in sorted(found.items()):
            pattern = f"/auv{number}/**" if number else "/**"
            below.setdefault(pattern, {}).setdefault("vehicle", {}).update(_metres(name, position, origin))
    for pattern, values in below.items():
        given = patterns.get(pattern, {}).get("vehicle", {})
        if isinstance(given, dict):
            patterns.setdefault(pattern, {})["vehicle"] = {**values["vehicle"], **given}
    return patterns


def _positions_of(area: dict[str, Any], folder: Path, where: str) -> Positions | None:
    """The positions that a section `area` specifies; removes their keys from it."""
    name = area.pop("file", None)
    if name is None and not {"polygon_deg", "no_go_deg"} & set(area):
        return None
    if name is not None and not isinstance(name, str):
        raise ParameterError(f"{where}: area.file: got {name!r}; expected the name of a file: {_KINDS}")
    try:
        positions = read_positions(folder / name) if name else Positions()
    except ParameterError as error:
        raise ParameterError(f"{where}: area.file: {error}") from error
    if name and "polygon_deg" in area:
        raise ParameterError(
            f"{where}: area.file and area.polygon_deg are both given, and both may define the operating area. Draw the "
            "area in the file, or remove area.file and give its no-go areas as area.no_go_deg"
        )
    if "polygon_deg" in area:
        positions.area = _numbers(area.pop("polygon_deg"), f"{where}: area.polygon_deg")
    no_go = area.pop("no_go_deg", {})
    if not isinstance(no_go, Mapping):
        raise ParameterError(f"{where}: area.no_go_deg: got {no_go!r}; expected corners by name")
    for k, ring in no_go.items():
        add_no_go(positions.no_go, str(k), _numbers(ring, f"{where}: area.no_go_deg.{k}"))
    if positions.area is not None and "polygon_m" in area:
        if not name:
            raise ParameterError(f"{where}: area.polygon_m and area.polygon_deg are both given. Remove area.polygon_m")
        raise ParameterError(
            f"{where}: area.polygon_m is given, but the polygon {positions.area_name!r} of {name} may be the operating "
            f"area, too. {NAMING}; or remove area.polygon_m"
        )
    return positions


def _origin(area: Mapping[str, Any], positions: Positions | None, where: str) -> tuple[float, float]:
    """Latitude and longitude (deg) of north = east = 0."""
    origin = area.get("origin_lat_deg"), area.get("origin_lon_deg")
    if isinstance(origin[0], int | float) and isinstance(origin[1], int | float):
        position = _numbers(origin, f"{where}: area.origin_lat_deg, origin_lon_deg")
        return float(position[0, 0]), float(position[0, 1])
    if positions is None or positions.area is None:
        raise ParameterError(
            f"{where}: area.origin_lat_deg, origin_lon_deg: got {origin[0]!r}, {origin[1]!r}; expected both, since "
            "positions are given in degrees"
        )
    middle = (positions.area.min(axis=0) + positions.area.max(axis=0)) / 2.0
    return round(float(middle[0]), 5), round(float(middle[1]), 5)


def _metres(name: str, position: tuple[float, float], origin: tuple[float, float]) -> dict[str, float]:
    north, east = local_from_geodetic(*position, *origin)
    return {f"{name}_north_m": round(float(north), 2), f"{name}_east_m": round(float(east), 2)}


def _flat(ring: Array, origin: tuple[float, float]) -> list[float]:
    """North, east, north, east, ... (m, to the centimetre) of corners (n, 2) in degrees."""
    north, east = local_from_geodetic(ring[:, 0], ring[:, 1], *origin)
    return [round(float(v), 2) for v in np.column_stack([north, east]).ravel()]


def _numbers(value: Any, key: str) -> Array:
    """Positions (n, 2) of a list: latitude, longitude, latitude, longitude, ... (deg)."""
    if isinstance(value, str | bytes | Mapping) or not hasattr(value, "__iter__"):
        raise ParameterError(f"{key}: got {value!r}; expected latitude, longitude, ... in deg")
    try:
        flat = np.array([float(v) for v in value])
    except (TypeError, ValueError, OverflowError) as error:
        raise ParameterError(f"{key}: got {str(value)[:80]}; expected latitude, longitude, ... in deg") from error
    if len(flat) % 2 or not len(flat):
        raise ParameterError(f"{key}: got {len(flat)} numbers; expected latitude, longitude of each position")
    return checked(flat.reshape(-1, 2), key)


def _geojson(text: str, where: str) -> Iterator[Feature]:
    data = json.loads(text)
    crs = str(data.get("crs", "")) if isinstance(data, Mapping) else ""
    if crs and "CRS84" not in crs and "4326" not in crs:
        raise ParameterError(f"{where}: got coordinates in {crs[:80]}; expected WGS84 degrees. Export as EPSG:4326")
    for feature in data["features"] if data["type"] == "FeatureCollection" else [data]:
        geometry = feature["geometry"] if feature["type"] == "Feature" else feature
        named = named_feature(feature.get("properties") or {})
        if geometry is None:
            yield Feature(named.name or "without a geometry")
            continue
        for kind, coordinates in _simple(geometry):
            if kind == "Polygon":
                yield replace(named, rings=tuple(_ring(ring) for ring in coordinates))
            elif kind == "Point":
                yield replace(named, point=(float(coordinates[1]), float(coordinates[0])))
            elif kind == "LineString":
                yield replace(named, name=named.name or kind, line=_line(coordinates))
            else:
                yield Feature(named.name or kind)


def _simple(geometry: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """The single geometries of a GeoJSON geometry: (kind, coordinates)."""
    kind = str(geometry["type"])
    if kind == "GeometryCollection":
        for inner in geometry["geometries"]:
            yield from _simple(inner)
    elif kind in ("MultiPolygon", "MultiLineString", "MultiPoint"):
        yield from ((kind.removeprefix("Multi"), coordinates) for coordinates in geometry["coordinates"])
    else:
        yield kind, geometry["coordinates"]


def _ring(positions: Sequence[Sequence[float]]) -> Array:
    """Corners (n, 2) lat, lon of a ring of longitude, latitude; its repeated last corner is dropped."""
    ring = _line(positions)
    return ring[:-1] if len(ring) > 3 and np.array_equal(ring[0], ring[-1]) else ring


def _line(positions: Sequence[Sequence[float]]) -> Array:
    """Positions (n, 2) lat, lon of a list of longitude, latitude."""
    return np.array([(float(position[1]), float(position[0])) for position in positions]).reshape(-1, 2)


def _kml(text: str, where: str) -> Iterator[Feature]:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ParameterError(f"{where}: got a document type declaration; expected plain KML")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ParameterError(f"{where}: is not valid KML: {error}") from error
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]  # without its namespace
    for placemark in root.iter("Placemark"):
        name = (placemark.findtext("name") or "").strip()
        used: set[ElementTree.Element] = set()
        for polygon in placemark.iter("Polygon"):
            outer, inner = (list(polygon.iterfind(f"{side}BoundaryIs//coordinates")) for side in ("outer", "inner"))
            if len(outer) > 1:
                raise ParameterError(
                    f"{where}: the polygon {name!r} has {len(outer)} outer rings. Draw a polygon for each of them"
                )
            used.update(outer, inner)
            yield Feature(name, rings=tuple(_ring(_kml_positions(part)) for part in (*outer, *inner)))
        for point in placemark.iter("Point"):
            used.update(point.iter("coordinates"))
            longitude, latitude, *_ = _kml_positions(point)[0]
            yield Feature(name, point=(latitude, longitude))
        for line in placemark.iter("LineString"):
            used.update(line.iter("coordinates"))
            yield Feature(name or "line", line=_line(_kml_positions(line)))
        for ring in placemark.iter("coordinates"):
            if ring not in used:
                yield Feature(name or "outline", line=_line(_kml_positions(ring)))


def _kml_positions(element: ElementTree.Element) -> list[list[float]]:
    """Longitude, latitude (and height) of each position of an element's coordinates."""
    return [
        [float(v) for v in position.split(",")] for position in (next(element.iter("coordinates")).text or "").split()
    ]


def _qgc_plan(text: str, where: str) -> Iterator[Feature]:
    data = json.loads(text)
    if data.get("fileType") != "Plan":
        raise ParameterError(f"{where}: got fileType {data.get('fileType')!r}; expected a QGroundControl plan ('Plan')")
    fence = data.get("geoFence") or {}
    for number, polygon in enumerate(fence.get("polygons", ()), 1):
        ring = np.array([(float(lat), float(lon)) for lat, lon, *_ in polygon["polygon"]]).reshape(-1, 2)
        yield Feature("area" if polygon.get("inclusion", True) else f"no-go {number}", rings=(ring,))
    for number, entry in enumerate(fence.get("circles", ()), 1):
        circle = entry["circle"]
        latitude, longitude = (float(v) for v in circle["center"][:2])
        turn = np.linspace(0.0, 2.0 * math.pi, _CIRCLE_CORNERS, endpoint=False)
        radius_m = float(circle["radius"])
        north, east = radius_m * np.cos(turn), radius_m * np.sin(turn)
        ring = np.column_stack(geodetic_from_local(north, east, latitude, longitude))
        yield Feature("area" if entry.get("inclusion", True) else f"no-go circle {number}", rings=(ring,))
    for number, point in enumerate((data.get("rallyPoints") or {}).get("points", ()), 1):
        yield Feature("recovery" if number == 1 else "further rally point", point=(float(point[0]), float(point[1])))
