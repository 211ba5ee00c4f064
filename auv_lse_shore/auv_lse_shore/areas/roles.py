"""Finds the purpose of an area file's features, by their names, properties and folders.

A feature's name, a property such as `role` or `type`, its folder, or a document's title defines its use: "no-go ...",
"start ...", "recovery ...", "shore ...". A number in the name of a start or recovery position is the vehicle number. A
shore is a line or the outline of a polygon. The one remaining polygon, or a closed line, is the operating area.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auv_lse_common.mission_file.degrees import NAMING, AreaContent, add_no_go, checked
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.plurals import listed
from auv_lse_common.vocabulary.frames import unwrapped_deg
from auv_lse_shore.areas.features import Feature
from auv_lse_shore.areas.outline import outline
from auv_lse_shore.areas.role_words import stated_role, states_keep_out

#: Largest extent (deg) of everything in a file: beyond it a flat map is wrong, or coordinates are swapped.
MAX_EXTENT_DEG = 2.0
#: Largest number of rings in a file; those of an area have at most 2,000 corners together.
MAX_RINGS = 700
#: Number of names that an error or a note lists.
MAX_LISTED = 8


def content_of(features: Sequence[Feature], where: str) -> AreaContent:
    """The content of a file, from its features.

    Raises:
        ParameterError: if something in it is impossible, or could be more than one thing.
    """
    content = AreaContent()
    content.notes += dict.fromkeys(feature.assumed for feature in features if feature.assumed)
    areas: list[Feature] = []
    lines: list[Feature] = []
    if (polygons := sum(len(feature.rings) for feature in features)) > MAX_RINGS:
        raise ParameterError(f"{where}: has {polygons:,} rings, more than {MAX_RINGS:,}. Leave only what is needed")
    _check_extent(features, where)
    for feature in features:
        role = _role(feature, where)
        if role == "no_go":
            _add_no_go_feature(content, feature, where)
        elif role == "shore" and (feature.rings or feature.line is not None):
            content.shores += [_checked(line, feature, where) for line in _shores(feature) if len(line) > 1]
        elif feature.rings:
            areas.append(feature)
        elif role in ("", "area") and _encloses(feature):
            lines.append(feature)
        elif feature.point is not None and role in ("start", "recovery"):
            _add_position(content, role, feature, where)
        else:
            content.ignored.append(feature.name or _kind(feature))
    areas = _one_each(areas, content) or [_outlined(line, content, where) for line in lines[:1] if len(lines) == 1]
    if len(areas) > 1 or (not areas and len(lines) > 1):
        names = listed_names([f.name or "without a name" for f in areas or lines])
        what = f"{len(areas or lines)} {'polygons' if areas else 'lines'}"
        cure = _if_islands(areas or lines) or _if_parts(areas, where)
        raise ParameterError(f"{where}: {what} may be the operating area: {names}. {NAMING}{cure}")
    if areas:
        content.ignored += [f.name or _kind(f) for f in lines if len(lines) > 1 or f.line is not areas[0].line]
        content.area, content.area_name = _checked(areas[0].rings[0], areas[0], where), areas[0].name
        for number, hole in enumerate(areas[0].rings[1:], 1):
            add_no_go(content.no_go, f"hole {number}", _checked(hole, areas[0], where))
    elif not (content.starts or content.recoveries or content.no_go):
        raise ParameterError(_nothing_usable(content, where))
    return content


def _if_islands(features: Sequence[Feature]) -> str:
    """What to do if one feature is a lake, and the others are its islands; "" if none encloses all others."""
    rings = [feature.rings[0] if feature.rings else feature.line for feature in features]
    around = max((ring for ring in rings if ring is not None), key=lambda ring: float(np.ptp(ring, axis=0).prod()))
    if not all(ring is around or (ring is not None and _covers(around, ring)) for ring in rings):
        return ""
    return ". If the largest is a lake and the others are islands, name those so, or give them the property role: no-go"


def _if_parts(areas: Sequence[Feature], where: str) -> str:
    """What to do if polygons are the parts of one feature, which share its name; "" if they have names of their own."""
    if not areas or len({feature.name for feature in areas}) > 1:
        return ""
    return f". If they are the parts of one feature, split it: ogr2ogr -explodecollections parts.geojson {where}"


def _nothing_usable(content: AreaContent, where: str) -> str:
    shown = listed_names(content.ignored)
    return f"{where} has no polygon{f', only {shown}' if shown else ''}. Draw the operating area as a polygon"


def listed_names(names: Sequence[str]) -> str:
    """The names of features, each once with its number."""
    numbers = Counter(names).items()
    return listed([f"{number} x {name!r}" if number > 1 else repr(name) for name, number in numbers], MAX_LISTED)


def _kind(feature: Feature) -> str:
    """The kind of an unnamed feature, in words."""
    if feature.rings:
        return "polygon without a name"
    return "line without a name" if feature.line is not None else "point without a name"


def _one_each(areas: list[Feature], content: AreaContent) -> list[Feature]:
    """Polygons that may be the area, without repeated ones and without fences around all others."""
    kept: list[Feature] = []
    for feature in areas:
        if any(_same(feature, other) for other in kept):
            content.ignored.append(f"{feature.name or _kind(feature)} (given twice)")
        else:
            kept.append(feature)
    for fence in [f for f in kept if f.role_text == "inclusion fence"]:
        others = [f for f in kept if f is not fence]
        if others and all(_covers(fence.rings[0], f.rings[0]) for f in others):
            kept = others
            content.ignored.append(f"{fence.name} (the area lies inside)")
    return kept


def _same(one: Feature, other: Feature) -> bool:
    return len(one.rings) == len(other.rings) and all(map(np.array_equal, one.rings, other.rings))


def _covers(outer: Array, inner: Array) -> bool:
    if min(len(outer), len(inner)) < 3:
        return False
    import shapely  # slow to import, and rarely needed

    around, inside = shapely.Polygon(outer), shapely.Polygon(inner)
    return bool(around.is_valid and inside.is_valid and around.covers(inside))


def _outlined(feature: Feature, content: AreaContent, where: str) -> Feature:
    """A line as the polygon that it encloses; notes how."""
    assert feature.line is not None
    name = feature.name or _kind(feature)
    ring, note = outline(feature.line, feature.closes, f"{where}: {name!r}")
    content.notes.append(f"the area is the outline of {name!r}{note}")
    return replace(feature, rings=(ring,))


def _encloses(feature: Feature) -> bool:
    """Whether a feature is a polygon, a closed line, or one that may be closed."""
    line = feature.line
    is_closed = line is not None and len(line) > 3 and np.array_equal(line[0], line[-1])
    return bool(feature.rings or is_closed or feature.closes)


def _check_extent(features: Sequence[Feature], where: str) -> None:
    """Checks every corner of a file."""
    everywhere: list[Array] = []
    for feature in features:
        if any(not len(ring) for ring in feature.rings):
            raise ParameterError(f"{where}: the polygon {feature.name!r} has no corners. Draw it again, or remove it")
        mine = [*feature.rings, *([feature.line] if feature.line is not None and len(feature.line) else [])]
        mine += [np.array([feature.point])] if feature.point else []
        everywhere += [checked(ring, f"{where}: {feature.name!r}", None) for ring in mine]
    if not everywhere:
        return
    lat, lon = np.concatenate(everywhere).T
    extent = np.array([np.ptp(lat), np.ptp(unwrapped_deg(lon))])
    if extent.max() > MAX_EXTENT_DEG:
        raise ParameterError(
            f"{where}: it spans {extent[0]:.3g} deg of latitude and {extent[1]:.3g} deg of longitude, more than "
            f"{MAX_EXTENT_DEG:g}. Are latitude and longitude swapped in one of its features?"
        )


def _checked(ring: Array, feature: Feature, where: str) -> Array:
    return checked(ring, f"{where}: {feature.name or _kind(feature)!r}")


def _role(feature: Feature, where: str) -> str:
    """The role of a feature, as `stated_role`, or "" if nothing states it."""
    by_property = stated_role(" ".join((feature.role_text, *feature.flags)))
    by_name, by_folder, elsewhere = (stated_role(t) for t in (feature.name, feature.folder, feature.other_text))
    role = by_property or by_name or by_folder
    unclear = by_property and by_name == "no_go" and role != "no_go"
    may_be_no_go = elsewhere == "no_go" or states_keep_out(feature.other_keys)
    if _encloses(feature) and (unclear or (may_be_no_go and role not in ("no_go", "area", "shore"))):
        text = " ".join((feature.role_text, *feature.flags, feature.other_keys, feature.other_text)).strip()
        what = f"the {'polygon' if feature.rings else 'line'} {feature.name!r} with {text[:120]!r}"
        raise ParameterError(
            f"{where}: {what} may be the operating area or a no-go area. Set its property role to 'area' or 'no-go'"
        )
    return role


def _add_no_go_feature(content: AreaContent, feature: Feature, where: str) -> None:
    """Adds a no-go area: a polygon, a closed line, or one that may be closed."""
    name = feature.name or feature.role_text or feature.folder
    if feature.rings:
        add_no_go(content.no_go, name, _checked(feature.rings[0], feature, where))
        content.ignored += [f"hole {k} of no-go area {name}" for k in range(1, len(feature.rings))]
    elif feature.line is not None and _encloses(feature):
        ring, note = outline(feature.line, feature.closes, f"{where}: {name!r}")
        add_no_go(content.no_go, name, _checked(ring, feature, where))
        content.notes.append(f"no-go area {name} is the outline of a line{note}")
    elif feature.line is None and feature.point is None:
        content.ignored.append(name)
    else:
        kind = "a point" if feature.point is not None else "an open line"
        raise ParameterError(
            f"{where}: {name!r} is {kind}; a no-go area needs a polygon or a closed line. Draw one, or change its role"
        )


def _shores(feature: Feature) -> list[Array]:
    """The lines of a shore: itself, or the closed outlines of a polygon and its holes."""
    if feature.line is not None:
        return [feature.line]
    return [np.vstack([ring, ring[:1]]) for ring in feature.rings]


def _add_position(content: AreaContent, role: str, feature: Feature, where: str) -> None:
    assert feature.point is not None
    number = re.search(r"\d+", f"{feature.role_text} {feature.name}"[:80])  # Python refuses to convert very long ones
    found = content.starts if role == "start" else content.recoveries
    key = int(number[0]) if number else (max(found, default=0) + 1 if role == "start" else 0)
    if key in found or not 0 <= key <= 255 or (role == "start" and key == 0):
        raise ParameterError(
            f"{where}: {feature.name!r} is a second {role}, or has no number of a vehicle. Name one for each vehicle, "
            f"such as '{role} 2'"
        )
    found[key] = feature.point
