"""What the features of a file of positions are for, by their names and properties.

A feature's name or a property such as `role` or `type` defines its use: "no-go ...", "start ...", "recovery ...",
"shore ...". A number in the name of a start or recovery position is the vehicle number. A shore is a line or the
outline of a polygon. The one remaining polygon is the operating area.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.input_bounds import MAX_CORNERS

Array = NDArray[np.float64]

#: Largest extent (deg) of all positions of a file: beyond it a flat map is wrong, or coordinates are swapped.
MAX_EXTENT_DEG = 2.0
#: Words of a name, as `_words` separates them, that define a role; the first role that matches counts.
_ROLES = {
    "no_go": re.compile(
        r"\b(no ?go|no ?entry|exclu(sion|sive|de|ded)|keep ?(out|away)|stay out|off limits|avoid|forbidden|prohibited"
        r"|restricted|danger|dangerous|hazard|obstacles?|obstructions?|islands?|islets?)\b"
    ),
    "start": re.compile(r"\b(start|launch)\b"),
    "recovery": re.compile(r"\b(recovery|rally|pick ?up|home)\b"),
    "shore": re.compile(r"\b(shore|shoreline|coastline)\b"),
    "area": re.compile(r"\b(area|survey|operating|boundary|perimeter|inclu(sion|sive|de|ded)|geofence)\b"),
}
#: Properties that state what a feature is, most explicit first; capitals do not count.
_ROLE_KEYS = ("role", "type", "kind", "class", "category", "zone", "use", "usage")
_NAME_KEYS = ("name", "title", "label", "id")
#: How to name what is in a file; ends messages about features that are not understood.
NAMING = "Name it 'no-go ...' if vehicles must stay out, or 'shore ...', or remove it from the file"


@dataclass(kw_only=True)
class Positions:
    """The positions of a file in WGS84 degrees; a position is (latitude, longitude).

    Attributes:
        area: Corners (n, 2) of the operating area; None if the file has none.
        area_name: Its name in the file.
        no_go: Corners (n, 2) of each no-go area by name.
        starts: Starts by vehicle number.
        recoveries: Recovery positions by vehicle number; 0 is that of all vehicles.
        shores: Lines (n, 2) along the shore.
        ignored: Names of unused features.
    """

    area: Array | None = None
    area_name: str = ""
    no_go: dict[str, Array] = field(default_factory=dict)
    starts: dict[int, tuple[float, float]] = field(default_factory=dict)
    recoveries: dict[int, tuple[float, float]] = field(default_factory=dict)
    shores: list[Array] = field(default_factory=list)
    ignored: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Feature:
    """A polygon (rings, the first around it, then its holes), a line or a point; all are (n, 2) lat, lon.

    `role_text` is what its properties state about its use, `other_text` all other text beside its name.
    """

    name: str
    role_text: str = ""
    other_text: str = ""
    rings: tuple[Array, ...] = ()
    line: Array | None = None
    point: tuple[float, float] | None = None


def named_feature(properties: Mapping[str, Any]) -> Feature:
    """A feature without a geometry, with the texts of its properties.

    A true property counts with its key, such as `no_go: true`; a false one with the opposite: `inclusion: false`.
    """
    said: dict[str, str] = {}
    flags: list[str] = []
    for key, value in properties.items():
        word = _words(str(key))
        text = "" if value is None else str(value).strip()
        if text.lower() in ("true", "yes", "1", "1.0"):
            flags.append(word)
        elif text.lower() in ("false", "no", "0", "0.0"):
            flags += ["exclusion"] if word.startswith("inclu") else []
        elif isinstance(value, str) and text:
            said[word] = text
    flags = [word for word in flags if any(pattern.search(word) for pattern in _ROLES.values())]
    name = next((said[key] for key in _NAME_KEYS if key in said), "")
    role = " ".join([said.pop(key) for key in _ROLE_KEYS if key in said] + flags)
    other = " ".join(text for key, text in said.items() if key not in _NAME_KEYS)
    return Feature(name, role_text=role, other_text=other)


def checked(ring: Array, key: str) -> Array:
    """Positions (n, 2), if each is a latitude and a longitude.

    Raises:
        ParameterError: naming the position.
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


def sorted_by_role(features: Sequence[Feature], where: str) -> Positions:
    """Positions of a file's features, by their names."""
    positions = Positions()
    areas: list[Feature] = []
    _check_extent(features, where)
    for feature in features:
        role = _role(feature, where)
        if role == "no_go":
            _add_no_go_feature(positions, feature, where)
        elif role == "shore" and (feature.rings or feature.line is not None):
            positions.shores += [line for line in _shores(feature) if len(line) > 1]
        elif feature.rings:
            areas.append(feature)
        elif feature.point is not None and role in ("start", "recovery"):
            _add_position(positions, role, feature, where)
        else:
            positions.ignored.append(feature.name or "without a name")
    if len(areas) > 1:
        names = ", ".join(repr(f.name) for f in areas)
        raise ParameterError(f"{where}: {len(areas)} polygons may be the operating area: {names}. {NAMING}")
    if not areas and not positions.starts and not positions.recoveries and not positions.no_go:
        raise ParameterError(f"{where}: no usable position. Draw the operating area as a polygon")
    if areas:
        positions.area, positions.area_name = areas[0].rings[0], areas[0].name
        for number, hole in enumerate(areas[0].rings[1:], 1):
            add_no_go(positions.no_go, f"hole {number}", hole)
    return positions


