"""Recomputes a recorded mission's maps and decisions, and reports what differs."""

import csv
import io
from argparse import Namespace
from collections.abc import Callable, Sequence
from pathlib import Path

from auv_lse_common.mission_file.parameters import nest
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.atomic_files import write_whole
from auv_lse_record.recording import RecordingError
from auv_lse_record.software import version
from auv_lse_shore.mission_options import settings_given
from auv_lse_shore.replay.inputs import RecordedInputs, read_inputs
from auv_lse_shore.replay.recompute_decisions import AFTER_CUT, CUT, DecisionStep, recompute_decisions
from auv_lse_shore.replay.recompute_map import MapStep, recompute_map
from auv_lse_shore.report.progress import show_step

#: Rows of a table that are shown without --all.
SHOWN = 20

Row = MapStep | DecisionStep


def recompute(options: Namespace) -> int:
    """Recomputes maps or decisions, as options ask, and prints the differences. Returns 0 if there are none, else 1.

    Raises:
        RecordingError: if the recording cannot be read, or holds nothing to compare.
        ParameterError: if its mission file, or a --set, does not fit this version of the software.
    """
    inputs = read_inputs(options.run, options.mission)
    overrides = settings_given(options.set)
    flown = Settings.from_patterns(inputs.parameters, str(options.run))
    settings = flown.with_overrides(overrides) if overrides else flown
    print(f"recorded by {inputs.software or 'unknown software'}, recomputed by {version()}")
    for note in inputs.notes:
        print(note)
    for name in overrides:
        print(f"changed: {name}: {_values(flown, name)} -> {_values(settings, name)}")
    if not inputs.lockstep:
        within_s = 0.1 * (flown.sim.real_time_factor or 1.0)
        print(
            f"not flown in lockstep: input times are known to about {within_s:g} s, which can cause small differences"
        )
    found: list[Row] = []
    for part in options.recompute:
        rows = _computed(part, inputs, (flown, settings), options.tolerance)
        if not rows:
            wanted = "maps (topic /auvN/field)" if part == "gp" else "decisions (topic /auvN/plan)"
            raise RecordingError(f"{options.run}: --recompute {part}: the recording holds no {wanted}")
        differing = [row for row in rows if row.differs]
        what = "maps" if part == "gp" else "decisions"
        values = bool(differing) and all(isinstance(row, DecisionStep) and row.only_value_differs for row in differing)
        print(f"{part}: {len(rows)} {what} compared, {len(differing)} differ{', only in value' if values else ''}")
        if any(isinstance(row, DecisionStep) and not row.comparable for row in rows):
            print("the values measure different rewards, or horizons, and are not compared")
        if cut := sum(isinstance(row, DecisionStep) and row.note in (CUT, AFTER_CUT) for row in differing):
            print(
                f"{cut} of them cannot be repeated: a deadline ended the search, or an earlier one, after which other "
                "random numbers are drawn. Compare their values, or fly the mission in lockstep (sim.lockstep)"
            )
        chosen = rows if options.all else differing
        for line in table(rows[0].TITLES, [row.cells for row in (chosen if options.all else chosen[:SHOWN])]):
            print(line)
        if not options.all and len(differing) > SHOWN:
            print(f"... {len(differing) - SHOWN} more; --all or --csv FILE lists them")
        found += rows
    if options.csv is not None:
        _write(options.csv, found)
        print(f"written: {options.csv}")
    return int(any(row.differs for row in found))


def _computed(part: str, inputs: RecordedInputs, flown_now: tuple[Settings, Settings], tolerance: float) -> list[Row]:
    settings = flown_now[1]
    rows: list[Row] = []
    with_planner = [v for v in inputs.vehicles if v <= settings.mission.vehicles]
    for i, number in enumerate(with_planner):
        vehicle, show = inputs.vehicles[number], _progress(f"{part}, auv{number}", i, len(with_planner))
        if part == "gp":
            own = settings.planner_settings(number)
            rows += recompute_map(vehicle, own, settings.positions_in_force(number), inputs.lockstep, tolerance, show)
        else:
            comparable = len({_measure(each, number) for each in flown_now}) == 1
            rows += recompute_decisions(vehicle, settings, inputs.lockstep, tolerance, show, comparable)
    show_step("")
    return rows


def _measure(settings: Settings, vehicle: int) -> tuple[str, str]:
    """What the values of a vehicle's decisions measure: the reward of its family of methods, and up to where."""
    planner = settings.vehicle(vehicle).planner.complete()
    to_the_end = planner.family.to_the_end or planner.augmented
    return planner.family_name, "the end" if to_the_end else str(planner.horizon)


def _progress(what: str, before: int, of: int) -> Callable[[float], None]:
    """Shows the share done in one line of a terminal; elsewhere nothing (a mission takes less than a minute)."""
    shown = -1

    def show(share: float) -> None:
        nonlocal shown
        percent = int(100.0 * (before + share) / of)
        if percent != shown:
            shown = percent
            show_step(f"{what}: {percent} %")

    return show


def table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of aligned columns under their titles, without empty columns; no lines without rows."""
    kept = [i for i in range(len(titles)) if any(row[i] for row in rows)]
    lines = [[line[i] for i in kept] for line in ([titles, *rows] if rows else [])]
    widths = [max(len(line[i]) for line in lines) for i in range(len(kept))] if lines else []
    return ["  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip() for line in lines]


def _write(path: Path, rows: Sequence[Row]) -> None:
    """Writes every row as CSV, each kind under its titles."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    titles: tuple[str, ...] = ()
    for row in rows:
        if titles != row.TITLES:
            titles = row.TITLES
            writer.writerow([*titles, "differs"])
        writer.writerow([*row.cells, row.differs])
    write_whole(path, text.getvalue())


def _values(settings: Settings, name: str) -> str:
    """The value of a parameter; one value per vehicle if they differ."""
    *sections, key = name.split(".")
    if sections and sections[0].startswith("auv"):
        sections = sections[1:]
    values = []
    for number in range(1, settings.mission.vehicles + 1):
        level = nest(settings.parameters(number))
        for section in sections:
            level = level.get(section, {})
        value = level.get(key)
        values.append("set by the method" if value is None else str(value))
    return values[0] if len(set(values)) == 1 else ", ".join(values)
