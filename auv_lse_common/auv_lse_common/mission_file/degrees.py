"""Converts the area, starts and recovery positions of a mission file from degrees to metres.

A mission file may give them in latitude and longitude (`area.polygon_deg`, `vehicle.start_deg`, ...), or name an area
file (`area.file`). They are converted when the mission file is read: nodes take metres only. Area files are read on
shore: its commands pass a reader, and vehicles get a mission file with the polygons written into it.
"""

import math
import re
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.parameters import ParameterError, nest
from auv_lse_common.mission_file.sections.area import corners
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.input_bounds import MAX_CORNERS
from auv_lse_common.vocabulary.frames import FAR_M, local_from_geodetic, unwrapped_deg

Patterns = dict[str, dict[str, Any]]

#: How to name the features of a file; ends messages about features that are not understood.
NAMING = "Name a polygon 'no-go ...' if vehicles must stay out, 'shore ...' if it is a shore, or remove it"


@dataclass(kw_only=True)
class AreaContent:
    """The content of an area file, in WGS84 degrees; a position is (latitude, longitude).

    Attributes:
        area: Corners (n, 2) of the operating area; None if the file has none.
        area_name: Its name in the file.
        no_go: Corners (n, 2) of each no-go area by name.
        starts: Starts by vehicle number.
        recoveries: Recovery positions by vehicle number; 0 is that of all vehicles.
        shores: Lines (n, 2) along the shore.
        ignored: Names of unused features.
        notes: Sentences about how it was read.
    """

    area: Array | None = None
    area_name: str = ""
    no_go: dict[str, Array] = field(default_factory=dict)
    starts: dict[int, tuple[float, float]] = field(default_factory=dict)
    recoveries: dict[int, tuple[float, float]] = field(default_factory=dict)
    shores: list[Array] = field(default_factory=list)
    ignored: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


#: Reads an area file, and raises a ParameterError that names the problem.
AreaReader = Callable[[Path], AreaContent]


def in_metres(
    patterns: Mapping[str, Mapping[str, Any]],
    folder: Path,
    where: str,
    read_area: AreaReader | None = None,
    *,
    origin_on_top: Mapping[str, Any] | None = None,
    may_replace_origin: bool = False,
) -> Patterns:
    """Converts `area.file` and everything in degrees of a mission file to metres.

    A file's starts and recovery positions apply where the mission file gives none. Without `area.origin_lat_deg` and
    `origin_lon_deg` the origin is the middle of the area, rounded to 1e-5 deg.

    Args:
        patterns: Nested parameters by node pattern.
        folder: Folder that a relative `area.file` is in.
        read_area: Reads `area.file`; None: such a file is refused.
        origin_on_top: `origin_lat_deg` and `origin_lon_deg` that replace those of the section `area`.
        may_replace_origin: Whether an origin far from the area is replaced.

    Raises:
        ParameterError: naming the key and what is wrong with it.
    """
    converted = {pattern: _copied(values) for pattern, values in patterns.items()}
    areas = [values["area"] for values in converted.values() if isinstance(values.get("area"), dict)]
    area = next((a for a in areas if {"file", "polygon_deg", "no_go_deg"} & set(a)), areas[0] if areas else {})
    area.update(origin_on_top or {})
    file = f"{where}: area.file: {area['file']}" if area.get("file") else ""
    content = _content_of(area, folder, where, read_area)
    own = [values["vehicle"] for values in converted.values() if isinstance(values.get("vehicle"), dict)]
    if content is None and not any({"start_deg", "recovery_deg"} & set(vehicle) for vehicle in own):
        return converted
    if content is not None and content.area is None and "polygon_m" not in area:
        raise ParameterError(
            f"{where}: area: no polygon is the operating area. Name one 'area' (not 'no-go', 'island' or 'exclusion'), "
            "or give area.polygon_m"
        )
    origin = _origin(area, content, where, may_replace_origin)
    for vehicle in own:
        _convert_positions(vehicle, origin, where)
    if content is None:
        return converted
    area["origin_lat_deg"], area["origin_lon_deg"] = origin
    if content.no_go:
        given = area.get("no_go", {})
        if not isinstance(given, Mapping):
            raise ParameterError(f"{where}: area.no_go must map names to corners, not {given!r}")
        area["no_go"] = dict(given)
        for name, ring in content.no_go.items():
            add_no_go(area["no_go"], name, _polygon(ring, origin, f"{file or where}: no-go area {name}"))
    if content.area is not None:
        what = f"{file}: {content.area_name!r}" if file else f"{where}: area.polygon_deg"
        area["polygon_m"] = _polygon(content.area, origin, what)
    if content.shores:
        lines = {f"shore_{number}": _flat(line, origin) for number, line in enumerate(content.shores, 1)}
        area["shore"] = {**lines, **(area.get("shore") or {})}
    return _under(converted, content, origin)


