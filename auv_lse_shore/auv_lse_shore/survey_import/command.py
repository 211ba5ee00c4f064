"""auv_lse import: the command line."""

import argparse
import math
import sys
import time
from collections.abc import Iterable, Iterator
from datetime import UTC, date, datetime
from pathlib import Path

from auv_lse_common.support.atomic_files import check_folder
from auv_lse_gp.tables.units import METRES
from auv_lse_shore.report.progress import can_rewrite
from auv_lse_shore.survey_import.choice import Choice
from auv_lse_shore.survey_import.clocks import ClockFacts, start_of
from auv_lse_shore.survey_import.formats import formats
from auv_lse_shore.survey_import.gather import UserFacts, gather
from auv_lse_shore.survey_import.log_file import ReadOptions
from auv_lse_shore.survey_import.run import check_free, dive_parameters, survey_run, survey_table, write_survey
from auv_lse_shore.survey_import.survey_log import LogError
from auv_lse_shore.survey_import.team import vehicles_of
from auv_lse_shore.survey_import.track import Placement
from auv_lse_shore.survey_import.words import SOUNDINGS, next_lines, survey_lines

#: Seconds between two lines of progress.
_REWRITE_S, _LINE_S = 0.3, 5.0
_BAR = 30

ERRORS = (ValueError, OSError)

#: Options that only some logs need, and what they are for.
NEEDED_BY = {
    "columns": "tables",
    "depth_unit": "tables",
    "surface": "tables with elevations",
    "crs": "tables with positions in metres",
    "day_first": "tables with times",
    "utc_offset": "logs with local times",
    "accept_checksums": "NMEA sentences",
}

