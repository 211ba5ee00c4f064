"""Estimates the unknowns from all measurements: damped Gauss-Newton, fixes and ranges first, terrain last.

For errors above some ten metres the terrain likelihood has many local minima, so it is added last, near its minimum.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.linalg.lapack import dpotri

from auv_lse_common.support.arrays import Array, Mask
from auv_lse_gp.inference.triangular import solve_positive
from auv_lse_gp.positions.elimination import Elimination
from auv_lse_gp.positions.error_model import MANY_UNKNOWNS, TeamErrorModel
from auv_lse_gp.positions.measurements import Fixes, Ranges, within_gate
from auv_lse_gp.positions.terrain_matching import TerrainLikelihood

#: Maximum number of steps with fixes and ranges, and with the terrain, whose steps take thirty times as long.
STEPS, TERRAIN_STEPS = 15, 3
#: The search ends at a step below this many prior standard deviations in all unknowns, without and with the terrain.
_CONVERGED, _TERRAIN_CONVERGED = 1e-3, 1e-2
_HALVINGS = 4
#: Whitened residual at which the Huber loss changes from quadratic to linear (Huber 1964).
_HUBER_BEND = 1.5
#: A fix is rejected if it is more than this many standard deviations, and metres, from the position by all other
#: measurements, provided that these reduce the position's variance to this share of dead reckoning's.
FIX_GATE, MIN_FIX_GATE_M, MAX_VARIANCE_SHARE = 6.0, 10.0, 0.3


class Loss(Protocol):
    """Loss of the whitened residuals of ranges."""

    def costs(self, residuals: Array) -> float:
        """Total loss."""

    def weights(self, residuals: Array) -> Array:
        """Weight (m,) of each squared residual in a Gauss-Newton step."""


class Huber:
    """Quadratic for small residuals and linear for large ones."""

    def costs(self, residuals: Array) -> float:
        """As `Loss.costs`."""
        size = np.abs(residuals)
        return float(np.where(size <= _HUBER_BEND, 0.5 * size**2, _HUBER_BEND * size - 0.5 * _HUBER_BEND**2).sum())

    def weights(self, residuals: Array) -> Array:
        """As `Loss.weights`."""
        return np.asarray(_HUBER_BEND / np.maximum(np.abs(residuals), _HUBER_BEND))


class Gated:
    """Quadratic for the residuals that passed the gate, zero for the others."""

    def __init__(self, kept: Mask) -> None:
        self._kept = kept.astype(float)

    def costs(self, residuals: Array) -> float:
        """As `Loss.costs`."""
        return 0.5 * float(self._kept @ residuals**2)

    def weights(self, residuals: Array) -> Array:
        """As `Loss.weights`."""
        return self._kept


@dataclass(frozen=True, slots=True)
class Solution:
    """The estimated unknowns.

    Attributes:
        theta: The unknowns (u,).
        covariance: Their covariance (u, u).
        refused: Number of ranges and fixes that the gates rejected.
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
    """Estimates the unknowns.

    Args:
        terrain: Likelihood of the depths; None to ignore them.
        start: Initial unknowns (u,).
        terrain_steps: Maximum number of steps with the terrain.
    """
    precision = model.prior_std() ** -2.0
    search = _Search(precision, fixes, ranges, _elimination(model, fixes, ranges))
    theta = search.run(start, Huber(), STEPS)
    given = len(fixes)
    while (wrong := _find_contradicted(model, fixes, search, theta, len(ranges))) is not None:
        fixes = fixes.without(wrong)
        search = _Search(precision, fixes, ranges, _elimination(model, fixes, ranges))
        theta = search.run(np.zeros_like(theta), Huber(), STEPS)
    kept = within_gate(ranges.residuals(theta))
    loss = Gated(kept)
    theta = search.run(theta, loss, STEPS)
    information = search.normal(theta, loss)[1]
    if terrain is not None and len(terrain) > 1:
        theta, information = _with_terrain(search, terrain, theta, loss, information, terrain_steps)
    covariance = _inverse(information)
    return Solution(theta, 0.5 * (covariance + covariance.T), int((~kept).sum()) + given - len(fixes))


def _elimination(model: TeamErrorModel, fixes: Fixes, ranges: Ranges) -> Elimination | None:
    """The elimination of a large team's unknowns; None: all are solved for together."""
    return Elimination.of(model, fixes, ranges) if model.size > MANY_UNKNOWNS else None


def _inverse(information: Array) -> Array:
    """The covariance (u, u) of the unknowns; of many, with half the operations."""
    factor, lower = cho_factor(information, lower=True)
    if len(information) <= MANY_UNKNOWNS:
        return np.asarray(cho_solve((factor, lower), np.eye(len(information))))
    half = np.tril(dpotri(factor, lower=1)[0])
    return np.asarray(half + np.tril(half, -1).T)


