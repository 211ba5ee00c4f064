"""The certificate's map."""

from pathlib import Path
from typing import Any

from auv_lse_shore.certify.final_map import FinalMap
from auv_lse_shore.report import figures
from auv_lse_shore.report.found_figure import SIDES
from auv_lse_shore.report.map_marks import add_graticule


@figures.styled
def draw(final: FinalMap, path: Path) -> None:
    """Draws the probability of being at least the level deep, soundings, and the isobath's pieces."""
    grid, half = final.field.grid, 0.5 * final.field.grid.resolution_m
    extent = (grid.east_m[0] - half, grid.east_m[-1] + half, grid.north_m[0] - half, grid.north_m[-1] + half)
    aspect, north_to_east = figures.map_shape(extent)
    figure = figures.new_figure(figures.WIDTH_IN, min((figures.WIDTH_IN - 1.6) * aspect, 6.0) + 1.0)
    axis = figure.subplots()
    shown: dict[str, Any] = {
        "cmap": SIDES,
        "vmin": 0.0,
        "vmax": 1.0,
        "origin": "lower",
        "extent": extent,
        "aspect": north_to_east,
    }
    image = axis.imshow(final.field.p_safe, **shown)
    for vehicle in final.run.vehicles:
        axis.plot(vehicle.soundings.east_m, vehicle.soundings.north_m, ".", ms=0.7, color="#999999")
    figures.draw_pieces(axis, final.pieces)
    axis.set_xlim(extent[:2])
    axis.set_ylim(extent[2:])
    axis.set_xlabel(figures.axis_label("east", 1.0 / north_to_east))
    axis.set_ylabel(figures.axis_label("north", north_to_east))
    add_graticule(axis, final.run.origin)
    bar = figures.add_color_bar(figure, image, axis, "At least the level deep?", ticks=[0.0, 0.5, 1.0])
    bar.ax.set_yticklabels(["surely\nshallower", "uncertain", "surely\ndeeper"])
    handles, labels = axis.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    figures.save(figure, path)
