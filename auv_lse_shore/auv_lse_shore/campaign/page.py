"""The page of a campaign: settings compared over seeds, failures, and the command that reruns a mission."""

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from auv_lse_common.support.plurals import counted
from auv_lse_shore.campaign.comparison_figures import (
    HEADINGS,
    MAIN,
    MAP_CURVES,
    MAX_CURVES,
    MEASURES,
    comparison,
    curves,
    sweep_figure,
)
from auv_lse_shore.campaign.reliability_figure import MAX_SETTINGS, reliability_figure, with_reliability
from auv_lse_shore.campaign.rows import Row, Rows, by_group, by_seed, columns_of, mean_of, rows_of, value_of
from auv_lse_shore.campaign.runner import CampaignState
from auv_lse_shore.campaign.spec import CampaignSpec, short
from auv_lse_shore.campaign.statistics import paired
from auv_lse_shore.judge.quantity_names import P_DEEP
from auv_lse_shore.report.figures import save
from auv_lse_shore.report.page import embed, number, render

_COMPARISON = (
    "Every setting: each seed's result (dots), the mean and its 95 % confidence interval, which a panel may cut off."
)
#: Most settings that the page names as no worse than the best.
_NAMED = 5
#: Parameters that change the ground of a seed.
_GROUND = ("sim.lake.", "sim.bathymetry.")
_CURVES = (
    "Map risk over steps, and the map risk expected at the end with the current plans: mean over seeds and 95 % "
    "confidence interval."
)
_RELIABILITY = (
    f"Left: share of locations that are safe against the {P_DEEP} that the final maps report; on the dotted line a map "
    "is calibrated, above it conservative, below it overconfident. Right: how the locations spread over it. All "
    "locations of all missions of a setting; 95 % bootstrap interval over missions."
)


def write_results(spec: CampaignSpec, folder: Path, state: CampaignState) -> Path:
    """Writes all rows in one table, the progress and the page of a campaign; returns the page's path."""
    kept = Rows(folder, columns_of(spec))
    rows = rows_of(spec, kept.read())
    kept.write_table(rows)
    if state.done:
        facts = {k: v for k, v in dataclasses.asdict(state).items() if k != "last"}
        facts["efficiency"] = state.efficiency
        (folder / "progress.json").write_text(json.dumps(facts, indent=2) + "\n")
    return write_page(spec, rows, folder)


def write_page(spec: CampaignSpec, rows: Sequence[Row], folder: Path) -> Path:
    """Writes the figures and `campaign.html`; returns the page's path."""
    groups = by_group(spec, rows)
    failed = [row for row in rows if row["status"] == "failed"]
    pictures = []
    for name, figure, caption in _figures(spec, groups):
        save(figure, folder / name)
        pictures.append(embed(folder / name, caption))
    path = folder / "campaign.html"
    path.write_text(
        render(
            "campaign.html",
            "auv_lse_shore.campaign",
            title=f"Campaign {spec.name}",
            subtitle=f"{counted(len(spec.settings), 'setting')}, {counted(len(spec.seeds), 'seed')}, "
            f"{counted(len(spec.settings) * len(spec.seeds), 'mission')}; "
            f"{sum(map(len, groups.values()))} finished, {len(failed)} failed.",
            cards=list(_best(groups)),
            same_lakes=not any(name.startswith(_GROUND) for name in spec.varied),
            header=["setting", "seeds", *HEADINGS.values()],
            settings=[[label, len(own), *(_mean(own, column) for column in HEADINGS)] for label, own in groups.items()],
            pictures=pictures,
            failed=[[row["id"], row["group"], row["seed"], row["error"] or ""] for row in failed],
            folder=folder,
            mission_header=["id", "setting", "seed", "status", *(HEADINGS[c] for c in MAIN), "note"],
            missions=list(_missions(spec, rows)),
        )
    )
    return path


