"""The page of a campaign: settings compared over seeds, failures, and the command that flies a mission again."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from auv_lse_shore.campaign.reliability_figure import reliability_figure
from auv_lse_shore.campaign.rows import Row, by_group, value_of
from auv_lse_shore.campaign.spec import CampaignSpec
from auv_lse_shore.campaign.statistics import Interval, interval
from auv_lse_shore.report.figures import COLORS, DASHES, STYLE, WIDTH_IN, new_figure, save
from auv_lse_shore.report.page_parts import embedded, facts, head, number, table

#: Measures in which settings are compared: column, heading, and whether more is better.
MEASURES: tuple[tuple[str, str, bool], ...] = (
    ("isobath_error_m", "isobath error, whole line (m)", False),
    ("isobath_found", "isobath found (share)", True),
    ("isobath_found_error_m", "isobath error where found (m)", False),
    ("risk_after", "final risk (cost/place)", False),
    ("loss_expected", "loss expected by the map (cost/place)", False),
    ("loss_after", "true loss (cost/place)", False),
    ("mowing_risk", "risk expected of mowing (cost/place)", False),
    ("risk_third", "risk at a third (cost/place)", False),
    ("f1", "F1", True),
    ("misclassified_m2", "misclassified (m²)", False),
    ("local_risk_error", "local-map risk error (cost/place)", False),
    ("delivery", "packets delivered", True),
    ("planning_median_s", "median decision (s)", False),
    ("busy_s", "flown and judged in (s)", False),
)

#: The measures that get a panel in the comparison.
MAIN = ("isobath_error_m", "isobath_found", "risk_after", "loss_after")


def write_page(spec: CampaignSpec, rows: Sequence[Row], folder: Path) -> Path:
    """Writes the figures and `campaign.html`; returns the page's path."""
    groups = by_group(spec, rows)
    failed = [row for row in rows if row["status"] == "failed"]
    drawn: list[tuple[str, str]] = []
    if groups:
        drawn.append(_draw(comparison(groups), folder, "comparison.png", _COMPARISON))
        drawn.append(_draw(curves(groups, MAP_CURVES), folder, "risk_curves.png", _CURVES))
        reliability = reliability_figure(groups)
        if reliability is not None:
            drawn.append(_draw(reliability, folder, "reliability.png", _RELIABILITY))
        for name in spec.varied:
            figure = sweep(spec, groups, name)
            if figure is not None:
                file = f"sweep_{name.replace('.', '_')}.png"
                drawn.append(
                    _draw(figure, folder, file, f"Mean and 95 % confidence interval over seeds against {name}.")
                )
    total = len(spec.settings) * len(spec.seeds)
    parts = [
        head(f"Campaign {spec.name}"),
        f"<h1>Campaign {html.escape(spec.name)}</h1>",
        f'<p class="sub">{len(spec.settings)} settings, {len(spec.seeds)} seeds, {total} missions; '
        f"{sum(map(len, groups.values()))} finished, {len(failed)} failed.</p>",
        facts([(number(b), a) for a, b in _extremes(groups)]),
        "<h2>Settings</h2><p>Mean ± half the 95 % confidence interval over seeds. Seeds share their lakes.</p>",
        comparison_table(groups),
        "<h2>Figures</h2>" + "".join(embedded(folder / name, caption) for name, caption in drawn),
        "<h2>Failed missions</h2>" + _failures(failed),
        "<h2>Flying one mission again</h2><p>With full recording, from its row: "
        f"<code>scripts/campaign --out {html.escape(str(folder))} --rerun ID</code></p>" + _all_rows(spec, rows),
    ]
    path = folder / "campaign.html"
    path.write_text("\n".join(parts) + "\n</body></html>\n")
    return path


_COMPARISON = "Every setting: each seed's result (dots), their mean and its 95 % confidence interval."
_CURVES = (
    "Risk over the map, and what the plans in hand were expected to leave of it at the end, over steps: mean over "
    "seeds, 95 % confidence interval."
)

#: Curves over steps, with their axes' labels: of the map, and of the paper's own reward beside its risk.
MAP_CURVES = (("risk", "risk (cost/place)"), ("expected_risk", "risk expected of the end (cost/place)"))
PAPER_CURVES = (("risk", "risk (cost/place)"), ("stepwise", "team reward, stepwise (cost)"))


_RELIABILITY = (
    "How often it is so where the final maps say how probable it is (left; the dotted line is an honest map, above it "
    "the map is too careful, below it too bold), and how the places are spread over the probabilities (right). All "
    "places of all missions of a setting; 95 % interval by drawing missions."
)


def _draw(figure: Figure, folder: Path, name: str, caption: str) -> tuple[str, str]:
    save(figure, folder / name)
    return name, caption


