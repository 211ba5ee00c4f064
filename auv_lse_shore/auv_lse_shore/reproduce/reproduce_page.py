"""The page of scripts/reproduce: claims, figures as the paper has them, tables over seeds, sensitivities."""

from __future__ import annotations

import html
import json
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path

from auv_lse_shore.campaign.page import PAPER_CURVES, comparison, curves, sweep_figure
from auv_lse_shore.campaign.rows import Row
from auv_lse_shore.judge.evaluation import Evaluation
from auv_lse_shore.report import figures
from auv_lse_shore.report.figures import save
from auv_lse_shore.report.page_parts import embedded, facts, head, table
from auv_lse_shore.reproduce.claims import Claim, claims
from auv_lse_shore.reproduce.study import SENSITIVE, Study, Sweep, trial_name
from auv_lse_shore.reproduce.study_figures import path_figure, reward_figure
from auv_lse_shore.reproduce.study_results import (
    COLUMNS,
    Groups,
    Lines,
    as_data,
    by_sweep,
    by_trial,
    cell_of,
    markdown,
    rows_by_campaign,
)

#: Columns of the sensitivities' figures.
DRAWN = ("risk_third", "risk_after", "isobath_error_m", "local_risk_error")


def write_page(study: Study, folder: Path, examples: Mapping[tuple[int, str], Evaluation]) -> Path:
    """Writes figures, `results.json`, `results.md` and `reproduce.html` from the rows so far; returns its path."""
    rows = rows_by_campaign(study, folder)
    done = {name: [r for r in found if r["status"] == "ok"] for name, found in rows.items()}
    failed = [r for found in rows.values() for r in found if r["status"] == "failed"]
    trials = by_trial(done.get("trials", []), study.teams)
    large = by_trial(done.get("large", []), (study.large_team,))
    swept = by_sweep(study, done.get("sensitivity", []))
    charted = by_trial(done.get("charted", []), study.teams)
    found = claims(trials, charted)
    parts = [
        head("The paper, reproduced"),
        "<h1>Collaborative isobath mapping: the paper's results, reproduced</h1>",
        f'<p class="sub">{html.escape(_subtitle(study, done, failed))}</p>',
        facts(_counts(found)),
        "<h2>The claims, one by one</h2>" + "".join(map(_claim, found)),
        "<h2>The paper's figures</h2>" + _paper_figures(folder, examples),
        "<h2>Field trials over seeds</h2>" + _table(trials) + _groups_figure(folder, "trials", trials),
    ]
    if charted:
        parts.append(
            "<h2>With a coarse chart as prior</h2><p>The same lakes, with a chart as the prior mean of every map: the "
            "truth smoothed over 75 m, with errors of 2.5 m.</p>"
        )
        parts.append(_table(charted) + _groups_figure(folder, "charted", charted))
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
    parts.append("<h2>How it was made</h2>" + _made(study, done))
    path = folder / "reproduce.html"
    path.write_text("\n".join(parts) + "\n</body></html>\n")
    (folder / "results.json").write_text(
        json.dumps(as_data(found, {"trials": trials, "charted": charted, "large": large}), indent=2) + "\n"
    )
    (folder / "results.md").write_text(markdown(found, trials, charted, large, swept, _subtitle(study, done, failed)))
    return path


def _subtitle(study: Study, done: Mapping[str, Sequence[Row]], failed: Sequence[Row]) -> str:
    flown = sum(map(len, done.values()))
    seeds = len({r["seed"] for r in done.get("trials", [])})
    kind = "Small version (--quick): a small area, 40 steps. " if study.name == "quick" else ""
    return f"{kind}{flown} simulated missions, {seeds} seeds in the trials, {len(failed)} missions failed."


def _counts(found: Sequence[Claim]) -> list[tuple[str, str]]:
    verdicts = [e.verdict for claim in found for e in claim.evidence]
    return [(str(verdicts.count(v)), f"measurements: {v}") for v in ("supported", "undecided", "contradicted")]


_MARKS = {"supported": "✔ supported", "contradicted": "✘ contradicted", "undecided": "? undecided"}


def _claim(claim: Claim) -> str:
    rows = [[e.prior, html.escape(e.what), html.escape(e.value), _MARKS[e.verdict]] for e in claim.evidence]
    remark = f"<p>{html.escape(claim.remark)}</p>" if claim.remark else ""
    remark = f"<p>How it stands. {html.escape(claim.standing())}</p>" + remark
    return (
        f"<h3>{html.escape(claim.text)}</h3><p class='sub'>{html.escape(claim.source)}</p>"
        + table(
            ["prior", "measured here", "result (mean ± half the 95 % interval)", "this claim is"],
            rows,
            ["", "", "n", "n"],
        )
        + remark
    )


def _table(groups: Groups) -> str:
    header = ["setting", "seeds", *(heading for _, heading in COLUMNS)]
    lines = []
    for (vehicles, method), rows in groups.items():
        cells = [cell_of(rows, column) for column, _ in COLUMNS]
        lines.append([trial_name(vehicles, method), str(len(rows)), *cells])
    return table(header, lines, ["", *["n"] * (len(header) - 1)])


def _groups_figure(folder: Path, name: str, groups: Groups) -> str:
    if not groups:
        return "<p>No mission has finished yet.</p>"
    named = {trial_name(*key): rows for key, rows in groups.items()}
    save(comparison(named), folder / f"{name}.png")
    save(curves(named, PAPER_CURVES), folder / f"{name}_curves.png")
    caption = "Risk over the map, and stepwise team reward, over steps: mean and 95 % confidence interval."
    return embedded(folder / f"{name}.png", "Each seed (dots), mean and 95 % confidence interval.") + embedded(
        folder / f"{name}_curves.png", caption
    )


def _paper_figures(folder: Path, examples: Mapping[tuple[int, str], Evaluation]) -> str:
    parts = []
    for team in sorted({k for k, _ in examples}, reverse=True):
        methods = [m for m in SENSITIVE if (team, m) in examples]
        own = {m: examples[team, m] for m in methods}
        for name, caption, figure in (
            (
                f"paths_{team}_auvs.png",
                f"Paths and Bayes risk of {team} vehicles, before (top) and given all measurements (bottom).",
                path_figure(own),
            ),
            (
                f"reward_{team}_auvs.png",
                f"Team reward of {team} vehicles on one lake: with the naive path as terminal reward (augmented) and "
                "without (plain), with the time-varying lower bound and its maximum; stepwise (the paper's "
                "literal sum), and for the whole path.",
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


def _made(study: Study, done: Mapping[str, Sequence[Row]]) -> str:
    from importlib.metadata import version

    versions = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "dask"))
    busy = sum(r["busy_s"] or 0.0 for rows in done.values() for r in rows)
    settings = "; ".join(f"{n}: {len(s.settings)} settings × {len(s.seeds)} seeds" for n, s in study.campaigns.items())
    text = (
        f"Fleet engine of this project (one process, no ROS), Python {platform.python_version()}, {versions}, "
        f"{platform.machine()}, {os.cpu_count()} cores; {busy / 3600.0:.1f} core hours. Asked for: {settings}. "
        "Every seed draws its own lake, sensor errors and channel, the same for all methods. Rows with the complete "
        "parameters of every mission are in the campaigns' Parquet files; scripts/campaign --rerun flies any of them "
        "again."
    )
    return f"<p>{html.escape(text)}</p>"
