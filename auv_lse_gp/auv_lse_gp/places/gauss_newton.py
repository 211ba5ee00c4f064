"""The unknowns given all measurements: Gauss-Newton with damping, fixes and ranges first, terrain last.

Where errors are beyond some ten metres the terrain has many local minima, so it is asked last, near its own minimum.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from auv_lse_gp.places.error_model import TeamErrorModel
from auv_lse_gp.places.measurements import Fixes, Ranges, within_gate
from auv_lse_gp.places.terrain_matching import TerrainLikelihood

Array = NDArray[np.float64]

#: Steps of Gauss-Newton at most: with fixes and ranges, and with the terrain, whose steps cost thirty times as much.
STEPS, TERRAIN_STEPS = 15, 3
#: A step of less than this many prior standard deviations, in all unknowns, ends the search; so with the terrain.
_SETTLED, _TERRAIN_SETTLED = 1e-3, 1e-2
_HALVINGS = 4
#: Whitened residuals up to which the robust pass takes squares; beyond, it takes their size (Huber 1964).
_BEND = 1.5
#: A fix is refused that is farther than so many standard deviations, and metres, from where all else says that the
#: vehicle was, if all else knows that place at least so much better (variance) than dead reckoning alone.
FIX_GATE, LEAST_FIX_GATE_M, CROSS_CHECKED = 6.0, 10.0, 0.3


class Loss(Protocol):
    """What a whitened residual of a range costs."""

    def costs(self, residuals: Array) -> float:
        """Their costs together."""

    def weights(self, residuals: Array) -> Array:
        """Weight (m,) with which each square counts in a step of Gauss-Newton."""


class Huber:
    """Squares for small residuals, sizes for large ones: no outlier pulls more than one at the bend."""

    def costs(self, residuals: Array) -> float:
        """As `Loss.costs`."""
        size = np.abs(residuals)
        return float(np.where(size <= _BEND, 0.5 * size**2, _BEND * size - 0.5 * _BEND**2).sum())

    def weights(self, residuals: Array) -> Array:
        """As `Loss.weights`."""
        return np.asarray(_BEND / np.maximum(np.abs(residuals), _BEND))


class Gated:
    """Squares of those that passed the gate."""

    def __init__(self, kept: NDArray[np.bool_]) -> None:
        """Takes which residuals (m,) count."""
        self._kept = kept.astype(float)

    def costs(self, residuals: Array) -> float:
        """As `Loss.costs`."""
        return 0.5 * float(self._kept @ residuals**2)

    def weights(self, residuals: Array) -> Array:
        """As `Loss.weights`."""
        return self._kept


@dataclass(frozen=True, slots=True)
class Solution:
    """The unknowns given the measurements.

    Attributes:
        theta: The unknowns (u,).
        covariance: Their covariance (u, u).
        refused: How many ranges and fixes the gates refused.
    """

    theta: Array
    covariance: Array
    refused: int


def solve(
    model: TeamErrorModel,
    fixes: Fixes,
    ranges: Ranges,
    terrain: TerrainLikelihood | None,
    start: Array,
    terrain_steps: int = TERRAIN_STEPS,
) -> Solution:
    """Solves for the unknowns.

    Args:
        model: The unknowns and what is known of them before.
        fixes: The fixes.
        ranges: The ranges.
        terrain: Depths along the tracks, if they count.
        start: Where to begin (u,); the result does not depend on it as long as the search finds the same minimum.
        terrain_steps: Steps with the terrain at most.
    """
    precision = model.prior_std() ** -2.0
    search = _Search(precision, fixes, ranges)
    theta = search.run(start, Huber(), STEPS)
    given = len(fixes)
    while (
        wrong := find_contradicted(
            model, fixes, search.normal(theta, Huber())[1], theta, search.cost(theta, Huber()), len(ranges)
        )
    ) is not None:
        fixes = fixes.without(wrong)
        search = _Search(precision, fixes, ranges)
        theta = search.run(np.zeros_like(theta), Huber(), STEPS)
    kept = within_gate(ranges.residuals(theta))
    loss = Gated(kept)
    theta = search.run(theta, loss, STEPS)
    information = search.normal(theta, loss)[1]
    if terrain is not None and len(terrain) > 1:
        theta, information = _with_terrain(search, terrain, theta, loss, information, terrain_steps)
    covariance = cho_solve(cho_factor(information, lower=True), np.eye(model.size))
    return Solution(theta, 0.5 * (covariance + covariance.T), int((~kept).sum()) + given - len(fixes))


def find_contradicted(
    model: TeamErrorModel, fixes: Fixes, information: Array, theta: Array, cost: float, ranges: int
) -> int | None:
    """The fix that is farthest from where all other measurements place its vehicle; None if none is too far.

    With P the covariance of what a fix should have measured, given all measurements, in variances of the fix, and e
    what it is off, the others alone expect it (I - P)^-1 e away, with the covariance P (I - P)^-1. Where these others,
    too, cost more than they should, the instruments are worse than supposed, and it may be farther away by as much.

    Args:
        model: The unknowns.
        fixes: The fixes.
        information: Information about the unknowns with all measurements (u, u).
        theta: The unknowns given all of them.
        cost: What they cost.
        ranges: Number of ranges.
    """
    rows, off = fixes.derivatives(theta).reshape(-1, 2, model.size), fixes.residuals(theta).reshape(-1, 2)
    factor, before = cho_factor(information, lower=True), model.prior_std() ** 2
    worst, found = 1.0, None
    for i, (row, e) in enumerate(zip(rows, off, strict=True)):
        p = row @ cho_solve(factor, row.T)
        rest = np.linalg.solve(np.eye(2) - p, np.column_stack([p, e]))  # (I - P)^-1 P, and (I - P)^-1 e
        known = float(np.trace(rest[:, :2])) / max(float(np.einsum("du,u,du->", row, before, row)), 1e-12)
        away_m = float(np.linalg.norm(rest[:, 2])) * fixes.std_m(i)
        distance2 = float(e @ rest[:, 2])
        usual = max(1.0, (2.0 * cost - distance2) / max(2 * len(fixes) + ranges - 2, 1))
        excess = distance2 / (FIX_GATE**2 * usual)
        if known <= CROSS_CHECKED and away_m > LEAST_FIX_GATE_M and excess > worst:
            worst, found = excess, i
    return found


class _Search:
    """The part of the problem that is cheap: what is known before, fixes and ranges."""

    def __init__(self, precision: Array, fixes: Fixes, ranges: Ranges) -> None:
        self.precision, self._fixes, self._ranges = precision, fixes, ranges
        self._scale = precision**-0.5

    def cost(self, theta: Array, loss: Loss) -> float:
        """What the unknowns cost at `theta`."""
        fixed, ranged = self._fixes.residuals(theta), self._ranges.residuals(theta)
        return 0.5 * float(self.precision @ theta**2 + fixed @ fixed) + loss.costs(ranged)

    def normal(self, theta: Array, loss: Loss) -> tuple[Array, Array]:
        """Gradient (u,) of the log posterior, and the information (u, u)."""
        fixed, fixed_rows = self._fixes.residuals(theta), self._fixes.derivatives(theta)
        ranged, range_rows = self._ranges.residuals(theta), self._ranges.derivatives(theta)
        weighted = range_rows * loss.weights(ranged)[:, None]
        gradient = -self.precision * theta + fixed_rows.T @ fixed + weighted.T @ ranged
        information = fixed_rows.T @ fixed_rows + weighted.T @ range_rows
        information[np.diag_indices(len(theta))] += self.precision
        return gradient, information

    def settled(self, step: Array, share: float) -> bool:
        """Whether a step is less than a share of what was known before of each unknown."""
        return bool(np.all(np.abs(step) < share * self._scale))

    def run(self, start: Array, loss: Loss, steps: int) -> Array:
        """Descends from `start`."""
        theta, cost = start, self.cost(start, loss)
        for _ in range(steps):
            gradient, information = self.normal(theta, loss)
            step = cho_solve(cho_factor(information, lower=True), gradient)
            for _ in range(_HALVINGS):
                moved = self.cost(theta + step, loss)
                if moved <= cost:
                    break
                step = 0.5 * step
            else:
                return theta
            theta, cost = theta + step, moved
            if self.settled(step, _SETTLED):
                break
        return theta


def _with_terrain(
    search: _Search, terrain: TerrainLikelihood, theta: Array, loss: Loss, information: Array, steps: int
) -> tuple[Array, Array]:
    """Goes on with the terrain; returns the unknowns and their information with it (without it, if it fails)."""
    try:
        now = search.cost(theta, loss) + terrain.cost(theta)
        for _ in range(steps):
            slope, seen = terrain.gradient(theta, search.precision)
            gradient, known = search.normal(theta, loss)
            information = known + seen
            step = cho_solve(cho_factor(information, lower=True), gradient + slope)
            if search.settled(step, _TERRAIN_SETTLED):
                break
            for _ in range(_HALVINGS):
                moved = search.cost(theta + step, loss) + terrain.cost(theta + step)
                if moved <= now:
                    break
                step = 0.5 * step
            else:
                break
            theta, now = theta + step, moved
    except LinAlgError:
        pass
    return theta, information
