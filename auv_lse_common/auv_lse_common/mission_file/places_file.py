"""Area, no-go areas, starts and recovery places from GeoJSON, KML and QGroundControl files, or in degrees.

A mission file may name such a file (`area.file`) or give places in latitude and longitude (`area.polygon_deg`,
`vehicle.start_deg`, ...). They are converted to metres when the mission file is read: nodes only know metres.

A feature's name (or its property `role`) defines its use: "no-go ...", "start ...", "recovery ...", "shore ...". A
number in the name of a start or recovery place is the vehicle number. A shore is a line or the outline of a polygon.
The one remaining polygon is the operating area.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.parameters import ParameterError, nest
from auv_lse_common.support.input_bounds import MAX_CORNERS, MAX_YAML_BYTES, over_size
from auv_lse_common.vocabulary.frames import geodetic_from_local, local_from_geodetic

Array = NDArray[np.float64]
Patterns = dict[str, dict[str, Any]]

#: Largest extent (deg) of all places of a file: beyond it a flat map is wrong, or coordinates are swapped.
MAX_EXTENT_DEG = 2.0
#: Corners of the polygon that stands for a circle of a QGroundControl plan.
_CIRCLE_CORNERS = 36

_ROLES = {
    "no_go": re.compile(r"\b(no[ _-]?go|exclusion|exclude|keep[ _-]?out|forbidden|island)\b", re.IGNORECASE),
    "start": re.compile(r"\b(start|launch)(?![a-z])", re.IGNORECASE),
    "recovery": re.compile(r"\b(recovery|rally|pick[ _-]?up|home)(?![a-z])", re.IGNORECASE),
    "shore": re.compile(r"\b(shore|shoreline|coastline)\b", re.IGNORECASE),
}
_KINDS = "GeoJSON (.geojson, .json), KML (.kml) or QGroundControl (.plan)"


@dataclass(kw_only=True)
class Places:
    """The places of a file in WGS84 degrees; a place is (latitude, longitude).

    Attributes:
        area: Corners (n, 2) of the operating area; None if the file has none.
        no_go: Corners (n, 2) of each no-go area by name.
        starts: Starts by vehicle number.
        recoveries: Recovery places by vehicle number; 0 is that of all vehicles.
        shores: Lines (n, 2) along the shore.
        ignored: Names of unused features.
    """

    area: Array | None = None
    no_go: dict[str, Array] = field(default_factory=dict)
    starts: dict[int, tuple[float, float]] = field(default_factory=dict)
    recoveries: dict[int, tuple[float, float]] = field(default_factory=dict)
    shores: list[Array] = field(default_factory=list)
    ignored: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Feature:
    """A polygon (rings, the first around it, then its holes), a line or a point; all are (n, 2) lat, lon."""

    name: str
    rings: tuple[Array, ...] = ()
    line: Array | None = None
    point: tuple[float, float] | None = None


def read_places(path: str | Path) -> Places:
    """Reads the places of a GeoJSON, KML or QGroundControl plan file.

    Raises:
        ParameterError: if the file is missing, too large or of another kind, or its places are impossible.
    """
    path = Path(path)
    readers: dict[str, Callable[[str, str], Iterator[_Feature]]] = {
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
    return _sorted_by_role(features, str(path))


def with_places(patterns: Mapping[str, Mapping[str, Any]], folder: Path, where: str) -> Patterns:
    """Converts `area.file` and all places in degrees of a mission file to metres.

    A file's starts and recovery places apply where the mission file gives none. Without `area.origin_lat_deg` and
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
    places = _places_of(area, folder, where)
    own = [values["vehicle"] for values in converted.values() if isinstance(values.get("vehicle"), dict)]
    if places is None and not any({"start_deg", "recovery_deg"} & set(vehicle) for vehicle in own):
        return converted
    origin = _origin(area, places, where)
    for vehicle in own:
        for name in ("start", "recovery"):
            if f"{name}_deg" in vehicle:
                place = _numbers(vehicle.pop(f"{name}_deg"), f"{where}: vehicle.{name}_deg")
                if len(place) != 1:
                    raise ParameterError(f"{where}: vehicle.{name}_deg: got {len(place)} places; expected lat, lon")
                vehicle.update(_metres(name, (place[0, 0], place[0, 1]), origin))
    if places is None:
        return converted
    area["origin_lat_deg"], area["origin_lon_deg"] = origin
    if places.area is None and "polygon_m" not in area:
        raise ParameterError(
            f"{where}: area: got no polygon for the operating area; expected one, whose name has none of 'no-go', "
            "'island', 'exclusion'"
        )
    if places.area is not None:
        area["polygon_m"] = _flat(places.area, origin)
    if places.no_go:
        given = area.get("no_go", {})
        if not isinstance(given, Mapping):
            raise ParameterError(f"{where}: area.no_go: got {given!r}; expected corners by name")
        area["no_go"] = {**given, **{name: _flat(ring, origin) for name, ring in places.no_go.items()}}
    if places.shores:
        lines = {f"shore_{number}": _flat(line, origin) for number, line in enumerate(places.shores, 1)}
        area["shore"] = lines if not area.get("shore") else area["shore"]
    return _under(converted, places, origin)