def _check_extent(features: Sequence[Feature], where: str) -> None:
    """Checks every corner of a file.

    Raises:
        ParameterError: if a polygon has no corners, or a position is impossible or far from the others.
    """
    for feature in features:
        if any(not len(ring) for ring in feature.rings):
            raise ParameterError(f"{where}: the polygon {feature.name!r} has no corners. Draw it again, or remove it")
    everywhere = [ring for f in features for ring in f.rings] + [np.array([f.point]) for f in features if f.point]
    everywhere += [f.line for f in features if f.line is not None]
    for ring in everywhere:
        checked(ring, where)
    if everywhere and (extent := np.ptp(np.concatenate(everywhere), axis=0)).max() > MAX_EXTENT_DEG:
        raise ParameterError(
            f"{where}: its positions lie {extent[0]:.3g} deg of latitude and {extent[1]:.3g} deg of longitude apart, "
            f"more than {MAX_EXTENT_DEG:g}. Are latitude and longitude swapped in one of them?"
        )


def _words(text: str) -> str:
    """Text in lower case with its words separated by single blanks: 'NoGo_1' becomes 'no go 1'."""
    return re.sub(r"[\W_]+|(?<=[a-z])(?=[A-Z])|(?<=[^\W\d_])(?=\d)", " ", text).lower().strip()


def _role(feature: Feature, where: str) -> str:
    """The role of a feature: one of `_ROLES`, or "" if nothing states it.

    Raises:
        ParameterError: if its properties contradict its name about whether vehicles must stay out.
    """

    def stated(text: str) -> str:
        return next((role for role, pattern in _ROLES.items() if pattern.search(_words(text))), "")

    by_property, by_name, elsewhere = (stated(t) for t in (feature.role_text, feature.name, feature.other_text))
    role = by_property or by_name
    unclear = by_property and by_name == "no_go" and role != "no_go"
    if feature.rings and (unclear or (elsewhere == "no_go" and role not in ("no_go", "area", "shore"))):
        text = f"{feature.role_text} {feature.other_text}".strip()
        raise ParameterError(
            f"{where}: the polygon {feature.name!r} with {text[:120]!r} may be the operating area or a no-go area. Set "
            "its property role to 'area' or 'no-go'"
        )
    return role


def _add_no_go_feature(positions: Positions, feature: Feature, where: str) -> None:
    """Adds a no-go area: a polygon or a closed line.

    Raises:
        ParameterError: if it is an open line or a point, which vehicles cannot keep out of.
    """
    name = feature.name or feature.role_text
    closed = feature.line is not None and len(feature.line) > 3 and np.array_equal(feature.line[0], feature.line[-1])
    if feature.line is not None and closed:
        add_no_go(positions.no_go, name, feature.line[:-1])
    elif feature.rings:
        add_no_go(positions.no_go, name, feature.rings[0])
        positions.ignored += [f"hole {k} of no-go area {name}" for k in range(1, len(feature.rings))]
    else:
        kind = "point" if feature.point is not None else "line"
        raise ParameterError(f"{where}: {name!r} is a {kind}; a no-go area needs a polygon. Draw one, or rename it")


def _shores(feature: Feature) -> list[Array]:
    """The lines of a shore: itself, or the closed outlines of a polygon and its holes."""
    if feature.line is not None:
        return [feature.line]
    return [np.vstack([ring, ring[:1]]) for ring in feature.rings]


def add_no_go(no_go: dict[str, Any], name: str, ring: Any) -> None:
    """Adds a ring under its name, which becomes that of a ROS parameter and gets a number if it is taken."""
    key = re.sub(r"\W+", "_", name).strip("_").lower() or "no_go"
    number = 1
    while (unique := key if number == 1 else f"{key}_{number}") in no_go:
        number += 1
    no_go[unique] = ring


def _add_position(positions: Positions, role: str, feature: Feature, where: str) -> None:
    assert feature.point is not None
    number = re.search(r"\d+", f"{feature.role_text} {feature.name}"[:80])  # Python converts no endless ones
    found = positions.starts if role == "start" else positions.recoveries
    key = int(number[0]) if number else (max(found, default=0) + 1 if role == "start" else 0)
    if key in found or not 0 <= key <= 255 or (role == "start" and key == 0):
        raise ParameterError(
            f"{where}: {feature.name!r}: got a second {role} position, or no number of a vehicle; expected one for "
            f"each vehicle, such as '{role} 2'"
        )
    found[key] = feature.point
