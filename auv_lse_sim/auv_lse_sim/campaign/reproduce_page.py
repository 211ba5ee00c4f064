"""The page of scripts/reproduce: claims, figures as the paper shows them, tables over seeds, sensitivities."""

from __future__ import annotations

import html
import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from auv_lse_sim.campaign.campaign import columns_of, rows_of
from auv_lse_sim.campaign.claims import Claim, claims
from auv_lse_sim.campaign.page import comparison, curves, sweep_figure, value_of
from auv_lse_sim.campaign.reproduce import METHODS, Plan, Sweep, sweep_name, trial_name
from auv_lse_sim.campaign.rows import Rows
from auv_lse_sim.campaign.statistics import Interval, interval, proportion
from auv_lse_sim.judge import figures
from auv_lse_sim.judge.evaluation import Evaluation
from auv_lse_sim.judge.figures import STYLE, WIDTH_IN, new_figure, save
from auv_lse_sim.judge.report import embedded, facts, head, table

Row = Mapping[str, Any]

#: Rows at each point of a sensitivity, by method.
Lines = dict[str, list[tuple[float, Sequence[Row]]]]

#: Columns of the main table: key, heading.
COLUMNS = (
    ("team_reward", "team reward, stepwise (cost)"),
    ("bound_kept", "above printed bound (share)"),
    ("path_reward", "path reward (cost)"),
    ("path_bound_kept", "above lawnmower's value (share)"),
    ("risk_third", "risk at a third (cost/place)"),
    ("risk_after", "final risk (cost/place)"),
    ("f1", "F1"),
    ("isobath_error_m", "isobath error (m)"),
    ("isobath_found", "isobath found (share)"),
    ("misclassified_m2", "misclassified (m²)"),
    ("local_risk_error", "local-map risk error (cost/place)"),
    ("delivery", "packets delivered (share)"),
    ("planning_median_s", "median decision (s)"),
)


#: What the tables of sensitivities show: column, name with unit.
SWEPT = {
    "risk_after": "final risk (cost/place)",
    "isobath_error_m": "isobath error (m)",
    "local_risk_error": "local-map risk error (cost/place)",
}

#: What their figures show.
DRAWN = ("risk_third", "risk_after", "isobath_error_m", "local_risk_error")


def write_page(plan: Plan, folder: Path, shown: Mapping[tuple[int, str], Evaluation]) -> Path:
    """Writes figures, `results.json`, `results.md` and `reproduce.html` from the rows so far; returns its path."""
    rows = {name: rows_of(spec, Rows(folder / name, columns_of(spec)).read()) for name, spec in plan.campaigns.items()}
    done = {name: [r for r in found if r["status"] == "ok"] for name, found in rows.items()}
    failed = [r for found in rows.values() for r in found if r["status"] == "failed"]
    trials = _by_trial(done.get("trials", []), plan.teams)
    large = _by_trial(done.get("large", []), (plan.large_team,))
    swept = _swept(plan, done.get("sensitivity", []))
    found = claims(trials)
    parts = [
        head("The paper, reproduced"),
        "<h1>Collaborative isobath mapping: the paper's results, reproduced</h1>",
        f'<p class="sub">{html.escape(_subtitle(plan, done, failed))}</p>',
        facts(_counts(found)),
        "<h2>The claims, one by one</h2>" + "".join(map(_claim, found)),
        "<h2>The paper's figures</h2>" + _paper_figures(plan, folder, shown),
        "<h2>Field trials over seeds</h2>" + _table(trials) + _groups_figure(folder, "trials", trials),
    ]
    if large:
        parts.append(
            "<h2>In an area four times as large</h2><p>1400 m × 1200 m: three vehicles cannot saturate it.</p>"
        )
        parts.append(_table(large) + _groups_figure(folder, "large", large))
    if done.get("sensitivity"):
        parts.append("<h2>Sensitivity</h2>" + _sensitivity(folder, swept))
    if failed:
        lines = [[html.escape(str(r["group"])), str(r["seed"]), html.escape(str(r["error"]))] for r in failed]
        parts.append("<h2>Failed missions</h2>" + table(["setting", "seed", "error"], lines))
    parts.append("<h2>How it was made</h2>" + _made(plan, done))
    path = folder / "reproduce.html"
    path.write_text("\n".join(parts) + "\n</body></html>\n")
    (folder / "results.json").write_text(
        json.dumps(_results(found, {"trials": trials, "large": large}), indent=2) + "\n"
    )
    (folder / "results.md").write_text(markdown(found, trials, large, swept, _subtitle(plan, done, failed)))
    return path