def _convert_positions(vehicle: dict[str, Any], origin: tuple[float, float], where: str) -> None:
    """Converts the start and the recovery position of a section `vehicle` to metres."""
    for name in ("start", "recovery"):
        if f"{name}_deg" in vehicle:
            position = _numbers(vehicle.pop(f"{name}_deg"), f"{where}: vehicle.{name}_deg")
            if len(position) != 1:
                raise ParameterError(
                    f"{where}: vehicle.{name}_deg has {len(position)} positions; give one latitude and longitude"
                )
            vehicle.update(_metres(name, (position[0, 0], position[0, 1]), origin))


def with_area_file(
    patterns: Mapping[str, Mapping[str, Any]],
    file: str,
    read_area: AreaReader | None,
    origin_on_top: Mapping[str, Any] | None = None,
) -> Patterns:
    """Replaces area and no-go areas in a mission file's parameters with those of an area file.

    Its origin stays, because starts and `gp.survey_file` count from there, unless the area is on another lake.

    Raises:
        ParameterError: as `in_metres`.
    """
    replaced = {pattern: nest(values) for pattern, values in patterns.items()}
    for values in replaced.values():
        if isinstance(values.get("area"), Mapping):
            replaceable = ("polygon_m", "no_go", "shore", "shore_depth_m")
            values["area"] = {k: v for k, v in values["area"].items() if k not in replaceable}
    values = replaced.setdefault("/**", {})
    values["area"] = {**values.get("area", {}), "file": file}
    may_replace = not origin_on_top
    return in_metres(replaced, Path(), "--area", read_area, origin_on_top=origin_on_top, may_replace_origin=may_replace)


def _copied(values: Mapping[str, Any]) -> dict[str, Any]:
    """A pattern's values, their sections copied; dotted names of both sections are nested."""
    dotted = any(re.match(r"(area|vehicle)\.", name) for name in values)
    copied = {k: dict(v) if isinstance(v, Mapping) else v for k, v in (nest(values) if dotted else values).items()}
    for section in (copied.get("area"), copied.get("vehicle")):
        for key in ("file", "polygon_deg", "no_go_deg", "start_deg", "recovery_deg"):
            if isinstance(section, dict) and key in section and not section[key] and section[key] != 0:
                del section[key]  # empty: not given
    return copied


def _under(patterns: Patterns, content: AreaContent, origin: tuple[float, float]) -> Patterns:
    """The patterns, below them the starts and recovery positions of a file; those that do not apply are noted."""
    below: Patterns = {}
    for name, found in (("recovery", content.recoveries), ("start", content.starts)):
        for number, position in sorted(found.items()):
            pattern = f"/auv{number}/**" if number else "/**"
            if giver := next((p for p in (pattern, "/**") if _gives(patterns.get(p, {}), name)), ""):
                whose = f"auv{number}" if number else "all vehicles"
                content.notes.append(f"the {name} of {whose} is that of the mission file ({giver})")
                del found[number]
                continue
            below.setdefault(pattern, {}).setdefault("vehicle", {}).update(_metres(name, position, origin))
    for pattern, values in below.items():
        given = patterns.get(pattern, {}).get("vehicle", {})
        if isinstance(given, dict):
            patterns.setdefault(pattern, {})["vehicle"] = {**values["vehicle"], **given}
    return patterns


def _gives(values: dict[str, Any], name: str) -> bool:
    """Whether a pattern's values give the position `name`: start or recovery."""
    vehicle = values.get("vehicle", {})
    return isinstance(vehicle, dict) and not {f"{name}_north_m", f"{name}_east_m"}.isdisjoint(vehicle)


def _content_of(area: dict[str, Any], folder: Path, where: str, read_area: AreaReader | None) -> AreaContent | None:
    """The positions that a section `area` specifies; removes their keys from it."""
    name = area.pop("file", None)
    if name is None and not {"polygon_deg", "no_go_deg"} & set(area):
        return None
    if name is not None and not isinstance(name, str):
        raise ParameterError(f"{where}: area.file is {name!r}; write the name of a file, such as lake.kml")
    if name and read_area is None:
        raise ParameterError(
            f"{where}: area.file names {name}, which only the commands on shore read. Write a mission file that has "
            f"the area: auv_lse mission {shlex.quote(Path(where).name)} --for-vehicles vehicles.yaml"
        )
    try:
        content = read_area(folder / name) if name and read_area else AreaContent()
    except ParameterError as error:
        raise ParameterError(f"{where}: area.file: {error}") from error
    if name and "polygon_deg" in area:
        raise ParameterError(
            f"{where}: area.file and area.polygon_deg are both given, and both may define the operating area. Draw the "
            "area in the file, or remove area.file and give its no-go areas as area.no_go_deg"
        )
    if "polygon_deg" in area:
        content.area = _numbers(area.pop("polygon_deg"), f"{where}: area.polygon_deg")
    no_go = area.pop("no_go_deg", {})
    if not isinstance(no_go, Mapping):
        raise ParameterError(f"{where}: area.no_go_deg must map names to corners, not {no_go!r}")
    for k, ring in no_go.items():
        add_no_go(content.no_go, str(k), _numbers(ring, f"{where}: area.no_go_deg.{k}"))
    if content.area is not None and "polygon_m" in area:
        if not name:
            raise ParameterError(f"{where}: area.polygon_m and area.polygon_deg are both given. Remove area.polygon_m")
        raise ParameterError(
            f"{where}: area.polygon_m is given, but the polygon {content.area_name!r} of {name} may be the operating "
            f"area, too. {NAMING}; or remove area.polygon_m"
        )
    return content


