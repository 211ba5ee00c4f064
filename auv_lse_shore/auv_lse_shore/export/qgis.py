"""A QGIS project that opens an export, and a style beside each file for those who open it alone.

Written as text, with no QGIS at hand: of the format only what QGIS needs to find, place and draw each layer. QGIS fills
in the rest when it saves. Paths are relative, so the folder can be moved and sent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from auv_lse_common.mission_file.operating_area import Grid
from auv_lse_shore.export.reference import Reference
from auv_lse_shore.judge.team_map import TeamMap

#: Version of the format: QGIS 3.22 and later read it.
VERSION = "3.22.0"

#: Colours from the least to the largest value.
RISK = ("#00224e", "#35456c", "#666970", "#948e77", "#c8b866", "#fee838")
DEPTH = ("#fde725", "#7ad151", "#22a884", "#2a788e", "#414487", "#440154")

#: Lines by their class: colour, colour beside the line, width (mm) and pen; drawn in this order, the last on top.
LINES = {
    "band": ("#cc79a7", "#cc79a7", 0.26, "solid"),
    "guessed": ("#555555", "#ffffff", 0.4, "dot"),
    "likely": ("#f0e442", "#000000", 0.7, "solid"),
    "found": ("#000000", "#ffffff", 0.7, "solid"),
}

#: Width (mm) of what shows beside a line.
CASING = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layer:
    """A layer of the project: its file's name without ending, title, source, provider, geometry and style."""

    name: str
    title: str
    source: str
    provider: str
    shown: bool
    style: Element
    geodetic: bool = False
    geometry: str = ""


def write_qgis(folder: Path, team: TeamMap, reference: Reference) -> None:
    """Writes `isobath.qgs` and the styles into the folder of an export.

    Args:
        folder: Where the exported files are.
        team: The map that they hold: its values set the range of colours.
        reference: Their coordinates.
    """
    layers = _layers(team, reference)
    for layer in layers:
        style = Element("qgis", version=VERSION)
        style.append(layer.style)
        _write(folder / f"{layer.name}.qml", style)
    _write(folder / "isobath.qgs", _project(layers, team.field.grid, team.level_m, reference))


def _layers(team: TeamMap, reference: Reference) -> list[_Layer]:
    """The layers, the topmost first."""
    field, on_earth = team.field, reference.origin is not None
    x, y, crs = ("longitude_deg", "latitude_deg", "&crs=EPSG:4326") if on_earth else ("east_m", "north_m", "")
    level = f"{team.level_m:g} m isobath"
    rasters = (
        ("risk", "Bayes risk (cost per place)", True, (0.0, team.settings.level_set.largest_risk), RISK),
        ("std", "standard deviation of the depth (m)", False, (0.0, float(np.nanmax(field.std_m))), RISK),
        ("depth", "depth (m)", False, (float(np.nanmin(field.mean_m)), float(np.nanmax(field.mean_m))), DEPTH),
    )
    return [
        _Layer(
            name="isobath",
            title=level,
            source="./isobath.geojson",
            provider="ogr",
            shown=True,
            style=_lines(),
            geodetic=on_earth,
            geometry="Line",
        ),
        _Layer(
            name="soundings",
            title="soundings",
            source=f"./soundings.csv?type=csv&xField={x}&yField={y}{crs}",
            provider="delimitedtext",
            shown=True,
            style=_points(),
            geodetic=on_earth,
            geometry="Point",
        ),
        *(
            _Layer(
                name=name,
                title=title,
                source=f"./{name}.tif",
                provider="gdal",
                shown=shown,
                style=_colours(*limits, colours),
            )
            for name, title, shown, limits, colours in rasters
        ),
    ]


def _project(layers: Sequence[_Layer], grid: Grid, level_m: float, reference: Reference) -> Element:
    project = Element("qgis", version=VERSION, projectname=f"{level_m:g} m isobath")
    SubElement(project, "title").text = f"{level_m:g} m isobath"
    SubElement(project, "projectCrs").append(_system(reference, geodetic=False))
    tree = SubElement(project, "layer-tree-group")
    canvas = SubElement(project, "mapcanvas", name="theMapCanvas")
    SubElement(canvas, "units").text = "meters"
    extent = SubElement(canvas, "extent")
    for tag, value in (
        ("xmin", grid.east_m[0]),
        ("ymin", grid.north_m[0]),
        ("xmax", grid.east_m[-1]),
        ("ymax", grid.north_m[-1]),
    ):
        SubElement(extent, tag).text = repr(float(value))
    SubElement(canvas, "destinationsrs").append(_system(reference, geodetic=False))
    described = SubElement(project, "projectlayers")
    for layer in layers:
        identity = f"exported_{layer.name}"  # QGIS replaces one of 10 letters or fewer
        keys = {"id": identity, "name": layer.title, "source": layer.source, "providerKey": layer.provider}
        keys["checked"] = "Qt::Checked" if layer.shown else "Qt::Unchecked"
        SubElement(tree, "layer-tree-layer", keys, expanded="0")
        kind = {"type": "vector", "geometry": layer.geometry} if layer.geometry else {"type": "raster"}
        element = SubElement(described, "maplayer", kind)
        SubElement(element, "id").text = identity
        SubElement(element, "datasource").text = layer.source
        SubElement(element, "layername").text = layer.title
        SubElement(element, "srs").append(_system(reference, geodetic=layer.geodetic))
        SubElement(element, "provider", encoding="UTF-8").text = layer.provider
        element.append(layer.style)
    properties = SubElement(project, "properties")
    SubElement(SubElement(properties, "Paths"), "Absolute", type="bool").text = "false"
    enabled = SubElement(SubElement(properties, "SpatialRefSys"), "ProjectionsEnabled", type="int")
    enabled.text = str(int(reference.origin is not None))
    return project