def _by_trial(rows: Sequence[Row], teams: Sequence[int]) -> dict[tuple[int, str], list[Row]]:
    groups = {(k, m): [r for r in rows if r["group"] == trial_name(k, m)] for k in teams for m in METHODS}
    return {key: found for key, found in groups.items() if found}


def _subtitle(plan: Plan, done: Mapping[str, Sequence[Row]], failed: Sequence[Row]) -> str:
    flown = sum(map(len, done.values()))
    seeds = len({r["seed"] for r in done.get("trials", [])})
    kind = "Small version (--quick): a small area, 40 steps. " if plan.name == "quick" else ""
    return f"{kind}{flown} simulated missions, {seeds} seeds in the trials, {len(failed)} missions failed."


def _counts(found: Sequence[Claim]) -> list[tuple[str, str]]:
    verdicts = [e.verdict for claim in found for e in claim.evidence]
    return [(str(verdicts.count(v)), f"measurements: {v}") for v in ("supported", "undecided", "contradicted")]


_MARKS = {"supported": "✔ supported", "contradicted": "✘ contradicted", "undecided": "? undecided"}


def _claim(claim: Claim) -> str:
    rows = [[html.escape(e.what), html.escape(e.value), _MARKS[e.verdict]] for e in claim.evidence]
    remark = f"<p>{html.escape(claim.remark)}</p>" if claim.remark else ""
    return (
        f"<h3>{html.escape(claim.text)}</h3><p class='sub'>{html.escape(claim.source)}</p>"
        + table(["measured here", "result (mean ± half the 95 % interval)", "this claim is"], rows, ["", "n", "n"])
        + remark
    )


def _table(groups: Mapping[tuple[int, str], Sequence[Row]]) -> str:
    header = ["setting", "seeds", *(heading for _, heading in COLUMNS)]
    lines = []
    for (vehicles, method), rows in groups.items():
        cells = [_cell(rows, column) for column, _ in COLUMNS]
        lines.append([trial_name(vehicles, method), str(len(rows)), *cells])
    return table(header, lines, ["", *["n"] * (len(header) - 1)])


def _groups_figure(folder: Path, name: str, groups: Mapping[tuple[int, str], Sequence[Row]]) -> str:
    if not groups:
        return "<p>No mission has finished yet.</p>"
    named = {trial_name(*key): rows for key, rows in groups.items()}
    save(comparison(named), folder / f"{name}.png")
    save(curves(named), folder / f"{name}_curves.png")
    caption = "Risk over the map, and stepwise team reward, over steps: mean and 95 % confidence interval."
    return embedded(folder / f"{name}.png", "Each seed (dots), mean and 95 % confidence interval.") + embedded(
        folder / f"{name}_curves.png", caption
    )


# Figures of single missions -------------------------------------------------------------------------------------------


def _paper_figures(plan: Plan, folder: Path, shown: Mapping[tuple[int, str], Evaluation]) -> str:
    parts = []
    for team in sorted({k for k, _ in shown}, reverse=True):
        methods = [m for m in ("augmented", "plain", "best") if (team, m) in shown]
        own = {m: shown[team, m] for m in methods}
        for name, caption, figure in (
            (
                f"paths_{team}_auvs.png",
                f"Paths and Bayes risk of {team} vehicles, before (top) and given all measurements (bottom).",
                path_figure(own),
            ),
            (
                f"reward_{team}_auvs.png",
                f"Team reward of {team} vehicles on one lake: with the naive path as terminal reward (augmented) and "
                "without (plain), with the time-varying lower bound and its maximum; in the printed, stepwise reading, "
                "and for the whole path.",
                reward_figure(own),
            ),
        ):
            save(figure, folder / name)
            parts.append(embedded(folder / name, caption))
        if "augmented" in own:
            name = f"local_maps_{team}_auvs.png"
            save(figures.local_risk_error(own["augmented"]), folder / name)
            caption = "Posterior risk given what each vehicle had, less the posterior risk given all measurements."
            parts.append(embedded(folder / name, caption))
    return "".join(parts) or "<p>No example mission has been flown yet.</p>"


