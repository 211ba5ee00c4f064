"""The page of auv_lse reproduce: claims, the paper's figures, tables over seeds, sensitivities."""

import json
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from auv_lse_common.support.plurals import counted
from auv_lse_shore.campaign.comparison_figures import PAPER_CURVES, comparison, curves, sweep_figure
from auv_lse_shore.campaign.rows import Row
from auv_lse_shore.judge.evaluation import Evaluation
from auv_lse_shore.report import figures
from auv_lse_shore.report.page import Picture, embed, render
from auv_lse_shore.reproduce.claims import CONTRADICTED, SUPPORTED, UNDECIDED, Claim, claims
from auv_lse_shore.reproduce.study import SENSITIVE, Study, trial_name
from auv_lse_shore.reproduce.study_figures import path_figure, reward_figure
from auv_lse_shore.reproduce.study_results import (
    COLUMNS,
    Groups,
    SweptRows,
    as_data,
    by_sweep,
    by_trial,
    cell_of,
    markdown,
    rows_by_campaign,
)

#: Columns of the sensitivities' figures.
SWEPT = ("risk_third", "risk_after", "isobath_error_m", "local_risk_error")

#: Campaigns that compare methods: heading, and what is different in them.
COMPARISONS = {
    "trials": ("Field trials over seeds", ""),
    "charted": (
        "With a coarse chart as prior",
        "The same lakes, with a chart as the prior mean of every map: the truth smoothed over 75 m, with errors of "
        "2.5 m.",
    ),
    "large": ("In an area four times as large", "1400 m × 1200 m, which three vehicles cannot cover completely."),
}

_MARKS = {SUPPORTED: "✔ supported", CONTRADICTED: "✘ contradicted", UNDECIDED: "? undecided"}


def write_page(study: Study, folder: Path, examples: Mapping[tuple[int, str], Evaluation]) -> Path:
    """Writes figures, `results.json`, `results.md` and `reproduce.html` from the rows so far; returns its path."""
    rows = rows_by_campaign(study, folder)
    done = {name: [r for r in found if r["status"] == "ok"] for name, found in rows.items()}
    failed = [r for found in rows.values() for r in found if r["status"] == "failed"]
    teams = {"trials": study.teams, "charted": study.teams, "large": (study.large_team,)}
    groups = {name: by_trial(done.get(name, []), own) for name, own in teams.items()}
    swept = by_sweep(study, done.get("sensitivity", []))
    found = claims(groups["trials"], groups["charted"])
    subtitle = _subtitle(study, done, failed)
    path = folder / "reproduce.html"
    path.write_text(
        render(
            "reproduce.html",
            "auv_lse_shore.reproduce",
            title="The paper, reproduced",
            subtitle=subtitle,
            cards=_counts(found),
            claims=found,
            evidence=lambda claim: [(e.prior, e.what, e.value, _MARKS[e.verdict]) for e in claim.evidence],
            paper_pictures=[_picture(folder, *drawn) for drawn in _paper_figures(examples)],
            header=["setting", "seeds", *(heading for _, heading in COLUMNS)],
            comparisons=[
                (*COMPARISONS[name], _table(own), [_picture(folder, *drawn) for drawn in _comparison(name, own)])
                for name, own in groups.items()
                if own or name == "trials"
            ],
            sensitivities=[_picture(folder, *drawn) for drawn in _sensitivities(swept)],
            failed=[[r["group"], r["seed"], r["error"]] for r in failed],
            method=_method(study, done),
        )
    )
    (folder / "results.json").write_text(json.dumps(as_data(found, groups), indent=2) + "\n")
    (folder / "results.md").write_text(markdown(found, groups, swept, subtitle))
    return path


def _subtitle(study: Study, done: Mapping[str, Sequence[Row]], failed: Sequence[Row]) -> str:
    flown = sum(map(len, done.values()))
    seeds = len({r["seed"] for r in done.get("trials", [])})
    small = "Small version (--quick): a small area, 40 steps, and too few missions for verdicts. "
    kind = small if study.name == "quick" else ""
    trials = f"{counted(seeds, 'seed')} in the trials"
    return f"{kind}{counted(flown, 'simulated mission')}, {trials}, {counted(len(failed), 'mission')} failed."


def _counts(found: Sequence[Claim]) -> list[tuple[int, str]]:
    verdicts = [e.verdict for claim in found for e in claim.evidence]
    return [(verdicts.count(v), f"measurements: {v}") for v in (SUPPORTED, UNDECIDED, CONTRADICTED)]


def _table(groups: Groups) -> list[list[Any]]:
    return [
        [trial_name(*key), len(rows), *(cell_of(rows, column) for column, _ in COLUMNS)] for key, rows in groups.items()
    ]


def _picture(folder: Path, name: str, figure: Figure, caption: str) -> Picture:
    figures.save(figure, folder / name)
    return embed(folder / name, caption)


def _comparison(name: str, groups: Groups) -> Iterator[tuple[str, Figure, str]]:
    named = {trial_name(*key): rows for key, rows in groups.items()}
    if named:
        yield f"{name}.png", comparison(named), "Each seed (dots), mean and 95 % confidence interval."
        caption = "Map risk and stepwise team reward over steps: mean and 95 % confidence interval."
        yield f"{name}_curves.png", curves(named, PAPER_CURVES), caption


def _paper_figures(examples: Mapping[tuple[int, str], Evaluation]) -> Iterator[tuple[str, Figure, str]]:
    for team in sorted({k for k, _ in examples}, reverse=True):
        own = {m: examples[team, m] for m in SENSITIVE if (team, m) in examples}
        caption = f"Paths and Bayes risk of {team} vehicles, before (top) and given all measurements (bottom)."
        yield f"paths_{team}_auvs.png", path_figure(own), caption
        caption = (
            f"Team reward of {team} vehicles on one lake: with the naive path as terminal reward (augmented) and "
            "without (plain), with the time-varying lower bound and its maximum. (a) Stepwise, the sum as the paper "
            "defines it. (b) For the whole path."
        )
        yield f"reward_{team}_auvs.png", reward_figure(own), caption
        if "augmented" in own:
            caption = "Posterior risk of each vehicle's own map, minus the posterior risk given all measurements."
            yield f"local_maps_{team}_auvs.png", figures.local_risk_error(own["augmented"]), caption


def _sensitivities(swept: SweptRows) -> Iterator[tuple[str, Figure, str]]:
    for sweep, lines in swept:
        seeds = len({r["seed"] for points in lines.values() for _, own in points for r in own})
        caption = f"Mean and 95 % confidence interval over {seeds} seeds against {sweep.label}"
        caption += "." if sweep.name == "team" else ", three vehicles."
        yield f"sensitivity_{sweep.name}.png", sweep_figure(lines, sweep.label, SWEPT), caption


def _method(study: Study, done: Mapping[str, Sequence[Row]]) -> str:
    versions = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "dask"))
    busy = sum(r["busy_s"] or 0.0 for rows in done.values() for r in rows)
    settings = "; ".join(f"{n}: {len(s.settings)} settings × {len(s.seeds)} seeds" for n, s in study.campaigns.items())
    return (
        f"This project's fleet engine (one process, no ROS), Python {platform.python_version()}, {versions}, "
        f"{platform.machine()}, {os.cpu_count()} cores; {busy / 3600.0:.1f} core hours. Requested: {settings}. "
        "Every seed draws its own lake, sensor errors and channel, the same for all methods. The campaigns' Parquet "
        "files hold every mission's complete parameters; auv_lse campaign --rerun repeats any of them."
    )
