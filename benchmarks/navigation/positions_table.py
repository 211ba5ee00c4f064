"""The table of docs/design/positions.md: what corrected positions are worth, from the rows of
config/campaigns/positions.yaml.

    auv_lse campaign config/campaigns/positions.yaml
    python -m benchmarks.navigation.positions_table runs/campaigns/positions

Settings whose labels begin alike, up to the first comma, are compared seed by seed with the first of them.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pyarrow import parquet

from auv_lse_shore.campaign.statistics import interval
from benchmarks.command import end_with, parser_of

#: Columns: of a row, and heading.
COLUMNS = (
    ("isobath_error_m", "isobath error (m)"),
    ("isobath_error_true_positions_m", "at true positions (m)"),
    ("position_error_m", "position error (m)"),
    ("risk_after", "final risk"),
    ("loss_expected", "expected loss"),
    ("loss_after", "true loss"),
    ("error_over_std", "(error/std)^2"),
)

Row = dict[str, Any]
Arguments = Sequence[str] | None


def value(row: Row, name: str) -> float:
    """A figure of a row; of one for each vehicle the root mean square. NaN: not known, or not to the software then."""
    found = row.get(name)
    return math.nan if found is None else float(np.sqrt(np.mean(np.square(found))))


def rows_of(folders: Sequence[Path]) -> dict[str, dict[int, Row]]:
    """Rows of the finished missions in campaigns' folders, by setting, in the campaign's order, and seed."""
    groups: dict[str, dict[int, Row]] = {}
    for folder in folders:
        rows = [row for path in folder.glob("rows/*.parquet") for row in parquet.read_table(path).to_pylist()]
        # not as a CampaignSpec: its mission file is named as seen from where the campaign's file was
        listed = []
        if rows:
            listed = [setting["label"] for setting in yaml.safe_load((folder / "campaign.yaml").read_text())["list"]]
        for label in (*listed, *sorted({row["group"] for row in rows} - set(listed))):
            found = {row["seed"]: row for row in rows if row["group"] == label and row["status"] == "ok"}
            if found:
                groups.setdefault(label, {}).update(found)
    return groups


def table(groups: Mapping[str, Mapping[int, Row]]) -> list[str]:
    """The table's lines, in Markdown."""
    titles = " | ".join(title for _, title in COLUMNS)
    lines = [f"| setting | missions | {titles} | isobath, paired (m) | risk, paired (%) |"]
    lines.append("|---" * (len(COLUMNS) + 4) + "|")
    for label, own in groups.items():
        cells = [str(interval([value(r, name) for r in own.values()])) for name, _ in COLUMNS]
        base = next(name for name in groups if name.split(",")[0] == label.split(",")[0])
        both = sorted(set(own) & set(groups[base]))
        paired = risk = ""
        if base != label and both:
            pairs = [(own[s], groups[base][s]) for s in both]
            paired = str(interval([value(a, "isobath_error_m") - value(b, "isobath_error_m") for a, b in pairs]))
            risk = str(interval([100.0 * (value(a, "risk_after") / value(b, "risk_after") - 1.0) for a, b in pairs]))
        lines.append(f"| {label} | {len(own)} | " + " | ".join(cells) + f" | {paired} | {risk} |")
    return lines


def print_rows(
    module: str, about: str | None, lines: Callable[[Mapping[str, Mapping[int, Row]]], list[str]], given: Arguments
) -> int:
    """Command line of a table over campaigns' folders. Returns 0, or 2 if there are no rows."""
    parser = parser_of(module, about)
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER", help="the campaign, or parts of it")
    folders = parser.parse_args(given).folders
    groups = rows_of(folders)
    if not groups:
        print(f"error: {', '.join(map(str, folders))}: no rows; name the folder of a campaign", file=sys.stderr)
        return 2
    print("\n".join(lines(groups)))
    return 0


def main(arguments: Arguments = None) -> int:
    """Prints the table."""
    return print_rows("benchmarks.navigation.positions_table", __doc__, table, arguments)


if __name__ == "__main__":
    end_with(main)
