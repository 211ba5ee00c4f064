"""isobath.qgs: a QGIS project that opens the files, with a style (.qml) beside each of them."""

from typing import Any

import numpy as np

from auv_lse_shore.export.content import Export
from auv_lse_shore.export.formats import geotiff
from auv_lse_shore.report.page import render

#: Colors from the lowest to the highest value.
RISK = ("#00224e", "#35456c", "#666970", "#948e77", "#c8b866", "#fee838")
DEPTH = ("#fde725", "#7ad151", "#22a884", "#2a788e", "#414487", "#440154")

#: Lines by class: color, color on both sides, width (mm) and pen; drawn in this order, the last on top.
LINES = {
    "band": ("#cc79a7", "#cc79a7", 0.26, "solid"),
    "guessed": ("#555555", "#ffffff", 0.4, "dot"),
    "likely": ("#f0e442", "#000000", 0.7, "solid"),
    "found": ("#000000", "#ffffff", 0.7, "solid"),
}
#: Width (mm) of the color beside a line.
CASING = 0.3

check = geotiff.check  # the project's rasters


def write(export: Export) -> str:
    """Writes the project and the styles, with which QGIS finds, places and draws each layer. Paths are relative."""
    layers, reference, grid = _layers(export), export.reference, export.team.field.grid
    for layer in layers:
        (export.folder / f"{layer['name']}.qml").write_text(_render("style.qml", layer=layer), encoding="utf-8")
    path = export.folder / "isobath.qgs"
    extent = {"xmin": grid.east_m[0], "ymin": grid.north_m[0], "xmax": grid.east_m[-1], "ymax": grid.north_m[-1]}
    path.write_text(
        _render(
            "project.qgs",
            title=f"{export.team.level_m:g} m isobath",
            layers=layers,
            extent={tag: repr(float(value)) for tag, value in extent.items()},
            local={"wkt": reference.wkt(), "proj4": reference.proj, "authid": "", "srid": "0"},
            on_earth=reference.origin is not None,
        ),
        encoding="utf-8",
    )
    return "isobath.qgs, and a style (.qml) for each file"


def _render(template: str, **values: Any) -> str:
    return render(template, "auv_lse_shore.export", **values)


def _layers(export: Export) -> list[dict[str, Any]]:
    """The layers, the topmost first; what the templates need of each."""
    team, on_earth = export.team, export.reference.origin is not None
    x, y, crs = ("longitude_deg", "latitude_deg", "&crs=EPSG:4326") if on_earth else ("east_m", "north_m", "")
    field, largest_risk = team.field, team.settings.level_set.largest_risk
    vector = {"shown": True, "geodetic": on_earth}
    return [
        {
            "name": "isobath",
            "title": f"{team.level_m:g} m isobath",
            "source": "./isobath.geojson",
            "provider": "ogr",
            "geometry": "Line",
            "lines": [_line(kind) for kind in LINES],
            **vector,
        },
        {
            "name": "soundings",
            "title": "soundings",
            "source": f"./soundings.csv?type=csv&xField={x}&yField={y}{crs}",
            "provider": "delimitedtext",
            "geometry": "Point",
            "color": _rgba("#ffffff"),
            **vector,
        },
        _raster("risk", "Bayes risk (cost per location)", RISK, 0.0, largest_risk),
        _raster("std", "standard deviation of the depth (m)", RISK, 0.0, float(np.nanmax(field.std_m))),
        _raster("depth", "depth (m)", DEPTH, float(np.nanmin(field.mean_m)), float(np.nanmax(field.mean_m))),
    ]


def _raster(name: str, title: str, colors: tuple[str, ...], low: float, high: float) -> dict[str, Any]:
    stops = [
        {"value": repr(float(value)), "label": f"{value:.2f}", "color": color}
        for value, color in zip(np.linspace(low, high, len(colors)), colors, strict=True)
    ]
    layer = {"name": name, "title": title, "source": f"./{name}.tif", "provider": "gdal", "geometry": ""}
    return {**layer, "shown": name == "risk", "geodetic": False, "low": repr(low), "high": repr(high), "stops": stops}


def _line(kind: str) -> dict[str, Any]:
    """A class of the isobath: its symbol layers from below to the top, as QGIS names their options."""
    color, beside, width, pen = LINES[kind]
    strokes = [(beside, width + CASING)] if beside != color else []
    return {
        "kind": kind,
        "strokes": [
            {"line_style": pen, "line_width_unit": "MM", "line_color": _rgba(shown), "line_width": f"{wide:g}"}
            for shown, wide in [*strokes, (color, width)]
        ],
    }


def _rgba(color: str) -> str:
    return ",".join([*(str(int(color[i : i + 2], 16)) for i in (1, 3, 5)), "255"])
