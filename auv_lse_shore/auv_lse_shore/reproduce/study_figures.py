"""The paper's figures from single missions: paths on the risk map, and the team reward with its lower bound."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from auv_lse_shore.judge.evaluation import Evaluation
from auv_lse_shore.judge.quantity_names import COST_PER_LOCATION, MAP_RISK
from auv_lse_shore.report import figures
from auv_lse_shore.report.figures import WIDTH_IN, add_grid, new_figure, styled
from auv_lse_shore.report.reward_figures import EXPECTED, LAWNMOWER, MAXIMUM


@styled
def path_figure(missions: Mapping[str, Evaluation]) -> Figure:
    """Prior (top) and posterior (bottom) Bayes risk with the paths of one mission per method."""
    first = next(iter(missions.values()))
    width = (WIDTH_IN - 1.1 - 0.17 * len(missions)) / len(missions)
    handles = figures.map_handles(first, truth=bool(first.truth), estimate=True)
    height = 2.0 * (width * figures.map_extent(first)[1] + 0.2) + 0.75 + figures.legend_in(handles)
    figure = new_figure(WIDTH_IN, height)
    axes = figure.subplots(2, len(missions), sharex=True, sharey=True, squeeze=False)
    top = max(float(np.nanmax(e.prior.risk)) for e in missions.values())
    image: Any = None
    for column, (method, e) in enumerate(missions.items()):
        for axis, field, title in zip(axes[:, column], (e.prior, e.team), (method, ""), strict=True):
            image = figures.draw_map(axis, e, field.risk, title, cmap=figures.RISK_COLORS, vmin=0.0, vmax=top)
            figures.draw_tracks(axis, e)
            figures.draw_isobath(axis, e.truth, "true")
        figures.draw_pieces(axes[1, column], e.pieces)
    figures.outer_labels(axes.ravel(), len(missions))
    label = f"{MAP_RISK} ({COST_PER_LOCATION})"
    figures.add_color_bar(figure, image, axes.ravel().tolist(), label, shrink=0.85, aspect=36)
    figures.map_legend(figure, handles)
    return figure


#: Line of each method, close to the paper's colors and distinguishable with color blindness.
_LINES: dict[str, dict[str, Any]] = {
    "augmented": {"color": "#009E73", "ls": "-", "lw": 1.8},
    "plain": {"color": "#0072B2", "ls": (0, (5, 1.5)), "lw": 1.6},
    "tour": {"color": "#CC79A7", "ls": (0, (1.2, 1.0)), "lw": 1.6},
}


@styled
def reward_figure(missions: Mapping[str, Evaluation]) -> Figure:
    """Team reward over steps of one mission per method, with the augmented one's bound curves."""
    figure = new_figure(WIDTH_IN, 3.3)
    left, right = figure.subplots(1, 2)
    left.set_title(r"$\bf{a}$  Stepwise")
    right.set_title(r"$\bf{b}$  Whole path")
    for method, e in missions.items():
        left.plot(e.curves.stepwise, label=method, **_LINES[method])
        right.plot(e.curves.whole, label=method, **_LINES[method])
    if "augmented" in missions:
        c = missions["augmented"].curves
        for axis, bound, largest in ((left, c.bound, c.bound_max), (right, c.whole_bound, c.whole_bound_max)):
            at = np.flatnonzero(np.isfinite(bound[:-1]))
            axis.plot(at, bound[at], label="time-varying bound", **EXPECTED)
            axis.plot(at, largest[at], label="its maximum", **MAXIMUM)
        right.axhline(c.naive_value, label="lawnmower, expected", **LAWNMOWER)
    for axis in (left, right):
        axis.set_xlabel("step")
        axis.set_ylabel("team reward (cost)")
        axis.set_xlim(left=0)
        axis.set_ylim(0.0, axis.get_ylim()[1] * 1.02)
        add_grid(axis)
    handles, labels = right.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6, handlelength=2.4, columnspacing=1.2)
    return figure
