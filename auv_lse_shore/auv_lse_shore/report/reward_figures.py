"""The figures of a mission that are curves over steps: map risk with its bound, and the paper's reward."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from auv_lse_common.mission_file.methods import PAPER_METHODS
from auv_lse_shore.judge.evaluation import Evaluation
from auv_lse_shore.judge.quantity_names import COST_PER_LOCATION, MAP_RISK
from auv_lse_shore.report.figures import WIDTH_IN, add_grid, new_figure, styled

#: Lines of what happened, of what was expected, of the running maximum, and of a lawnmower.
SO_FAR: dict[str, Any] = {"color": "#0072B2", "lw": 1.8}
EXPECTED: dict[str, Any] = {"color": "#D55E00", "lw": 1.2, "ls": (0, (4, 1.5))}
MAXIMUM: dict[str, Any] = {"color": "black", "lw": 1.2}
LAWNMOWER: dict[str, Any] = {"color": "#777777", "lw": 1.2, "ls": (0, (1, 1.5))}


@styled
def map_risk(e: Evaluation) -> Figure | None:
    """Map risk over steps, with what was expected at the end; None if it was not computed."""
    c = e.curves
    known, ahead = np.flatnonzero(np.isfinite(c.risk)), np.flatnonzero(np.isfinite(c.expected_risk))
    if len(known) < 2:
        return None
    figure = new_figure(WIDTH_IN, 2.9)
    axis = figure.subplots()
    axis.plot(known, c.risk[known], "o-", ms=3.5, label="map risk so far", **SO_FAR)
    axis.plot(ahead, c.expected_risk[ahead], label="expected at the end with the current plans", **EXPECTED)
    if e.summary.mowing_risk is not None:
        axis.axhline(c.mowing_risk, label="expected of a lawnmower", **LAWNMOWER)
    axis.set_ylabel(f"{MAP_RISK} ({COST_PER_LOCATION})")
    _finish(axis, len(c.risk) - 1, "best")
    axis.set_ylim(bottom=0.0)
    return figure


@styled
def paper_reward(e: Evaluation) -> Figure | None:
    """The paper's reward with its time-varying bound, stepwise and for the whole path; None for other methods."""
    if e.summary.method not in PAPER_METHODS:
        return None
    c = e.curves
    bound = c.bound.copy()
    bound[-1] = np.nan
    figure = new_figure(WIDTH_IN, 3.2)
    left, right = figure.subplots(1, 2)
    left.set_title(r"$\bf{a}$  Stepwise")
    left.plot(c.stepwise, label="team reward so far", **SO_FAR)
    if np.isfinite(bound).any():
        _bound(left, bound, c.bound_max, "lower bound, time-varying")
    else:
        left.plot([], [], " ", label="no naive part, so no lower bound")
    right.set_title(r"$\bf{b}$  Whole path")
    right.plot(c.whole, label="path reward so far", **SO_FAR)
    _bound(right, c.whole_bound, c.whole_bound_max, "expected at the end with the current plans")
    right.axhline(c.naive_value, label="expected of a lawnmower", **LAWNMOWER)
    for axis in (left, right):
        axis.set_ylabel("reward (drop of Bayes risk, cost)")
        axis.set_ylim(min(0.0, float(np.nanmin(c.stepwise))), axis.get_ylim()[1] * 1.32)
        _finish(axis, max(len(c.stepwise) - 1, 1), "upper left")
    return figure


def _bound(axis: Any, bound: Any, largest: Any, label: str) -> None:
    """Draws a bound over steps, where it is known, and its running maximum."""
    known = np.flatnonzero(np.isfinite(bound))
    axis.plot(known, bound[known], label=label, **EXPECTED)
    axis.plot(known, largest[known], label="its running maximum", **MAXIMUM)


def _finish(axis: Any, steps: int, legend: str) -> None:
    axis.set_xlabel("step")
    axis.set_xlim(0, steps)
    add_grid(axis)
    axis.legend(loc=legend, handlelength=2.4, labelspacing=0.25, borderaxespad=0.2)
