"""The tables of docs/evidence/planner.md: methods compared lake by lake, from config/campaigns/headline.yaml's rows.

    auv_lse campaign config/campaigns/headline.yaml
    python -m benchmarks.planning.headline_table runs/campaigns/headline

Settings whose labels match up to the colon form one scene. Its first setting is compared with each of the others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from auv_lse_shore.campaign.statistics import Interval, interval
from benchmarks.command import end_with
from benchmarks.navigation.positions_table import Arguments, Row, print_rows, value

#: Columns of the means: of a row, heading, and decimal places.
COLUMNS = (
    ("risk_third", "risk at 1/3", 2),
    ("risk_after", "at the end", 3),
    ("loss_after", "true loss", 3),
    ("isobath_error_m", "isobath error (m)", 1),
    ("loss_expected", "expected loss", 3),
    ("isobath_found", "found", 2),
    ("isobath_found_error_m", "error of found (m)", 1),
    ("position_error_m", "location error (m)", 1),
    ("error_over_std", "(error/std)^2", 2),
)
#: What is compared in pairs: in percent, and as a difference.
PAIRED = COLUMNS[:4]
FOUND = "isobath_found"

Groups = Mapping[str, Mapping[int, Row]]


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
    """The first setting of each scene against the others, lake by lake, in Markdown: percent; found: the difference."""
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
        found = interval(more)
        cells.append(
            f"{found.mean:+z.2f} ({found.low:+z.2f}..{found.high:+z.2f}; lower on {sum(m < 0.0 for m in more)})"
        )
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
    lower = sum(c < 0.0 for c in known)
    return f"{found.mean:+z.0f} % ({found.low:+z.0f}..{found.high:+z.0f}; worst {max(known):+z.0f}; lower on {lower})"


def main(arguments: Arguments = None) -> int:
    """Prints both tables."""
    return print_rows("benchmarks.planning.headline_table", __doc__, lambda g: [*means(g), "", *pairs(g)], arguments)


if __name__ == "__main__":
    end_with(main)
