"""The figures of a mission that are curves over steps: the map's risk with its bound, and the paper's own reward."""

from __future__ import annotations

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from auv_lse_common.mission_file.methods import PAPER_METHODS
from auv_lse_shore.judge.evaluation import Evaluation
from auv_lse_shore.report.figures import STYLE, WIDTH_IN, new_figure

BLUE, RED, BLACK, GREY = "#0072B2", "#D55E00", "#000000", "#777777"


def map_risk(e: Evaluation) -> Figure | None:
    """Mean Bayes risk over the map against steps, with what was expected of the end; None if it was not computed."""
    c = e.curves
    known = np.flatnonzero(np.isfinite(c.risk))
    if len(known) < 2:
        return None
    with matplotlib.rc_context(STYLE):
        figure = new_figure(WIDTH_IN, 2.9)
        axis = figure.subplots()
        axis.plot(known, c.risk[known], "o-", ms=3.5, lw=1.8, color=BLUE, label="risk so far")
        ahead = np.flatnonzero(np.isfinite(c.expected_risk))
        plans, mowing = (
            "expected of the end, by the plans in hand",
            "expected of the end, of mowing the lawn",
        )
        axis.plot(ahead, c.expected_risk[ahead], color=RED, lw=1.2, ls=(0, (4, 1.5)), label=plans)
        if np.isfinite(c.mowing_risk):
            axis.axhline(c.mowing_risk, color=GREY, lw=1.2, ls=(0, (1, 1.5)), label=mowing)
        axis.set_xlabel("step")
        axis.set_ylabel("mean Bayes risk (cost/place)")
        axis.set_xlim(0, len(c.risk) - 1)
        axis.set_ylim(bottom=0.0)
        axis.grid(True, color="#e4e4e4", lw=0.5)
        axis.set_axisbelow(True)
        axis.legend(loc="upper right", handlelength=2.4, labelspacing=0.25, borderaxespad=0.2)
        return figure


def paper_reward(e: Evaluation) -> Figure | None:
    """The paper's own reward with its time-varying bound, in both readings; None for methods that are not its."""
    if e.summary.method not in PAPER_METHODS:
        return None
    with matplotlib.rc_context(STYLE):
        figure = new_figure(WIDTH_IN, 3.2)
        left, right = figure.subplots(1, 2)
        c = e.curves
        steps = np.arange(len(c.stepwise))
        blue, red, black = "#0072B2", "#D55E00", "#000000"
        left.plot(steps, c.stepwise, color=blue, lw=1.8, label="team reward so far")
        bound = c.bound.copy()
        bound[-1] = np.nan
        known = np.isfinite(bound)
        if known.any():
            left.plot(
                steps[known], bound[known], color=red, lw=1.2, ls=(0, (4, 1.5)), label="lower bound, time-varying"
            )
            left.plot(steps[known], c.bound_max[known], color=black, lw=1.2, label="its running maximum")
        else:
            left.plot([], [], " ", label="no naive part, so no lower bound")
        left.set_title(r"$\bf{a}$  Stepwise")
        known = np.isfinite(c.whole_bound)
        right.plot(steps, c.whole, color=blue, lw=1.8, label="path reward so far")
        right.plot(
            steps[known],
            c.whole_bound[known],
            color=red,
            lw=1.2,
            ls=(0, (4, 1.5)),
            label="expected at the end, plans in hand",
        )
        right.plot(steps[known], c.whole_bound_max[known], color=black, lw=1.2, label="its running maximum")
        right.axhline(c.naive_value, color="#777777", lw=1.0, ls=(0, (1, 1.5)), label="expected of mowing the lawn")
        right.set_title(r"$\bf{b}$  Whole path")
        for axis in (left, right):
            axis.set_xlabel("step")
            axis.set_ylabel("reward (drop of Bayes risk, units of cost)")
            axis.set_xlim(0, max(len(c.stepwise) - 1, 1))
            top = axis.get_ylim()[1]
            axis.set_ylim(min(0.0, float(np.nanmin(c.stepwise))), top * 1.32)
            axis.grid(True, color="#e4e4e4", lw=0.5)
            axis.set_axisbelow(True)
            axis.legend(loc="upper left", handlelength=2.4, labelspacing=0.25, borderaxespad=0.2)
        return figure
