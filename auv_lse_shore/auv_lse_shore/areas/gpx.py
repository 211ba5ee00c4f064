"""GPX: routes and tracks around an area, waypoints as starts and recovery positions."""

import itertools
from collections.abc import Iterator
from xml.etree.ElementTree import Element

import numpy as np

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.plurals import counted
from auv_lse_shore.areas.features import Feature, line_of, named_feature
from auv_lse_shore.areas.outline import MAX_GAP, ends_meet, lengths_m
from auv_lse_shore.areas.xml_tree import text_of


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

    The segments of a track become one line if the recording was paused on the way around: each starts where the last
    one ended, and at most one returns to its own start. Segments of one point are left out.
    """
    if element.tag == "rte":
        return [("", line_of([_position(point, where) for point in element.iter("rtept")]))]
    segments = list(element.iter("trkseg")) or [element]
    parts = [line_of([_position(point, where) for point in segment.iter("trkpt")]) for segment in segments]
    long = [part for part in parts if len(part) > 1]
    points = sum(len(part) == 1 for part in parts)
    left_out = f" ({counted(points, 'segment')} of one point left out)" if long and points else ""
    if len(long) < 2:
        return [(left_out, (long or [part for part in parts if len(part)] or [line_of([])])[0])]
    whole = np.concatenate(long)
    gaps_m = [lengths_m(np.array([one[-1], other[0]]))[0] for one, other in itertools.pairwise(long)]
    if max(gaps_m) <= MAX_GAP * lengths_m(whole)[0] and sum(map(ends_meet, long)) < 2:
        return [(f" ({len(long)} segments joined over at most {max(gaps_m):.0f} m){left_out}", whole)]
    return [(f", segment {number}{left_out}", part) for number, part in enumerate(long, 1)]


def _position(element: Element, where: str) -> tuple[float, float]:
    """Longitude, latitude of a point."""
    try:
        return float(element.get("lon", "")), float(element.get("lat", ""))
    except ValueError:
        shown = f"lat={element.get('lat')!r} lon={element.get('lon')!r}"
        raise ParameterError(f'{where}: a {element.tag} has {shown}; write degrees, such as lat="46.5"') from None