def path_figure(missions: Mapping[str, Evaluation]) -> Figure:
    """Prior (top) and posterior (bottom) Bayes risk with the paths of one mission per method."""
    with matplotlib.rc_context(STYLE):
        first = next(iter(missions.values()))
        extent, aspect = figures._extent(first)
        width = (WIDTH_IN - 1.1 - 0.17 * len(missions)) / len(missions)
        figure = new_figure(WIDTH_IN, 2.0 * (width * aspect + 0.2) + 0.75)
        axes = figure.subplots(2, len(missions), sharex=True, sharey=True, squeeze=False)
        top = max(float(np.nanmax(e.prior.risk)) for e in missions.values())
        image: Any = None
        for column, (method, e) in enumerate(missions.items()):
            for axis, field, title in zip(axes[:, column], (e.prior, e.team), (method, ""), strict=True):
                image = axis.imshow(
                    figures._shown(field.risk, e),
                    origin="lower",
                    extent=extent,
                    cmap=figures.RISK_COLORS,
                    vmin=0.0,
                    vmax=top,
                    aspect="equal",
                )
                figures._map_axes(axis, extent, title)
                figures._tracks(axis, e)
                figures._isobath(axis, e.truth, "true")
            figures._isobath(axes[1, column], e.estimate, "estimate")
        figures._outer_labels(axes.ravel(), len(missions))
        bar = figure.colorbar(image, ax=axes.ravel().tolist(), shrink=0.85, pad=0.015, aspect=36)
        bar.set_label("Bayes risk per place (units of cost)")
        bar.outline.set_linewidth(0.5)
        figures._legend(figure, first, truth=bool(first.truth), estimate=True)
        return figure


#: Line of each method, as near to the paper's colours as everybody can tell apart.
_LINES = {
    "augmented": {"color": "#009E73", "ls": "-", "lw": 1.8},
    "plain": {"color": "#0072B2", "ls": (0, (5, 1.5)), "lw": 1.6},
    "best": {"color": "#CC79A7", "ls": (0, (1.2, 1.0)), "lw": 1.6},
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
        left.set_title(r"$\bf{a}$  Stepwise, as printed")
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


def _swept(plan: Plan, rows: Sequence[Row]) -> list[tuple[Sweep, Lines]]:
    """What has been flown of each sensitivity."""
    swept = []
    for sweep in plan.sweeps:
        lines: Lines = {}
        for method in METHODS:
            for value, _ in sweep.points:
                found = [r for r in rows if r["group"] == sweep_name(sweep, value, method)]
                if found:
                    lines.setdefault(method, []).append((value, found))
        if lines:
            swept.append((sweep, lines))
    return swept


def _sensitivity(folder: Path, swept: Sequence[tuple[Sweep, Lines]]) -> str:
    parts = []
    for sweep, lines in swept:
        name = f"sensitivity_{sweep.name}.png"
        save(sweep_figure(lines, sweep.label, DRAWN), folder / name)
        seeds = len({r["seed"] for points in lines.values() for _, own in points for r in own})
        caption = f"Three vehicles: mean and 95 % confidence interval over {seeds} seeds against {sweep.label}."
        if sweep.name == "team":
            caption = f"Mean and 95 % confidence interval over {seeds} seeds against the number of vehicles."
        parts.append(embedded(folder / name, caption))
    return "".join(parts) or "<p>No mission has finished yet.</p>"


def _made(plan: Plan, done: Mapping[str, Sequence[Row]]) -> str:
    from importlib.metadata import version

    versions = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "dask"))
    busy = sum(r["busy_s"] or 0.0 for rows in done.values() for r in rows)
    settings = "; ".join(f"{n}: {len(s.settings)} settings × {len(s.seeds)} seeds" for n, s in plan.campaigns.items())
    text = (
        f"Fleet engine of this project (one process, no ROS), Python {platform.python_version()}, {versions}, "
        f"{platform.machine()}, {os.cpu_count()} cores; {busy / 3600.0:.1f} core hours. Asked for: {settings}. "
        "Every seed draws its own lake, sensor errors and channel, the same for all methods. Rows with the complete "
        "parameters of every mission are in the campaigns' Parquet files; scripts/campaign --rerun flies any of them "
        "again."
    )
    return f"<p>{html.escape(text)}</p>"