INTERRUPTED = "stopped; nothing is written"


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse import."""
    files = "\n".join(f"  {(module.__doc__ or '').splitlines()[0]}" for module in formats())
    p = argparse.ArgumentParser(
        prog="auv_lse import",
        description="Turns logs of an existing survey into a run folder that auv_lse export, adjust, fit, replay and "
        "live read as they read a mission's. Prints what it left out and why, and what to type next.",
        epilog=f"Formats, recognized by content:\n{files}\n\n"
        "Times stay UTC. The same sounding in two files counts once. Logs that overlap in time come from different "
        "boats.\n\n"
        "Exit codes: 0 success; 2 a log cannot be imported, or wrong command line; 130 Ctrl-C, nothing is written.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("logs", type=Path, nargs="+", metavar="LOG", help="file, folder, or pattern such as 'logs/*.bin'")
    p.add_argument("--out", type=Path, metavar="DIR", help="run folder to make (default: runs/NAME of the first LOG)")
    p.add_argument("--level", type=float, metavar="M", help="depth of the isobath (default: the median depth)")
    p.add_argument("--origin", type=float, nargs=2, metavar=("LAT", "LON"),
                   help="local origin in degrees (default: the first good position)")  # fmt: skip
    p.add_argument("--dry-run", action="store_true", help="only print what would be imported, file by file")
    _add_boat(p.add_argument_group("the boat"))
    _add_log(p.add_argument_group("what the log does not show"))
    return p


def _add_boat(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--sounder", default="", metavar="NAME", help="use this sounder (default: the one with most pings)"
    )
    group.add_argument("--min-quality", type=float, default=40.0, metavar="PERCENT",
                       help="discard pings of lower quality, if the log rates them (default: %(default)g)")  # fmt: skip
    group.add_argument("--draught", type=float, metavar="M", help="depth of the transducer (of the keel, for depths "
                       "below it) below the surface, or below a submarine's barometer")  # fmt: skip
    group.add_argument("--offset", type=float, nargs=2, default=(0.0, 0.0), metavar=("FORWARD", "STARBOARD"),
                       help="the transducer's position relative to the antenna in metres (default: 0 0)")  # fmt: skip
    group.add_argument(
        "--lag", type=float, default=0.0, metavar="S", help="seconds from a measurement to its stamp (default: 0)"
    )
    group.add_argument("--lag-std", type=float, metavar="S", help="standard deviation of the lag (default: by format)")
    group.add_argument("--position-std", type=float, default=1.5, metavar="M",
                       help="standard deviation of a log's positions, per axis (default: its own, else "
                       "%(default)g)")  # fmt: skip
    group.add_argument("--density", type=float, default=998.0, metavar="KG_M3",
                       help="water density for a submarine's depth (default: %(default)g; sea: 1025)")  # fmt: skip
    group.add_argument("--from", type=float, default=0.0, dest="start", metavar="S",
                       help="discard earlier data: seconds from a log's first position")  # fmt: skip
    group.add_argument("--to", type=float, default=math.inf, dest="end", metavar="S", help="discard later data")


def _add_log(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--columns", default="", metavar="NAME,...", help="what a table's columns hold: lat, lon, "
                       "depth, time, date, quality, altitude (above the bottom: adds to the depth); with units, such "
                       "as depth_ft or time_ms; - skips one")  # fmt: skip
    group.add_argument("--depth-unit", choices=("m", "ft", "fathom"), help="unit of a table's depths")
    group.add_argument("--surface", type=float, default=math.nan, metavar="M",
                       help="elevation of the water surface, for a table of bed elevations")  # fmt: skip
    group.add_argument(
        "--crs", default="", metavar="CRS", help="coordinate system of a table's metres, such as EPSG:32632"
    )
    group.add_argument("--date", default="", metavar="DAY", help="the first log's first day, or its start: "
                       "2026-06-14 or 2026-06-14T10:00:00Z")  # fmt: skip
    group.add_argument("--utc-offset", type=float, metavar="H", help="hours by which a local clock is ahead of UTC")
    group.add_argument("--day-first", action=argparse.BooleanOptionalAction, help="whether 3/4/2026 is in April")
    group.add_argument("--accept-checksums", action="store_true", help="use NMEA sentences with a wrong checksum")


def run(options: argparse.Namespace) -> None:
    """Imports logs."""
    if not options.start < options.end:
        raise LogError(f"--from {options.start:g} is not earlier than --to {options.end:g}.")
    for name, low in (("density", 0.0), ("position_std", 0.0)):
        if not math.inf > getattr(options, name) > low:
            raise LogError(f"--{name.replace('_', '-')} is {getattr(options, name):g}; it must be more than 0.")
    if options.origin and not (abs(options.origin[0]) <= 90.0 and abs(options.origin[1]) <= 180.0):
        raise LogError(f"--origin is {options.origin}; write latitude and longitude in degrees.")
    folder = options.out or Path("runs") / (options.logs[0].stem.strip("*?") or "survey")
    if not options.dry_run:
        check_free(folder)
        check_folder(folder)
    for line in imported(options, folder):
        print(line, flush=True)


def imported(options: argparse.Namespace, folder: Path) -> Iterator[str]:
    """Imports logs into `folder`; yields what was found, line by line.

    Raises:
        LogError, FlightLogError: if a log cannot be used.
        MissingPackageError: if a package that a format needs is missing.
        OSError: if a file cannot be read or written.
    """
    facts, progress = user_facts(options), _Progress()
    found = gather(options.logs, facts, progress, progress.step)
    _refuse_unused(options, facts.read.used | facts.clock.used)
    yield from progress.lines(found.lines)
    progress.step("learning the prior")
    vehicles = vehicles_of(found.placed, options.position_std)
    draught_m = max(options.draught or 0.0, 0.0)
    run, area = survey_run(vehicles, found.origin, options.level, found.depth_std_m, draught_m)
    lines = survey_lines(run, area)
    yield from progress.lines(lines)
    if options.dry_run:
        yield "dry run: nothing is written"
        return
    progress.step(f"writing {folder}")
    table, note = survey_table(run)
    dive = dive_parameters(run, area, folder.resolve() / SOUNDINGS)
    after = next_lines(folder, dive["/**"], note)
    write_survey(run, area, table, dive, folder, [*found.lines, *lines, *after])
    yield from progress.lines(after)


def _refuse_unused(options: argparse.Namespace, used: set[str]) -> None:
    """Raises LogError for an option that no log needed: it would have no effect."""
    defaults = parser()
    for name, use in NEEDED_BY.items():
        value, default = getattr(options, name), defaults.get_default(name)
        if name not in used and value is not default and value != default:
            raise LogError(f"--{name.replace('_', '-')} is for {use}, and there are none. Leave it out.")


def user_facts(options: argparse.Namespace) -> UserFacts:
    """What the command line states about the logs.

    Raises:
        LogError: if `--date` is not a day.
    """
    return UserFacts(
        read=ReadOptions(
            accept_checksums=options.accept_checksums,
            columns=tuple(name.strip() for name in options.columns.split(",")) if options.columns else (),
            depth_unit_m=METRES[options.depth_unit] if options.depth_unit else 0.0,
            day_first=options.day_first,
            surface_m=options.surface,
            crs=options.crs,
            today=_today(),
        ),
        choice=Choice(
            sounder=options.sounder,
            least_quality=options.min_quality,
            draught_m=options.draught,
            density_kgpm3=options.density,
        ),
        clock=_clock_facts(options),
        placement=Placement(
            forward_m=options.offset[0],
            starboard_m=options.offset[1],
            position_std_m=options.position_std,
            lag_s=options.lag,
            start_s=options.start,
            end_s=options.end,
        ),
        origin=None if options.origin is None else (options.origin[0], options.origin[1]),
        lag_std_s=options.lag_std,
    )


def _clock_facts(options: argparse.Namespace) -> ClockFacts:
    try:
        start = start_of(options.date) if options.date else None
    except ValueError as error:
        raise LogError(f"--date {options.date} is not a date; write it like 2026-06-14.") from error
    return ClockFacts(start=start, ahead_h=options.utc_offset, today=_today())


def _today() -> date:
    return datetime.now(UTC).date()


class _Progress:
    """Shows, if it takes long, how much of a log has been read, and each step after that."""

    def __init__(self) -> None:
        self._out = sys.stdout  # readers of logs redirect it; None if it is closed: print() prints nothing then
        self._is_terminal = can_rewrite(self._out)
        self._start_s = self._shown_s = time.monotonic()

    def __call__(self, path: Path, share: float) -> None:
        """Draws a bar of the share of a log that has been read."""
        if time.monotonic() - self._shown_s >= (_REWRITE_S if self._is_terminal else _LINE_S):
            self._show(f"reading {path.name} [{'#' * round(_BAR * share):<{_BAR}}] {100.0 * share:.0f} %")

    def step(self, text: str) -> None:
        """Shows the step that begins."""
        if self._is_terminal or time.monotonic() - self._start_s >= _LINE_S:
            self._show(f"{text} ...")

    def lines(self, lines: Iterable[str]) -> Iterator[str]:
        """Yields lines; on a terminal, each over the text shown last."""
        for line in lines:
            print("\x1b[K" if self._is_terminal else "", end="", file=self._out)
            yield line

    def _show(self, text: str) -> None:
        self._shown_s = time.monotonic()
        print(text, end="\x1b[K\r" if self._is_terminal else "\n", flush=True, file=self._out)
