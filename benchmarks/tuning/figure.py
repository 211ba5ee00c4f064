"""The figure of one parameter: three missions over the same lake, with a low, the default, and a high value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from auv_lse_gp.map.certainty import FOUND
from auv_lse_shore.judge import isobath
from auv_lse_shore.judge.evaluation import Evaluation
from auv_lse_shore.report.figures import (
    RISK_COLORS,
    WIDTH_IN,
    add_color_bar,
    draw_isobath,
    draw_map,
    draw_pieces,
    draw_tracks,
    legend_in,
    map_extent,
    map_handles,
    map_legend,
    new_figure,
    outer_labels,
    styled,
)
from benchmarks.tuning.knobs import Knob, shown


@styled
def tuning_figure(knob: Knob, missions: Sequence[Evaluation], means: Sequence[Mapping[str, float]]) -> Figure:
    """Draws the final risk of each mission, with tracks, true and estimated isobath.

    Args:
        knob: The parameter.
        missions: One mission for each of its values.
        means: Figures of merit of each value, over all lakes.
    """
    first, amounts = missions[0], ("low", "default", "high")
    panel_in = (WIDTH_IN - 1.4) / len(missions) * map_extent(first)[1] + 0.8
    handles = map_handles(first, truth=bool(first.truth), estimate=True)
    figure = new_figure(WIDTH_IN, panel_in + 0.45 + legend_in(handles))
    axes = figure.subplots(1, len(missions), sharex=True, sharey=True)
    top = max(float(np.nanmax(first.prior.risk)), 1e-9)
    image: Any = None
    for axis, amount, value, e, mean in zip(axes, amounts, knob.values, missions, means, strict=True):
        own = f", own map {mean['own_risk']:.2f}" if knob.own_map else ""
        title = f"{amount}: {shown(knob, value)}\nloss {mean['loss']:.2f}{own}\nisobath error {mean['isobath_m']:.1f} m"
        field = e.local[0] if knob.own_map else e.team
        image = draw_map(axis, e, field.risk, title, cmap=RISK_COLORS, vmin=0.0, vmax=top)
        draw_tracks(axis, e)
        draw_isobath(axis, e.truth, "true")
        if knob.own_map:
            grid, level = field.grid, e.settings[0].level_set.level_m
            draw_isobath(axis, isobath.trace(grid.north_m, grid.east_m, field.mean_m, level), FOUND)
        else:
            draw_pieces(axis, e.pieces)
    outer_labels(axes, len(missions))
    whose = "auv1's own map" if knob.own_map else "all soundings"
    add_color_bar(figure, image, list(axes), f"Bayes risk per location\n({whose})", shrink=0.8, aspect=26)
    map_legend(figure, handles)
    return figure
