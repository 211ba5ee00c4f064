"""GeoJSON, with the CRS that older files name, and with a feature on each line."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_shore.areas.features import Feature, named_feature, with_geometry
from auv_lse_shore.areas.projection import to_degrees


def json_of(text: str) -> Any:
    """The value of a JSON text; for one feature per line (GeoJSONSeq), their collection.

    Raises:
        ValueError: if it is not JSON.
    """
    try:
        return json.loads(text)
    except ValueError:
        mark = "\x1e" if "\x1e" in text else "\n"  # RFC 8142 puts one before each feature
        first, *others = [part for part in map(str.strip, text.split(mark)) if part]
        try:
            features = [json.loads(first)]
        except ValueError:
            others = []
        if not others:
            raise  # the error of the whole text
    return {"type": "FeatureCollection", "features": [*features, *map(json.loads, others)]}


def geojson_features(data: Mapping[str, Any], where: str) -> Iterator[Feature]:
    """The features of a GeoJSON document.

    Raises:
        ParameterError: if its CRS or a kind of geometry is not understood.
        KeyError, TypeError, ValueError: if it is not GeoJSON.
    """
    if "type" not in data:
        raise ParameterError(f"{where} has no type, so it is not GeoJSON. Export it as GeoJSON or KML")
    if data["type"] == "Topology":
        raise ParameterError(f"{where} is TopoJSON. Convert it to GeoJSON: ogr2ogr -t_srs EPSG:4326 area.geojson FILE")
    layer = str(data.get("name") or "")
    convert = to_degrees(_crs(data.get("crs")), where)
    features = data.get("features") if data["type"] == "FeatureCollection" else [data]
    if not isinstance(features, list):
        raise ParameterError(f"{where} is a FeatureCollection without a list of features. Export it again")
    for number, feature in enumerate(features, 1):
        if not isinstance(feature, Mapping):
            raise ParameterError(
                f"{where}: feature {number} is {json.dumps(feature)[:80]}, not an object. Export the file again"
            )
        is_feature = feature.get("type") == "Feature"
        properties = dict((is_feature and feature.get("properties")) or {})
        if is_feature and "id" in feature and not any(str(key).lower() in ("id", "name") for key in properties):
            properties["id"] = feature["id"]
        named = named_feature(properties, layer)
        if not named.name:
            named = named_feature({**properties, "name": f"feature {number}"}, layer)
        geometry = feature.get("geometry") if is_feature else feature
        yield from map(convert, with_geometry(named, geometry, where))


def _crs(crs: Any) -> str | None:
    """The name of the member `crs`; None: WGS84 longitude and latitude."""
    if not crs:
        return None
    named = crs.get("properties", {}).get("name") if isinstance(crs, Mapping) else None
    return str(named or crs)
