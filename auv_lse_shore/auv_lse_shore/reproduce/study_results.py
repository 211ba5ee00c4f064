"""The results of a study: rows by setting, tables and claims as text and as data."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_shore.campaign.rows import Row, Rows, columns_of, mean_of, rows_of
from auv_lse_shore.campaign.statistics import proportion
from auv_lse_shore.report.page import render
from auv_lse_shore.reproduce.claims import Claim
from auv_lse_shore.reproduce.study import METHODS, Study, Sweep, sweep_name, trial_name

#: Finished rows by team size and method.
Groups = Mapping[tuple[int, str], Sequence[Row]]


#: Rows at each point of a sensitivity, by method.
Lines = dict[str, list[tuple[float, Sequence[Row]]]]
SweptRows = Sequence[tuple[Sweep, Lines]]

#: Columns of the main table: key, heading.
COLUMNS = (
    ("team_reward", "team reward, stepwise (cost)"),
    ("bound_kept", "above stepwise bound (share)"),
    ("path_reward", "path reward (cost)"),
    ("path_bound_kept", "above lawnmower's value (share)"),
    ("risk_third", "map risk after a third (cost per location)"),
    ("risk_after", "final map risk (cost per location)"),
    ("f1", "F1"),
    ("isobath_error_m", "isobath error (m)"),
    ("isobath_found", "isobath found (share)"),
    ("misclassified_m2", "misclassified (m²)"),
    ("local_risk_error", "own-map risk difference (cost per location)"),
    ("delivery", "packets received (share)"),
    ("planning_median_s", "median decision time (s)"),
)


#: Columns of the tables of sensitivities: key, name with unit.
SWEPT = {
    "risk_after": "final map risk (cost per location)",
    "isobath_error_m": "isobath error (m)",
    "local_risk_error": "own-map risk difference (cost per location)",
}


def rows_by_campaign(study: Study, folder: Path) -> dict[str, list[Row]]:
    """The rows of each of a study's campaigns so far, failed ones included."""
    return {
        name: [*rows_of(spec, Rows(folder / name, columns_of(spec)).read())] for name, spec in study.campaigns.items()
    }


def by_trial(rows: Sequence[Row], teams: Sequence[int]) -> dict[tuple[int, str], list[Row]]:
    """Rows of the trials by team size and method; those without any are left out."""
    groups = {(k, m): [r for r in rows if r["group"] == trial_name(k, m)] for k in teams for m in METHODS}
    return {key: found for key, found in groups.items() if found}


def by_sweep(study: Study, rows: Sequence[Row]) -> list[tuple[Sweep, Lines]]:
    """The rows of each sensitivity so far."""
    swept = []
    for sweep in study.sweeps:
        lines: Lines = {}
        for method in METHODS:
            for value, _ in sweep.points:
                found = [r for r in rows if r["group"] == sweep_name(sweep, value, method)]
                if found:
                    lines.setdefault(method, []).append((value, found))
        if lines:
            swept.append((sweep, lines))
    return swept


def markdown(found: Sequence[Claim], groups: Mapping[str, Groups], swept: SweptRows, subtitle: str) -> str:
    """Tables and claims as text, for a document."""
    return render(
        "results.md",
        "auv_lse_shore.reproduce",
        subtitle=subtitle,
        claims=found,
        groups=groups,
        swept=swept,
        columns={key: heading for key, heading in COLUMNS if key not in ("bound_kept", "isobath_found")},
        measures=SWEPT,
        trial_name=trial_name,
        cell_of=cell_of,
        points=_points,
    )


def _points(sweep: Sweep, lines: Lines) -> Iterator[tuple[str, list[str], int]]:
    """Value, a cell for each method, and number of seeds of each point of a sensitivity."""
    for value, _ in sweep.points:
        at = [dict(points).get(value, ()) for points in lines.values()]
        cells = ["; ".join(cell_of(rows, column) for column in SWEPT) for rows in at]
        yield f"{value:g}", cells, max(map(len, at))


def cell_of(rows: Sequence[Row], column: str) -> str:
    """A column's mean with its interval, and the number of missions with a value if some have none."""
    values = [r.get(column) for r in rows]
    if any(isinstance(v, bool) for v in values):
        return proportion(values)
    mean = mean_of(rows, column)
    return f"{mean}" if mean.count == len(rows) else f"{mean} ({mean.count} of {len(rows)})"


def as_data(found: Sequence[Claim], campaigns: Mapping[str, Groups]) -> dict[str, Any]:
    """Claims and tables as plain data, for JSON: a mean as [mean, low, high], None where unknown."""
    tables: dict[str, list[dict[str, Any]]] = {}
    for name, groups in campaigns.items():
        tables[name] = []
        for (vehicles, method), rows in groups.items():
            entry: dict[str, Any] = {"vehicles": vehicles, "method": method, "seeds": len(rows)}
            for column, _ in COLUMNS:
                mean = mean_of(rows, column)
                entry[column] = [v if np.isfinite(v) else None for v in (mean.mean, mean.low, mean.high)]
            tables[name].append(entry)
    return {"claims": [asdict(claim) for claim in found], **tables}
