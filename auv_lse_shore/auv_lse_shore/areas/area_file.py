"""Reads an area file; its content, not its suffix, decides how."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from auv_lse_common.mission_file.degrees import AreaContent
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.input_bounds import over_size
from auv_lse_common.support.plurals import counted
from auv_lse_common.support.text import decoded
from auv_lse_common.support.user_error import brief
from auv_lse_shore.areas.corner_table import corner_table_features
from auv_lse_shore.areas.features import Feature
from auv_lse_shore.areas.gdal_layers import gdal_features, zipped_features
from auv_lse_shore.areas.geojson import geojson_features, json_of
from auv_lse_shore.areas.gpx import gpx_features
from auv_lse_shore.areas.kml import is_kmz, kml_features, kmz_features
from auv_lse_shore.areas.plans import corner_list_features, is_fence, qgc_features, waypoint_features
from auv_lse_shore.areas.roles import MAX_LISTED, content_of, listed_names
from auv_lse_shore.areas.xml_tree import read_xml

KINDS = (
    "GeoJSON, KML, KMZ, GPX, GeoPackage, shapefile, a QGroundControl plan, a fence or polygon of Mission Planner, or a "
    "table of corners with columns lat and lon"
)
#: Largest size of an area file.
MAX_BYTES = 20_000_000
_GDAL = {b"SQLite format 3\0": "GeoPackage", b"\x00\x00\x27\x0a": "shapefile"}
_CORNER_LISTS = (".poly", ".fen", ".ral")


class AreaFiles:
    """Reads area files, and remembers what was used and ignored of each.

    Attributes:
        read: The content of each file that was read, in order.
    """

    def __init__(self) -> None:
        self.read: list[tuple[Path, AreaContent]] = []

    def __call__(self, path: Path) -> AreaContent:
        """Reads a file; see `read_area`."""
        content = read_area(path)
        self.read.append((path, content))
        return content

    def notes(self, vehicles: int) -> list[str]:
        """Sentences about the file that was read last, for a mission with this many vehicles; none before a file."""
        return [text for path, content in self.read[-1:] for text in notes_on(path, content, vehicles)]


def read_area(path: str | Path) -> AreaContent:
    """Reads the operating area, no-go areas, starts and recovery positions of a file.

    Raises:
        ParameterError: if the file is missing, too large or of another kind, or something in it is impossible.
    """
    path = Path(path)
    try:
        if problem := over_size(path, MAX_BYTES):
            raise ParameterError(f"{problem}. Leave only the area and the no-go areas")
        data = path.read_bytes()
    except IsADirectoryError as error:
        raise ParameterError(f"{path} is a folder, as a file geodatabase is. Save the area as {KINDS}") from error
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read: {error.strerror or error}") from error
    try:
        return content_of(list(_features(data, path)), str(path))
    except ParameterError:
        raise
    except json.JSONDecodeError as error:
        raise ParameterError(f"{path} is not valid JSON: {error}. Export it again, as {KINDS}") from error
    except (LookupError, TypeError, ValueError, AttributeError, RecursionError, OverflowError) as error:
        raise ParameterError(
            f"{path} is damaged, or not what it seems: {type(error).__name__}: {brief(error)}. "
            f"Export it again, as {KINDS}"
        ) from error


def _features(data: bytes, path: Path) -> Iterator[Feature]:
    where = str(path)
    if data[:4] == b"PK\x03\x04":
        return kmz_features(data, where) if is_kmz(data) else zipped_features(data, where)
    if data[:2] == b"\x1f\x8b":
        raise ParameterError(f"{where} is compressed with gzip. Unpack it first")
    if any(data.startswith(magic) for magic in _GDAL):
        return gdal_features(path, where)
    text = decoded(data)
    begin = text.lstrip()[:1]
    if begin == "<":
        root = read_xml(data, where)
        if root.tag == "osm":
            convert = f"ogr2ogr area.geojson {where} multipolygons"
            raise ParameterError(f"{where} is an OpenStreetMap file. Convert it to GeoJSON: {convert}")
        if root.tag not in ("kml", "gpx"):
            raise ParameterError(f"{where} is XML of the kind {root.tag[:40]!r}. Save the area as {KINDS}")
        return kml_features(root, where) if root.tag == "kml" else gpx_features(root, where)
    if begin in ("{", "["):
        found = json_of(text)
        if not isinstance(found, Mapping):
            raise ParameterError(f"{where} is a list, not GeoJSON. Save the area as {KINDS}")
        is_plan = "fileType" in found or "geoFence" in found
        return qgc_features(found, where) if is_plan else geojson_features(found, where)
    if text.lstrip().startswith("QGC WPL"):
        return waypoint_features(text.lstrip(), where)
    suffix = ".fen" if is_fence(text) else path.suffix.lower()
    if suffix in _CORNER_LISTS:
        return corner_list_features(text, where, suffix)
    if table := corner_table_features(path):
        return iter(table)
    what = "is empty" if not data.strip() else f"is not a known kind of area file ({path.suffix or 'no suffix'})"
    raise ParameterError(f"{where} {what}. Save the area as {KINDS}")


def notes_on(path: Path, content: AreaContent, vehicles: int) -> list[str]:
    """Sentences about what a mission with this many vehicles uses and ignores of a file."""
    used = [f"the area {content.area_name!r}" if content.area_name else "the area"] if content.area is not None else []
    names = list(content.no_go)
    if len(names) > MAX_LISTED:
        used.append(f"{len(names)} no-go areas, {names[0]} to {names[-1]}")
    else:
        used += [f"no-go area {name}" for name in names]
    used += ["the shore"] if content.shores else []
    own = [(number, f"start of auv{number}") for number in sorted(content.starts)]
    own += [
        (number, f"recovery position of {f'auv{number}' if number else 'all vehicles'}")
        for number in sorted(content.recoveries)
    ]
    used += [text for number, text in own if number <= vehicles]
    notes = [f"{path.name}: used {', '.join(used)}", *(f"{path.name}: {note}" for note in content.notes)]
    if beyond := [text for number, text in own if number > vehicles]:
        notes.append(f"{path.name}: ignored {', '.join(beyond)}: the mission has {counted(vehicles, 'vehicle')}")
    if content.ignored:
        notes.append(f"{path.name}: ignored {listed_names(content.ignored)}")
    return notes
