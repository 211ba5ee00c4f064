"""The figures of the report in their order, with captions."""

import contextlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from auv_lse_run.process.background import run_in_background
from auv_lse_shore.judge.evaluation import Evaluation
from auv_lse_shore.report.figures import depth_map, local_risk_error, navigation, risk_maps, save
from auv_lse_shore.report.found_figure import found
from auv_lse_shore.report.reward_figures import map_risk, paper_reward

#: The picture of the paper's reward, which stands beside its explanation.
PAPER = "reward.png"

#: Figures of the report: file name, caption, and the function that draws it (it returns None for nothing to show).
FIGURES: tuple[tuple[str, str, Callable[[Evaluation], Figure | None]], ...] = (
    (
        "map.png",
        "The final map, north up. Blue is surely deeper than the isobath, sand is surely shallower, white is "
        "uncertain. Black line: isobath found, placed within 20 m with 95 % certainty. Yellow: likely isobath. "
        "Dotted: a guess with little data behind it. Labels: length of isobath that may be missing there. "
        "Dashed: true isobath, known in simulation only. Colored lines: the vehicles' tracks, from circle to square.",
        found,
    ),
    (
        "risk_maps.png",
        "Map risk: at each location the Bayes risk, the expected cost of calling it deep enough or not. Bright "
        "locations are uncertain. (a) Before the mission. (b) Given all soundings.",
        risk_maps,
    ),
    (
        "risk_over_steps.png",
        "Map risk over the mission. Solid: map risk so far. Dashed: map risk expected at the end if the vehicles carry "
        "out their current plans. Dotted: map risk expected of a lawnmower mission of the same length.",
        map_risk,
    ),
    (
        "local_risk_error.png",
        "Map risk of each vehicle's own map minus that of the team's: the cost of lost, late and thinned samples.",
        lambda e: local_risk_error(e) if len(e.local) > 1 else None,
    ),
    (
        "depth_map.png",
        "Depth map from all soundings, its standard deviation and, in simulation only, its error.",
        depth_map,
    ),
    (
        "navigation.png",
        "Horizontal error of the position that each vehicle estimated under way. It drops when a vehicle surfaces for "
        "a fix.",
        navigation,
    ),
    (
        PAPER,
        "The paper's reward, the drop of risk at the positions of the vehicles' paths. (a) Stepwise, the sum as the "
        "paper defines it, with its lower bound. The two do not telescope, so the sum can end below the bound. (b) The "
        "whole path, its value expected at the end of the current plans, and the value expected of a lawnmower.",
        paper_reward,
    ),
)


def draw_all(e: Evaluation, folder: Path) -> list[tuple[str, str]]:
    """Draws every figure into `folder`, half of them beside the others; file name and caption of each one drawn."""
    rest = run_in_background(partial(_draw, e, folder, 1))
    try:
        half = _draw(e, folder, 0)
    except BaseException:
        with contextlib.suppress(Exception):  # the first error is the one to report
            rest()
        raise
    drawn = {*half, *rest()}
    return [(name, caption) for name, caption, _ in FIGURES if name in drawn]


def _draw(e: Evaluation, folder: Path, first: int) -> list[str]:
    """Draws every second figure from number `first` on; file names of those drawn."""
    drawn = []
    for name, _, draw in FIGURES[first::2]:
        figure = draw(e)
        if figure is not None:
            save(figure, folder / name)
            drawn.append(name)
    return drawn
