"""The picture of one parameter: three missions over the same lake, with little of it, the default, and much."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from auv_lse_shore.judge import isobath
from auv_lse_shore.judge.certainty import FOUND
from auv_lse_shore.judge.evaluation import Evaluation
from auv_lse_shore.report.figures import (
    RISK_COLORS,
    STYLE,
    WIDTH_IN,
    draw_isobath,
    draw_pieces,
    draw_tracks,
    judged_part,
    legend_in,
    map_axes,
    map_extent,
    map_legend,
    new_figure,
    outer_labels,
)
from auv_lse_shore.reproduce.knobs import Knob, shown

AMOUNTS = ("little", "default", "much")


def tuning_figure(knob: Knob, missions: Sequence[Evaluation], means: Sequence[Mapping[str, float]]) -> Figure:
    """Draws the risk that each mission left, with tracks, true and estimated isobath.

    Args:
        knob: The parameter.
        missions: One mission for each of its values.
        means: Figures of merit of each value, over all lakes.
    """
    with matplotlib.rc_context(STYLE):
        first = missions[0]
        extent, aspect = map_extent(first)
        panel_in = (WIDTH_IN - 1.4) / len(missions) * aspect + 0.8
        figure = new_figure(WIDTH_IN, panel_in + 0.45 + legend_in(first, 5))
        axes = figure.subplots(1, len(missions), sharex=True, sharey=True)
        top = max(float(np.nanmax(first.prior.risk)), 1e-9)
        image: Any = None
        for axis, amount, value, e, mean in zip(axes, AMOUNTS, knob.values, missions, means, strict=True):
            risk = e.local[0].risk if knob.own_map else e.team.risk
            image = axis.imshow(
                judged_part(risk, e),
                origin="lower",
                extent=extent,
                cmap=RISK_COLORS,
                vmin=0.0,
                vmax=top,
                aspect="equal",
            )
            own = f", own map {mean['own_risk']:.2f}" if knob.own_map else ""
            map_axes(
                axis,
                extent,
                f"{amount}: {shown(knob, value)}\n"
                f"loss {mean['loss']:.2f}{own}\nisobath off by {mean['isobath_m']:.1f} m",
            )
            draw_tracks(axis, e)
            draw_isobath(axis, e.truth, "true")
            if knob.own_map:
                grid, level = e.team.grid, e.settings[0].level_set.level_m
                draw_isobath(axis, isobath.trace(grid.north_m, grid.east_m, e.local[0].mean_m, level), FOUND)
            else:
                draw_pieces(axis, e.pieces)
        outer_labels(axes, len(missions))
        bar = figure.colorbar(image, ax=list(axes), shrink=0.8, pad=0.015, aspect=26)
        whose = "auv1's own map" if knob.own_map else "all soundings"
        bar.set_label(f"Bayes risk per place\n({whose})")
        bar.outline.set_linewidth(0.5)
        map_legend(figure, first, truth=bool(first.truth), estimate=True)
        return figure
