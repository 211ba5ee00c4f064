"""The first picture of a report: where the isobath was found."""

from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from auv_lse_shore.judge.evaluation import Evaluation
from auv_lse_shore.report import figures
from auv_lse_shore.report.words import MIN_STRETCH_M

#: From shallow (sand) through uncertain (white) to deep (blue); equally light at both ends.
SIDES = LinearSegmentedColormap.from_list("sides", ["#e8d3a8", "#ffffff", "#a5c5e3"])


@figures.styled
def found(e: Evaluation) -> Figure:
    """The probability of being at least the level deep, the isobath by its certainty, and the tracks."""
    height = max(min((figures.WIDTH_IN - 1.6) * figures.map_extent(e)[1], 6.0), 2.2)
    handles = figures.map_handles(e, truth=bool(e.truth), estimate=True)
    figure = figures.new_figure(figures.WIDTH_IN, height + 0.65 + figures.legend_in(handles))
    axis = figure.subplots()
    image = figures.draw_map(axis, e, e.team.p_safe, "", cmap=SIDES, vmin=0.0, vmax=1.0)
    figures.draw_tracks(axis, e, width=0.7)
    figures.draw_isobath(axis, e.truth, "true")
    figures.draw_pieces(axis, e.pieces)
    for north, east, length in e.team_map.undiscovered.patches():
        if length >= MIN_STRETCH_M:
            box = {"boxstyle": "round,pad=0.2", "facecolor": "#ffe9a8", "edgecolor": "#d55e00", "linewidth": 0.6}
            axis.text(east, north, f"{length:.0f} m?", fontsize=7.0, ha="center", va="center", bbox=box, zorder=7)
    figures.outer_labels([axis], 1, e.run.origin)
    label = f"Is the water at least {e.settings[0].level_set.level_m:g} m deep?"
    bar = figures.add_color_bar(figure, image, axis, label, ticks=[0.0, 0.5, 1.0])
    bar.ax.set_yticklabels(["surely\nshallower", "uncertain", "surely\ndeeper"])
    figures.map_legend(figure, handles)
    return figure