def comparison_table(groups: Mapping[str, Sequence[Row]]) -> str:
    """Settings against measures, as HTML."""
    header = ["setting", "seeds", *(heading for _, heading, _ in MEASURES)]
    lines = []
    for label, rows in groups.items():
        cells = [str(interval([value_of(r, column) for r in rows])) for column, _, _ in MEASURES]
        lines.append([html.escape(label), str(len(rows)), *cells])
    return table(header, lines, ["", *["n"] * (len(header) - 1)])


def comparison(groups: Mapping[str, Sequence[Row]]) -> Figure:
    """Dots and intervals of every setting in the main measures."""
    with matplotlib.rc_context(STYLE):
        longest = max(len(label) for label in groups)
        figure = new_figure(WIDTH_IN, 0.9 + 0.27 * len(groups) + (0.0 if len(groups) > 2 else 0.4))
        axes = figure.subplots(1, len(MAIN), sharey=True)
        names = {column: heading for column, heading, _ in MEASURES}
        rng = np.random.default_rng(0)
        for axis, column in zip(axes, MAIN, strict=True):
            for place, rows in enumerate(groups.values()):
                values = [v for v in (value_of(r, column) for r in rows) if v is not None]
                _dot(axis, interval(values), values, place, rng)
            axis.set_title(names[column].replace(" (", "\n("), fontsize=8.5)
            low, high = _range(column, groups.values())
            axis.set_xlim(low, high)
            axis.grid(True, axis="x", color="#e4e4e4", lw=0.5)
            axis.set_axisbelow(True)
            axis.locator_params(axis="x", nbins=4)
            axis.tick_params(axis="y", length=0)
        axes[0].set_yticks(range(len(groups)), list(groups), fontsize=8.0 if longest < 45 else 6.5)
        axes[0].set_ylim(len(groups) - 0.4, -0.6)
        return figure


def _range(column: str, groups: Iterable[Sequence[Row]]) -> tuple[float, float]:
    """Limits that include every value; the wide intervals of a few seeds may exceed them."""
    values = [v for rows in groups for v in (value_of(r, column) for r in rows) if v is not None and math.isfinite(v)]
    if not values:
        return 0.0, 1.0
    room = 0.08 * (max(values) - min(values)) or 0.05 * abs(values[0]) or 1.0
    return min(values) - room, max(values) + room


def _dot(axis: Any, mean: Interval, values: Sequence[float], place: int, rng: np.random.Generator) -> None:
    color = COLORS[place % len(COLORS)]
    spread = place + rng.uniform(-0.22, 0.22, len(values))
    axis.plot(values, spread, ".", ms=3.0, color=color, alpha=0.4, mew=0)
    if mean.count > 1:
        axis.plot([mean.low, mean.high], [place, place], color="black", lw=1.6, solid_capstyle="butt")
    axis.plot(mean.mean, place, "o", ms=4.5, color=color, mec="black", mew=0.8)


def curves(groups: Mapping[str, Sequence[Row]], columns: Sequence[tuple[str, str]]) -> Figure:
    """Two curves over steps, with their axes' labels: means of every setting (of the first 16)."""
    with matplotlib.rc_context(STYLE):
        lines = (min(len(groups), 16) + 2) // 3
        figure = new_figure(WIDTH_IN, 2.9 + 0.17 * lines)
        axes = figure.subplots(1, 2)
        for axis, (column, label) in zip(axes, columns, strict=True):
            for place, rows in enumerate(list(groups.values())[:16]):
                _curve(axis, [r[column] for r in rows if r.get(column)], place)
            axis.set_xlabel("step")
            axis.set_ylabel(label)
            axis.set_xlim(left=0)
            axis.set_ylim(bottom=0.0)
            axis.xaxis.set_major_locator(MaxNLocator(integer=True))
            axis.grid(True, color="#e4e4e4", lw=0.5)
            axis.set_axisbelow(True)
        if len(groups) > 1:
            handles = [Line2D([], [], label=name, **_line(i)) for i, name in enumerate(list(groups)[:16])]
            figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=7.0, handlelength=2.4)
        return figure


