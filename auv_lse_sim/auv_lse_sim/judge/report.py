"""Writes what a run folder holds besides the recording: summary, isobath, figures and one self-contained page."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_sim.judge import figures, isobath, summary
from auv_lse_sim.judge.evaluation import Evaluation, evaluate
from auv_lse_sim.judge.page_parts import embedded, facts, head, number, table
from auv_lse_sim.judge.summary import Summary
from auv_lse_sim.record.bag import write_mission_file
from auv_lse_sim.record.run_data import RunData


def write_report(run: RunData, folder: Path) -> Summary:
    """Judges a mission and writes `summary.json`, `isobath.geojson`, the figures as PNG and `report.html`.

    `mission.yaml` is written too if it is not there yet. Takes a few seconds for a default mission.

    Args:
        run: The mission.
        folder: Run folder, made if needed.

    Returns:
        The figures of merit.
    """
    return write_outputs(evaluate(run), folder)


def write_outputs(evaluation: Evaluation, folder: Path) -> Summary:
    """As `write_report`, for a mission that is judged already."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "mission.yaml").exists():
        write_mission_file(folder / "mission.yaml", evaluation.run.parameters)
    evaluation.summary.write(folder / "summary.json")
    write_isobath(evaluation, folder / "isobath.geojson")
    drawn = figures.draw_all(evaluation, folder)
    (folder / "report.html").write_text(page(evaluation, folder, drawn))
    return evaluation.summary


def write_isobath(e: Evaluation, path: Path) -> None:
    """Writes the estimated isobath, the 95 % band about it and, where known, the true one as GeoJSON."""
    level = e.settings[0].level_set.level_m
    common = {"depth_m": level, "seed": e.summary.seed, "method": e.summary.method}
    grid = e.team.grid
    with np.errstate(invalid="ignore", divide="ignore"):
        score = (e.team.mean_m - level) / np.maximum(e.team.std_m, 1e-9)
    features: list[tuple[Mapping[str, Any], list[Any]]] = [
        ({"name": "estimated isobath", "length_m": round(e.summary.isobath_length_m, 1), **common}, e.estimate)
    ]
    for name, side in (("shallow edge of the 95 % band", -1.0), ("deep edge of the 95 % band", 1.0)):
        lines = isobath.trace(grid.north_m, grid.east_m, score, side * 1.959964)
        features.append(({"name": name, **common}, lines))
    if e.truth:
        features.append(({"name": "true isobath", **common}, e.truth))
    isobath.write_geojson(path, features, e.run.origin)


def page(e: Evaluation, folder: Path, drawn: Sequence[tuple[str, str]]) -> str:
    """The report as one HTML file: images embedded, no script, nothing fetched."""
    s = e.summary
    title = f"{s.vehicles} AUV{'s' if s.vehicles > 1 else ''}, {s.steps} steps, {s.method}, seed {s.seed}"
    parts = [
        head(title),
        f"<h1>Isobath mission: {html.escape(title)}</h1>",
        f'<p class="sub">{html.escape(_subtitle(e))}</p>',
        facts(_facts(s)),
    ]
    if e.run.notes:
        parts.append("".join(f'<p class="note">{html.escape(note)}</p>' for note in e.run.notes))
    parts.append("<h2>What happened</h2>" + "".join(f"<p>{html.escape(text)}</p>" for text in _story(s)))
    parts.append("<h2>Figures</h2>" + "".join(embedded(folder / name, caption) for name, caption in drawn))
    parts.append("<h2>Vehicles</h2>" + _vehicle_table(e))
    parts.append("<h2>Every figure of <code>summary.json</code></h2>" + _summary_table(s))
    parts.append("<h2>Parameters</h2>" + _parameter_tables(e.run.parameters))
    return "\n".join(parts) + "\n</body></html>\n"


def _subtitle(e: Evaluation) -> str:
    s = e.summary
    level = e.settings[0].level_set.level_m
    wall = "" if s.wall_s is None else f", flown in {s.wall_s:.1f} s of wall-clock time"
    return f"Looking for the {level:g} m isobath; {s.sim_s / 60.0:.1f} min of mission time{wall}."


