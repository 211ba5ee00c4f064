"""isobath.kml: the isobath and the operating area, for Google Earth and QGroundControl; needs an origin."""

from collections.abc import Sequence
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_common.support.plurals import counted
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_gp.map.certainty import CLASSES
from auv_lse_shore.export.content import NO_ORIGIN, Export

NAMESPACE = "http://www.opengis.net/kml/2.2"
#: Color (alpha, blue, green, red, as KML writes it) and width (pixels) of each kind of line.
STYLES = {
    "found": ("ff00ff00", 4),
    "likely": ("ff42e4f0", 3),
    "guessed": ("ffcccccc", 2),
    "band": ("ffa779cc", 1),
    "area": ("ffffffff", 1),
    "no-go": ("ff2e3ab0", 2),
}
#: Decimals of a coordinate (deg): 1 cm.
_DECIMALS = 7


def write(export: Export) -> str:
    """Writes a line for each piece of the isobath, its band, the area and the no-go areas.

    QGroundControl imports the first line of a file, and prefers a polygon to all lines. So the longest piece found is
    the first line, and areas are closed lines.
    """
    path = export.folder / "isobath.kml"
    if export.reference.origin is None:
        export.discard(path.name)
        return f"isobath.kml: {NO_ORIGIN}"
    team = export.team
    root = Element("kml", xmlns=NAMESPACE)
    document = SubElement(root, "Document")
    SubElement(document, "name").text = f"{team.level_m:g} m isobath"
    SubElement(document, "description").text = "; ".join(f"{key}: {text}" for key, text in export.metadata().items())
    for kind, (color, width) in STYLES.items():
        line = SubElement(SubElement(document, "Style", id=kind), "LineStyle")
        SubElement(line, "color").text = color
        SubElement(line, "width").text = str(width)
    pieces = sorted(team.pieces, key=lambda piece: (CLASSES.index(piece.kind), -piece.length_m))
    for kind in CLASSES:
        folder = _folder(document, f"isobath, {kind}")
        for number, piece in enumerate((p for p in pieces if p.kind == kind), 1):
            about = f"{piece.length_m:.0f} m; standard deviation across the line {np.median(piece.std_m):.1f} m"
            about += f"; {piece.reason}" if piece.reason else ""
            _line(folder, f"{kind} {number}", kind, piece.line, export.reference.origin, about)
    band = f"{100.0 * team.isobath.band_probability:g} % band"
    folder = _folder(document, band)
    for name, lines in (("shallow", team.isobath.shallow_edge), ("deep", team.isobath.deep_edge)):
        for line_m in lines:
            _line(folder, f"{name} edge of the {band}", "band", line_m, export.reference.origin)
    folder = _folder(document, "operating area")
    _line(folder, "operating area", "area", _closed(team.area.polygon), export.reference.origin)
    for name, ring in team.area.no_go.items():
        _line(folder, name, "no-go", _closed(ring), export.reference.origin)
    indent(root)
    ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return f"isobath.kml ({counted(len(pieces), 'piece')})"


def _closed(ring: Array) -> Array:
    return np.vstack([ring, ring[:1]])


def _folder(document: Element, name: str) -> Element:
    folder = SubElement(document, "Folder")
    SubElement(folder, "name").text = name
    return folder


def _line(folder: Element, name: str, style: str, line_m: Array, origin: Sequence[float], about: str = "") -> None:
    """Adds a line (n, 2) of north, east (m)."""
    placemark = SubElement(folder, "Placemark")
    SubElement(placemark, "name").text = name
    if about:
        SubElement(placemark, "description").text = about
    SubElement(placemark, "styleUrl").text = f"#{style}"
    line = SubElement(placemark, "LineString")
    SubElement(line, "tessellate").text = "1"
    latitude, longitude = geodetic_from_local(line_m[:, 0], line_m[:, 1], *origin)
    locations = (f"{x:.{_DECIMALS}f},{y:.{_DECIMALS}f}" for x, y in zip(longitude, latitude, strict=True))
    SubElement(line, "coordinates").text = " ".join(locations)