def _line(place: int) -> dict[str, Any]:
    return {"color": COLORS[place % len(COLORS)], "ls": DASHES[place // len(COLORS) % len(DASHES)], "lw": 1.4}


def _curve(axis: Any, runs: Sequence[Sequence[float | None]], place: int) -> None:
    """Mean of a curve over runs, where all of them have a value, and its confidence interval."""
    if not runs:
        return
    length = min(map(len, runs))
    values = np.array([[np.nan if v is None else v for v in run[:length]] for run in runs])
    at = np.flatnonzero(np.isfinite(values).all(axis=0))
    mean = values[:, at].mean(axis=0)
    axis.plot(at, mean, **_line(place))
    if len(runs) > 2:
        half = np.array([interval(column).half for column in values[:, at].T])
        axis.fill_between(at, mean - half, mean + half, color=COLORS[place % len(COLORS)], alpha=0.13, lw=0)


def sweep(spec: CampaignSpec, groups: Mapping[str, Sequence[Row]], name: str) -> Figure | None:
    """The main measures against a numeric parameter, a line for each combination of the others; None if not numeric."""
    varied = dict(spec.settings)
    values = {label: varied[label].get(name) for label in groups}
    numeric = {v for v in values.values() if isinstance(v, int | float) and not isinstance(v, bool)}
    if len(numeric) < 3 or any(v not in numeric for v in values.values()):
        return None
    lines: dict[str, list[tuple[float, Sequence[Row]]]] = {}
    for label, rows in groups.items():
        rest = ", ".join(
            f"{k.split('.')[-1]} {varied[label][k]}" for k in spec.varied if k != name and k in varied[label]
        )
        lines.setdefault(rest, []).append((float(values[label] or 0.0), rows))
    return sweep_figure(lines, name.split(".")[-1].replace("_", " "))


def sweep_figure(
    lines: Mapping[str, Sequence[tuple[float, Sequence[Row]]]], label: str, columns: Sequence[str] = MAIN
) -> Figure:
    """The main measures against a number: for each name one line of points (number, rows)."""
    with matplotlib.rc_context(STYLE):
        figure = new_figure(WIDTH_IN, 2.3 if len(lines) < 2 else 2.6)
        axes = figure.subplots(1, len(columns))
        names = {column: heading for column, heading, _ in MEASURES}
        for axis, column in zip(axes, columns, strict=True):
            for place, points in enumerate(lines.values()):
                points = sorted(points, key=lambda p: p[0])
                at = [x for x, _ in points]
                means = [interval([value_of(r, column) for r in rows]) for _, rows in points]
                color = COLORS[place % len(COLORS)]
                axis.plot(at, [m.mean for m in means], "o-", ms=3.5, lw=1.3, color=color)
                low = [m.low if math.isfinite(m.low) else m.mean for m in means]
                high = [m.high if math.isfinite(m.high) else m.mean for m in means]
                axis.fill_between(at, low, high, color=color, alpha=0.15, lw=0)
            axis.set_ylim(*_range(column, [rows for points in lines.values() for _, rows in points]))
            axis.set_title(names[column].replace(" (", "\n("), fontsize=8.5)
            axis.set_xlabel(label)
            axis.grid(True, color="#e4e4e4", lw=0.5)
            axis.set_axisbelow(True)
            axis.locator_params(nbins=4)
        if len(lines) > 1:
            handles = [
                Line2D([], [], color=COLORS[i % len(COLORS)], marker="o", ms=3.5, label=n) for i, n in enumerate(lines)
            ]
            figure.legend(handles=handles, loc="outside lower center", ncols=min(4, len(lines)), fontsize=7.5)
        return figure


def _extremes(groups: Mapping[str, Sequence[Row]]) -> list[tuple[str, float]]:
    """The best setting in each of the first measures, by its mean."""
    best = []
    for column, heading, more in MEASURES[:3]:
        means = {label: interval([value_of(r, column) for r in rows]).mean for label, rows in groups.items()}
        means = {label: mean for label, mean in means.items() if math.isfinite(mean)}
        if len(means) > 1:
            label = (max if more else min)(means, key=lambda name: means[name])
            best.append((f"best mean {heading}: {label}", means[label]))
    return best


def _failures(rows: Sequence[Row]) -> str:
    if not rows:
        return "<p>None.</p>"
    lines = [
        [f"<code>{r['id']}</code>", html.escape(r["group"]), str(r["seed"]), html.escape(r["error"] or "")]
        for r in rows
    ]
    return table(["id", "setting", "seed", "error"], lines)


def _all_rows(spec: CampaignSpec, rows: Sequence[Row]) -> str:
    order = {label: i for i, (label, _) in enumerate(spec.settings)}
    lines = []
    for r in sorted(rows, key=lambda r: (order[r["group"]], r["seed"] or 0)):
        cells = [number(value_of(r, column)) for column in MAIN]
        note = html.escape(r["error"] or "")
        lines.append([f"<code>{r['id']}</code>", html.escape(r["group"]), str(r["seed"]), r["status"], *cells, note])
    header = ["id", "setting", "seed", "status", *(h for c, h, _ in MEASURES if c in MAIN), "note"]
    return f"<details><summary>all {len(rows)} missions</summary>{table(header, lines)}</details>"
