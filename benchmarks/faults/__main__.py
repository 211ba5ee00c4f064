"""auv_lse faults: breaks things on purpose and prints a table of what happened (docs/design/safety.md)."""

import argparse
import importlib
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from auv_lse_common.support.atomic_files import check_folder
from auv_lse_common.support.option_types import whole_from
from benchmarks.faults.report import Report, summary

# The kinds of faults, a module of this package each, with `arguments(parser)`, which adds its options, and
# `run(options, folder, say)`, which injects the faults, leaves its files in `folder` and returns a Report. A module may
# have `check(options)`, which raises ValueError for options that the parser cannot judge. One
# with `SMALL`, the arguments of a run of a few minutes, is part of `auv_lse faults all`.
KINDS = {
    "kills": "kills random nodes of two vehicles in one paced mission",
    "disk": "a full disk under real nodes, and kills while it is full",
    "media": "a disk that becomes read-only, is deleted or full, and kills and power failures then (needs root)",
    "reboot": "power loss at random moments, with cut and torn files",
    "day": "a working day of a team's nodes, faster than real time, with kills and power losses",
    "soak": "a long mission of a large team, with mates that transmit constantly",
    "watch": "random sequences of readings for the safety watch: every limit, dropouts, outliers",
    "water": "packets lost, doubled, late, damaged; a clock off",
    "flood": "10,000 datagrams a second on the port of the MAVLink link",
    "mixing": "nodes, a vehicle or a played recording in the ROS domain of a simulation",
    "files": "damaged area files, bathymetry and logs: each ends soon with a one-sentence error, in bounded memory",
    "sensors": "depth, pressure, altitudes and stamps that are wrong, frozen or missing",
    "field": "a field day over SSH: orders over a link that is cut, ten faults that must be named, and a fetch",
    "forgery": "an attacker with a modem and no key; clocks that are corrected",
}


ERRORS = (OSError, ValueError)  # raised by checks, before anything is broken


def _kind(name: str) -> ModuleType:
    return importlib.import_module(f"benchmarks.faults.{name}")


_EXIT_CODES = "Exit codes: 0 no fault; 1 something was lost or broke; 2 wrong command line; 130 Ctrl-C."


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse faults."""
    p = argparse.ArgumentParser(
        prog="auv_lse faults",
        description="Breaks things on purpose, and prints a table of what happened.",
        epilog=_EXIT_CODES,
    )
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument(
        "--seed", type=whole_from(0), default=1, help="seed of everything random (default: %(default)s)"
    )
    common.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="output folder, which must not exist (default: a temporary one, kept if something broke)",
    )
    kinds = p.add_subparsers(dest="kind", required=True, metavar="KIND")
    for name, text in KINDS.items():
        _kind(name).arguments(kinds.add_parser(name, parents=[common], help=text, epilog=_EXIT_CODES))
    every = f"{', '.join(_small())}: a few minutes each, one table; Ctrl-C prints what there is"
    kinds.add_parser("all", parents=[common], help=every, epilog=_EXIT_CODES)
    return p


def _small() -> dict[str, list[str]]:
    """The kinds that are part of `auv_lse faults all`, with the arguments that keep each of them short."""
    return {name: list(_kind(name).SMALL) for name in KINDS if hasattr(_kind(name), "SMALL")}


def run_all(seed: int, folder: Path, say: Callable[[str], None]) -> tuple[dict[str, Report], bool]:
    """Runs each kind of `_small` in a folder of its own; returns their reports, and whether Ctrl-C ended it.

    A kind that breaks, or that Ctrl-C interrupts, is a row of the table as well.
    """
    reports: dict[str, Report] = {}
    small = _small()
    for number, (name, arguments) in enumerate(small.items(), 1):
        say(f"{name} ({number} of {len(small)})")
        options = parser().parse_args([name, *arguments, "--seed", str(seed)])
        try:
            reports[name] = _kind(name).run(options, folder / name, say)
        except KeyboardInterrupt:
            reports[name] = Report([], tried=0, survived=0, lost=["interrupted"])
            return reports, True
        except Exception as error:  # whatever broke: the other kinds still run
            reports[name] = Report([], tried=1, survived=0, lost=[f"{type(error).__name__}: {error}"])
        say(f"{name}: {reports[name].survived} of {reports[name].tried} survived")
    return reports, False


def run(options: argparse.Namespace) -> int:
    """Runs one kind of fault. Returns 0, 1 or 130, as the help says."""
    if options.out is not None:
        check_folder(options.out)
        if options.out.exists():
            print(f"error: --out {options.out} exists already; choose a new folder", file=sys.stderr)
            return 2
    if check := getattr(_kind(options.kind), "check", None) if options.kind != "all" else None:
        check(options)
    began_s = time.monotonic()

    def say(text: str) -> None:
        print(f"  {time.monotonic() - began_s:6.0f} s  {text}", file=sys.stderr, flush=True)

    try:
        with _folder(options.out) as folder:
            reports, interrupted = _run(options, folder, say)
            if interrupted:
                return 130
            if not all(report.good for report in reports):
                raise _Broken("not all as it should be")
    except (OSError, RuntimeError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


def _run(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> tuple[list[Report], bool]:
    """Runs the requested kinds and prints the table; returns the reports, and whether Ctrl-C ended it."""
    if options.kind != "all":
        report: Report = _kind(options.kind).run(options, folder, say)
        print("\n".join([*report.lines, *(f"lost: {text}" for text in report.lost)]))
        return [report], False
    reports, interrupted = run_all(options.seed, folder, say)
    for name, report in reports.items():
        print("\n".join([f"## {name}", *report.lines, ""]))
    print("\n".join(summary(reports)))
    return list(reports.values()), interrupted


class _Broken(RuntimeError):
    """Something was lost, or broke."""


@contextmanager
def _folder(out: Path | None) -> Iterator[Path]:
    """The output folder: `out`, or a temporary one, which is kept and printed if something broke."""
    if out is not None:
        yield out.resolve()
        return
    temporary = Path(tempfile.mkdtemp(prefix="auv_lse_faults_"))
    keep = False
    try:
        yield temporary / "faults"
    except Exception:
        keep = (temporary / "faults").exists()
        if keep:
            print(f"logs, journals and recordings are kept in {temporary / 'faults'}", file=sys.stderr)
        raise
    finally:
        if not keep:
            shutil.rmtree(temporary, ignore_errors=True)
