"""GPX: routes and tracks around an area, waypoints as starts and recovery positions."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_shore.areas.features import Feature, line_of, named_feature
from auv_lse_shore.areas.outline import MAX_GAP, ends_meet, lengths_m
from auv_lse_shore.areas.xml_tree import text_of

Array = NDArray[np.float64]


def gpx_features(root: Element, where: str) -> Iterator[Feature]:
    """The features of a GPX document.

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
            closes = "route" if element.tag == "rte" else "track"
            name = named.name or f"{closes} without a name"
            for suffix, line in _lines(element, where):
                yield Feature(name + suffix, named.role_text, other_text=named.other_text, line=line, closes=closes)
        elif element.tag not in ("metadata", "extensions"):
            yield Feature(f"{named.name} ({element.tag})".strip())


def _lines(element: Element, where: str) -> list[tuple[str, Array]]:
    """The lines of a route or track, and what is added to its name for each.

    The segments of a track are one line if a way around was paused: each goes on where the one before ended, and none
    returns to its own start.
    """
    if element.tag == "rte":
        return [("", line_of([_position(point, where) for point in element.iter("rtept")]))]
    parts = [line_of([_position(point, where) for point in part.iter("trkpt")]) for part in element.iter("trkseg")]
    parts = [part for part in parts if len(part)]
    if len(parts) < 2:
        return [("", parts[0] if parts else line_of([]))]
    whole = np.concatenate(parts)
    gaps_m = [lengths_m(np.array([one[-1], other[0]]))[0] for one, other in itertools.pairwise(parts)]
    if max(gaps_m) <= MAX_GAP * lengths_m(whole)[0] and not any(map(ends_meet, parts)):
        return [(f" ({len(parts)} segments joined over at most {max(gaps_m):.0f} m)", whole)]
    return [(f", segment {number}", part) for number, part in enumerate(parts, 1)]


def _position(element: Element, where: str) -> tuple[float, float]:
    """Longitude, latitude of a point."""
    try:
        return float(element.get("lon", "")), float(element.get("lat", ""))
    except ValueError:
        shown = f"lat={element.get('lat')!r} lon={element.get('lon')!r}"
        raise ParameterError(f'{where}: a {element.tag} has {shown}; write degrees, such as lat="46.5"') from None
