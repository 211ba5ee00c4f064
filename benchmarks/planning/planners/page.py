"""The page of the benchmark: means, and differences paired ground by ground, with 95 % intervals."""

from collections.abc import Mapping, Sequence
from typing import Any

from auv_lse_common.support.plurals import counted
from auv_lse_gp.level_set.lines import FOUND_WITHIN_M
from auv_lse_shore.campaign.statistics import interval
from benchmarks.planning.planners.options import HINDSIGHT

#: Columns of the means: key, title, digits.
COLUMNS = (
    ("to_50", "to 50 %", 2),
    ("to_80", "to 80 %", 2),
    ("to_95", "to 95 %", 2),
    ("never_80", "never 80 %", 2),
    ("third", "found at 1/3", 2),
    ("two_thirds", "at 2/3", 2),
    ("end", "at the end", 2),
    ("fell", "fell by", 2),
    ("risk", "end risk", 3),
    ("true_loss", "true loss", 3),
    ("false_share", "false claims", 3),
    ("error_m", "error of found (m)", 1),
    ("misses", "misses 40 m", 2),
    ("missed_m", "longest missed (m)", 0),
    ("cpu_s", "processor time (s)", 0),
)
#: Columns that show the largest value of a planner's missions, not the mean.
LARGEST = ("fell", "missed_m")
#: A mission misses a piece of the isobath if a connected piece longer than this (m) is not found.
MISSED_M = 40.0
#: Columns of the paired differences.
PAIRED = (("end", "found at the end"), ("third", "at 1/3"), ("two_thirds", "at 2/3"))
#: Columns of the paired ratios.
RATIOS = (("to_80", "distance to 80 %"), ("risk", "end risk"), ("true_loss", "true loss"))

#: Description of each simulation.
SIMULATIONS = {
    "light": "Perfect navigation, 7 % of packets lost, one judge and one prior.",
    "whole": "The whole simulation: drift, corrected positions, surfacings and the acoustic channel. The judge has the "
    "map of the report.",
}

Row = Mapping[str, Any]


def rows_of(lines: Sequence[Row]) -> list[dict[str, Any]]:
    """The lines with the figures that follow from others."""
    rows = []
    for line in lines:
        found = line["found"]
        n = len(found)
        fell = max(before - after for i, before in enumerate(found) for after in found[i:])
        derived = {"fell": fell, "third": found[n // 3 - 1], "two_thirds": found[2 * n // 3 - 1], "end": found[-1]}
        if "missed_m" in line:
            derived["misses"] = float(line["missed_m"] > MISSED_M)
        rows.append({**line, **derived, "never_80": float(found[-1] < 0.8)})
    return rows


def page(lines: Sequence[Row], against: Sequence[str]) -> str:
    """The page in Markdown: for each size of team a table of means, and one of differences to each of `against`."""
    rows, text = rows_of(lines), ["# Planners, measured", "", *_preface(lines)]
    for vehicles in sorted({row["vehicles"] for row in rows}):
        team = [row for row in rows if row["vehicles"] == vehicles]
        text += ["", f"## {vehicles} vehicle{'s' * (vehicles > 1)}", "", *_means(team)]
        for other in against:
            text += _paired(team, other)
        text += _worst(team)
    return "\n".join(text) + "\n"


def _preface(lines: Sequence[Row]) -> list[str]:
    roles = sorted({line["role"] for line in lines})
    grounds = sorted({line["ground"] for line in lines})
    return [
        f"{counted(len(lines), 'mission')} over {counted(len(grounds), 'ground')} for {', '.join(roles)}: "
        f"{', '.join(grounds)}. "
        f"{SIMULATIONS[lines[0]['simulation']]} Each vehicle has {counted(lines[0]['legs'], 'leg')}. *Found*: share of "
        f"the true isobath within {FOUND_WITHIN_M:.0f} m of the line called found. *End risk*, *true loss*: cost per "
        "location. Distances are shares of the mission's legs; a "
        "mission that never gets there counts as 1. *False claims*: share of the line called found that is more "
        f"than 20 m off. *Misses {MISSED_M:.0f} m*: share of missions that miss a connected piece longer than this; "
        "*longest missed*: in the worst of them. *Fell by*: the most by which the share found fell during a mission; "
        "more data should not find less.",
    ]


def _means(rows: Sequence[Row]) -> list[str]:
    head = ["planner", "missions", *(title for _, title, _ in COLUMNS)]
    text = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    names = sorted({row["planner"] for row in rows}, key=lambda n: (n == HINDSIGHT, n))
    for name in names:
        mine = [row for row in rows if row["planner"] == name]
        cells = [name, str(len(mine))]
        for key, _, digits in COLUMNS:
            known = [row[key] for row in mine if row.get(key) is not None and row[key] == row[key]]
            value = max(known, default=0.0) if key in LARGEST else sum(known) / max(len(known), 1)
            cells.append(f"{value:.{digits}f}{_share(known, mine, 'missions')}" if known else "")
        text.append("| " + " | ".join(cells) + " |")
    return text


def _share(known: Sequence[Any], everything: Sequence[Any], what: str) -> str:
    """How many missions or pairs a figure is of, if some have no value."""
    return f" ({len(known)} of {len(everything)} {what})" if 0 < len(known) < len(everything) else ""


def _paired(rows: Sequence[Row], other: str) -> list[str]:
    theirs = {(row["ground"], row["seed"]): row for row in rows if row["planner"] == other}
    names = sorted({row["planner"] for row in rows} - {other, HINDSIGHT})
    if not theirs or not names:
        return []
    head = ["planner", "pairs", *(title for _, title in PAIRED), *(f"{title}, ratio" for _, title in RATIOS)]
    text = [
        "",
        f"Against `{other}`, mean with its 95 % interval over pairs (a ground and a seed each), taken as independent:",
        "",
        "| " + " | ".join(head) + " |",
    ]
    text.append("|" + "---|" * len(head))
    for name in names:
        pairs = [
            (row, theirs[row["ground"], row["seed"]])
            for row in rows
            if row["planner"] == name and (row["ground"], row["seed"]) in theirs
        ]
        if not pairs:
            continue
        cells = [name, str(len(pairs))]
        cells += [_interval([a[key] - b[key] for a, b in pairs], "+.2f") for key, _ in PAIRED]
        ratios = [[a[key] / b[key] for a, b in pairs if b.get(key, 0.0) > 0.0] for key, _ in RATIOS]
        cells += [_interval(values, ".2f") + _share(values, pairs, "pairs") for values in ratios]
        text.append("| " + " | ".join(cells) + " |")
    return text


def _interval(values: Sequence[float], form: str) -> str:
    if not values:
        return ""
    found = interval(values)
    if len(values) < 2:
        return f"{found.mean:{form}}"
    return f"{found.mean:{form}} ({found.low:{form}} to {found.high:{form}})"


def _worst(rows: Sequence[Row]) -> list[str]:
    """Share found at the end on each ground."""
    names = sorted({row["planner"] for row in rows}, key=lambda n: (n == HINDSIGHT, n))
    grounds = sorted({row["ground"] for row in rows})
    text = ["", "Share found at the end, ground by ground:", "", "| ground | " + " | ".join(names) + " |"]
    text.append("|---|" + "---|" * len(names))
    for ground in grounds:
        cells = []
        for name in names:
            ends = [row["end"] for row in rows if row["ground"] == ground and row["planner"] == name]
            cells.append(f"{sum(ends) / len(ends):.2f}" if ends else "")
        text.append(f"| {ground} | " + " | ".join(cells) + " |")
    return text