def _origin(area: Mapping[str, Any], content: AreaContent | None, where: str, may_replace: bool) -> tuple[float, float]:
    """Latitude and longitude (deg) of north = east = 0."""
    origin = area.get("origin_lat_deg"), area.get("origin_lon_deg")
    if isinstance(origin[0], int | float) and isinstance(origin[1], int | float):
        position = _numbers(origin, f"{where}: area.origin_lat_deg, origin_lon_deg")
        given = float(position[0, 0]), float(position[0, 1])
        if not may_replace or content is None or content.area is None:
            return given
        if np.hypot(*local_from_geodetic(content.area[0, 0], content.area[0, 1], *given)) <= FAR_M:
            return given
    if content is None or content.area is None:
        now = "give both" if origin == (None, None) else f"they are {origin[0]!r} and {origin[1]!r}"
        raise ParameterError(
            f"{where}: positions in degrees (..._deg) need area.origin_lat_deg and area.origin_lon_deg, the latitude "
            f"and longitude of north = east = 0; {now}"
        )
    lat, lon = content.area[:, 0], unwrapped_deg(content.area[:, 1])
    middle_deg = float(lon.min() + lon.max()) / 2.0
    return round(float(lat.min() + lat.max()) / 2.0, 5), round(middle_deg - (360.0 if middle_deg >= 180.0 else 0.0), 5)


def _metres(name: str, position: tuple[float, float], origin: tuple[float, float]) -> dict[str, float]:
    north, east = local_from_geodetic(*position, *origin)
    return {f"{name}_north_m": round(float(north), 2), f"{name}_east_m": round(float(east), 2)}


def _flat(ring: Array, origin: tuple[float, float]) -> list[float]:
    """North, east, north, east, ... (m, to the centimetre) of corners (n, 2) in degrees, repeated ones once."""
    north, east = local_from_geodetic(ring[:, 0], ring[:, 1], *origin)
    corners = [(round(float(n), 2), round(float(e), 2)) for n, e in zip(north, east, strict=True)]
    return [v for k, corner in enumerate(corners) if k == 0 or corner != corners[k - 1] for v in corner]


def _polygon(ring: Array, origin: tuple[float, float], what: str) -> list[float]:
    """As `_flat`, of a polygon.

    Raises:
        ParameterError: if it crosses itself or has no area; `what` names it.
    """
    flat = _flat(ring, origin)
    corners(what, tuple(flat))
    return flat


def _numbers(value: Any, key: str) -> Array:
    """Positions (n, 2) of a list: latitude, longitude, latitude, longitude, ... (deg)."""
    if isinstance(value, str | bytes | Mapping) or not hasattr(value, "__iter__"):
        raise ParameterError(f"{key} must be a list of latitude, longitude, ... in degrees, not {value!r}")
    try:
        flat = np.array([float(v) for v in value])
    except (TypeError, ValueError, OverflowError) as error:
        raise ParameterError(
            f"{key} must be a list of latitude, longitude, ... in degrees, not {str(value)[:80]}"
        ) from error
    if len(flat) % 2 or not len(flat):
        raise ParameterError(f"{key} has {len(flat)} numbers; give latitude and longitude of each position")
    return checked(flat.reshape(-1, 2), key)


def add_no_go(no_go: dict[str, Any], name: str, ring: Any) -> None:
    """Adds a ring under its name, which becomes that of a ROS parameter and gets a number if it is taken."""
    key = re.sub(r"\W+", "_", name).strip("_").lower() or "no_go"
    number = 1
    while (unique := key if number == 1 else f"{key}_{number}") in no_go:
        number += 1
    no_go[unique] = ring


def checked(ring: Array, key: str, most: int | None = MAX_CORNERS) -> Array:
    """Corners (n, 2), if each is a latitude and a longitude (deg), and they are at most `most`.

    Raises:
        ParameterError: naming the corner.
    """
    if most is not None and len(ring) > most:
        raise ParameterError(f"{key} has {len(ring):,} corners, more than {most:,}. Simplify the polygon")
    for latitude, longitude in ring.tolist():
        if not (math.isfinite(latitude) and abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
            is_swapped = abs(longitude) <= 90.0 < abs(latitude) <= 180.0
            cure = "Are they swapped?" if is_swapped else "Write WGS84 (EPSG:4326), longitudes from -180 to 180"
            raise ParameterError(
                f"{key}: latitude {latitude:g}, longitude {longitude:g} is not a position in degrees. {cure}"
            )
    return ring
