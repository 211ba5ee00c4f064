"""The area and the isobaths as GeoJSON on Earth, for Foxglove's map panel; only with a known origin."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from auv_lse_shore.judge.isobath import geojson_of
from auv_lse_shore.live.sources.timeline import Event

#: Its schema in foxglove-sdk, in place of a ROS type.
GEOJSON = "foxglove.GeoJSON"
#: Looks of lines by name, as Leaflet path options.
_LOOKS: dict[str, dict[str, Any]] = {
    "operating area": {"color": "#888888", "weight": 2, "fill": False},
    "no-go area": {"color": "#d00000", "weight": 2, "fill": False},
    "true isobath": {"color": "#000000", "weight": 2},
    "found": {"color": "#d55e00", "weight": 5},
    "likely": {"color": "#d55e00", "weight": 3},
    "guessed": {"color": "#888888", "weight": 1},
    "shallow_edge": {"color": "#e69f00", "weight": 1},
    "deep_edge": {"color": "#0072b2", "weight": 1},
}


def area_text(facts: Event) -> str:
    """The operating area, its no-go areas and, for a simulated lake, the true isobath."""
    rings = {"operating area": [facts["area"]], "no-go area": facts["holes"]}
    closed = {name: [[*ring, *ring[:2]] for ring in lines] for name, lines in rings.items()}
    return _text({**closed, "true isobath": facts["true_isobath"]}, facts)


def isobath_text(event: Event, facts: Event) -> str:
    """The isobath and the edges of its band on one vehicle's map."""
    return _text({name: event[name] for name in ("found", "likely", "guessed", "shallow_edge", "deep_edge")}, facts)


def _text(lines: Mapping[str, Sequence[Sequence[int]]], facts: Event) -> str:
    """Lines of decimetres (north, east, north, ...) by name."""
    features = [
        ({"name": name.replace("_", " "), "style": _LOOKS[name]}, [np.reshape(line, (-1, 2)) / 10.0 for line in found])
        for name, found in lines.items()
        if found
    ]
    return json.dumps(geojson_of(features, tuple(facts["origin_deg"])), allow_nan=False)
