"""auv_lse bench: runs groups of measurements, prints a table, writes the same figures as JSON.

`auv_lse bench planners` flies any set of planners over any set of grounds instead, and writes one page.
"""

import argparse
import importlib
import json
import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from auv_lse_common.support.atomic_files import check_file, write_whole
from benchmarks.planning.planners.options import add_options
from benchmarks.rows import KEYS, Row

GROUPS = (
    "mission",
    "vehicle",
    "executor",
    "gp",
    "planner",
    "comms",
    "day",
    "altitude",
    "battery",
)
#: Flies planners over grounds and writes a page; not a group, because it takes hours.
PLANNERS = "planners"
#: Modules of groups that are not named after them.
MODULES = {
    "mission": "mission_pairs",
    "day": "planning.day",
    "altitude": "navigation.altitude",
    "battery": "planning.battery",
}


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else str(value)


def _table(group: str, rows: list[Row]) -> Table:
    table = Table(title=f"bench {group}", title_justify="left")
    for column in KEYS:
        table.add_column(column, justify="right" if column in ("value", "ratio") else "left", overflow="fold")
    for row in rows:
        holds = {True: "yes", False: "NO", None: ""}[row.get("holds")]
        cells = [_number(row.get(key)) for key in ("name", "value", "unit", "against", "ratio", "goal")]
        table.add_row(*cells, holds)
    return table


ERRORS = (OSError, ValueError)


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse bench."""
    p = argparse.ArgumentParser(
        prog="auv_lse bench",
        description=__doc__,
        epilog="Exit codes: 0, also if a goal is missed; 1 a group or a mission failed, or a part of the default "
        "mission takes more processor time than its baseline allows (group mission); 2 a wrong command line; 130 "
        "Ctrl-C.",
    )
    known = f"any of {', '.join(GROUPS)}; default: all; or {PLANNERS} alone"
    p.add_argument("groups", nargs="*", metavar="GROUP", help=known)
    p.add_argument("--json", type=Path, metavar="FILE", help="also write the figures here, as a JSON list")
    p.add_argument("--smoke", action="store_true", help="every row at its smallest size: shows that it runs")
    p.add_argument(
        "--new-baseline",
        metavar="REASON",
        default="",
        help="group mission: make this commit the baseline, in benchmarks/mission_baseline.json, with the reason",
    )
    p.add_argument("--lake", type=Path, metavar="FILE", help="a real lake for the group gp")
    add_options(p)
    return p


def _check_options(options: argparse.Namespace) -> None:
    """Raises ValueError for an option, other than at its default, of a group that does not run."""
    running = options.groups or GROUPS
    of_planners = argparse.ArgumentParser()
    add_options(of_planners)
    owners = {**dict.fromkeys(vars(of_planners.parse_args([])), PLANNERS), "lake": "gp", "new_baseline": "mission"}
    for name, value in vars(parser().parse_args([])).items():
        owner, option = owners.get(name, ""), f"--{name.replace('_', '-')}"
        if name == "groups" or getattr(options, name) == value:
            continue
        if owner and owner not in running:
            raise ValueError(f"{option} is an option of bench {owner}, which does not run. Leave it out")
        if not owner and PLANNERS in running:
            raise ValueError(f"{option} is not an option of bench {PLANNERS}. Leave it out")


def run(options: argparse.Namespace) -> int:
    """Runs the groups asked for. Returns 0, or 1 if one could not be run or the mission exceeds its baseline.

    Raises:
        ValueError: for an unknown group, an option of a group that does not run, or an unusable file of --lake.
        OSError: if that file cannot be read.
    """
    unknown = [group for group in options.groups if group not in (PLANNERS, *GROUPS)]
    if unknown:
        raise ValueError(f"there is no group {', '.join(unknown)}; choose from {', '.join((PLANNERS, *GROUPS))}")
    if options.groups == [PLANNERS]:
        _check_options(options)
        from benchmarks.planning.planners import command  # loads the planners

        return command.run(options)
    if PLANNERS in options.groups:
        raise ValueError(f"{PLANNERS} flies for hours, and runs alone: name no group beside it")
    _check_options(options)
    if options.json:
        check_file(options.json, "--json")
    if options.lake:
        from auv_lse_gp.soundings import read_soundings  # loads NumPy

        read_soundings(options.lake)
    console = Console(width=None if sys.stdout.isatty() else 160)
    figures: list[Row] = []
    failed = False
    for group in options.groups or GROUPS:
        console.print(f"measuring {group} ...", style="dim")
        try:
            own = {"gp": {"lake": options.lake}, "mission": {"new_baseline": options.new_baseline}}.get(group, {})
            module = importlib.import_module(f"benchmarks.{MODULES.get(group, group)}")
            rows = module.run(smoke=options.smoke, **own)
        except Exception as error:  # one group's failure must not lose the others' figures
            console.print(f"bench {group} failed: {error!r}", style="red")
            failed = True
            continue
        figures += rows
        console.print(_table(group, rows))
        for text in module.complaints(rows) if group == "mission" else ():
            console.print(f"bench {group}: {text}", style="red")
            failed = True
    if options.json:
        write_whole(options.json, json.dumps(figures, indent=1) + "\n")
    return int(failed)
