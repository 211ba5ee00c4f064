"""Figures that compare settings over seeds: dots with intervals, curves over steps, and sweeps of one parameter."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from auv_lse_shore.campaign.rows import Row, known_values, mean_of
from auv_lse_shore.campaign.statistics import interval
from auv_lse_shore.report.figures import COLORS, DASHES, WIDTH_IN, add_grid, legend_below, new_figure, styled

#: Measures in which settings are compared: column, heading, and whether more is better.
MEASURES: tuple[tuple[str, str, bool], ...] = (
    ("isobath_error_m", "isobath error, whole line (m)", False),
    ("isobath_found", "isobath found (share)", True),
    ("isobath_found_error_m", "isobath error, part found (m)", False),
    ("risk_after", "final map risk (cost per location)", False),
    ("loss_expected", "expected loss (cost per location)", False),
    ("loss_after", "actual loss (cost per location)", False),
    ("mowing_risk", "lawnmower bound (cost per location)", False),
    ("risk_third", "map risk after a third (cost per location)", False),
    ("f1", "F1", True),
    ("misclassified_m2", "misclassified (m²)", False),
    ("local_risk_error", "own-map risk difference (cost per location)", False),
    ("delivery", "packets received (share)", True),
    ("planning_median_s", "median decision time (s)", False),
    ("busy_s", "simulation and evaluation time (s)", False),
)

#: Heading of each measure.
HEADINGS = {column: heading for column, heading, _ in MEASURES}

#: The measures that get a panel in the comparison.
MAIN = ("isobath_error_m", "isobath_found", "risk_after", "loss_after")

#: Curves over steps with the labels of their axes: of the map, and of the paper's reward beside it.
MAP_CURVES = (
    ("risk", "map risk (cost per location)"),
    ("expected_risk", "map risk expected at the end\n(cost per location)"),
)
PAPER_CURVES = (("risk", "map risk (cost per location)"), ("stepwise", "team reward, stepwise (cost)"))

#: Number of settings that `curves` shows.
MAX_CURVES = 16


@styled
def comparison(groups: Mapping[str, Sequence[Row]]) -> Figure:
    """Dots and intervals of every setting in the main measures."""
    longest = max(len(label) for label in groups)
    figure = new_figure(WIDTH_IN, 0.9 + 0.27 * len(groups) + (0.0 if len(groups) > 2 else 0.4))
    axes = figure.subplots(1, len(MAIN), sharey=True)
    rng = np.random.default_rng(0)
    for axis, column in zip(axes, MAIN, strict=True):
        for index, rows in enumerate(groups.values()):
            _dots(axis, known_values(rows, column), index, rng)
        axis.set_title(_title(column), fontsize=8.5)
        axis.set_xlim(*_range(column, groups.values()))
        add_grid(axis, "x")
        axis.locator_params(axis="x", nbins=4)
        axis.tick_params(axis="y", length=0)
    axes[0].set_yticks(range(len(groups)), list(groups), fontsize=8.0 if longest < 45 else 6.5)
    axes[0].set_ylim(len(groups) - 0.4, -0.6)
    return figure


def _title(column: str) -> str:
    """A heading in two short lines, narrow enough for the panels side by side."""
    heading = HEADINGS[column]
    return heading.replace(", ", ",\n", 1) if ", " in heading else heading.replace(" (", "\n(")


def _range(column: str, groups: Iterable[Sequence[Row]]) -> tuple[float, float]:
    """Limits that include every value; the wide intervals of a few seeds may exceed them."""
    values = [v for rows in groups for v in known_values(rows, column)]
    if not values:
        return 0.0, 1.0
    room = 0.08 * (max(values) - min(values)) or 0.05 * abs(values[0]) or 1.0
    return min(values) - room, max(values) + room


def _dots(axis: Any, values: Sequence[float], index: int, rng: np.random.Generator) -> None:
    color, mean = COLORS[index % len(COLORS)], interval(values)
    axis.plot(values, index + rng.uniform(-0.22, 0.22, len(values)), ".", ms=3.0, color=color, alpha=0.4, mew=0)
    if mean.count > 1:
        axis.plot([mean.low, mean.high], [index, index], color="black", lw=1.6, solid_capstyle="butt")
    axis.plot(mean.mean, index, "o", ms=4.5, color=color, mec="black", mew=0.8)


@styled
def curves(groups: Mapping[str, Sequence[Row]], columns: Sequence[tuple[str, str]]) -> Figure:
    """Two curves over steps, with the labels of their axes: means of the first `MAX_CURVES` settings."""
    shown = list(groups.items())[:MAX_CURVES]
    figure = new_figure(WIDTH_IN, 3.1)
    axes = figure.subplots(1, 2)
    for axis, (column, label) in zip(axes, columns, strict=True):
        for index, (_, rows) in enumerate(shown):
            _curve(axis, [r[column] for r in rows if r.get(column)], index)
        axis.set_xlabel("step")
        axis.set_ylabel(label)
        axis.set_xlim(left=0)
        axis.set_ylim(bottom=0.0)
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
        add_grid(axis)
    if len(groups) > 1:
        handles = [Line2D([], [], label=name, **_line(i)) for i, (name, _) in enumerate(shown)]
        legend_below(figure, handles, 3, fontsize=7.0, handlelength=2.4)
    return figure


def _line(index: int) -> dict[str, Any]:
    return {"color": COLORS[index % len(COLORS)], "ls": DASHES[index // len(COLORS) % len(DASHES)], "lw": 1.4}


def _curve(axis: Any, runs: Sequence[Sequence[float | None]], index: int) -> None:
    """Mean of a curve over runs, where all of them have a value, and its confidence interval."""
    if not runs:
        return
    length = min(map(len, runs))
    values = np.array([[np.nan if v is None else v for v in run[:length]] for run in runs])
    at = np.flatnonzero(np.isfinite(values).all(axis=0))
    mean = values[:, at].mean(axis=0)
    axis.plot(at, mean, **_line(index))
    if len(runs) > 2:
        half = np.array([interval(column).half for column in values[:, at].T])
        axis.fill_between(at, mean - half, mean + half, color=COLORS[index % len(COLORS)], alpha=0.13, lw=0)


@styled
def sweep_figure(
    lines: Mapping[str, Sequence[tuple[float, Sequence[Row]]]], label: str, columns: Sequence[str] = MAIN
) -> Figure:
    """Measures against a parameter: for each name one line of points (value, rows)."""
    figure = new_figure(WIDTH_IN, 2.3 if len(lines) < 2 else 2.6)
    axes = figure.subplots(1, len(columns))
    for axis, column in zip(axes, columns, strict=True):
        for index, points in enumerate(lines.values()):
            points = sorted(points, key=lambda p: p[0])
            at, means = [x for x, _ in points], [mean_of(rows, column) for _, rows in points]
            axis.plot(at, [m.mean for m in means], marker="o", ms=3.5, **_line(index))
            low = [m.low if math.isfinite(m.low) else m.mean for m in means]
            high = [m.high if math.isfinite(m.high) else m.mean for m in means]
            axis.fill_between(at, low, high, color=COLORS[index % len(COLORS)], alpha=0.15, lw=0)
        axis.set_ylim(*_range(column, [rows for points in lines.values() for _, rows in points]))
        axis.set_title(_title(column), fontsize=8.5)
        axis.set_xlabel(label)
        add_grid(axis)
        axis.locator_params(nbins=4)
    if len(lines) > 1:
        handles = [Line2D([], [], marker="o", ms=3.5, label=name, **_line(i)) for i, name in enumerate(lines)]
        legend_below(figure, handles, 4, fontsize=7.5)
    return figure
