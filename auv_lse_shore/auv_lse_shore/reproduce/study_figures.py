"""The paper's figures from single missions: paths on the risk map, and the team reward with its lower bound."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from auv_lse_shore.judge.evaluation import Evaluation
from auv_lse_shore.report import figures
from auv_lse_shore.report.figures import STYLE, WIDTH_IN, new_figure


def path_figure(missions: Mapping[str, Evaluation]) -> Figure:
    """Prior (top) and posterior (bottom) Bayes risk with the paths of one mission per method."""
    with matplotlib.rc_context(STYLE):
        first = next(iter(missions.values()))
        extent, aspect = figures.map_extent(first)
        width = (WIDTH_IN - 1.1 - 0.17 * len(missions)) / len(missions)
        figure = new_figure(WIDTH_IN, 2.0 * (width * aspect + 0.2) + 0.75)
        axes = figure.subplots(2, len(missions), sharex=True, sharey=True, squeeze=False)
        top = max(float(np.nanmax(e.prior.risk)) for e in missions.values())
        image: Any = None
        for column, (method, e) in enumerate(missions.items()):
            for axis, field, title in zip(axes[:, column], (e.prior, e.team), (method, ""), strict=True):
                image = axis.imshow(
                    figures.judged_part(field.risk, e),
                    origin="lower",
                    extent=extent,
                    cmap=figures.RISK_COLORS,
                    vmin=0.0,
                    vmax=top,
                    aspect="equal",
                )
                figures.map_axes(axis, extent, title)
                figures.draw_tracks(axis, e)
                figures.draw_isobath(axis, e.truth, "true")
            figures.draw_pieces(axes[1, column], e.pieces)
        figures.outer_labels(axes.ravel(), len(missions))
        bar = figure.colorbar(image, ax=axes.ravel().tolist(), shrink=0.85, pad=0.015, aspect=36)
        bar.set_label("Bayes risk per place (units of cost)")
        bar.outline.set_linewidth(0.5)
        figures.map_legend(figure, first, truth=bool(first.truth), estimate=True)
        return figure


#: Line of each method, as near to the paper's colours as everybody can tell apart.
_LINES = {
    "augmented": {"color": "#009E73", "ls": "-", "lw": 1.8},
    "plain": {"color": "#0072B2", "ls": (0, (5, 1.5)), "lw": 1.6},
    "tour": {"color": "#CC79A7", "ls": (0, (1.2, 1.0)), "lw": 1.6},
}


def reward_figure(missions: Mapping[str, Evaluation]) -> Figure:
    """Team reward over steps of one mission per method, with the augmented one's bound curves."""
    with matplotlib.rc_context(STYLE):
        figure = new_figure(WIDTH_IN, 3.3)
        left, right = figure.subplots(1, 2)
        for method, e in missions.items():
            left.plot(e.curves.stepwise, label=method, **_LINES[method])
            right.plot(e.curves.whole, label=method, **_LINES[method])
        if "augmented" in missions:
            c = missions["augmented"].curves
            red, black = {"color": "#D55E00", "ls": (0, (4, 1.5)), "lw": 1.2}, {"color": "black", "lw": 1.2}
            for axis, bound, largest in ((left, c.bound, c.bound_max), (right, c.whole_bound, c.whole_bound_max)):
                at = np.flatnonzero(np.isfinite(bound[:-1]))
                axis.plot(at, bound[at], label="time-varying bound", **red)
                axis.plot(at, largest[at], label="its maximum", **black)
            right.axhline(c.naive_value, color="#777777", lw=1.0, ls=(0, (1, 1.5)), label="lawnmower, expected")
        left.set_title(r"$\bf{a}$  Stepwise")
        right.set_title(r"$\bf{b}$  Whole path")
        for axis in (left, right):
            axis.set_xlabel("step")
            axis.set_ylabel("team reward (units of cost)")
            axis.set_xlim(left=0)
            axis.set_ylim(0.0, axis.get_ylim()[1] * 1.02)
            axis.grid(True, color="#e4e4e4", lw=0.5)
            axis.set_axisbelow(True)
        handles, labels = right.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=6, handlelength=2.4, columnspacing=1.2)
        return figure