def with_area_file(patterns: Mapping[str, Mapping[str, Any]], file: str) -> Patterns:
    """Replaces area, no-go areas and origin in a mission file's parameters with those of its file of places.

    Raises:
        ParameterError: as `with_places`.
    """
    replaced = {pattern: nest(values) for pattern, values in patterns.items()}
    for values in replaced.values():
        if isinstance(values.get("area"), Mapping):
            replaceable = ("polygon_m", "no_go", "shore", "shore_depth_m", "origin_lat_deg", "origin_lon_deg")
            values["area"] = {k: v for k, v in values["area"].items() if k not in replaceable}
    values = replaced.setdefault("/**", {})
    values["area"] = {**values.get("area", {}), "file": file}
    return with_places(replaced, Path(), "--area")


def _copied(values: Mapping[str, Any]) -> dict[str, Any]:
    """A pattern's values, their sections copied; dotted names of places are nested."""
    dotted = any(re.fullmatch(r"(area|vehicle)\.(file|\w+_deg)", name) for name in values)
    copied = {k: dict(v) if isinstance(v, Mapping) else v for k, v in (nest(values) if dotted else values).items()}
    for section in (copied.get("area"), copied.get("vehicle")):
        for key in ("file", "polygon_deg", "no_go_deg", "start_deg", "recovery_deg"):
            if isinstance(section, dict) and key in section and not section[key] and section[key] != 0:
                del section[key]  # empty: not given
    return copied


def _under(patterns: Patterns, places: Places, origin: tuple[float, float]) -> Patterns:
    """The patterns, below them the starts and recovery places of a file."""
    below: Patterns = {}
    for name, found in (("recovery", places.recoveries), ("start", places.starts)):
        for number, place in sorted(found.items()):
            pattern = f"/auv{number}/**" if number else "/**"
            below.setdefault(pattern, {}).setdefault("vehicle", {}).update(_metres(name, place, origin))
    for pattern, values in below.items():
        given = patterns.get(pattern, {}).get("vehicle", {})
        if isinstance(given, dict):
            patterns.setdefault(pattern, {})["vehicle"] = {**values["vehicle"], **given}
    return patterns


def _places_of(area: dict[str, Any], folder: Path, where: str) -> Places | None:
    """The places that a section `area` specifies; removes their keys from it."""
    name = area.pop("file", None)
    if name is None and not {"polygon_deg", "no_go_deg"} & set(area):
        return None
    if name is not None and not isinstance(name, str):
        raise ParameterError(f"{where}: area.file: got {name!r}; expected the name of a file: {_KINDS}")
    try:
        places = read_places(folder / name) if name else Places()
    except ParameterError as error:
        raise ParameterError(f"{where}: area.file: {error}") from error
    if "polygon_deg" in area:
        places.area = _numbers(area.pop("polygon_deg"), f"{where}: area.polygon_deg")
    no_go = area.pop("no_go_deg", {})
    if not isinstance(no_go, Mapping):
        raise ParameterError(f"{where}: area.no_go_deg: got {no_go!r}; expected corners by name")
    places.no_go.update({str(k): _numbers(ring, f"{where}: area.no_go_deg.{k}") for k, ring in no_go.items()})
    if places.area is not None and "polygon_m" in area:
        raise ParameterError(
            f"{where}: area: got polygon_m and an area in degrees or a file; expected one. Remove area.polygon_m"
        )
    return places


def _origin(area: Mapping[str, Any], places: Places | None, where: str) -> tuple[float, float]:
    """Latitude and longitude (deg) of north = east = 0."""
    origin = area.get("origin_lat_deg"), area.get("origin_lon_deg")
    if isinstance(origin[0], int | float) and isinstance(origin[1], int | float):
        place = _numbers(origin, f"{where}: area.origin_lat_deg, origin_lon_deg")
        return float(place[0, 0]), float(place[0, 1])
    if places is None or places.area is None:
        raise ParameterError(
            f"{where}: area.origin_lat_deg, origin_lon_deg: got {origin[0]!r}, {origin[1]!r}; expected both, since "
            "places are given in degrees"
        )
    middle = (places.area.min(axis=0) + places.area.max(axis=0)) / 2.0
    return round(float(middle[0]), 5), round(float(middle[1]), 5)


