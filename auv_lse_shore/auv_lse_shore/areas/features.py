"""The features of an area file: polygons, lines and points with the text that states their purpose."""

import json
import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.arrays import Array

#: Properties that state what a feature is, most explicit first, and those that name it; case-insensitive.
_ROLE_KEYS = ("role", "type", "kind", "class", "category", "zone", "use", "usage")
_NAME_KEYS = ("name", "title", "label", "id")
#: Characters of a geometry that an error quotes.
_MOST = 100
#: Words for true and false.
TRUE = ("true", "yes", "y", "t", "x", "on", "1", "1.0", "ja", "oui", "si", "sí")
FALSE = ("false", "no", "n", "f", "off", "0", "0.0", "nein", "non")


@dataclass(frozen=True)
class Feature:
    """A polygon, a line or a point in WGS84 degrees; corners are (n, 2) latitude, longitude.

    Attributes:
        role_text: What its properties state about its use.
        folder: Names of the folders or the layer it is in.
        other_text: All other text of its properties.
        other_keys: Names of the properties with that text.
        flags: Properties that are true.
        rings: Those of a polygon, the outer one first, then its holes.
        point: Latitude, longitude.
        closes: Whether a line that is open may be closed to an outline: "" (no), "route" or "track".
        assumed: Assumption about its coordinates; "" if none.
    """

    name: str
    role_text: str = ""
    folder: str = ""
    other_text: str = ""
    other_keys: str = ""
    flags: tuple[str, ...] = ()
    rings: tuple[Array, ...] = ()
    line: Array | None = None
    point: tuple[float, float] | None = None
    closes: str = ""
    assumed: str = ""


def is_resource_fork(name: str) -> bool:
    """Whether a file in an archive is not content but an addition of macOS."""
    return name.startswith("__MACOSX/") or name.rpartition("/")[2].startswith("._")


def words(text: str) -> str:
    """Text in lower case, without accents, its words separated by single blanks: 'NoGo_Île1' becomes 'no go ile 1'."""
    text = "".join(letter for letter in unicodedata.normalize("NFKD", text) if not unicodedata.combining(letter))
    return re.sub(r"[\W_]+|(?<=[a-z])(?=[A-Z])|(?<=[^\W\d_])(?=\d)", " ", text).lower().strip()


def named_feature(properties: Mapping[str, Any], folder: str = "") -> Feature:
    """A feature without a geometry, with the texts of its properties.

    A true property counts with its key, such as `no_go: true`; a false one with the opposite: `inclusion: false`.
    """
    said: dict[str, str] = {}
    flags: list[str] = []
    for key, value in properties.items():
        word = words(str(key))
        text = "" if value is None else str(value).strip()
        if text.lower() in TRUE and word not in _NAME_KEYS:
            flags.append(word)
        elif text.lower() in FALSE and word not in _NAME_KEYS:
            flags += ["exclusion"] if word.startswith("inclu") else []
        elif isinstance(value, str | int | float) and text:
            said[word] = text
    name = next((said[key] for key in _NAME_KEYS if key in said), "")
    role = " ".join(said.pop(key) for key in _ROLE_KEYS if key in said)
    other = {key: text for key, text in said.items() if key not in _NAME_KEYS}
    texts, keys = (" ".join(part) for part in (other.values(), other))
    return Feature(name, role_text=role, folder=folder, other_text=texts, other_keys=keys, flags=tuple(flags))


def with_geometry(named: Feature, geometry: Mapping[str, Any] | None, where: str) -> Iterator[Feature]:
    """The features of a GeoJSON geometry, one for each polygon, line and point in it.

    Raises:
        ParameterError: for a kind of geometry that is not known, and if it is not GeoJSON; names the feature.
    """
    if geometry is None:
        yield replace(named, name=named.name or "without a geometry")
        return
    try:
        yield from _parts(named, geometry, where)
    except ParameterError:
        raise
    except (LookupError, TypeError, ValueError) as error:
        shown = json.dumps(geometry, default=str)
        shown = shown if len(shown) <= _MOST else f"{shown[:_MOST]} ..."
        raise ParameterError(
            f"{where}: {named.name!r} has the geometry {shown}, which is not GeoJSON. Export the file again"
        ) from error


def _parts(named: Feature, geometry: Mapping[str, Any], where: str) -> Iterator[Feature]:
    kind = str(geometry["type"])
    single = kind.removeprefix("Multi")
    inside = geometry["geometries" if kind == "GeometryCollection" else "coordinates"]
    if not inside:
        yield replace(named, name=f"{named.name} (empty)".strip())
        return
    if kind == "GeometryCollection":
        for inner in inside:
            yield from with_geometry(named, inner, where)
        return
    parts = inside if kind != single else [inside]
    if kind == "MultiPolygon":
        parts = _joined(parts)
    for part in parts:
        if single == "Polygon":
            yield replace(named, rings=tuple(ring_of(ring) for ring in part))
        elif single == "LineString":
            yield replace(named, line=line_of(part))
        elif single == "Point":
            yield replace(named, point=(float(part[1]), float(part[0])))
        else:
            raise ParameterError(f"{where}: {named.name!r} is a {kind}, which is not read. Save it as a polygon")


def _joined(parts: Sequence[Any]) -> Sequence[Any]:
    """The polygons of a multipolygon without the cut at the antimeridian that RFC 7946 asks for."""
    longitudes = [{float(corner[0]) for ring in part for corner in ring} for part in parts]
    if not any(180.0 in of_part for of_part in longitudes) or not any(-180.0 in of_part for of_part in longitudes):
        return parts
    import shapely  # slow to import, and rarely needed

    east = [[[(float(x) % 360.0, float(y)) for x, y, *_ in ring] for ring in part] for part in parts]
    shapes = [shapely.Polygon(rings[0], rings[1:]) for rings in east]
    if not all(shape.is_valid for shape in shapes):
        return parts  # the check of the area names what is wrong
    whole = shapely.get_parts(shapely.union_all(shapes).simplify(0.0)).tolist()
    rings_of = [[shape.exterior, *shape.interiors] for shape in whole]
    return [[[(x - 360.0 * (x > 180.0), y) for x, y in ring.coords] for ring in rings] for rings in rings_of]


def ring_of(corners: Sequence[Sequence[float]]) -> Array:
    """Corners (n, 2) lat, lon of a ring of longitude, latitude, without repeated ones."""
    ring = line_of(corners)
    if len(ring) > 1:
        ring = ring[np.r_[True, (np.diff(ring, axis=0) != 0.0).any(axis=1)]]
    return ring[:-1] if len(ring) > 3 and np.array_equal(ring[0], ring[-1]) else ring


def line_of(corners: Sequence[Sequence[float]]) -> Array:
    """Corners (n, 2) lat, lon of a list of longitude, latitude."""
    return np.array([(float(corner[1]), float(corner[0])) for corner in corners]).reshape(-1, 2)
