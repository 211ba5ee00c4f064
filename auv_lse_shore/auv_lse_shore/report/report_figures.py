"""The report's pictures in their order, each with a caption that says what to see."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from auv_lse_common.process.background import run_in_background
from auv_lse_shore.judge.evaluation import Evaluation
from auv_lse_shore.report.figures import depth_map, local_risk_error, navigation, risk_maps, save
from auv_lse_shore.report.found_figure import found
from auv_lse_shore.report.reward_figures import map_risk, paper_reward

#: The picture of the paper's own reward, which stands beside its explanation.
PAPERS = "reward.png"

#: Figures of the report: file name, caption, and the function that draws it (None: nothing to show).
FIGURES: tuple[tuple[str, str, Any], ...] = (
    (
        "map.png",
        "The map that the team brought home, seen from above, north up. Blue: surely deeper than the isobath; sand: "
        "surely shallower; white: unsure. The black line is the isobath where it was found: the vehicles (coloured "
        "lines, from circle to square) measured near enough to place it to within 20 m with 95 % certainty. Yellow: "
        "it is likely to run there. Dotted: a guess, hardly supported by any measurement. The dashes are the true "
        "isobath, which only a simulation knows: in a good mission they lie inside the black line everywhere.",
        found,
    ),
    (
        "risk_maps.png",
        "Bayes risk, the expected cost of calling a place safe (deep enough) or not: bright where that would be a "
        "gamble. (a) Before the mission, by the prior, (b) given the soundings of all vehicles, by the standard "
        "deviation that they show.",
        risk_maps,
    ),
    (
        "risk_over_steps.png",
        "The map's reward is the drop of its mean risk (blue). Dashed: what was expected of the mission's end by the "
        "plans that the vehicles had in hand, and nothing after them. Dotted: what mowing the lawn was "
        "expected to leave, the bound of the methods that keep one. A mission that ends below the dotted line did "
        "better than that.",
        map_risk,
    ),
    (
        "local_risk_error.png",
        "Risk of each vehicle's own map less the risk given all soundings: what lost, late and thinned samples cost "
        "each of them.",
        local_risk_error,
    ),
    ("depth_map.png", "Depth map from all soundings, its standard deviation and its error.", depth_map),
    (
        "navigation.png",
        "Horizontal error of the vehicles' position estimates, as each believed them at the time. It falls at once "
        "where a vehicle surfaces for a fix.",
        navigation,
    ),
    (
        PAPERS,
        "The paper's own reward, the drop of risk at the places of the vehicles' paths. (a) Stepwise, the paper's "
        "literal sum, with its lower bound: the sum plus the naive part of the augmented value. The two do not "
        "telescope, so the sum can end below it however good the mission was. (b) The whole path as one, its "
        "expectation at the mission's end by the plans in hand, and that of mowing the lawn.",
        paper_reward,
    ),
)


def draw_all(e: Evaluation, folder: Path) -> list[tuple[str, str]]:
    """Draws every figure into `folder`, half of them beside the others; file name and caption of each one drawn."""
    rest = run_in_background(partial(_draw, e, folder, 1))
    drawn = {*_draw(e, folder, 0), *rest()}
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
