"""Writes what a run folder holds besides the recording: summary, isobath, figures and one self-contained page."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from auv_lse_common.support.atomic_files import written_whole
from auv_lse_record.bag import write_mission_file
from auv_lse_record.run_data import RunData
from auv_lse_shore.judge import summary
from auv_lse_shore.judge.evaluation import Evaluation, evaluate
from auv_lse_shore.judge.summary import Summary
from auv_lse_shore.judge.team_map import write_isobath
from auv_lse_shore.report import report_figures, words
from auv_lse_shore.report.page_parts import embedded, facts, head, number, table


def write_report(run: RunData, folder: Path) -> Summary:
    """Judges a mission and writes `summary.json`, `isobath.geojson`, the figures as PNG and `report.html`.

    `mission.yaml` is written too if it is not there yet. Takes a few seconds for a default mission.

    Args:
        run: The mission.
        folder: Run folder, made if needed.

    Returns:
        The figures of merit.

    Raises:
        OSError: if it cannot be written; nothing of it is there then.
    """
    return write_outputs(evaluate(run), folder)


def write_outputs(evaluation: Evaluation, folder: Path) -> Summary:
    """As `write_report`, for a mission that is judged already."""
    with written_whole(folder) as part:
        if not (folder / "mission.yaml").exists():
            write_mission_file(part / "mission.yaml", evaluation.run.parameters)
        evaluation.summary.write(part / "summary.json")
        write_isobath(evaluation.team_map, part / "isobath.geojson", evaluation.run.origin, evaluation.truth)
        drawn = report_figures.draw_all(evaluation, part)
        (part / "report.html").write_text(page(evaluation, part, drawn))
    return evaluation.summary


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
    pictures = [(name, embedded(folder / name, caption)) for name, caption in drawn]
    parts.append(pictures[0][1])
    parts.append("<h2>What was found</h2>" + _text(words.paragraphs(e)))
    others = [picture for name, picture in pictures[1:] if name != report_figures.PAPERS]
    parts.append("<h2>Figures</h2>" + "".join(others))
    if papers := words.paper_paragraphs(s):
        own = [picture for name, picture in pictures if name == report_figures.PAPERS]
        parts.append("<h2>The paper's own reward</h2>" + _text(papers) + "".join(own))
    parts.append("<h2>Vehicles</h2>" + _vehicle_table(e))
    parts.append("<h2>Every figure of <code>summary.json</code></h2>" + _summary_table(s))
    parts.append("<h2>Parameters</h2>" + _parameter_tables(e.run.parameters))
    return "\n".join(parts) + "\n</body></html>\n"


def _text(paragraphs: Sequence[str]) -> str:
    return "".join(f"<p>{html.escape(text)}</p>" for text in paragraphs)


def _subtitle(e: Evaluation) -> str:
    s = e.summary
    level = e.settings[0].level_set.level_m
    wall = "" if s.wall_s is None else f", flown in {s.wall_s:.1f} s of wall-clock time"
    return f"Looking for the {level:g} m isobath; {s.sim_s / 60.0:.1f} min of mission time{wall}."


def _facts(s: Summary) -> list[tuple[str, str]]:
    rows = [(f"{s.isobath_found_m:,.0f} m", "of isobath found")]
    if s.isobath_found_error_m is not None:
        rows.insert(0, (f"{s.isobath_found_error_m:.1f} m", "isobath error: mean distance of what was found"))
    if s.isobath_found is not None:
        rows.append((f"{100.0 * s.isobath_found:.0f} %", "of the true isobath found"))
    rows.append((f"{number(s.risk_before, 3)} → {number(s.risk_after, 3)}", "risk of the map (cost per place)"))
    if s.mowing_risk is not None:
        what = "risk expected of mowing the lawn" + (": the bound" if s.map_bound_promised else "")
        rows.append((number(s.mowing_risk, 3), what))
    rows.append((number(s.loss_expected, 3), "loss that the map expects (cost per place)"))
    if s.loss_after is not None:
        rows.append((number(s.loss_after, 3), "true loss of the map (cost per place)"))
    if s.delivery is not None:
        rows.append((f"{100.0 * s.delivery:.0f} %", f"of receptions succeeded ({s.packets_sent} packets sent)"))
    return rows


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
                number(s.alone_risk[i], 3),
                number(s.local_risk[i], 3),
                number(s.local_risk_error[i], 3),
                number(s.local_f1[i] if s.local_f1 else None),
                number(s.navigation_error_m[i] if s.navigation_error_m else None, 3),
                number(s.place_error_m[i] if s.place_error_m else None, 3),
            ]
        )
    header = [
        "vehicle", "steps", "distance (m)", "soundings", "samples heard", "packets sent / heard",
        "risk, own soundings alone (cost/place)", "own map: risk (cost/place)",
        "its error (cost/place)", "its F1", "navigation RMS (m)", "soundings off, as mapped (m)",
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
