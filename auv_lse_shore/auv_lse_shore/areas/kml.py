"""KML and KMZ, as Google Earth, simplekml, ArcGIS, iNav and GDAL write them.

GDAL is not used here: of several rings in one `innerBoundaryIs` its driver keeps only the last.
"""

import io
import re
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from xml.etree.ElementTree import Element

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.user_error import brief
from auv_lse_shore.areas.features import Feature, is_resource_fork, line_of, named_feature, ring_of
from auv_lse_shore.areas.role_words import is_no_go_title
from auv_lse_shore.areas.xml_tree import read_xml, text_of

#: Features without a geometry of their own.
_OVERLAYS = ("GroundOverlay", "ScreenOverlay", "PhotoOverlay", "NetworkLink")
#: Largest size of a document in a KMZ file.
_MAX_DOCUMENT_BYTES = 50_000_000


def is_kmz(data: bytes) -> bool:
    """Whether a ZIP file has a KML document; a damaged one, whether it may have one."""
    try:
        return any(name.lower().endswith(".kml") for name in zipfile.ZipFile(io.BytesIO(data)).namelist())
    except (zipfile.BadZipFile, NotImplementedError, ValueError, OSError):
        return b".kml" in data.lower()


def kmz_features(data: bytes, where: str) -> Iterator[Feature]:
    """The features of every document in a KMZ file.

    Raises:
        ParameterError: if there is none, or one cannot be read.
    """
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
        names = [info for info in archive.infolist() if not is_resource_fork(info.filename)]
        names = [info for info in names if info.filename.lower().endswith(".kml")]
        if too_large := [info.filename for info in names if info.file_size > _MAX_DOCUMENT_BYTES]:
            raise ParameterError(f"{where}: {too_large[0]} has more than {_MAX_DOCUMENT_BYTES / 1e6:.0f} MB")
        documents = {info.filename: _unpacked(archive, info, where) for info in names}
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        raise ParameterError(f"{where}: cannot be unpacked: {brief(error)}. Save it again as KML") from error
    if not documents:
        raise ParameterError(f"{where}: contains no .kml document. Save it as KML, or give the file inside")
    for name, document in documents.items():
        yield from kml_features(read_xml(document, f"{where}: {name}"), f"{where}: {name}")


def _unpacked(archive: zipfile.ZipFile, info: zipfile.ZipInfo, where: str) -> bytes:
    with archive.open(info) as file:
        data = file.read(_MAX_DOCUMENT_BYTES + 1)
    if len(data) > _MAX_DOCUMENT_BYTES:
        raise ParameterError(f"{where}: {info.filename} has more than {_MAX_DOCUMENT_BYTES / 1e6:.0f} MB")
    return data


def kml_features(root: Element, where: str) -> Iterator[Feature]:
    """The features of a KML document; what has coordinates or is an overlay is never left out.

    Raises:
        ParameterError: naming the feature that cannot be read.
    """
    stack: list[tuple[Element, str]] = [(root, "")]
    while stack:
        element, folder = stack.pop()
        if element.tag == "Placemark":
            yield from _placemark(element, folder, where)
        elif element.tag in _OVERLAYS:
            yield Feature(f"{text_of(element, 'name') or 'without a name'} ({element.tag})")
        elif element.tag in ("coordinates", "coord"):
            yield Feature("coordinates outside a placemark")
        else:
            title = text_of(element, "name")
            counts = element.tag == "Folder" or (element.tag == "Document" and is_no_go_title(title))
            inner = f"{folder} {title}".strip() if counts else folder
            stack += [(child, inner) for child in reversed(element)]


def _placemark(placemark: Element, folder: str, where: str) -> Iterator[Feature]:
    properties = {child.get("name", ""): "".join(child.itertext()).strip() for child in placemark.iter("SimpleData")}
    properties |= {child.get("name", ""): text_of(child, "value") for child in placemark.iter("Data")}
    properties |= {"description": text_of(placemark, "description"), "name": text_of(placemark, "name")}
    named = named_feature(properties, folder)
    name = named.name or "without a name"
    used: set[Element] = set()
    for polygon in placemark.iter("Polygon"):
        inner = list(polygon.iterfind("innerBoundaryIs//coordinates"))
        outer = [ring for ring in polygon.iter("coordinates") if ring not in inner]
        if len(outer) != 1:
            raise ParameterError(
                f"{where}: the polygon {name!r} has {len(outer)} outer rings. Draw a polygon for each of them"
            )
        used.update(outer, inner)
        yield replace(named, rings=tuple(ring_of(_numbers(part, name, where)) for part in (*outer, *inner)))
    for track in placemark.iter("Track"):
        corners = [_coordinate(element, name, where) for element in track.iter("coord")]
        used.update(track.iter("coord"))
        yield replace(named, line=line_of(corners), closes="track")
    for kind in ("Point", "LinearRing", "LineString"):
        for element in placemark.iter(kind):
            for part in element.iter("coordinates"):
                if part not in used:
                    used.add(part)
                    yield _simple(named, kind, _numbers(part, name, where), where)
    left = [element for tag in ("coordinates", "coord") for element in placemark.iter(tag) if element not in used]
    if left or not used:
        yield Feature(f"{name} ({f'{len(left)} coordinates of an unknown kind' if left else 'without a geometry'})")


def _simple(named: Feature, kind: str, corners: list[list[float]], where: str) -> Feature:
    if kind == "LinearRing":
        return replace(named, rings=(ring_of(corners),))
    if kind == "LineString":
        return replace(named, line=line_of(corners))
    if len(corners) > 1:
        raise ParameterError(f"{where}: the point {named.name!r} has {len(corners)} coordinates; leave one")
    return replace(named, point=(corners[0][1], corners[0][0])) if corners else named


def _numbers(element: Element, name: str, where: str) -> list[list[float]]:
    """Longitude, latitude (and height) of each tuple of an element's coordinates; blanks around commas do not count."""
    text = re.sub(r"\s*,\s*", ",", "".join(element.itertext()).strip())
    found = []
    for part in text.split():
        try:
            values = [float(v) for v in part.rstrip(",").split(",")]
        except ValueError:
            values = []
        if len(values) not in (2, 3):
            raise ParameterError(
                f"{where}: {name!r} has the coordinates {part[:60]!r}; write longitude,latitude,height with a blank "
                "between corners"
            )
        found.append(values)
    return found


def _coordinate(element: Element, name: str, where: str) -> list[float]:
    text = "".join(element.itertext())
    try:
        longitude, latitude = (float(v) for v in text.split()[:2])
    except ValueError:
        raise ParameterError(f"{where}: the track {name!r} has the coordinate {text.strip()[:60]!r}") from None
    return [longitude, latitude]
