"""The map's reward of a path: the expected drop of Bayes risk, summed over fixed places that cover the area.

J(V) = sum over p in M of [ E r(p | S u O) - E r(p | S u O u V) ],  S the data, O the places that team mates' plans
still hold, V the path's places, M the map. As M stays the same, the drops of successive paths add up to the drop of
them together (J telescopes), so that a plan's value is a lower bound, in expectation, on what the mission brings if
the plan is only ever replaced by one worth more. A vehicle is credited with what it adds beyond O.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf

from auv_lse_gp.columns import Columns
from auv_lse_gp.kept import KeptColumns
from auv_lse_gp.risk import LevelSet
from auv_lse_planner.reward.path import not_positive_definite

Array = NDArray[np.float64]


class MapReward:
    """Map reward for one decision: the data and the team mates' places are fixed."""

    def __init__(self, kept: KeptColumns, level_set: LevelSet) -> None:
        """Takes the posterior as it stands, with the team mates' places planned.

        Args:
            kept: The map's places, kept up to date with the posterior.
            level_set: Level and costs.
        """
        self.posterior = kept.posterior
        self.level_set = level_set
        self.places = kept.columns()
        self.risk_in_hand = level_set.risk(self.places.mean_m, np.sqrt(self.places.data_var_m2))
        planned = self.posterior.planned_rows > 0
        self.risk_before = self.expected(self.places.planned_var_m2) if planned else self.risk_in_hand

    def expected(self, var_after_m2: Array) -> Array:
        """Expected risk at the map's places once their variances are `var_after_m2`, shape (..., M) both."""
        after = np.clip(var_after_m2, 0.0, self.places.data_var_m2)
        return self.level_set.expected_risk(
            self.places.mean_m, np.sqrt(self.places.data_var_m2 - after), np.sqrt(after)
        )

    def _reductions(self, columns: Columns) -> Array:
        """Whitened covariance (P, M) of the path's measurements with the map: row i is what place i adds to 0..i-1."""
        matrix = self.posterior.measured_covariance(columns)
        factor, failed = dpotrf(matrix, lower=1, clean=1)
        if failed:
            raise ValueError(not_positive_definite(len(matrix)))
        cross = self.posterior.covariance(columns, self.places)
        return np.asarray(solve_triangular(factor, cross, lower=True, check_finite=False, overwrite_b=True))

    def var_after_m2(self, columns: Columns) -> Array:
        """Variance (M,) at the map's places once the path's places are measured."""
        if not len(columns):
            return self.places.planned_var_m2
        rows = self._reductions(columns)
        return np.asarray(np.maximum(self.places.planned_var_m2 - np.einsum("pm,pm->m", rows, rows), 0.0))

    def value(self, columns: Columns) -> float:
        """J of the path with these places."""
        return float(np.sum(self.risk_before - self.expected(self.var_after_m2(columns))))

    def values_of_equal(self, columns: Columns, length: int) -> Array:
        """J of several paths of equal length, all at once.

        Args:
            columns: Places of all paths, one path after the other, B * length of them.
            length: Places of each.

        Returns:
            Values, shape (B,).
        """
        batch = len(columns) // length
        matrices = self.posterior.measured_covariances(columns, batch)
        try:
            factors = np.linalg.cholesky(matrices)
        except np.linalg.LinAlgError:
            raise ValueError(not_positive_definite(length)) from None
        cross = self.posterior.covariance(columns, self.places).reshape(batch, length, len(self.places))
        rows = np.linalg.solve(factors, np.eye(length)) @ cross  # L^-1 of a small L first: the map has many places
        after = np.maximum(self.places.planned_var_m2 - np.einsum("bpm,bpm->bm", rows, rows), 0.0)
        return np.asarray((self.risk_before - self.expected(after)).sum(axis=1))
