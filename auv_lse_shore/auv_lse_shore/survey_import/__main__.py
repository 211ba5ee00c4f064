"""scripts/import: the command line."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

from auv_lse_common.support.user_error import error_text
from auv_lse_record.run_data import RunData
from auv_lse_shore.survey_import.reading import read_logs
from auv_lse_shore.survey_import.run import check_free, survey_run, write_survey
from auv_lse_shore.survey_import.survey_log import LogError, Progress, SurveyLog
from auv_lse_shore.survey_import.track import PlacedLog, Placement, local_origin, position, vehicle_of

#: Seconds between two lines of progress.
_REWRITE_S, _LINE_S = 0.3, 5.0
#: A log's times are UTC from here on (s since 1970: 2000).
_UTC_FROM_S = 946_684_800.0


def parser() -> argparse.ArgumentParser:
    """The command line of scripts/import."""
    p = argparse.ArgumentParser(
        prog="scripts/import",
        description="Turns logs of an existing survey into a run folder that scripts/export, adjust, fit, replay and "
        "live read as they read a mission's: ArduPilot dataflash (.bin) and telemetry (.tlog), NMEA 0183 "
        "(GGA or RMC with DPT, DBT, DBS or DBK), and tables (CSV) of soundings, with time_s if known. Uncertainties "
        "in a table (north_std_m, east_std_m, tvu_m) are kept. Prints what it left out and why, and writes that to "
        "import.md.",
        epilog="All logs become one vehicle's soundings, one log after the other. The mission file in the run folder "
        "has an area around the survey and a prior learned from it. "
        "Exit codes: 0 success; 2 a log cannot be imported, or wrong command line; 130 Ctrl-C, nothing is written.",
    )
    p.add_argument("logs", type=Path, nargs="+", metavar="LOG", help="file of a log")
    p.add_argument("--out", type=Path, metavar="DIR", help="run folder to make (default: runs/NAME of the first LOG)")
    p.add_argument("--level", type=float, metavar="M", help="depth of the isobath (default: the median depth)")
    p.add_argument("--origin", type=float, nargs=2, metavar=("LAT", "LON"),
                   help="local origin in degrees (default: the first good position)")  # fmt: skip
    p.add_argument("--offset", type=float, nargs=2, default=(0.0, 0.0), metavar=("FORWARD", "STARBOARD"),
                   help="the transducer's position relative to the antenna in metres (0 0)")  # fmt: skip
    p.add_argument("--draught", type=float, default=0.0, metavar="M",
                   help="depth of the transducer below the surface, or below a submarine's barometer (0)")  # fmt: skip
    p.add_argument("--density", type=float, default=998.0, metavar="KG_M3",
                   help="of the water, for a submarine's depth (%(default)g; sea 1025)")  # fmt: skip
    p.add_argument("--position-std", type=float, default=1.5, metavar="M",
                   help="standard deviation of a position, each axis, if a table has none (%(default)g)")  # fmt: skip
    p.add_argument("--from", type=float, default=0.0, dest="start", metavar="S",
                   help="leave out what is earlier: seconds from a log's first position")  # fmt: skip
    p.add_argument("--to", type=float, default=float("inf"), dest="end", metavar="S", help="leave out what is later")
    p.add_argument("--dry-run", action="store_true", help="only print what would be imported")
    return p


def main(arguments: Sequence[str] | None = None) -> int:
    """Imports logs; returns the exit code."""
    command_line = parser()
    options = command_line.parse_args(arguments)
    if not options.start < options.end:
        command_line.error(f"--from, --to: got {options.start:g} to {options.end:g}; expected the first to be smaller")
    for name, low in (("density", 0.0), ("position_std", 0.0)):
        if not getattr(options, name) > low:
            command_line.error(f"--{name.replace('_', '-')}: got {getattr(options, name):g}; expected more than 0")
    if options.origin and not (abs(options.origin[0]) <= 90.0 and abs(options.origin[1]) <= 180.0):
        command_line.error(f"--origin: got {options.origin}; expected latitude, longitude in degrees")
    folder = options.out or Path("runs") / options.logs[0].stem
    try:
        if not options.dry_run:
            check_free(folder)
        for line in imported(options, folder):
            print(line, flush=True)
    except (ValueError, OSError, ImportError) as error:
        print(f"error: {error_text(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nstopped; nothing is written", file=sys.stderr)
        return 130
    return 0


def imported(options: argparse.Namespace, folder: Path) -> Iterator[str]:
    """Imports logs into `folder`; yields what was found, line by line.

    Raises:
        LogError, SoundingsError: if a log cannot be used.
        MissingPackageError: if a package that a format needs is missing.
        OSError: if a file cannot be read or written.
    """
    logs = [log for path in options.logs for log in read_logs(path, options.density, _progress(path))]
    origin = local_origin(logs)
    if options.origin:
        if origin is None:
            raise LogError("--origin: got one for logs in metres; expected none. Set it in the mission file")
        origin = (options.origin[0], options.origin[1])
    how = Placement(
        forward_m=options.offset[0],
        starboard_m=options.offset[1],
        draught_m=options.draught,
        position_std_m=options.position_std,
        start_s=options.start,
        end_s=options.end,
    )
    placed = [position(log, origin, how) for log in logs]
    summary = [line for log, found in zip(logs, placed, strict=True) for line in _described(log, found)]
    yield from summary
    depth_std_m = max(log.depth_std_m for log in logs)
    run = survey_run(vehicle_of(placed, options.position_std), origin, options.level, depth_std_m)
    lines = _run_lines(run)
    yield from lines
    if options.dry_run:
        yield "dry run: nothing is written"
        return
    write_survey(run, folder, [*summary, *lines])
    yield f"written: {folder} (import.md repeats this)"
    yield f"next: scripts/export {folder}; a prior: scripts/fit {folder} --out gp.yaml"


def _described(log: SurveyLog, found: PlacedLog) -> Iterator[str]:
    """What was found in a log, and what was left out."""
    yield f"{log.name}: {len(found.soundings)} soundings of {len(log.depths)} depths; {'; '.join(log.notes)}"
    first_s, last_s = float(found.track[0, 0]), float(found.track[-1, 0])
    if log.has_time:
        start = datetime.fromtimestamp(first_s, tz=UTC).strftime("%Y-%m-%d %H:%M:%S UTC, ")
        yield f"- {start if first_s > _UTC_FROM_S else ''}{(last_s - first_s) / 60.0:.1f} min"
    else:
        yield "- no times (column time_s): scripts/adjust cannot move these soundings"
    for reason, count in sorted(found.left_out.items()):
        if count:
            yield f"- left out: {count} {reason}"


def _run_lines(run: RunData) -> list[str]:
    soundings = run.vehicles[0].soundings
    gp, area, level = (run.parameters["/**"][name] for name in ("gp", "area", "level_set"))
    spans = [f"{np_range:.0f} m" for np_range in (soundings.points_m.max(axis=0) - soundings.points_m.min(axis=0))[:2]]
    origin = "" if run.origin is None else f"; origin {run.origin[0]:.6f}, {run.origin[1]:.6f} deg"
    return [
        f"{len(soundings)} soundings over {spans[0]} north-south, {spans[1]} east-west; "
        f"{soundings.depth_m.min():.1f} to {soundings.depth_m.max():.1f} m deep{origin}",
        f"prior: mean {gp['mean_depth_m']:.1f} m, standard deviation {gp['signal_std_m']:.1f} m, length scale "
        f"{gp['length_scale_m']:.0f} m, noise {gp['noise_std_m']:.2f} m",
        f"isobath {level['level_m']:g} m in an area of {len(area['polygon_m']) // 2} corners",
    ]


def _progress(path: Path) -> Progress:
    """Prints the share of a log that has been read, if it takes long."""
    shown_s, is_terminal = time.monotonic(), sys.stdout.isatty()

    def show(share: float) -> None:
        nonlocal shown_s
        if time.monotonic() - shown_s >= (_REWRITE_S if is_terminal else _LINE_S):
            shown_s = time.monotonic()
            print(f"reading {path}: {100.0 * share:.0f} %", end="\x1b[K\r" if is_terminal else "\n", flush=True)

    return show


if __name__ == "__main__":
    sys.exit(main())
