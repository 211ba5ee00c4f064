"""Public planners for level sets, one class each; parameters as their authors recommend.

Where they recommend two, or none and others chose, each choice has a name (`level_set_ucb_3`, `dec_mcts_wide`).
All choose locations; our steering flies to them, and soundings on the way count. None models travel costs except
`TruncatedVarianceReduction`, whose authors divide by a cost. Planners of paths are in `dec_mcts.py` and
`sgptools_rivals.py`.
"""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.special import ndtr, ndtri

from auv_lse_common.support.arrays import Array
from auv_lse_gp.inference.point_posteriors import PointPosteriors
from auv_lse_gp.level_set.bayes_risk import LevelSet
from benchmarks.planning.planners.dec_mcts import WIDE, DecMcts
from benchmarks.planning.planners.interface import Planner, View

#: Most cells at which a joint covariance is computed.
MAX_CELLS = 700
#: Number of outcomes of a measurement over which an expectation is taken.
OUTCOMES = 16


def _moments(view: View) -> tuple[Array, Array]:
    """Mean and standard deviation at the cells, with the mates' planned locations as measured."""
    planned = np.concatenate([np.empty((0, 2)), *view.mates_m])
    posterior = view.posterior.with_planned(planned) if len(planned) else view.posterior
    mean, variance = posterior.moments(view.cells_m)
    return mean, np.sqrt(variance)


def _joint(view: View) -> tuple[Array, PointPosteriors, Array]:
    """At most `MAX_CELLS` cells (C, 2), their posterior with the mates' plans, and their joint covariance (C, C)."""
    cells = view.cells_m[:: max(1, math.ceil(len(view.cells_m) / MAX_CELLS))]
    posterior = view.posterior.with_planned(np.concatenate([np.empty((0, 2)), *view.mates_m]))
    at = posterior.at(cells)
    covariance = posterior.covariance(at, at)
    np.fill_diagonal(covariance, np.maximum(np.diag(covariance), 1e-9))
    return cells, at, covariance


def _moves(view: View, covariance: Array) -> Array:
    """Standard deviation (C, C) by which a measurement at the first cell moves the mean at the second, signed (m)."""
    return covariance / np.sqrt(np.diag(covariance) + view.prior.noise_std_m**2)[:, None]


class Straddle:
    """Bryan et al. 2006, Active learning for identifying function threshold boundaries: 1.96 s - |m - l|."""

    replan_legs: int | None = None

    def __init__(self, width: float = 1.96) -> None:
        """Sets the factor on the standard deviation."""
        self._width = width

    def path(self, view: View) -> Array:
        """The location of the largest score."""
        mean, std = _moments(view)
        return view.cells_m[[int(np.argmax(self.width(view) * std - np.abs(mean - view.level_m)))]]

    def width(self, view: View) -> float:
        """Factor on the standard deviation."""
        return self._width


class RandomizedStraddle(Straddle):
    """Inatsu et al. 2024, Active learning for level set estimation using randomized straddle algorithms.

    The squared factor is drawn from a chi-squared distribution with two degrees of freedom at each choice.
    """

    def width(self, view: View) -> float:
        """A random factor."""
        return math.sqrt(float(view.rng.chisquare(2.0)))


class LevelSetUcb(Straddle):
    """Gotovos et al. 2013, Active learning for level set estimation: the most ambiguous location, with GP-UCB's factor.

    beta = 2 log(n pi^2 t^2 / 6 d), d = 0.1, for n cells at the t-th choice, as their theorem demands. Their experiments
    have the factor 3 (`level_set_ucb_3`).
    """

    def __init__(self) -> None:
        super().__init__()
        self._choices = 0

    def width(self, view: View) -> float:
        """The factor of the next choice."""
        self._choices += 1
        return math.sqrt(2.0 * math.log(len(view.cells_m) * (math.pi * self._choices) ** 2 / (6.0 * 0.1)))


