"""scripts/bench: runs groups of measurements, prints a table, writes the same figures as JSON."""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

GROUPS = ("mission", "gp", "planner", "comms")


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else str(value)


def _table(group: str, rows: list[dict[str, Any]]) -> Table:
    table = Table(title=f"bench {group}", title_justify="left")
    for column in ("name", "value", "unit", "against", "ratio", "goal", "holds"):
        table.add_column(column, justify="right" if column in ("value", "ratio") else "left", overflow="fold")
    for row in rows:
        holds = {True: "yes", False: "NO", None: ""}[row.get("holds")]
        cells = [_number(row.get(key)) for key in ("name", "value", "unit", "against", "ratio", "goal")]
        table.add_row(*cells, holds)
    return table


def main(arguments: list[str] | None = None) -> int:
    """Runs the groups asked for. Returns 0, or 1 if a group could not be run; a goal missed is no failure."""
    parser = argparse.ArgumentParser(prog="scripts/bench", description=__doc__)
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=f"of {', '.join(GROUPS)}; default: all")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures here, as a JSON list")
    options = parser.parse_args(arguments)
    unknown = [group for group in options.groups if group not in GROUPS]
    if unknown:
        parser.error(f"no group {', '.join(unknown)}; there are {', '.join(GROUPS)}")
    if options.json and not options.json.resolve().parent.is_dir():
        parser.error(f"--json {options.json}: there is no folder {options.json.parent}")
    console = Console(width=None if sys.stdout.isatty() else 160)
    figures: list[dict[str, Any]] = []
    failed = False
    for group in options.groups or GROUPS:
        console.print(f"measuring {group} ...", style="dim")
        try:
            rows = importlib.import_module(f"benchmarks.{group}").run()
        except Exception as error:  # one group's failure must not lose the others' figures
            console.print(f"bench {group} failed: {error!r}", style="red")
            failed = True
            continue
        figures += rows
        console.print(_table(group, rows))
    if options.json:
        keys = ("name", "value", "unit", "against", "ratio", "goal", "holds")
        options.json.write_text(json.dumps([{key: row.get(key) for key in keys} for row in figures], indent=1) + "\n")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
