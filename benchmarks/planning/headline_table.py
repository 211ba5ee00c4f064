"""The tables of docs/evidence/planner.md: methods compared lake by lake, from config/campaigns/headline.yaml's rows.

    auv_lse campaign config/campaigns/headline.yaml
    python -m benchmarks.planning.headline_table runs/campaigns/headline

Settings whose labels match up to the colon form one scene. Its first setting is compared with each of the others.
"""

import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pyarrow import parquet

from auv_lse_shore.campaign.statistics import Interval, interval
from benchmarks.command import end_with, parser_of

#: Columns of the means: of a row, heading, and decimal places.
COLUMNS = (
    ("risk_third", "risk at 1/3", 2),
    ("risk_after", "at the end", 3),
    ("loss_after", "true loss", 3),
    ("isobath_error_m", "isobath error (m)", 1),
    ("loss_expected", "expected loss", 3),
    ("isobath_found", "found", 2),
    ("isobath_found_error_m", "error of found (m)", 1),
    ("position_error_m", "position error (m)", 1),
    ("error_over_std", "(error/std)^2", 2),
)
#: Columns compared in pairs: in percent, and as a difference.
PAIRED = COLUMNS[:4]
FOUND = "isobath_found"

Row = dict[str, Any]
Groups = Mapping[str, Mapping[int, Row]]


def value(row: Row, name: str) -> float:
    """A figure of a row; the root mean square of a figure per vehicle. NaN: unknown, also to the row's software."""
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


def _mean(rows: Mapping[int, Row], name: str) -> float:
    return interval([value(row, name) for row in rows.values()]).mean


def means(groups: Groups) -> list[str]:
    """Means of all settings, and how many missions ended above what mowing was expected to leave, in Markdown."""
    titles = " | ".join(title for _, title, _ in COLUMNS)
    lines = [f"| setting | lakes | {titles} | above lawnmower's expected end |"]
    lines.append("|---" * (len(COLUMNS) + 3) + "|")
    for label, rows in groups.items():
        cells = [f"{_mean(rows, name):.{locations}f}" for name, _, locations in COLUMNS]
        above = sum(value(row, "risk_after") > value(row, "mowing_risk") for row in rows.values())
        lines.append(f"| {label} | {len(rows)} | " + " | ".join(cells) + f" | {above} of {len(rows)} |")
    return lines


def pairs(groups: Groups) -> list[str]:
    """The first setting of each scene against the others, lake by lake, in Markdown: percent; found: the difference.

    A single lake has no interval.
    """
    lines = ["| against | lakes | " + " | ".join(title for _, title, _ in PAIRED) + " | found |"]
    lines.append("|---" * (len(PAIRED) + 3) + "|")
    first: dict[str, str] = {}
    for label in groups:
        own = first.setdefault(label.split(":")[0], label)
        both = sorted(set(groups[own]) & set(groups[label]))
        if own == label or not both:
            continue
        cells = [_compared([_change(groups[own][s], groups[label][s], name) for s in both]) for name, _, _ in PAIRED]
        more = [value(groups[own][s], FOUND) - value(groups[label][s], FOUND) for s in both]
        found, lower = interval(more), f"lower on {sum(m < 0.0 for m in more)}"
        between = f" ({found.low:+z.2f}..{found.high:+z.2f}; {lower})" if len(more) > 1 else ""
        cells.append(f"{found.mean:+z.2f}{between}")
        lines.append(f"| {own} against {label.split(':')[-1].strip()} | {len(both)} | " + " | ".join(cells) + " |")
    return lines


def _change(row: Row, base: Row, name: str) -> float:
    """Change of a figure in percent; NaN where it is not known or was 0."""
    before = value(base, name)
    return 100.0 * (value(row, name) / before - 1.0) if before else math.nan


def _compared(changes: Sequence[float]) -> str:
    known = [c for c in changes if not math.isnan(c)]
    found: Interval = interval(known)
    if not known:
        return "–"
    if len(known) == 1:
        return f"{found.mean:+z.0f} %"
    lower = sum(c < 0.0 for c in known)
    return f"{found.mean:+z.0f} % ({found.low:+z.0f}..{found.high:+z.0f}; worst {max(known):+z.0f}; lower on {lower})"


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints both tables. Returns 0, or 2 if there are no rows."""
    parser = parser_of("benchmarks.planning.headline_table", __doc__)
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER", help="the campaign, or parts of it")
    folders = parser.parse_args(arguments).folders
    groups = rows_of(folders)
    if not groups:
        print(f"error: {', '.join(map(str, folders))}: no rows; name the folder of a campaign", file=sys.stderr)
        return 2
    print("\n".join([*means(groups), "", *pairs(groups)]))
    return 0


if __name__ == "__main__":
    end_with(main)
