"""GPX: routes and tracks around an area, waypoints as starts and recovery positions."""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree.ElementTree import Element

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_shore.areas.features import Feature, line_of, named_feature
from auv_lse_shore.areas.xml_tree import text_of


def gpx_features(root: Element, where: str) -> Iterator[Feature]:
    """The features of a GPX document; the segments of a track are one line.

    Raises:
        ParameterError: naming the point that cannot be read.
    """
    for element in root:
        texts = {key: text_of(element, key) for key in ("name", "type", "desc", "cmt")}
        named = named_feature(texts)
        if element.tag == "wpt":
            longitude, latitude = _position(element, where)
            yield Feature(named.name, named.role_text, other_text=named.other_text, point=(latitude, longitude))
        elif element.tag in ("rte", "trk"):
            tag, closes = ("rtept", "route") if element.tag == "rte" else ("trkpt", "track")
            line = line_of([_position(point, where) for point in element.iter(tag)])
            name = named.name or f"{closes} without a name"
            yield Feature(name, named.role_text, other_text=named.other_text, line=line, closes=closes)
        elif element.tag not in ("metadata", "extensions"):
            yield Feature(f"{named.name} ({element.tag})".strip())


def _position(element: Element, where: str) -> tuple[float, float]:
    """Longitude, latitude of a point."""
    try:
        return float(element.get("lon", "")), float(element.get("lat", ""))
    except ValueError:
        shown = f"lat={element.get('lat')!r} lon={element.get('lon')!r}"
        raise ParameterError(f'{where}: a {element.tag} has {shown}; write degrees, such as lat="46.5"') from None