def _system(reference: Reference, geodetic: bool) -> Element:
    """A coordinate reference system; an empty one says that there is none."""
    system = Element("spatialrefsys")
    if geodetic:
        values = {"wkt": "", "proj4": "+proj=longlat +datum=WGS84 +no_defs", "authid": "EPSG:4326"}
        values["srid"] = "4326"
    else:
        values = {"wkt": reference.wkt(), "proj4": reference.proj, "authid": "", "srid": "0"}
    for tag, text in {**values, "geographicflag": str(geodetic).lower()}.items():
        SubElement(system, tag).text = text
    return system


def _colours(low: float, high: float, colours: Sequence[str]) -> Element:
    """The style of a raster: colours in between, nothing where there is no data."""
    pipe = Element("pipe")
    renderer = SubElement(
        pipe, "rasterrenderer", type="singlebandpseudocolor", band="1", opacity="1", alphaBand="-1",
        classificationMin=repr(low), classificationMax=repr(high),
    )  # fmt: skip
    shader = SubElement(
        SubElement(renderer, "rastershader"), "colorrampshader", colorRampType="INTERPOLATED", classificationMode="1",
        clip="0", minimumValue=repr(low), maximumValue=repr(high),
    )  # fmt: skip
    for value, colour in zip(np.linspace(low, high, len(colours)), colours, strict=True):
        SubElement(shader, "item", value=repr(float(value)), label=f"{value:.2f}", color=colour, alpha="255")
    return pipe


def _lines() -> Element:
    """The style of the isobath: a line for each class, in order."""
    renderer = Element("renderer-v2", type="categorizedSymbol", attr="class", symbollevels="1")
    categories, symbols = SubElement(renderer, "categories"), SubElement(renderer, "symbols")
    for number, (kind, (colour, beside, width, pen)) in enumerate(LINES.items()):
        SubElement(categories, "category", symbol=str(number), value=kind, label=kind, render="true")
        symbol = SubElement(symbols, "symbol", name=str(number), type="line", alpha="1")
        options = {"line_style": pen, "line_width_unit": "MM"}
        if beside != colour:
            below = {"line_color": _rgba(beside), "line_width": f"{width + CASING:g}"}
            _symbol_layer(symbol, "SimpleLine", 2 * number, {**options, **below})
        _symbol_layer(
            symbol, "SimpleLine", 2 * number + 1, {**options, "line_color": _rgba(colour), "line_width": f"{width:g}"}
        )
    return renderer


def _points() -> Element:
    """The style of the soundings: small dots."""
    renderer = Element("renderer-v2", type="singleSymbol", symbollevels="0")
    symbol = SubElement(SubElement(renderer, "symbols"), "symbol", name="0", type="marker", alpha="1")
    options = {"name": "circle", "color": _rgba("#ffffff"), "size": "0.5", "size_unit": "MM", "outline_style": "no"}
    _symbol_layer(symbol, "SimpleMarker", 0, options)
    return renderer


def _symbol_layer(symbol: Element, kind: str, level: int, options: dict[str, str]) -> None:
    layer = SubElement(symbol, "layer", {"class": kind, "enabled": "1", "locked": "0", "pass": str(level)})
    values = SubElement(layer, "Option", type="Map")
    for key, value in options.items():
        SubElement(values, "Option", name=key, type="QString", value=value)
        SubElement(layer, "prop", k=key, v=value)  # what QGIS before 3.26 reads where it prefers it


def _rgba(colour: str) -> str:
    return ",".join([*(str(int(colour[i : i + 2], 16)) for i in (1, 3, 5)), "255"])


def _write(path: Path, root: Any) -> None:
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    path.write_text(f"<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n{text}\n", encoding="utf-8")
