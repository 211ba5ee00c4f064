"""The reliability diagram of a campaign: how often it is so, against how probable the final maps call it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from auv_lse_shore.campaign.rows import Row
from auv_lse_shore.judge.reliability import EDGES, Reliability
from auv_lse_shore.report.figures import COLORS, STYLE, WIDTH_IN, new_figure

#: Settings that one diagram shows at most.
MOST = 8
#: Draws of the bootstrap over missions: places of one lake are alike, so that missions are drawn, not places.
DRAWS = 400


def reliability_of(rows: Sequence[Row]) -> list[Reliability]:
    """The reliability of each mission's final map, of those that have one."""
    return [
        Reliability(
            cells=tuple(row["reliability_cells"]),
            expected=tuple(row["reliability_expected"]),
            safe=tuple(row["reliability_safe"]),
        )
        for row in rows
        if row.get("reliability_cells")
    ]


def reliability_figure(groups: Mapping[str, Sequence[Row]]) -> Figure | None:
    """For each setting the share of places that are safe against P(safe), and how the places are spread over it.

    None where no mission has a known truth.
    """
    known = {name: found for name, rows in groups.items() if (found := reliability_of(rows))}
    if not known:
        return None
    with matplotlib.rc_context(STYLE):
        figure = new_figure(WIDTH_IN, 3.4)
        left, right = figure.subplots(1, 2)
        left.plot([0, 1], [0, 1], color="black", lw=0.8, ls=(0, (2, 2)))
        handles = []
        for color, parts in zip(COLORS, list(known.values())[:MOST], strict=False):
            pooled = Reliability.together(parts)
            low, high = _limits(parts)
            has = np.isfinite(pooled.shares)
            left.fill_between(pooled.probabilities[has], low[has], high[has], color=color, alpha=0.13, lw=0)
            (line,) = left.plot(pooled.probabilities[has], pooled.shares[has], "o-", ms=3.5, lw=1.3, color=color)
            right.stairs(np.array(pooled.cells) / max(sum(pooled.cells), 1.0), range(len(EDGES)), color=color, lw=1.3)
            handles.append(line)
        left.set_xlabel("P(safe) by the map")
        left.set_ylabel("share that is safe")
        left.set_aspect("equal")
        right.set_yscale("log")
        right.set_xticks(range(len(EDGES)), [f"{edge:g}" for edge in EDGES], fontsize=7.0, rotation=60)
        right.set_xlabel("class of P(safe)")
        right.set_ylabel("share of all places")
        for axis in (left, right):
            axis.grid(True, color="#e4e4e4", lw=0.5)
            axis.set_axisbelow(True)
        figure.legend(handles, list(known)[:MOST], loc="outside lower center", ncols=3, fontsize=7.0)
        return figure


def _limits(parts: Sequence[Reliability]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """95 % interval of the share safe in each class: missions drawn again and again with replacement."""
    rng = np.random.default_rng(0)
    cells, safe = (np.array([getattr(p, name) for p in parts]) for name in ("cells", "safe"))
    drawn = rng.integers(0, len(parts), (DRAWS, len(parts)))
    total = cells[drawn].sum(axis=1)
    shares = np.divide(safe[drawn].sum(axis=1), total, out=np.full(total.shape, np.nan), where=total > 0.0)
    pooled = Reliability.together(parts).shares
    some = np.isfinite(shares)
    limits = [
        [
            np.quantile(column[ok], q) if ok.any() else centre
            for column, ok, centre in zip(shares.T, some.T, pooled, strict=True)
        ]
        for q in (0.025, 0.975)
    ]
    return np.array(limits[0]), np.array(limits[1])