def _metres(name: str, place: tuple[float, float], origin: tuple[float, float]) -> dict[str, float]:
    north, east = local_from_geodetic(*place, *origin)
    return {f"{name}_north_m": round(float(north), 2), f"{name}_east_m": round(float(east), 2)}


def _flat(ring: Array, origin: tuple[float, float]) -> list[float]:
    """North, east, north, east, ... (m, to the centimetre) of corners (n, 2) in degrees."""
    north, east = local_from_geodetic(ring[:, 0], ring[:, 1], *origin)
    return [round(float(v), 2) for v in np.column_stack([north, east]).ravel()]


def _numbers(value: Any, key: str) -> Array:
    """Places (n, 2) of a list: latitude, longitude, latitude, longitude, ... (deg)."""
    if isinstance(value, str | bytes | Mapping) or not hasattr(value, "__iter__"):
        raise ParameterError(f"{key}: got {value!r}; expected latitude, longitude, ... in deg")
    try:
        flat = np.array([float(v) for v in value])
    except (TypeError, ValueError, OverflowError) as error:
        raise ParameterError(f"{key}: got {str(value)[:80]}; expected latitude, longitude, ... in deg") from error
    if len(flat) % 2 or not len(flat):
        raise ParameterError(f"{key}: got {len(flat)} numbers; expected latitude, longitude of each place")
    return _checked(flat.reshape(-1, 2), key)


