"""Draws an export from the exported files alone, as a check of their content."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from auv_lse_shore.export.formats.geotiff import rasterio
from auv_lse_shore.report.figures import WIDTH_IN, add_color_bar, axis_label, map_shape, new_figure, save, styled
from auv_lse_shore.report.map_marks import add_graticule

#: Panels: file, title, unit, colors.
PANELS = (
    ("risk.tif", "Bayes risk", "cost per location", "cividis"),
    ("depth.tif", "depth", "m", "viridis_r"),
    ("std.tif", "its standard deviation", "m", "cividis"),
)

#: How lines of the GeoJSON file are drawn, by their class.
LINES: dict[str, dict[str, Any]] = {
    "guessed": {"color": "#555555", "lw": 0.9, "ls": (0, (1.0, 1.8))},
    "band": {"color": "#CC79A7", "lw": 0.6},
    "likely": {"color": "#F0E442", "lw": 1.4},
    "found": {"color": "black", "lw": 1.4},
}


@styled
def draw_export(folder: Path, path: Path) -> None:
    """Draws the GeoTIFFs of `folder`, and over them the lines of its GeoJSON and the soundings of its CSV.

    Raises:
        ExportError: if rasterio is not installed.
    """
    library = rasterio()
    features = json.loads((folder / "isobath.geojson").read_text())["features"]
    with library.open(folder / PANELS[0][0]) as file:
        left, bottom, right, top = file.bounds
    shape, north_to_east = map_shape((left, right, bottom, top))
    figure = new_figure(WIDTH_IN, max(3.75, min((WIDTH_IN - 1.2) / len(PANELS) * shape, 6.0) + 1.6))
    axes = figure.subplots(1, len(PANELS), sharex=True, sharey=True)
    for axis, (name, title, unit, colors) in zip(axes, PANELS, strict=True):
        with library.open(folder / name) as file:
            values, (left, bottom, right, top), crs = file.read(1, masked=True), file.bounds, file.crs
        image = axis.imshow(
            values, extent=(left, right, bottom, top), cmap=colors, origin="upper", aspect=north_to_east
        )
        layout = {"orientation": "horizontal", "shrink": 0.95, "pad": 0.02, "aspect": 24}
        add_color_bar(figure, image, axis, f"{title} ({unit})", **layout)
        for kind, style in LINES.items():
            for feature in features:
                if feature["properties"]["class"] == kind:
                    for line in feature["geometry"]["coordinates"]:
                        axis.plot(*_local(np.array(line), crs).T, **style)
        axis.set_title(name, family="DejaVu Sans Mono")
        axis.set_xlabel(axis_label("east", 1.0 / north_to_east))
        axis.xaxis.set_major_locator(MaxNLocator(4))
    with (folder / "soundings.csv").open() as file:
        locations = np.array([(float(row["east_m"]), float(row["north_m"])) for row in csv.DictReader(file)])
    axes[2].plot(*locations.T, ".", ms=0.6, color="white")
    axes[0].set_ylabel(axis_label("north", north_to_east))
    for axis in axes:
        add_graticule(axis, _origin(crs), latitudes=axis is axes[-1])
    handles: list[Any] = [Line2D([], [], label=kind, **style) for kind, style in reversed(LINES.items())]
    handles.append(Line2D([], [], ls="", marker="o", ms=3, mfc="white", mec="black", mew=0.4, label="soundings.csv"))
    figure.legend(handles=handles, loc="outside lower center", ncols=5, title="isobath.geojson")
    figure.draw_without_rendering()  # moves titles above the longitudes; the layout of `save` then leaves room
    save(figure, path)


def _origin(crs: Any) -> tuple[float, float] | None:
    """Latitude and longitude (deg) of the rasters' origin; `crs` is None for local metres."""
    values = crs.to_dict() if crs is not None else {}
    return (float(values["lat_0"]), float(values["lon_0"])) if values.get("proj") == "aeqd" else None


def _local(line: Any, crs: Any) -> Any:
    """Locations (n, 2) of the GeoJSON in the coordinates of the rasters; `crs` is None for local metres."""
    if crs is None:
        return line
    from pyproj import Transformer

    return np.column_stack(Transformer.from_crs("EPSG:4326", crs.to_wkt(), always_xy=True).transform(*line.T))