def markdown(
    found: Sequence[Claim],
    trials: Mapping[tuple[int, str], Sequence[Row]],
    large: Mapping[tuple[int, str], Sequence[Row]],
    swept: Sequence[tuple[Sweep, Lines]],
    subtitle: str,
) -> str:
    """Tables and claims as text, for a document."""
    lines = [subtitle, "Mean ± half the 95 % confidence interval over seeds.", "", *_markdown_table(trials)]
    for claim in found:
        lines += ["", f"**{claim.text}** ({claim.source}) {claim.remark}", ""]
        lines += ["| measured here | result | this claim is |", "|---|---|---|"]
        lines += [f"| {e.what.replace('|', chr(92) + '|')} | {e.value} | {e.verdict} |" for e in claim.evidence]
    if large:
        lines += ["", "**In an area four times as large**", "", *_markdown_table(large)]
    for sweep, by_method in swept:
        lines += ["", f"**Sensitivity to {sweep.label}**: " + "; ".join(SWEPT.values()), ""]
        lines.append(f"| {sweep.label} | seeds | " + " | ".join(by_method) + " |")
        lines.append("|---" * (len(by_method) + 2) + "|")
        for value, _ in sweep.points:
            at = [dict(points).get(value, ()) for points in by_method.values()]
            cells = ["; ".join(_cell(rows, column) for column in SWEPT) for rows in at]
            lines.append(f"| {value:g} | {max(map(len, at))} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _markdown_table(groups: Mapping[tuple[int, str], Sequence[Row]]) -> list[str]:
    columns = [(key, heading) for key, heading in COLUMNS if key not in ("bound_kept", "isobath_found")]
    lines = ["| setting | seeds | " + " | ".join(heading for _, heading in columns) + " |"]
    lines.append("|---" * (len(columns) + 2) + "|")
    for (vehicles, method), rows in groups.items():
        cells = [_cell(rows, key) for key, _ in columns]
        lines.append(f"| {trial_name(vehicles, method)} | {len(rows)} | " + " | ".join(cells) + " |")
    return lines


def _mean(rows: Sequence[Row], column: str) -> Interval:
    return interval([value_of(r, column) for r in rows])


def _cell(rows: Sequence[Row], column: str) -> str:
    """A column's mean with its interval; of how many missions, if some have no value (no isobath found at all)."""
    values = [r.get(column) for r in rows]
    if any(isinstance(v, bool) for v in values):
        return proportion(values)
    mean = _mean(rows, column)
    return f"{mean}" if mean.count == len(rows) else f"{mean} ({mean.count} of {len(rows)})"


def _results(
    found: Sequence[Claim], campaigns: Mapping[str, Mapping[tuple[int, str], Sequence[Row]]]
) -> dict[str, Any]:
    tables: dict[str, list[dict[str, Any]]] = {}
    for name, groups in campaigns.items():
        tables[name] = []
        for (vehicles, method), rows in groups.items():
            entry: dict[str, Any] = {"vehicles": vehicles, "method": method, "seeds": len(rows)}
            for column, _ in COLUMNS:
                mean = _mean(rows, column)
                entry[column] = [v if np.isfinite(v) else None for v in (mean.mean, mean.low, mean.high)]
            tables[name].append(entry)
    return {"claims": [asdict(claim) for claim in found], **tables}
