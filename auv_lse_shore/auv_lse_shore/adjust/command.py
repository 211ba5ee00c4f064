"""auv_lse adjust: the command line."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from auv_lse_common.support.atomic_files import check_folder, written_whole
from auv_lse_common.support.plurals import counted
from auv_lse_record.run_reader import read_run
from auv_lse_shore.adjust.report import report, write_before_and_after
from auv_lse_shore.areas.area_file import read_area
from auv_lse_shore.export.content import Export
from auv_lse_shore.export.export import about_depths, write_formats
from auv_lse_shore.export.options import add_survey_options, survey_of
from auv_lse_shore.export.survey import Survey
from auv_lse_shore.judge.evaluation import Evaluation, evaluate
from auv_lse_shore.judge.team_map import TeamMap, adjusted_map, mission_settings
from auv_lse_shore.judge.true_ground import set_true_ground
from auv_lse_shore.positions.adjustment import AdjustError, adjust
from auv_lse_shore.positions.merging import on_one_clock
from auv_lse_shore.positions.recordings import missing_in

ERRORS = (ValueError, OSError)
INTERRUPTED = "stopped; the folder has all files of this adjustment, or is as it was"


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse adjust."""
    p = argparse.ArgumentParser(
        prog="auv_lse adjust",
        description="Re-estimates the positions of all soundings of one or more runs from all recorded data: fixes, "
        "ranges between vehicles, and track crossings. Writes the adjusted soundings, map and isobath (as "
        "auv_lse export does), before_and_after.csv with both positions of every sounding, and moved.md, a summary. "
        "Estimates from the packets how far the clocks are apart, and corrects it.",
        epilog="Give recordings of one dive by several vehicles, or of several dives in one local frame, in one call. "
        "The accuracy of compass and DVL comes from section positions of the first run's mission file. Recordings "
        "are only read; a second call replaces the files of the first. "
        "Exit codes: 0 success; 2 the runs cannot be adjusted, or wrong command line; 130 Ctrl-C.",
    )
    p.add_argument("runs", type=Path, nargs="+", metavar="RUN", help="run folder, or a recording")
    p.add_argument("--mission", type=Path, metavar="FILE", help="mission file, for recordings without one")
    p.add_argument("--out", type=Path, metavar="DIR", help="output folder (default: adjusted in the first RUN)")
    p.add_argument("--report", action="store_true", help="also write report.html of all vehicles of the dive")
    add_survey_options(p)
    return p


def run(options: argparse.Namespace) -> None:
    """Adjusts runs."""
    first: Path = options.runs[0]
    folder = options.out or (first if first.is_dir() else first.parent) / "adjusted"
    check_folder(folder)
    for line in adjusted(options.runs, folder, options.mission, survey_of(options), options.report):
        print(line, flush=True)


def adjusted(
    paths: Sequence[Path],
    folder: Path,
    mission: Path | None = None,
    survey: Survey | None = None,
    with_report: bool = False,
) -> Iterator[str]:
    """Adjusts the runs at `paths` into `folder`; yields its progress, line by line.

    Args:
        paths: Run folders or recordings.
        folder: Where the files go, made if needed.
        mission: Mission file of recordings without one.

    Raises:
        SurveyError: if a correction does not cover a recording.
        AdjustError: if nothing can be adjusted, naming what is missing, or a report of several dives is asked for.
        RecordingError, ParameterError: if a run cannot be read.
    """
    survey, recorded = survey or Survey(), []
    for path in paths:
        yield f"reading {path}"
        recorded.append(read_run(path, mission=mission, read_area=read_area))
        yield from (f"  {note}" for note in recorded[-1].notes)
        for vehicle in recorded[-1].vehicles:
            if missing := missing_in(vehicle):
                yield f"  auv{vehicle.vehicle}: {missing}; its soundings are not moved"
    shifted, offsets = on_one_clock(recorded)
    for path, offset in zip(paths, offsets, strict=True):
        if offset:
            yield f"{path}: its clock is {offset:+z.1f} s off that of {paths[0]}; its times are shifted"
    runs = [survey.reduce(run) for run in shifted]
    yield from (note for run, before in zip(runs, shifted, strict=True) for note in run.notes[len(before.notes) :])
    names = [path.resolve().name for path in paths]
    vehicles = [vehicle for run in runs for vehicle in run.vehicles]
    soundings = counted(sum(len(v.soundings) for v in vehicles), "sounding")
    yield f"estimating positions: {soundings} of {counted(len(vehicles), 'vehicle')}"
    adjustment = adjust(runs, crossings=True)
    text = report(adjustment, runs, names)
    yield text.rstrip("\n")
    if with_report:
        set_true_ground(adjustment.runs[0], str(paths[0]))
    team = adjusted_map(adjustment, mission_settings(runs[0].parameters, runs[0].vehicles[0].vehicle)[-1])
    evaluation = _evaluated(team) if with_report else None
    yield f"writing to {folder}"
    discarded = set[str]()
    with written_whole(folder, discarded) as part:
        (part / "moved.md").write_text(text)
        count = write_before_and_after(part / "before_and_after.csv", adjustment, runs, names)
        yield f"  moved.md, before_and_after.csv ({counted(count, 'sounding')})"
        if evaluation is not None:
            yield from _report(evaluation, part, folder)
        content = Export(team=team, folder=part, survey=survey, discarded=discarded)
        yield from write_formats(content)
    yield from about_depths(content)


def _evaluated(team: TeamMap) -> Evaluation:
    """Evaluates all vehicles of a dive."""
    numbers = [vehicle.vehicle for vehicle in team.run.vehicles]
    if len(set(numbers)) < len(numbers):
        raise AdjustError(
            "--report needs the recordings of one dive, but these are of vehicles "
            f"{', '.join(f'auv{number}' for number in numbers)}. Leave --report out for several dives"
        )
    return evaluate(team.run, team=team, on_two_cores=True)


def _report(evaluation: Evaluation, part: Path, folder: Path) -> Iterator[str]:
    """Writes the report of all vehicles of a dive into `part`, for `folder`; yields the main figures."""
    from auv_lse_shore.report.report import write_outputs  # slow to import
    from auv_lse_shore.report.words import headlines

    summary = write_outputs(evaluation, part)
    if (folder / "mission.yaml").exists():  # a run's own stays
        (part / "mission.yaml").unlink()
    yield "  report.html"
    yield from headlines(summary, evaluation.planned_steps, evaluation.run)