def _checked(ring: Array, key: str) -> Array:
    """Places (n, 2), if each is a latitude and a longitude.

    Raises:
        ParameterError: naming the place.
    """
    if len(ring) > MAX_CORNERS:
        raise ParameterError(f"{key}: got {len(ring)} corners; expected at most {MAX_CORNERS}. Simplify the polygon")
    for latitude, longitude in ring.tolist():
        if not (math.isfinite(latitude) and abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
            swapped = ". Are latitude and longitude swapped?" if abs(longitude) <= 90.0 else ""
            raise ParameterError(
                f"{key}: got latitude {latitude:g}, longitude {longitude:g}; expected -90 to 90, -180 to 180{swapped}"
            )
    return ring


def _sorted_by_role(features: Sequence[_Feature], where: str) -> Places:
    """Places of a file's features, by their names."""
    places = Places()
    areas: list[_Feature] = []
    for feature in features:
        if any(not len(ring) for ring in feature.rings):
            raise ParameterError(f"{where}: got a polygon {feature.name!r} without corners; expected at least 3")
    everywhere = [ring for f in features for ring in f.rings] + [np.array([f.point]) for f in features if f.point]
    everywhere += [f.line for f in features if f.line is not None]
    for ring in everywhere:
        _checked(ring, where)
    if everywhere and (extent := np.ptp(np.concatenate(everywhere), axis=0)).max() > MAX_EXTENT_DEG:
        raise ParameterError(
            f"{where}: got places {extent[0]:.3g} deg of latitude and {extent[1]:.3g} deg of longitude apart; expected "
            f"at most {MAX_EXTENT_DEG:g}. Are latitude and longitude swapped in one of them?"
        )
    for feature in features:
        role = next((role for role, pattern in _ROLES.items() if pattern.search(feature.name)), "")
        if feature.rings and role == "no_go":
            _add_no_go(places, feature.name, feature.rings[0])
        elif feature.rings and not role:
            areas.append(feature)
        elif role == "shore" and (feature.rings or feature.line is not None):
            places.shores += [line for line in _shores(feature) if len(line) > 1]
        elif feature.point is not None and role in ("start", "recovery"):
            _add_place(places, role, feature, where)
        else:
            places.ignored.append(feature.name or "without a name")
    if len(areas) > 1:
        names = ", ".join(repr(f.name) for f in areas)
        raise ParameterError(
            f"{where}: got {len(areas)} polygons that may be the operating area: {names}; expected one. Name the "
            "others 'no-go ...', or remove them"
        )
    if not areas and not places.starts and not places.recoveries and not places.no_go:
        raise ParameterError(f"{where}: got no usable place; expected a polygon (the operating area)")
    if areas:
        places.area = areas[0].rings[0]
        for number, hole in enumerate(areas[0].rings[1:], 1):
            _add_no_go(places, f"hole {number}", hole)
    return places


def _shores(feature: _Feature) -> list[Array]:
    """The lines of a shore: itself, or the closed outlines of a polygon and its holes."""
    if feature.line is not None:
        return [feature.line]
    return [np.vstack([ring, ring[:1]]) for ring in feature.rings]


def _add_no_go(places: Places, name: str, ring: Array) -> None:
    key = re.sub(r"\W+", "_", name).strip("_").lower() or "no_go"  # a ROS parameter's name
    number = 1
    while (unique := key if number == 1 else f"{key}_{number}") in places.no_go:
        number += 1
    places.no_go[unique] = ring


def _add_place(places: Places, role: str, feature: _Feature, where: str) -> None:
    assert feature.point is not None
    number = re.search(r"\d+", feature.name[:80])  # Python converts no endless ones
    found = places.starts if role == "start" else places.recoveries
    key = int(number[0]) if number else (max(found, default=0) + 1 if role == "start" else 0)
    if key in found or not 0 <= key <= 255 or (role == "start" and key == 0):
        raise ParameterError(
            f"{where}: {feature.name!r}: got a second {role} place, or no number of a vehicle; expected one for each "
            f"vehicle, such as '{role} 2'"
        )
    found[key] = feature.point


def _geojson(text: str, where: str) -> Iterator[_Feature]:
    data = json.loads(text)
    crs = str(data.get("crs", "")) if isinstance(data, Mapping) else ""
    if crs and "CRS84" not in crs and "4326" not in crs:
        raise ParameterError(f"{where}: got coordinates in {crs[:80]}; expected WGS84 degrees. Export as EPSG:4326")
    for feature in data["features"] if data["type"] == "FeatureCollection" else [data]:
        geometry = feature["geometry"] if feature["type"] == "Feature" else feature
        known = feature.get("properties") or {}
        name = " ".join(str(known[key]) for key in ("role", "name", "title") if known.get(key))
        if geometry is None:
            continue
        for kind, coordinates in _simple(geometry):
            if kind == "Polygon":
                yield _Feature(name, tuple(_ring(ring) for ring in coordinates))
            elif kind == "Point":
                yield _Feature(name, point=(float(coordinates[1]), float(coordinates[0])))
            elif kind == "LineString":
                yield _Feature(name or kind, line=_line(coordinates))
            else:
                yield _Feature(name or kind)


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


def _ring(places: Sequence[Sequence[float]]) -> Array:
    """Corners (n, 2) lat, lon of a ring of longitude, latitude; its repeated last corner is dropped."""
    ring = _line(places)
    return ring[:-1] if len(ring) > 3 and np.array_equal(ring[0], ring[-1]) else ring


def _line(places: Sequence[Sequence[float]]) -> Array:
    """Places (n, 2) lat, lon of a list of longitude, latitude."""
    return np.array([(float(place[1]), float(place[0])) for place in places]).reshape(-1, 2)


def _kml(text: str, where: str) -> Iterator[_Feature]:
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
        for polygon in placemark.iter("Polygon"):
            outer = [polygon.find("outerBoundaryIs"), *polygon.findall("innerBoundaryIs")]
            yield _Feature(name, tuple(_ring(_kml_places(part)) for part in outer if part is not None))
        for point in placemark.iter("Point"):
            longitude, latitude, *_ = _kml_places(point)[0]
            yield _Feature(name, point=(latitude, longitude))
        for line in placemark.iter("LineString"):
            yield _Feature(name or "line", line=_line(_kml_places(line)))


def _kml_places(element: ElementTree.Element) -> list[list[float]]:
    """Longitude, latitude (and height) of each place of an element's coordinates."""
    return [[float(v) for v in place.split(",")] for place in (element.findtext(".//coordinates") or "").split()]


def _qgc_plan(text: str, where: str) -> Iterator[_Feature]:
    data = json.loads(text)
    if data.get("fileType") != "Plan":
        raise ParameterError(f"{where}: got fileType {data.get('fileType')!r}; expected a QGroundControl plan ('Plan')")
    fence = data.get("geoFence") or {}
    for number, polygon in enumerate(fence.get("polygons", ()), 1):
        ring = np.array([(float(lat), float(lon)) for lat, lon, *_ in polygon["polygon"]]).reshape(-1, 2)
        yield _Feature("area" if polygon.get("inclusion", True) else f"no-go {number}", (ring,))
    for number, entry in enumerate(fence.get("circles", ()), 1):
        circle = entry["circle"]
        latitude, longitude = (float(v) for v in circle["center"][:2])
        turn = np.linspace(0.0, 2.0 * math.pi, _CIRCLE_CORNERS, endpoint=False)
        radius_m = float(circle["radius"])
        north, east = radius_m * np.cos(turn), radius_m * np.sin(turn)
        ring = np.column_stack(geodetic_from_local(north, east, latitude, longitude))
        yield _Feature("area" if entry.get("inclusion", True) else f"no-go circle {number}", (ring,))
    for number, point in enumerate((data.get("rallyPoints") or {}).get("points", ()), 1):
        yield _Feature("recovery" if number == 1 else "further rally point", point=(float(point[0]), float(point[1])))