def _find_contradicted(model: TeamErrorModel, fixes: Fixes, search: _Search, theta: Array, ranges: int) -> int | None:
    """Number of the fix farthest from the position by all other measurements; None if no fix is too far.

    P is the covariance of a fix's prediction from all measurements, in variances of the fix, and e its residual. The
    other measurements alone give the residual (I - P)^-1 e with covariance P (I - P)^-1. If their cost is higher than
    expected, the instruments are worse than assumed, and the gate is widened in proportion.
    """
    if not len(fixes):
        return None
    information, cost = search.normal(theta, Huber())[1], search.cost(theta, Huber())
    derivatives, off = fixes.derivatives(theta), fixes.residuals(theta).reshape(-1, 2)
    solved = cho_solve(cho_factor(information, lower=True), derivatives.T).T.reshape(-1, 2, model.size)
    rows, before = derivatives.reshape(-1, 2, model.size), model.prior_std() ** 2
    worst, found = 1.0, None
    for i, (row, e) in enumerate(zip(rows, off, strict=True)):
        p = row @ solved[i].T
        rest = np.linalg.solve(np.eye(2) - p, np.column_stack([p, e]))  # (I - P)^-1 P, and (I - P)^-1 e
        known = float(np.trace(rest[:, :2])) / max(float(np.einsum("du,u,du->", row, before, row)), 1e-12)
        away_m = float(np.linalg.norm(rest[:, 2])) * fixes.std_m(i)
        distance2 = float(e @ rest[:, 2])
        usual = max(1.0, (2.0 * cost - distance2) / max(2 * len(fixes) + ranges - 2, 1))
        excess = distance2 / (FIX_GATE**2 * usual)
        if known <= MAX_VARIANCE_SHARE and away_m > MIN_FIX_GATE_M and excess > worst:
            worst, found = excess, i
    return found


class _Search:
    """The fast part of the problem: prior, fixes and ranges; `elimination`: faster steps of a large team."""

    def __init__(self, precision: Array, fixes: Fixes, ranges: Ranges, elimination: Elimination | None = None) -> None:
        self.precision, self._fixes, self._ranges, self._elimination = precision, fixes, ranges, elimination
        self._scale = precision**-0.5
        self._last: tuple[Array, Loss, tuple[Array, Array]] | None = None

    def cost(self, theta: Array, loss: Loss) -> float:
        """Cost at `theta`: minus the log posterior, up to a constant."""
        fixed, ranged = self._fixes.residuals(theta), self._ranges.residuals(theta)
        return 0.5 * float(self.precision @ theta**2 + fixed @ fixed) + loss.costs(ranged)

    def normal(self, theta: Array, loss: Loss) -> tuple[Array, Array]:
        """Gradient (u,) of the log posterior, and the information (u, u); the last result is kept."""
        if self._last is None or self._last[1] is not loss or not np.array_equal(self._last[0], theta):
            self._last = theta.copy(), loss, self._linearize(theta, loss)
        return self._last[2]

    def _step(self, theta: Array, loss: Loss) -> Array:
        """A Gauss-Newton step (u,) from `theta`."""
        if self._elimination is not None:
            rows, gradient = self._weighted_rows(theta, loss)
            return self._elimination.step(rows, gradient)
        gradient, information = self.normal(theta, loss)
        return solve_positive(information, gradient)

    def _weighted_rows(self, theta: Array, loss: Loss) -> tuple[Array, Array]:
        """Whitened derivatives (m, u) of fixes and ranges, times the roots of their weights, and the gradient (u,)."""
        ranged = self._ranges.residuals(theta)
        root = np.sqrt(loss.weights(ranged))
        rows = np.concatenate([self._fixes.derivatives(theta), self._ranges.derivatives(theta) * root[:, None]])
        right = np.concatenate([self._fixes.residuals(theta), ranged * root])
        return rows, -self.precision * theta + rows.T @ right

    def _linearize(self, theta: Array, loss: Loss) -> tuple[Array, Array]:
        if len(theta) > MANY_UNKNOWNS:
            rows, gradient = self._weighted_rows(theta, loss)
            if self._elimination is not None:
                return gradient, self._elimination.information(rows)
            return gradient, rows.T @ rows + np.diag(self.precision)
        fixed, fixed_rows = self._fixes.residuals(theta), self._fixes.derivatives(theta)
        ranged, range_rows = self._ranges.residuals(theta), self._ranges.derivatives(theta)
        weighted = range_rows * loss.weights(ranged)[:, None]
        gradient = -self.precision * theta + fixed_rows.T @ fixed + weighted.T @ ranged
        information = fixed_rows.T @ fixed_rows + weighted.T @ range_rows
        information[np.diag_indices(len(theta))] += self.precision
        return gradient, information

    def converged(self, step: Array, share: float) -> bool:
        """Whether a step is below a share of each unknown's prior standard deviation."""
        return bool(np.all(np.abs(step) < share * self._scale))

    def run(self, start: Array, loss: Loss, steps: int) -> Array:
        """Minimizes the cost from `start`."""
        theta, cost = start, self.cost(start, loss)
        for _ in range(steps):
            step = self._step(theta, loss)
            for _ in range(_HALVINGS):
                moved = self.cost(theta + step, loss)
                if moved <= cost:
                    break
                step = 0.5 * step
            else:
                return theta
            theta, cost = theta + step, moved
            if self.converged(step, _CONVERGED):
                break
        return theta


def _with_terrain(
    search: _Search, terrain: TerrainLikelihood, theta: Array, loss: Loss, information: Array, steps: int
) -> tuple[Array, Array]:
    """Continues with the terrain; returns the unknowns and their information (without the terrain, if that fails)."""
    try:
        now = search.cost(theta, loss) + terrain.cost(theta)
        for _ in range(steps):
            slope, seen = terrain.gradient(theta, search.precision)
            gradient, known = search.normal(theta, loss)
            together = known + seen
            step = solve_positive(together, gradient + slope)
            information = together
            if search.converged(step, _TERRAIN_CONVERGED):
                break
            for _ in range(_HALVINGS):
                moved = search.cost(theta + step, loss) + terrain.cost(theta + step)
                if moved <= now:
                    break
                step = 0.5 * step
            else:
                break
            theta, now = theta + step, moved
    except (LinAlgError, ValueError):  # ValueError: numbers that are not finite
        pass
    return theta, information
