"""Writes what a run folder holds besides the recording: summary, isobath, figures and one self-contained page."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.parameters import flatten
from auv_lse_common.support.atomic_files import written_whole
from auv_lse_common.support.plurals import counted
from auv_lse_common.vocabulary.health import LEGS_LEFT, LEGS_PLANNED
from auv_lse_record.run_data import RunData
from auv_lse_record.run_writer import write_mission_file
from auv_lse_shore.judge import summary
from auv_lse_shore.judge.evaluation import Evaluation, evaluate
from auv_lse_shore.judge.quantity_names import MAP_RISK
from auv_lse_shore.judge.summary import Summary
from auv_lse_shore.judge.team_map import write_isobath
from auv_lse_shore.report import report_figures, words
from auv_lse_shore.report.page import embed, number, render
from auv_lse_shore.report.progress import Show, show_nothing

#: Columns of the table of vehicles; those without any value are left out.
VEHICLE_COLUMNS = (
    "vehicle", "steps", "distance (m)", "soundings", "samples received", "packets sent / received",
    f"{MAP_RISK}, own soundings only", f"{MAP_RISK}, own map", "difference to team map",
    "F1, own map", "position error, RMS (m)", "sounding error, RMS (m)", "legs left / planned",
)  # fmt: skip


def write_report(run: RunData, folder: Path, show: Show = show_nothing) -> Summary:
    """Evaluates a mission and writes `summary.json`, `isobath.geojson`, the figures as PNG and `report.html`.

    `mission.yaml` is written too if it is not there yet. Takes a few seconds for a default mission.

    Args:
        folder: Run folder, created if needed.

    Raises:
        OSError: if the files cannot be written; the folder then has none of them.
    """
    show(f"computing maps and bounds from {counted(sum(len(v.soundings) for v in run.vehicles), 'sounding')}")
    evaluation = evaluate(run, on_two_cores=True)
    show("drawing figures")
    summary = write_outputs(evaluation, folder)
    show("")
    return summary


def write_outputs(evaluation: Evaluation, folder: Path) -> Summary:
    """Like `write_report`, for a mission that is already evaluated."""
    with written_whole(folder) as part:
        if not (folder / "mission.yaml").exists():
            write_mission_file(part / "mission.yaml", evaluation.run.parameters)
        evaluation.summary.write(part / "summary.json")
        write_isobath(evaluation.team_map, part / "isobath.geojson", evaluation.run.origin, evaluation.truth)
        drawn = report_figures.draw_all(evaluation, part)
        (part / "report.html").write_text(page(evaluation, part, drawn))
    return evaluation.summary


def page(e: Evaluation, folder: Path, drawn: Sequence[tuple[str, str]]) -> str:
    """The report as one HTML file.

    Args:
        drawn: File name and caption of each figure.
    """
    s, planned = e.summary, e.planned_steps
    steps = counted(s.steps, "step") if s.steps >= planned else f"{s.steps} of {counted(planned, 'step')}"
    setting = f"{counted(s.vehicles, 'AUV')}, {steps}, goal {s.goal}, method {s.method}, seed {s.seed}"
    pictures = {name: embed(folder / name, caption) for name, caption in drawn}
    paper = pictures.pop(report_figures.PAPER, None)
    columns = list(zip(VEHICLE_COLUMNS, *_vehicles(e), strict=True))
    vehicle_header, *vehicles = zip(*(column for column in columns if {*column[1:]} != {"–"}), strict=True)
    return render(
        "report.html",
        title=f"{e.settings[0].level_set.level_m:g} m isobath",
        subtitle=words.subtitle(e),
        opening=[line.split(": ", 1) for line in words.opening(s)],
        cards=words.cards(e),
        findings=words.findings(e),
        setting=setting if s.steps else "",
        quality=words.quality_cards(s),
        notes=[*words.ended_early(s, planned), *words.batteries(e.run), *e.run.notes],
        pictures=list(pictures.values()),
        results=words.paragraphs(e),
        paper=words.paper_paragraphs(s),
        paper_pictures=[paper] if paper else [],
        vehicle_header=vehicle_header,
        vehicles=vehicles,
        summary=[(key, number(getattr(s, key)), unit, meaning) for key, unit, meaning in summary.table()],
        parameters=list(_parameters(e.run.parameters)),
    )


def _vehicles(e: Evaluation) -> list[list[str]]:
    """A row of `VEHICLE_COLUMNS` for each vehicle."""
    s = e.summary
    each: list[Any] = [s.alone_risk, s.local_risk, s.local_risk_error]
    optional = [(s.local_f1, 4), (s.navigation_error_m, 3), (s.position_error_m, 3)]
    return [
        [
            f"auv{vehicle.vehicle}",
            str(vehicle.steps),
            f"{s.distance_m[i]:,.0f}",
            str(len(vehicle.soundings)),
            str(len(vehicle.received)),
            f"{sum(p.source == vehicle.vehicle for p in e.run.sent)} / "
            f"{sum(p.receiver == vehicle.vehicle for p in e.run.received)}",
            *(number(values[i], 3) for values in each),
            *(number(values[i] if values else None, digits) for values, digits in optional),
            f"{vehicle.battery[LEGS_LEFT]} / {vehicle.battery.get(LEGS_PLANNED, '–')}" if vehicle.battery else "–",
        ]
        for i, vehicle in enumerate(e.run.vehicles)
    ]


def _parameters(parameters: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """Each section of the mission file with its parameters, dotted names where they are nested."""
    for pattern, sections in parameters.items():
        for section, content in sections.items():
            name = section if pattern == "/**" else f"{section} ({pattern})"
            flat = flatten(content if isinstance(content, Mapping) else {"": content})
            yield name, [(key, str(value)) for key, value in flat.items()]