def _facts(s: Summary) -> list[tuple[str, str]]:
    rows = [
        (f"{number(s.risk_before, 3)} → {number(s.risk_after, 3)}", "mean Bayes risk per place (units of cost)"),
        (number(s.team_reward, 4), "team reward, stepwise (units of cost)"),
        (
            f"{number(s.path_reward, 4)} / {number(s.lawnmower_value, 4)}",
            "whole-path reward / expected of the lawnmower",
        ),
    ]
    if s.f1 is not None:
        rows.append((f"{s.f1:.4f}", "F1 of the classification"))
    if s.misclassified_m2 is not None:
        share = 100.0 * s.misclassified_m2 / s.area_m2
        rows.append((f"{s.misclassified_m2:,.0f} m² ({share:.2f} %)", "misclassified"))
    if s.isobath_error_m is not None:
        rows.append((f"{s.isobath_error_m:.2f} m", "mean distance to the true isobath"))
    if s.isobath_found is not None:
        rows.append((f"{100.0 * s.isobath_found:.1f} %", "of the true isobath found to within 10 m"))
    if s.delivery is not None:
        rows.append(
            (f"{100.0 * s.delivery:.0f} %", f"of receptions succeeded ({s.packets_received}; {s.packets_sent} packets)")
        )
    if s.vehicles > 1:
        rows.append((number(max(s.local_risk_error), 3), "largest local-map risk error (units of cost per place)"))
    return rows


def _story(s: Summary) -> list[str]:
    texts = []
    if s.bound_kept is not None and s.lower_bound is not None:
        verb = "ended above" if s.bound_kept else "ended below"
        texts.append(
            f"Stepwise, the team reward of {number(s.team_reward)} {verb} the largest lower bound of "
            f"{number(s.lower_bound)}. That sum and that bound do not telescope (a naive part is credited against the "
            "data of today at all its places, a leg only against what was left when it was travelled), so this "
            "comparison says little about the mission; the next one does."
        )
    if s.path_bound_kept is not None:
        verb = "above" if s.path_bound_kept else "below"
        texts.append(
            f"As one path, the mission's reward of {number(s.path_reward)} is {verb} the {number(s.lawnmower_value)} "
            "expected at the start of mowing the lawn."
        )
    if s.f1 is not None and s.f1_true_positions is not None and s.navigation_error_m is not None:
        gain = (s.misclassified_m2 or 0.0) - (s.misclassified_true_positions_m2 or 0.0)
        texts.append(
            f"Navigation error was {number(s.navigation_error_m, 3)} m RMS. With the soundings booked at their true "
            f"positions, {abs(gain):,.0f} m² {'less' if gain >= 0 else 'more'} would be misclassified "
            f"({number(s.misclassified_true_positions_m2)} instead of {number(s.misclassified_m2)} m²), and the "
            f"isobath would be off by {number(s.isobath_error_true_positions_m, 3)} instead of "
            f"{number(s.isobath_error_m, 3)} m."
        )
    if s.loss_after is not None:
        texts.append(
            f"The map expects errors worth {number(s.risk_after, 3)} per place; they really cost "
            f"{number(s.loss_after, 3)}."
        )
    return texts


def _vehicle_table(e: Evaluation) -> str:
    s = e.summary
    rows = []
    for i, vehicle in enumerate(e.run.vehicles):
        sent = sum(p.source == vehicle.vehicle for p in e.run.sent)
        heard = sum(p.receiver == vehicle.vehicle for p in e.run.received)
        rows.append(
            [
                f"auv{vehicle.vehicle}",
                str(vehicle.steps),
                f"{s.distance_m[i]:,.0f}",
                str(len(vehicle.soundings)),
                str(len(vehicle.received)),
                f"{sent} / {heard}",
                number(float(e.curves.per_vehicle[i].sum())),
                number(s.local_risk[i], 3),
                number(s.local_risk_error[i], 3),
                number(s.local_f1[i] if s.local_f1 else None),
                number(s.navigation_error_m[i] if s.navigation_error_m else None, 3),
            ]
        )
    header = [
        "vehicle", "steps", "distance (m)", "soundings", "samples heard", "packets sent / heard", "reward (cost)",
        "own map: risk (cost/place)", "its error (cost/place)", "its F1", "navigation RMS (m)",
    ]  # fmt: skip
    return table(header, rows, ["n"] * len(header))


def _summary_table(s: Summary) -> str:
    rows = [
        [f"<code>{key}</code>", html.escape(number(getattr(s, key))), unit, html.escape(meaning)]
        for key, unit, meaning in summary.table()
    ]
    return table(["key", "value", "unit", "meaning"], rows, ["", "n", "u", ""])


def _parameter_tables(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    parts = []
    for pattern, values in parameters.items():
        for section, content in values.items():
            flat = _flat(content) if isinstance(content, Mapping) else {"": content}
            rows = [[f"<code>{html.escape(k)}</code>", html.escape(str(v))] for k, v in flat.items()]
            name = html.escape(f"{section}" if pattern == "/**" else f"{section} ({pattern})")
            parts.append(f"<details><summary><b>{name}</b></summary>{table(['parameter', 'value'], rows)}</details>")
    return "".join(parts)


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            flat.update(_flat(value, f"{prefix}{key}."))
        else:
            flat[prefix + str(key)] = value
    return flat
