"""auv_lse export: the command line."""

import argparse
from pathlib import Path

from auv_lse_common.support.atomic_files import check_folder
from auv_lse_shore.export.export import export
from auv_lse_shore.export.formats import formats
from auv_lse_shore.export.options import add_survey_options, survey_of

ERRORS = (ValueError, OSError)
INTERRUPTED = "stopped; the folder has all files of this export, or is as it was"


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse export."""
    files = "\n".join((module.__doc__ or "").splitlines()[0] for module in formats())
    p = argparse.ArgumentParser(
        prog="auv_lse export",
        description="Exports a mission's results to files for other programs.",
        epilog=f"{files}\n\nThe origin in the mission file, or --origin, georeferences the files; without one, "
        "coordinates are local\nmetres. A second export into the same folder replaces the first.\n\n"
        "Exit codes: 0 success; 2 the run cannot be exported, or wrong command line; 130 Ctrl-C.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("run", type=Path, metavar="RUN", help="run folder, with mission.yaml and bag/")
    p.add_argument("--out", type=Path, metavar="DIR", help="output folder (default: RUN/export)")
    p.add_argument("--picture", action="store_true", help="also draw export.png from the written files")
    add_survey_options(p)
    return p


def run(options: argparse.Namespace) -> None:
    """Exports a run."""
    folder = options.out or options.run / "export"
    if options.out or options.run.is_dir():  # else the run's own error is clearer
        check_folder(folder)
    for line in export(options.run, folder, picture=options.picture, survey=survey_of(options)):
        print(line, flush=True)