def _figures(spec: CampaignSpec, groups: Mapping[str, Sequence[Row]]) -> Iterator[tuple[str, Figure, str]]:
    """File name, figure and caption of everything that can be drawn."""
    if not groups:
        return
    yield "comparison.png", comparison(groups), _COMPARISON
    yield "risk_curves.png", curves(groups, MAP_CURVES), _CURVES + _first(MAX_CURVES, groups)
    if (reliability := reliability_figure(groups)) is not None:
        yield "reliability.png", reliability, _RELIABILITY + _first(MAX_SETTINGS, with_reliability(groups))
    for name in spec.varied:
        if (figure := sweep(spec, groups, name)) is not None:
            caption = f"Mean and 95 % confidence interval over seeds against {name}."
            yield f"sweep_{name.replace('.', '_')}.png", figure, caption


def _first(most: int, groups: Mapping[str, Sequence[Row]]) -> str:
    """A sentence on the settings that a figure leaves out; "" if it shows all."""
    return f" Only the first {most} of the {len(groups)} settings are shown." if len(groups) > most else ""


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
            short(k, varied[label][k], spec.varied) for k in spec.varied if k != name and k in varied[label]
        )
        lines.setdefault(rest, []).append((float(values[label] or 0.0), rows))
    return sweep_figure(lines, name.split(".")[-1].replace("_", " "))


def _best(groups: Mapping[str, Sequence[Row]]) -> Iterator[tuple[str, str]]:
    """The best mean in each of the first measures, and the settings that are best within the noise.

    Means are over the seeds of which all settings have the measure: one that finds no line on a hard lake has no error
    there. A setting is among the best if the 95 % interval of its paired difference to the best mean includes 0, or
    does not exist.
    """
    for column, heading, more in MEASURES[:3]:
        known = {label: _finite(by_seed(rows, column)) for label, rows in groups.items()}
        known = {label: values for label, values in known.items() if values}
        shared = set.intersection(*map(set, known.values())) if known else set()
        if len(known) < 2 or not shared:
            continue
        values = {label: {seed: own[seed] for seed in shared} for label, own in known.items()}
        means = {label: sum(own.values()) / len(shared) for label, own in values.items()}
        best = (max if more else min)(means, key=lambda name: means[name])
        apart = {label: paired(own, values[best]) for label, own in values.items()}
        tied = [label for label, d in apart.items() if label != best and not (d.low > 0.0 or d.high < 0.0)]
        names = "; ".join(tied) if len(tied) <= _NAMED else f"{len(tied)} others"
        others = f" (not significantly better than {names})" if tied else ""
        most, lacking = max(map(len, groups.values())), len(groups) - len(known)
        all_of = "all other settings" if lacking else "every setting"
        seeds = f"{len(shared)} of {most} seeds"
        over = f", over the {seeds} with a value for {all_of}" if len(shared) < most else ""
        over += f" ({counted(lacking, 'setting')} {'has' if lacking == 1 else 'have'} no value)" if lacking else ""
        yield number(means[best]), f"best mean {heading}{over}: {best}{others}"


def _finite(values: Mapping[int, float | None]) -> dict[int, float]:
    return {seed: value for seed, value in values.items() if value is not None and math.isfinite(value)}


def _mean(rows: Sequence[Row], column: str) -> str:
    """The mean of a column with its interval, and with the number of seeds if some have no value."""
    found = mean_of(rows, column)
    return f"{found} ({found.count} of {len(rows)} seeds)" if 0 < found.count < len(rows) else str(found)


def _missions(spec: CampaignSpec, rows: Sequence[Row]) -> Iterator[list[str]]:
    """A row for each mission, setting by setting."""
    order = {label: i for i, (label, _) in enumerate(spec.settings)}
    for r in sorted(rows, key=lambda r: (order[r["group"]], r["seed"] or 0)):
        measures = [number(value_of(r, column)) for column in MAIN]
        yield [r["id"], r["group"], str(r["seed"]), r["status"], *measures, r["error"] or ""]