class TruncatedVarianceReduction:
    """Bogunovic et al. 2016, Truncated variance reduction: beta^(1/2) = 3, r = 0.1, the cost is the distance."""

    replan_legs: int | None = None

    def __init__(self) -> None:
        self._eta_m = 0.0

    def path(self, view: View) -> Array:
        """The location whose sounding reduces the truncated variance of undecided cells most per metre."""
        self._eta_m = self._eta_m or view.prior.signal_std_m
        cells, at, covariance = _joint(view)
        variance = np.diag(covariance)
        undecided = np.abs(at.mean_m - view.level_m) <= 3.0 * np.sqrt(variance)
        if not undecided.any():
            undecided[:] = True
        while 3.0 * np.sqrt(variance[undecided].max()) <= 1.1 * self._eta_m and self._eta_m > 0.05:
            self._eta_m *= 0.5
        floor = (self._eta_m / 3.0) ** 2
        after = variance[undecided] - covariance[:, undecided] ** 2 / (variance + view.prior.noise_std_m**2)[:, None]
        gain = (np.maximum(variance[undecided], floor) - np.maximum(after, floor)).sum(axis=1)
        cost_m = np.hypot(*(cells - view.position_m).T) + view.leg_m
        return cells[[int(np.argmax(gain / cost_m))]]


class GlobalSur:
    """Letham et al. 2022, Look-ahead acquisition functions for Bernoulli level set estimation (AEPsych): global SUR.

    The location whose measurement is expected to reduce the sum of misclassification probabilities over the area most.
    The authors' outcomes are binary; with a depth the expectation over the outcome has a closed form. The query set
    is that of the candidates.
    """

    replan_legs: int | None = None

    def path(self, view: View) -> Array:
        """The location with the largest expected reduction."""
        cells, at, covariance = _joint(view)
        return cells[[int(np.argmax(self._scores(view, at, covariance)))]]

    def _scores(self, view: View, at: PointPosteriors, covariance: Array) -> Array:
        """Score (C,) of a measurement at each of the cells: minus the misclassified cells expected after it."""
        moves = _moves(view, covariance)
        known = at.data_var_m2 - at.planned_var_m2  # what the mates' soundings move
        left = np.maximum(at.planned_var_m2 - moves**2, 0.0)
        level = LevelSet(level_m=view.level_m, cost_false_safe=1.0, cost_false_unsafe=1.0)
        risk = level.expected_risk(at.mean_m, np.sqrt(known + moves**2), np.sqrt(left))
        return np.asarray(-risk.sum(axis=1))


class ExpectedAbsoluteVolumeChange(GlobalSur):
    """Letham et al. 2022, as above: the expected absolute volume change (EAVC).

    The location whose measurement is expected to change the expected size of the shallow ground most, up or down. The
    expectation is the mean over `OUTCOMES` equally probable depths.
    """

    def _scores(self, view: View, at: PointPosteriors, covariance: Array) -> Array:
        moves, gap = _moves(view, covariance), view.level_m - at.mean_m
        left = np.sqrt(np.maximum(at.planned_var_m2 - moves**2, 1e-9))
        now = ndtr(gap / np.sqrt(at.planned_var_m2)).sum()
        outcomes = ndtri((np.arange(OUTCOMES) + 0.5) / OUTCOMES)
        changes = [np.abs(ndtr((gap - moves * z) / left).sum(axis=1) - now) for z in outcomes]
        return np.asarray(np.mean(changes, axis=0))


#: Rivals by name.
RIVALS: dict[str, Callable[[], Planner]] = {
    "straddle": Straddle,
    "randomized_straddle": RandomizedStraddle,
    "level_set_ucb": LevelSetUcb,
    "level_set_ucb_3": partial(Straddle, 3.0),
    "truvar": TruncatedVarianceReduction,
    "global_sur": GlobalSur,
    "eavc": ExpectedAbsoluteVolumeChange,
    "dec_mcts": DecMcts,
    "dec_mcts_wide": partial(DecMcts, WIDE),
}
