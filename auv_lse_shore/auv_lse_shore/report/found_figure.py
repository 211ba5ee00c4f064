"""The first picture of a report: what was found."""

from __future__ import annotations

import matplotlib
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from auv_lse_shore.judge.evaluation import Evaluation
from auv_lse_shore.report import figures

#: From shallow (sand) through unsure (white) to deep (blue); as light at both ends.
SIDES = LinearSegmentedColormap.from_list("sides", ["#e8d3a8", "#ffffff", "#a5c5e3"])


def found(e: Evaluation) -> Figure:
    """The probability of being at least the level deep, the isobath by its certainty, and the tracks."""
    with matplotlib.rc_context(figures.STYLE):
        extent, aspect = figures.map_extent(e)
        height = min((figures.WIDTH_IN - 1.6) * aspect, 6.0)
        figure = figures.new_figure(figures.WIDTH_IN, height + 0.65 + figures.legend_in(e, 7))
        axis = figure.subplots()
        level = e.settings[0].level_set.level_m
        shown = figures.judged_part(e.team.p_safe, e)
        image = axis.imshow(shown, origin="lower", extent=extent, cmap=SIDES, vmin=0.0, vmax=1.0, aspect="equal")
        figures.map_axes(axis, extent, "")
        figures.draw_tracks(axis, e, width=0.7)
        figures.draw_isobath(axis, e.truth, "true")
        figures.draw_pieces(axis, e.pieces)
        figures.outer_labels([axis], 1)
        bar = figure.colorbar(image, ax=axis, shrink=0.9, pad=0.015, aspect=28, ticks=[0.0, 0.5, 1.0])
        bar.ax.set_yticklabels(["surely\nshallower", "unsure", "surely\ndeeper"])
        bar.set_label(f"Is the water at least {level:g} m deep?")
        bar.outline.set_linewidth(0.5)
        figures.map_legend(figure, e, truth=bool(e.truth), estimate=True)
        return figure
