"""The reliability diagram of a campaign: share of locations that are safe against the P(deep enough) of the final
maps."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from auv_lse_common.support.arrays import Array
from auv_lse_shore.campaign.rows import Row
from auv_lse_shore.campaign.statistics import bootstrap
from auv_lse_shore.judge.quantity_names import P_DEEP
from auv_lse_shore.judge.reliability import EDGES, Reliability
from auv_lse_shore.report.figures import COLORS, WIDTH_IN, add_grid, legend_below, new_figure, styled

#: Number of settings that the figure shows.
MAX_SETTINGS = 8
#: Resamples of the bootstrap over missions. Locations of one lake are alike, so missions are resampled, not locations.
RESAMPLES = 400


def reliability_of(rows: Sequence[Row]) -> list[Reliability]:
    """The reliability of each mission's final map; missions without one are left out."""
    names = ("cells", "expected", "safe")
    return [
        Reliability(**{name: tuple(row[f"reliability_{name}"]) for name in names})
        for row in rows
        if row.get("reliability_cells")
    ]


def with_reliability(groups: Mapping[str, Sequence[Row]]) -> dict[str, Sequence[Row]]:
    """The settings of which a mission has a reliability."""
    return {name: rows for name, rows in groups.items() if any(row.get("reliability_cells") for row in rows)}


@styled
def reliability_figure(groups: Mapping[str, Sequence[Row]]) -> Figure | None:
    """For each setting the share of locations that are safe against P(deep enough), and how the locations spread over
    it.

    None where no mission has a known truth.
    """
    known = {name: reliability_of(rows) for name, rows in with_reliability(groups).items()}
    if not known:
        return None
    figure = new_figure(WIDTH_IN, 3.4)
    left, right = figure.subplots(1, 2)
    left.plot([0, 1], [0, 1], color="black", lw=0.8, ls=(0, (2, 2)))
    handles = []
    for color, (name, parts) in zip(COLORS, list(known.items())[:MAX_SETTINGS], strict=False):
        pooled = Reliability.together(parts)
        low, high = _limits(parts)
        has = np.isfinite(pooled.shares)
        left.fill_between(pooled.probabilities[has], low[has], high[has], color=color, alpha=0.13, lw=0)
        style = {"ms": 3.5, "lw": 1.3, "color": color, "label": name}
        (line,) = left.plot(pooled.probabilities[has], pooled.shares[has], "o-", **style)
        right.stairs(np.array(pooled.cells) / max(sum(pooled.cells), 1.0), range(len(EDGES)), color=color, lw=1.3)
        handles.append(line)
    left.set_xlabel(f"{P_DEEP} reported by the map")
    left.set_ylabel("share that is safe")
    left.set_aspect("equal")
    right.set_yscale("log")
    right.set_xticks(range(len(EDGES)), [f"{edge:g}" for edge in EDGES], fontsize=7.0, rotation=60)
    right.set_xlabel(f"class of {P_DEEP}")
    right.set_ylabel("share of all locations")
    for axis in (left, right):
        add_grid(axis)
    legend_below(figure, handles, 3, fontsize=7.0)
    return figure


def _limits(parts: Sequence[Reliability]) -> Array:
    """95 % bootstrap interval (2, classes) of the share safe in each class, over the missions with locations in it.

    Where fewer than two missions have any, both limits are the share itself.
    """
    limits = np.tile(Reliability.together(parts).shares, (2, 1))
    for index, (cells, safe) in enumerate(
        zip(np.array([p.cells for p in parts]).T, np.array([p.safe for p in parts]).T, strict=True)
    ):
        some = cells > 0.0
        if some.sum() > 1:
            samples = safe[some], cells[some]
            limits[:, index] = bootstrap(samples, lambda s, c, axis: s.sum(axis) / c.sum(axis), RESAMPLES)
    return limits
