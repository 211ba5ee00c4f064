"""The paper's reward of a path: the expected benefit of search at its own locations (docs/design/paper.md).

    J(V) = sum over p in V of [ r(p | S) - E r(p | S u O u V) ],  S the data, O the mates' planned locations, V the
    path.

This is `credit="whole"`. With `credit="beyond"` the first term is E r(p | S u O), so that a vehicle is not rewarded for
locations that a team mate will visit. With M = cov(V, V | S u O) + sigma^2 I, the variance left at the path's locations
is sigma^2 - sigma^4 diag(M^-1), plus the variance due to uncertain positions of the data, which measuring does not
reduce.
"""

import math

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.compiled import compiled
from auv_lse_gp.inference.point_posteriors import PointPosteriors
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet

#: Compiled loops factorize paths with at most this many locations together; LAPACK factorizes longer ones one by one.
MAX_SMALL_PATH = 24


class PathReward:
    """Path reward of one decision, whose data and team mates' positions are fixed."""

    def __init__(self, posterior: Posterior, level_set: LevelSetConfig, credit: str = "whole") -> None:
        """Evaluates paths on a posterior that has the team mates' planned positions.

        Raises:
            ValueError: for an unknown credit.
        """
        if credit not in ("whole", "beyond"):
            raise ValueError(f"credit must be 'whole' or 'beyond', not {credit!r}")
        self.posterior = posterior
        self.level_set = LevelSet.of(level_set)
        self.credit = credit
        self._noise = posterior.noise_var_m2

    def before(self, points: PointPosteriors) -> Array:
        """Risk (P,) that the path may reduce: the current one, or with credit "beyond" that after the mates' plans."""
        if self.credit == "whole" or not self.posterior.planned_rows:
            return self.level_set.risk(points.mean_m, np.sqrt(points.data_var_m2))
        return self._expected(points, points.planned_var_m2)

    def _gains(self, points: PointPosteriors, var_after_m2: Array) -> Array:
        """Credited benefit at each location (P,) for variances `var_after_m2` (P,) after the path."""
        if self.credit == "whole" or not self.posterior.planned_rows:
            return self.before(points) - self._expected(points, var_after_m2)
        # before and after in one call
        data = points.data_var_m2
        after = np.minimum(np.stack([points.planned_var_m2, var_after_m2]), data)
        before, left = self.level_set.expected_risk(points.mean_m, np.sqrt(data - after), np.sqrt(after))
        return np.asarray(before - left)

    def _expected(self, points: PointPosteriors, var_after_m2: Array) -> Array:
        after = np.clip(var_after_m2, 0.0, points.data_var_m2)
        return self.level_set.expected_risk(points.mean_m, np.sqrt(points.data_var_m2 - after), np.sqrt(after))

    def contributions(self, points: PointPosteriors) -> Array:
        """Expected benefit (P,) at each location of a path with exactly these locations."""
        if not len(points):
            return np.empty(0)
        return self._gains(points, self.var_after_m2(points))

    def value(self, points: PointPosteriors) -> float:
        """J of the path with these locations."""
        return float(self.contributions(points).sum())

    def var_after_m2(self, points: PointPosteriors) -> Array:
        """Variance (P,) of the depth at the path's locations after all of them are measured."""
        matrix = self.posterior.measured_covariance(points)
        floor = self._floor(points, np.diagonal(matrix))
        return self._left(inverse_diagonal_of(matrix)) + floor

    def _left(self, inverse_diagonal: Array) -> Array:
        return np.maximum(self._noise - self._noise**2 * inverse_diagonal, 0.0)

    def _floor(self, points: PointPosteriors, measured_var_m2: Array) -> Array | float:
        """Part of each variance (P,) due to uncertain positions: the planned variance minus that of exact positions."""
        if not self.posterior.positions_uncertain:
            return 0.0
        return np.maximum(points.planned_var_m2 - (measured_var_m2 - self._noise), 0.0)

    def values_of_equal(self, points: PointPosteriors, length: int) -> Array:
        """J of several paths of equal length, computed together.

        Args:
            points: Locations of all paths, one path after the other, B * length in total.
            length: Number of locations of each path.

        Returns:
            Values, shape (B,).
        """
        batch = len(points) // length
        if length <= MAX_SMALL_PATH:
            matrices = self.posterior.measured_covariances(points, batch)
            floor = self._floor(points, np.einsum("bii->bi", matrices).ravel())
            diagonal = np.empty((batch, length))
            if not small_inverse_diagonals(matrices, diagonal):
                raise ValueError(not_positive_definite(length))
            after = self._left(diagonal.ravel()) + floor
        else:
            parts = [points.slice(i * length, (i + 1) * length) for i in range(batch)]
            after = np.concatenate([self.var_after_m2(part) for part in parts])
        return np.asarray(self._gains(points, after).reshape(batch, length).sum(axis=1))


def not_positive_definite(locations: int) -> str:
    """Error message for a covariance of `locations` measurements that is not positive definite."""
    return f"covariance of {locations} planned locations is not positive definite; use a larger gp.noise_std_m"


def inverse_diagonal_of(matrix: Array) -> Array:
    """Diagonal (P,) of the inverse of a symmetric positive definite matrix, whose lower triangle is overwritten.

    Raises:
        ValueError: if it is not positive definite.
    """
    factor, failed = dpotrf(matrix, lower=1, clean=1, overwrite_a=1)
    if failed:
        raise ValueError(not_positive_definite(len(matrix)))
    inverse, _ = dtrtri(factor, lower=1, overwrite_c=1)
    return np.asarray(np.einsum("ij,ij->j", inverse, inverse))


@compiled
def small_inverse_diagonals(matrices, diagonals):  # type: ignore[no-untyped-def]  # numba's types
    """Writes the diagonals (B, P) of the inverses of small matrices (B, P, P); overwrites their lower triangles.

    Returns whether all matrices are positive definite.
    """
    count = matrices.shape[1]
    for b in range(matrices.shape[0]):
        a = matrices[b]
        for j in range(count):  # a = L L^T
            pivot = a[j, j]
            for k in range(j):
                pivot -= a[j, k] * a[j, k]
            if not pivot > 0.0:
                return False
            root = math.sqrt(pivot)
            a[j, j] = root
            for i in range(j + 1, count):
                total = a[i, j]
                for k in range(j):
                    total -= a[i, k] * a[j, k]
                a[i, j] = total / root
        for j in range(count):  # column j of L^-1, kept in row j above the diagonal; its squares summed
            first = 1.0 / a[j, j]
            square = first * first
            for i in range(j + 1, count):
                total = a[i, j] * first
                for k in range(j + 1, i):
                    total += a[i, k] * a[j, k]
                entry = -total / a[i, i]
                a[j, i] = entry
                square += entry * entry
            diagonals[b, j] = square
    return True
